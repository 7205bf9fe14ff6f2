"""Take for a live calibration, collected frame by frame until every movement was shown."""

from collections.abc import Mapping
from time import monotonic
from typing import NamedTuple

import numpy as np

from ..core.model.marker_layout import MARKERS, PAPER_PLACES, MarkerLayout
from .prompts import PROMPTS, shown_shares
from .takes import InvalidTake, MarkerTake

TAKE_RATE = 30.       # [Hz] of the frames that are kept, at most
EARLY = .1            # share of its period by which a frame may come early
MAX_DURATION = 120.   # [s] of a take
MOST_STEP = 1.        # [s] that counts of a pause between two frames
UNSEEN_FRAMES = 60    # last ones in which a marker has to be seen now and then
LEAST_SEEN_NOW = .2   # share of those
STOPPED_AFTER = 3.    # [s] without a marker after which none counts as coming any more
# Keys of /diagnostics: what to do next, or this where there is no calibration; share of a prompt.
CALIBRATION_KEY, NO_CALIBRATION = 'calibration', 'off'
SHARE_KEY = 'calibration {} [%]'


class Coverage(NamedTuple):
    """Progress of a take.

    Attributes
    ----------
    shares : ndarray, shape (12,)
        Of each of `PROMPTS`, from 0 to 1.
    unseen : tuple of str
        Markers hardly seen in the last seconds.
    """

    shares: np.ndarray
    unseen: tuple[str, ...] = ()

    @property
    def is_complete(self) -> bool:
        """Whether every movement was shown."""
        return bool((self.shares >= 1.).all())

    @property
    def text(self) -> str:
        """The next instruction for the person."""
        if self.is_complete:
            return 'everything was shown'
        prompt = PROMPTS[int(np.argmin(self.shares >= 1.))]
        hidden = f' (hardly seen: {", ".join(self.unseen)})' if self.unseen else ''
        return f'{prompt.text}{hidden}'

    def missing(self) -> list[str]:
        """Return the movements not yet shown in full."""
        return [prompt.text for prompt, share in zip(PROMPTS, self.shares) if share < 1.]

    def values(self) -> dict[str, str]:
        """Return the shares in per cent, as for /diagnostics."""
        return {SHARE_KEY.format(prompt.name): f'{int(100. * share)}'
                for prompt, share in zip(PROMPTS, self.shares)}


def progress_from_diagnostics(values: Mapping[str, str]) -> tuple[str, dict[str, float]] | None:
    """Return a calibration's progress by the values of /diagnostics.

    Parameters
    ----------
    values : mapping of str to str
        Of a status by key.

    Returns
    -------
    text : str
        What to do next, or how it ended.
    shares : dict of str to float
        Of each of `PROMPTS` by name, while a take is collected, from 0 to 1.

    None where there is no calibration.
    """
    text = values.get(CALIBRATION_KEY, NO_CALIBRATION)
    if text == NO_CALIBRATION:
        return None
    keys = {prompt.name: SHARE_KEY.format(prompt.name) for prompt in PROMPTS}
    return text, {name: .01 * float(values[key]) for name, key in keys.items() if key in values}


class LiveTake:
    """Collect a take from the markers as they come.

    Parameters
    ----------
    layout : MarkerLayout
        Joints of the digits' markers.
    side : {'right', 'left'}
    max_duration : float, optional
        Time to end after, complete or not [s].

    Attributes
    ----------
    seconds : float
        Duration so far, by the stamps [s].

    Raises
    ------
    InvalidTake
        If the palm's markers are at other places than wrist and knuckles.
    """

    def __init__(self, layout: MarkerLayout, side: str,
                 max_duration: float = MAX_DURATION) -> None:
        if layout.names != MARKERS:
            raise InvalidTake(f'the layout has {len(layout.names)} markers of its own; a live '
                              f'calibration expects the eight {", ".join(MARKERS)}')
        for marker, place, expected in zip(MARKERS, layout.places[:3], PAPER_PLACES):
            if place != expected:
                raise InvalidTake(f'the {marker} marker is at {place}; a calibration expects the '
                                  f'markers of the palm at {", ".join(PAPER_PLACES[:3])}')
        self._names, self._side, self._max_duration = layout.places, side, max_duration
        self.seconds = 0.
        self._frames: list[np.ndarray] = []
        self._shares = np.zeros(len(PROMPTS))
        self._last: float | None = None
        self._received: tuple[float, float] | None = None   # when the first and the last came [s]
        self._since_kept = 1. / TAKE_RATE

    def add(self, markers: np.ndarray, time: float | None,
            received: float | None = None) -> None:
        """Take a frame.

        Parameters
        ----------
        markers : ndarray, shape (8, 3)
            NaN where not seen [m].
        time : float or None
            Of the frame; one without a time is left out [s].
        received : float, optional
            When it came, by the clock of `time.monotonic`; now when left out [s].
        """
        if time is None:
            return
        received = monotonic() if received is None else received
        self._received = received if self._received is None else self._received[0], received
        # Time may jump back, as where a recording begins again.
        step = 0. if self._last is None else min(max(time - self._last, 0.), MOST_STEP)
        self._last = time
        self.seconds += step
        self._since_kept += step
        if self._since_kept >= (1. - EARLY) / TAKE_RATE:
            self._since_kept = 0.
            self._frames.append(markers.copy())

    def coverage(self) -> Coverage:
        """Return the share of each movement that the take shows, and the markers unseen now."""
        frames = self._frames.copy()  # another thread may add to them
        if not frames:
            return Coverage(self._shares)
        seen = np.isfinite(np.array(frames[-UNSEEN_FRAMES:])).all(axis=2).mean(axis=0)
        unseen = tuple(marker for marker, share in zip(MARKERS, seen) if share < LEAST_SEEN_NOW)
        # What was shown stays so, even where a longer reach is seen later.
        self._shares = np.maximum(self._shares, shown_shares(np.array(frames), self._side))
        return Coverage(self._shares, unseen)

    @property
    def is_over(self) -> bool:
        """Whether the take has its greatest duration."""
        return self.seconds >= self._max_duration

    def has_stopped(self, now: float) -> bool:
        """Return whether the time is over at `now` [s], as of `add`, and no marker comes.

        The stamps of markers that no longer come tell no time.
        """
        if self._received is None:
            return False
        first, last = self._received
        return now - first >= self._max_duration and now - last > STOPPED_AFTER

    def has_ended(self, coverage: Coverage, now: float | None = None) -> bool:
        """Return whether every movement was shown, or the time is over; `now` as of `add` [s]."""
        return coverage.is_complete or self.is_over or now is not None and self.has_stopped(now)

    def end_lines(self, coverage: Coverage) -> list[tuple[bool, str]]:
        """Return the lines to log when the take has ended, each with whether it is a warning.

        The last line says what is done next.
        """
        lines = [(False, f'fitting a hand to {self.seconds:.0f} s')]
        if missing := coverage.missing():
            why = f'{self.seconds:.0f} s are over' if self.is_over else 'no marker comes any more'
            lines.insert(0, (True, f'{why}; not shown: {"; ".join(missing)}'))
        return lines

    def take(self) -> MarkerTake:
        """Return the take of the markers seen at all."""
        points = np.array(self._frames).reshape(-1, len(MARKERS), 3)
        seen = np.isfinite(points).all(axis=2).any(axis=0)
        rate = len(points) / self.seconds if self.seconds else TAKE_RATE
        return MarkerTake(
            'live take', tuple(name for name, there in zip(self._names, seen) if there),
            points[:, seen], self._side, rate, np.zeros(len(points), dtype=int))
