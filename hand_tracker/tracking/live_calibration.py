"""Calibrate in a running tracker: collect a take, fit a hand in a child process. No ROS."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

from ..background import start_low_priority
from ..calibration.live_take import CALIBRATION_KEY, NO_CALIBRATION, LiveTake
from ..core.errors import HandTrackerError
from ..core.model.marker_layout import MarkerLayout
from ..output_files import YAML_SUFFIXES, require_writable


class CalibrationRefused(HandTrackerError):
    """A calibration that cannot begin."""


class LiveCalibration:
    """One calibration after another.

    Attributes
    ----------
    take : LiveTake or None
        Collector of frames; None while none are collected.
    """

    def __init__(self) -> None:
        self.take: LiveTake | None = None
        self._text = NO_CALIBRATION
        self._values: dict[str, str] = {}
        self._fit: Fit | None = None
        self._log_lines: list[tuple[bool, str]] = []
        self._limits, self._output = '', Path()

    def start(self, layout: MarkerLayout, side: str, limits: str, output: Path) -> None:
        """Begin to collect a take.

        Parameters
        ----------
        layout : MarkerLayout
            At which joints the digits wear their markers.
        side : {'right', 'left'}
        limits : str
            Preset of the joint limits.
        output : Path
            Hand file to write, with report and picture.

        Raises
        ------
        CalibrationRefused
            If another one is not done yet.
        OutputError
            If the file cannot be written.
        InvalidTake
            If the layout is no such that can be calibrated.
        """
        if self.is_running:
            raise CalibrationRefused(f'a calibration is not done yet: {self._text}')
        require_writable(output, YAML_SUFFIXES)
        self.take = LiveTake(layout, side)
        self._limits, self._output = limits, output
        self._text = ''
        self.update()

    @property
    def is_running(self) -> bool:
        """Whether a take is collected or fitted."""
        return self.take is not None or self._fit is not None

    def update(self, now: float | None = None) -> Path | None:
        """Update the progress, fit a take that is complete, report the fit; a few times a second.

        Parameters
        ----------
        now : float, optional
            On the clock of `LiveTake.add`'s receipts, to end where markers stop [s].

        Returns
        -------
        Path or None
            The hand file, once, when it has been written.
        """
        if self.take is not None:
            self._collect(self.take, now)
        elif self._fit is not None and (ended := self._fit.ended()) is not None:
            self._fit = None
            done, self._text = ended
            self._log_lines.append((not done, f'calibration: {self._text}'))
            return self._output if done else None
        return None

    def _collect(self, take: LiveTake, now: float | None) -> None:
        """Update the progress of the take; begin to fit when it is complete."""
        coverage = take.coverage()
        if not take.has_ended(coverage, now):
            if coverage.text != self._text:
                self._text = coverage.text
                self._log_lines.append((False, f'calibration: {self._text}'))
            self._values = coverage.values()
            return
        self.take, self._values = None, {}
        *warnings, (_, self._text) = take.end_lines(coverage)
        self._log_lines += [(True, f'calibration: {line}') for _, line in warnings]
        self._log_lines.append((False, f'calibration: {self._text}; tracking goes on'))
        try:
            self._fit = Fit(take, self._limits, self._output)
        except OSError as error:
            self._text = f'the fit could not be started: {error.strerror or error}'
            self._log_lines.append((True, f'calibration: {self._text}'))

    def values(self) -> dict[str, str]:
        """Return the values for /diagnostics: next prompt, and share of each movement shown."""
        return {CALIBRATION_KEY: self._text, **self._values}

    def pop_log_lines(self) -> list[tuple[bool, str]]:
        """Return the lines to log, each with whether it is a warning."""
        lines, self._log_lines = self._log_lines, []
        return lines

    def stop(self) -> None:
        """Cancel the calibration that runs."""
        if self._fit is not None:
            self._fit.stop()
        self.take = self._fit = None
        self._text, self._values = NO_CALIBRATION, {}


class Fit:
    """The command that fits a hand, in a child process at low priority.

    Parameters
    ----------
    take : LiveTake
    limits : str
    output : Path
    """

    def __init__(self, take: LiveTake, limits: str, output: Path) -> None:
        self._folder = TemporaryDirectory(prefix='hand_tracker-take-')
        folder = Path(self._folder.name)
        take.take().save(folder / 'live_take.npz')
        self._stdout, self._stderr = folder / 'stdout', folder / 'stderr'
        with open(self._stdout, 'wb') as stdout, open(self._stderr, 'wb') as stderr:
            self._child = start_low_priority(
                ['-m', 'hand_tracker', 'calibrate', folder / 'live_take.npz', '-o', output,
                 '--limits', limits], {'OPENBLAS_NUM_THREADS': '1'}, stdout, stderr)

    def ended(self) -> tuple[bool, str] | None:
        """Return whether it went well, and its last line, with the verdict; None while it works."""
        code = self._child.poll()
        if code is None:
            return None
        text = (self._stderr if code else self._stdout).read_text(
            encoding='utf-8', errors='replace')
        lines = [line for line in text.split('\n') if line.strip()] or [
            f'the fit ended with {code}']
        self._folder.cleanup()
        # What it prints begins with the verdict, if there is one.
        return code == 0, lines[-1] if code else '; '.join(dict.fromkeys((lines[-1], lines[0])))

    def stop(self) -> None:
        """Kill the fit and delete its files."""
        self._child.kill()
        self._child.wait()
        self._folder.cleanup()
