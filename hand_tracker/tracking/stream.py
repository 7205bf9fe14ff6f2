"""Track a stream of marker messages, live or recorded: read, time, update.

The one loop of the tracker node's slow path, of `hand_tracker track` and of the viewers; the
fast path does the same in one kernel (`nodes.fast_path.track_kernel`).
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np

from ..calibration.live_take import LiveTake
from ..core.model.hand import Hand
from ..core.model.marker_layout import MarkerLayout
from ..core.model.states import MarkerState
from ..core.numerics.jit import DEFERRED, LABELLING_IS_DEFERRED, LABELLING_SET, TRACKING_SET
from ..core.options import TrackerOptions
from ..core.point_labelling.cloud_labeller import load_kernels as load_labelling_kernels
from ..core.tracker import HandState, HandTracker
from ..messages.cdr import MalformedMessage, MessageSignature
from ..messages.marker_array import MarkerFrame
from ..messages.stamps import Time, seconds
from .auto_size import AutoSize
from .compilation import COMPILE_TIME, PROGRAM, Compilation
from .point_labels import PointLabelReader

UNNAMED_FRAME = 'world'  # of markers without a frame, as TF needs one
BLEND_TIME = .25         # [s] in which each digit finds its bend on another hand, at 15 rad/s


class Reader(Protocol):
    """Interface of readers of marker messages: `MarkerReader`, or of message objects."""

    @property
    def signature(self) -> MessageSignature | None:
        """The signature of the last message, None where it has none."""
        ...

    def read(self, message: Any) -> MarkerFrame:
        """Return the markers of a message."""
        ...

    def load_kernels(self, folder: Path | None = None) -> None:
        """Load the compiled kernels of `read` from disk."""
        ...

    def use_loaded_kernels(self) -> None:
        """Go on with the loaded kernels."""
        ...


def read_or_warn(reader: Reader, message: Any,
                 warn_once: Callable[[str, str], None]) -> MarkerFrame | None:
    """Return the markers of a message; None, with one warning, of a malformed message.

    Parameters
    ----------
    reader : Reader
    message : bytes or message
    warn_once : callable
        Logs a warning (key, text) once for each key.
    """
    try:
        return reader.read(message)
    except MalformedMessage as error:
        warn_once('malformed', f'left out is what is no message of markers: {error}')
        return None


class TrackedFrame(NamedTuple):
    """Tracked frame of a message of markers.

    Attributes
    ----------
    received : float
        Time of receipt, on a clock that never jumps [s].
    stamp : Time
        Of the markers, else of their receipt.
    frame_id : str
        Frame of the markers.
    time : float or None
        That the tracker was given [s].
    state : HandState
    markers : MarkerFrame
        As read.
    is_valid : bool
        Whether there is a pose to publish: the palm has been seen. Who monitors the stream
        clears it while the markers are of another hand.
    is_regular : bool
        Whether messages like this one need not be seen by `Stream.track`: it has a stamp and a
        signature, and nothing but its markers went into the frame.
    restarted : bool
        Whether time jumped back, so that tracking began anew.
    limits : ndarray, shape (25, 2)
        Of the hand that was tracked [rad].
    """

    received: float
    stamp: Time
    frame_id: str
    time: float | None
    state: HandState
    markers: MarkerFrame
    is_valid: bool
    is_regular: bool
    restarted: bool
    limits: np.ndarray


class FrameTime:
    """Time of frames for the tracker: of the stamp, or of receipt until the first stamp."""

    def __init__(self) -> None:
        self._is_stamped = False

    def of(self, stamp: Time, received: float | None) -> float | None:
        """Return the time of the next frame.

        Parameters
        ----------
        stamp : Time
            Of the message.
        received : float or None
            [s]

        Returns
        -------
        float or None
            None, unknown, where this frame alone has no stamp: its receipt may be of another
            clock than the other frames' stamps [s].
        """
        time = seconds(stamp)
        self._is_stamped = self._is_stamped or time is not None
        return time if self._is_stamped else received


class LearnedSize(NamedTuple):
    """Size of a hand that nobody measured.

    Attributes
    ----------
    hand : Hand
    is_confirmed : bool
        As of `AutoSize`.
    """

    hand: Hand
    is_confirmed: bool


class Stream:
    """Track messages one by one.

    Where kernels are still to be compiled, plain Python tracks, and the compiled kernels take
    over between two frames.

    Parameters
    ----------
    tracker : HandTracker
    reader : Reader
        May be replaced between two messages.
    auto_size : AutoSize, optional
        Learner of the hand's size; left out where the size is given.

    Attributes
    ----------
    tracker, reader
    compilation : Compilation or None
        None where the kernels were ready, or there is no numba.
    take : LiveTake or None
        Collector of each frame's markers for a calibration.
    """

    def __init__(self, tracker: HandTracker, reader: Reader,
                 auto_size: AutoSize | None = None) -> None:
        self.tracker, self.reader = tracker, reader
        self.take: LiveTake | None = None
        self._auto_size = auto_size
        self.compilation: Compilation | None = None
        self._is_sized = False
        self._labels_were_right = self._are_labels_doubted = self._forgets_size = False
        self._blends = False
        self._blended_since: float | None = None  # [s]
        self._time = FrameTime()
        self._labelling: Compilation | None = None  # of the kernels that label points
        self._switches_kernels = self._awaits_labelling = self._has_announced = False
        self._log_lines: list[tuple[bool, str]] = []
        self._reported: list[str] = []  # of the compilation

    def compile_in_background(self, program: str = PROGRAM,
                              **loaders: Callable[[Path], None]) -> None:
        """Compile missing kernels in a child process; take them over once they are compiled.

        Parameters
        ----------
        program : str
            Compiling module, see `Compilation`.
        **loaders
            Loaders of further sets of kernels, by the set's name.
        """
        labels_points = isinstance(self.reader, PointLabelReader)
        if DEFERRED:
            loaders = {TRACKING_SET: self._load_kernels, **loaders}
            self._switches_kernels = True
            self._has_announced = labels_points
            slowly = ('labels points and tracks, and most frames are left out'
                      if labels_points else 'tracks, more slowly')
            self._log_lines.append((False, 'first start: kernels are compiled in the background '
                                    f'for {COMPILE_TIME}; until then plain Python {slowly}'))
            if not labels_points:   # nobody waits for them yet
                loaders[LABELLING_SET] = load_labelling_kernels
        if loaders:
            self.compilation = Compilation(loaders, program)
        if LABELLING_SET in loaders:
            self._labelling = self.compilation
        if labels_points:
            self.compile_for_points()

    def compile_for_points(self, beside: Stream | None = None) -> None:
        """Compile the kernels that label points, where they are missing: the reader needs them.

        Parameters
        ----------
        beside : Stream, optional
            Another one of this process that does so already.
        """
        if not LABELLING_IS_DEFERRED or self._awaits_labelling:
            return
        if self._labelling is None:
            # In a process of its own, beside those of tracking.
            self._labelling = (Compilation({LABELLING_SET: load_labelling_kernels}, PROGRAM)
                               if beside is None else beside._labelling)
        elif LABELLING_SET in self._labelling.loaded:
            return
        self._awaits_labelling = True
        if beside is None and not self._has_announced:
            self._has_announced = True
            self._log_lines.append((False, 'the kernels that label points are compiled in the '
                                    f'background for {COMPILE_TIME}; until then plain Python '
                                    'labels them, and most frames are left out'))

    def share_compilation(self, other: Stream) -> None:
        """Take over the kernels that another stream of this process has compiled."""
        self.compilation, self._switches_kernels = other.compilation, other._switches_kernels
        self._labelling, self._reported = other._labelling, other._reported
        self._awaits_labelling = other._awaits_labelling

    def _load_kernels(self, folder: Path) -> None:
        self.tracker.load_kernels(folder)
        self.reader.load_kernels(folder)

    def track(self, message: Any, received: float, receipt_stamp: Callable[[], Time],
              distal_flexion: np.ndarray | None = None) -> TrackedFrame | MarkerFrame:
        """Read a message and track its markers.

        Parameters
        ----------
        message : bytes or MarkerArray
            For the reader, or a `MarkerFrame` by it.
        received : float
            Time of receipt, on a clock that never jumps [s].
        receipt_stamp : callable
            Returns the stamp for markers without one.
        distal_flexion : ndarray, shape (5,), optional
            See `HandTracker.update` [rad].

        Returns
        -------
        TrackedFrame, or MarkerFrame where the message has no marker of the hand

        Raises
        ------
        MalformedMessage
            If the bytes are no MarkerArray.
        """
        if self._switches_kernels:
            self._use_loaded_kernels()
        if self._forgets_size:
            self._forgets_size = False
            self.learn_size_anew()
        markers = message if isinstance(message, MarkerFrame) else self.reader.read(message)
        if markers.stamp is None:
            return markers
        stamped = seconds(markers.stamp)
        stamp = receipt_stamp() if stamped is None else markers.stamp
        time = self._time.of(markers.stamp, seconds(stamp) if stamped is None else stamped)
        tracker = self.tracker
        if self.take is not None:
            self.take.add(markers.positions, time)
        if self._blends:
            self._blend_in(time)
        state = tracker.update(markers.positions, time, distal_flexion)
        frame = TrackedFrame(
            received, stamp, markers.frame_id or UNNAMED_FRAME, time, state, markers,
            tracker.placed, stamped is not None and distal_flexion is None, tracker.restarted,
            tracker.hand.limits)
        if (self._auto_size is not None and self._auto_size.is_learning
                and not self._are_labels_doubted):
            # With exchanged labels that the tracker has put right.
            is_swapped = (state.marker_states == MarkerState.SWAPPED)[:, None]
            self._learn_size(np.where(is_swapped, state.markers, markers.positions), time)
        return frame

    @property
    def size(self) -> str:
        """Whether the hand's size was 'given', or is 'learning', 'learned' or 'not learned'."""
        if self._auto_size is None:
            return 'given'
        if self._auto_size.is_learning:
            return 'learning'
        return 'learned' if self._is_sized else 'not learned'

    @property
    def learned_size(self) -> str:
        """The size that was learned, in words; empty where none was."""
        if self.size != 'learned':
            return ''
        mcp = self.tracker.hand.finger_mcp
        return (f'{1e3 * np.linalg.norm(mcp[0] - mcp[3]):.0f} mm between the knuckles of index and '
                'little finger')

    @property
    def found_size(self) -> LearnedSize | None:
        """The size that was learned until now, None where none was."""
        if self._auto_size is None or not self._is_sized:
            return None
        return LearnedSize(self.tracker.hand, self._auto_size.is_confirmed)

    def begin_with(self, size: LearnedSize) -> None:
        """Begin with a size that was learned from these markers before; learn no other."""
        assert self._auto_size is not None
        self._auto_size.stop()
        self._labels_were_right = True
        self.tracker.configure(size.hand)
        if size.is_confirmed and isinstance(self.reader, PointLabelReader):
            self.reader.replace_hand(size.hand)
        self._is_sized = True
        self._log_learned_size()

    @property
    def awaits_labelling(self) -> bool:
        """Whether plain Python labels points for now, so that most frames are left out."""
        return self._awaits_labelling and isinstance(self.reader, PointLabelReader)

    @property
    def why_not_found(self) -> str:
        """Why no hand is found among points, as of `PointLabelReader`; empty elsewhere."""
        return self.reader.why_not_found if isinstance(self.reader, PointLabelReader) else ''

    def learn_size_anew(self) -> None:
        """Learn the hand's size from the frames to come, where it is learned at all."""
        if self._auto_size is None:
            return
        self._auto_size = self._auto_size.anew()
        if self._is_sized:
            self._take_size(self._auto_size.hand)
            self._is_sized = False

    def judge_labels(self, are_right: bool | None) -> None:
        """Learn no size by exchanged labels, as of `Monitor`; forget what they may have told.

        That is done with the next frame, which has to come to `track`.
        """
        is_news = are_right is False and not self._are_labels_doubted
        self._are_labels_doubted = are_right is False
        self._labels_were_right |= are_right is True
        self._forgets_size |= is_news and (not self._labels_were_right or self.size == 'learning')

    @property
    def needs_each_frame(self) -> bool:
        """Whether `track` must see every frame: to label, learn the size, collect or blend in."""
        is_learning = self.size == 'learning' and not self._are_labels_doubted
        return (isinstance(self.reader, PointLabelReader) or is_learning or self._forgets_size
                or self.take is not None or self._blends)

    def replace_hand(self, hand: Hand, layout: MarkerLayout,
                     options: TrackerOptions | None = None) -> None:
        """Track with another hand from the next message on; angles go over at the re-entry rate.

        Parameters
        ----------
        hand : Hand
            Of the same side.
        layout : MarkerLayout
        options : TrackerOptions, optional
            The present ones when left out.
        """
        self._auto_size = None
        self._change_hand(hand, layout, options)

    def _change_hand(self, hand: Hand, layout: MarkerLayout | None = None,
                     options: TrackerOptions | None = None) -> None:
        self.tracker.configure(hand, layout, options)
        self._blends, self._blended_since = True, None

    def _blend_in(self, time: float | None) -> None:
        """Blend the next frame in, until each digit has found its bend on another hand."""
        if self._blended_since is None:
            self._blended_since = time
        elif time is not None and not 0. <= time - self._blended_since < BLEND_TIME:
            self._blends = False
            return
        self.tracker.blend_in()

    def _learn_size(self, markers: np.ndarray, time: float | None) -> None:
        assert self._auto_size is not None
        reader = self.reader if isinstance(self.reader, PointLabelReader) else None
        sized = self._auto_size.add(markers, time, None if reader is None else reader.cloud)
        if sized is not None:
            sized = self._take_size(sized)
            if reader is not None and self._auto_size.is_confirmed:
                reader.replace_hand(sized)
            self._is_sized = True
        if self._auto_size.is_learning or not self.tracker.placed:
            return
        if not self._is_sized and self._auto_size.is_refused:
            self._log_lines.append((True, 'the size of the hand is not learned, as single frames '
                                    'contradict the labels of the points: it is that of the mean '
                                    'hand, unless a size or a hand file is given'))
        elif not self._is_sized:
            self._log_lines.append((False, "these markers do not tell the hand's size: it is that "
                                    'of the mean hand, unless a size or a hand file is given'))
        else:
            self._log_learned_size()

    def _log_learned_size(self) -> None:
        self._log_lines.append((False, f'the size of the hand is learned: {self.learned_size}'))

    def _take_size(self, sized: Hand) -> Hand:
        """Track with the bones of another hand; return it with the present limits and coupling."""
        now = self.tracker.hand
        if not (np.array_equal(sized.limits, now.limits)
                and np.array_equal(sized.coupling, now.coupling)):
            sized = sized.replace(limits=now.limits, coupling=now.coupling)
        self._change_hand(sized)
        return sized

    @property
    def is_compiled(self) -> bool:
        """Whether compiled kernels track."""
        return self.tracker.is_compiled

    def _use_loaded_kernels(self) -> None:
        assert self.compilation is not None
        if TRACKING_SET in self.compilation.loaded:
            self.tracker.use_loaded_kernels()
            self.reader.use_loaded_kernels()
            self._log_lines.append((False, 'compiled kernels have taken over'))
            self._switches_kernels = False

    def pop_log_lines(self) -> list[tuple[bool, str]]:
        """Return the lines to log of kernels and size: whether it is a warning, and the line."""
        lines, self._log_lines = self._log_lines, []
        reader = self.reader if isinstance(self.reader, PointLabelReader) else None
        if reader is not None:
            # Frames too few to find a hand in do not tell why none is found.
            lines += [line for line in reader.pop_log_lines()
                      if not (line[0] and self._awaits_labelling)]
        news: list[tuple[bool, str | None]] = []
        labelling = self._labelling
        if self._awaits_labelling and labelling is not None:
            is_loaded = LABELLING_SET in labelling.loaded
            self._awaits_labelling = not (is_loaded or labelling.error)
            if reader is not None and not self._awaits_labelling:
                reader.forget_search()
            if is_loaded:
                news.append((False, 'compiled kernels label points now'))
        for one in self.compilation, labelling:
            if one is None:
                continue
            error = one.error and ('the kernels could not be compiled, frames go on being tracked '
                                   f'more slowly: {one.error}')
            news += [(True, one.unkept), (True, error)]
        for is_warning, line in news:
            if line is not None and line not in self._reported:
                self._reported.append(line)
                lines.append((is_warning, line))
        return lines
