"""A message of markers to those of the hand in one kernel: the short way. No ROS.

Reading, tracking and filling by turns from Python costs several times what the tracking does,
most of it in bringing the interpreter back into the processor's caches. Messages come alike
though: what one of them was like, and what answers it, is taught to a `Passage` by the long
way (`codec`, `HandTracker.update`). What is like it goes through here, and gives the same.
"""

from typing import NamedTuple

import numpy as np

from ...core.model.hand import JOINTS
from ...core.model.marker_layout import MARKERS
from ...core.model.states import PALM_STATES, PalmState
from ...core.numerics.jit import jit, overwrite
from ...core.numerics.quaternion import write_transforms
from ...core.pipeline import track_frame
from ...messages.cdr import ENCAPSULATION, LITTLE_ENDIAN, SMALLEST_MARKER, gather, walk

MESSAGE_ROOM = 2**14  # [bytes] of a message of markers,
ANSWER_ROOM = 2**13   # and of an answer
STAMPS, NUMBERS = 32, 256  # in an answer
KEPT = 1024           # frames until they are looked at
ANGLES, TRANSFORMS, CONFIDENCE = range(3)  # the answers
ANSWERS = 3
RECEIVED, PUBLISHED, TIME, MISS, PALM = range(5)  # the columns of the log
LOGGED = 5


class Passage(NamedTuple):
    """What the short way knows, and where it works.

    Attributes
    ----------
    message : ndarray, shape (MESSAGE_ROOM // 8,)
        The message without its encapsulation, which so is aligned.
    heads, places, strings : ndarray
        Of `walk`.
    known_heads, known_strings : ndarray
        As those, of the messages that pass.
    known : ndarray of int, shape (2,)
        Their markers, and bytes of their strings.
    first, count : ndarray of int, shape (1,)
        Place of the marker that has the stamp; how many are the hand's.
    slots, markers, rows, scale, zero_is_missing
        Of `gather`.
    stamp : ndarray of int, shape (2,)
        Seconds and nanoseconds of the last frame.
    time : ndarray, shape (1,)
        The same as a number [s].
    wanted : ndarray of int, shape (3,)
        Which answers are.
    answers : ndarray, shape (3, ANSWER_ROOM // 8)
        Each after half a double, so that what follows its encapsulation is aligned.
    stamps_at, numbers_at : ndarray of int, shape (3, STAMPS) and (3, NUMBERS)
        Where they have them, by four bytes and by eight.
    stamps, numbers : ndarray of int, shape (3,)
        How many.
    transforms : ndarray, shape (26, 7)
        Of `write_transforms`.
    frames, looked_at : ndarray of int, shape (1,)
        How many came, and how many of them were looked at.
    log : ndarray, shape (KEPT, 5)
        When a frame was received and published, its time [s]; the mean residual [m]; its palm.
    states : ndarray of int, shape (KEPT, 8)
        Of its markers.
    """

    message: np.ndarray
    heads: np.ndarray
    places: np.ndarray
    strings: np.ndarray
    known_heads: np.ndarray
    known_strings: np.ndarray
    known: np.ndarray
    first: np.ndarray
    count: np.ndarray
    slots: np.ndarray
    markers: np.ndarray
    rows: np.ndarray
    scale: np.ndarray
    zero_is_missing: np.ndarray
    stamp: np.ndarray
    time: np.ndarray
    wanted: np.ndarray
    answers: np.ndarray
    stamps_at: np.ndarray
    numbers_at: np.ndarray
    stamps: np.ndarray
    numbers: np.ndarray
    transforms: np.ndarray
    frames: np.ndarray
    looked_at: np.ndarray
    log: np.ndarray
    states: np.ndarray


def new_passage():
    """Return a `Passage` that knows no message yet."""
    def integers(*shape):
        return np.zeros(shape, np.int64)

    most, count = MESSAGE_ROOM // SMALLEST_MARKER + 1, len(MARKERS)
    return Passage(
        message=np.zeros(MESSAGE_ROOM // 8), heads=np.zeros((most, 5), np.int32),
        places=integers(most, 3), strings=np.zeros(MESSAGE_ROOM, np.uint8),
        known_heads=np.zeros((most, 5), np.int32), known_strings=np.zeros(MESSAGE_ROOM, np.uint8),
        known=np.array((-1, 0)), first=integers(1), count=integers(1), slots=integers(count),
        markers=integers(count), rows=np.zeros((count, 3)), scale=np.ones(1),
        zero_is_missing=integers(1), stamp=integers(2), time=np.zeros(1),
        wanted=integers(ANSWERS),
        answers=np.zeros((ANSWERS, ANSWER_ROOM // 8)),
        stamps_at=integers(ANSWERS, STAMPS), numbers_at=integers(ANSWERS, NUMBERS),
        stamps=integers(ANSWERS), numbers=integers(ANSWERS),
        transforms=np.zeros((1 + len(JOINTS), 7)),
        frames=integers(1), looked_at=integers(1), log=np.zeros((KEPT, LOGGED)),
        states=np.zeros((KEPT, count), np.int8))


def teach_kind(passage, kind, stamp, scale, zero_is_missing):
    """Let messages of a kind pass.

    Parameters
    ----------
    passage : Passage
        Changed.
    kind : Kind
        Of a message that the long way has read.
    stamp : Stamp
        That it had.
    scale, zero_is_missing
        See `markers_from_message`.

    Returns
    -------
    bool
        Whether it can be: not where the hand's markers are points of lists.
    """
    heads, strings, sources = kind
    if sources.first is None or sources.has_lists:
        return False
    if len(heads) > len(passage.known_heads) or len(strings) > len(passage.known_strings):
        return False
    count = len(sources.slots)
    passage.known[:] = len(heads), len(strings)
    passage.known_heads[:len(heads)], passage.known_strings[:len(strings)] = heads, strings
    passage.first[0], passage.count[0] = sources.first, count
    passage.stamp[:] = stamp.sec, stamp.nanosec
    passage.slots[:count], passage.markers[:count] = sources.slots, sources.markers
    passage.scale[0], passage.zero_is_missing[0] = scale, zero_is_missing
    return True


def teach_answer(passage, number, template):
    """Have a message filled in each frame.

    Parameters
    ----------
    passage : Passage
        Changed.
    number : int
        `ANGLES`, `TRANSFORMS` or `CONFIDENCE`.
    template : Template

    Returns
    -------
    bool
        Whether there is room for it.
    """
    body, stamps, numbers = template.body, template.stamps, template.numbers
    if body.size > passage.answers.shape[1] or len(stamps) > STAMPS or len(numbers) > NUMBERS:
        return False
    passage.answers[number, :body.size] = body
    passage.stamps[number], passage.numbers[number] = len(stamps), len(numbers)
    passage.stamps_at[number, :len(stamps)] = stamps
    passage.numbers_at[number, :len(numbers)] = numbers
    passage.wanted[number] = True
    return True


@jit
def take_in(passage, octets):
    """Bring a message where it is worked on; return its size, -1 where it cannot pass."""
    size = len(octets) - ENCAPSULATION
    if not 0 <= size <= MESSAGE_ROOM:
        return -1
    if octets[0] != LITTLE_ENDIAN[0] or octets[1] != LITTLE_ENDIAN[1]:
        return -1
    message = passage.message.view(np.uint8)
    for i in range(size):
        message[i] = octets[ENCAPSULATION + i]
    return size


@jit
def is_known(passage, size):
    """Return whether the message has the very markers of those that pass."""
    count, used = walk(passage.message.view(np.uint8), passage.message.view(np.int32), size,
                       passage.heads, passage.places, passage.strings)
    if count != passage.known[0] or used != passage.known[1]:
        return False
    for i in range(count):
        for k in range(5):
            if passage.heads[i, k] != passage.known_heads[i, k]:
                return False
    for i in range(used):
        if passage.strings[i] != passage.known_strings[i]:
            return False
    return True


@jit
def pass_message(passages, model, chains, options, clock, blank, state, report, octets):
    """Track a message and fill the answers, if it is known what it is like.

    Only what is regular passes: stamps that go forward, after the palm was seen.

    Parameters
    ----------
    passages : packed Passage
        Changed.
    model, chains, options, clock, blank, state, report
        Of `track_frame`.
    octets : ndarray of uint8, shape (n,)
        The message.

    Returns
    -------
    bool
        Whether it passed; nothing was tracked if not.
    """
    passage = passages[0]
    size = take_in(passage, octets)
    if size < 0 or not state[0].placed[0] or not is_known(passage, size):
        return False
    at = passage.places[passage.first[0], 0]
    words = passage.message.view(np.int32)
    seconds, nanoseconds = np.int64(words[at]), np.int64(words[at + 1]) & 0xffffffff
    time = seconds + 1e-9 * nanoseconds
    if not time > clock[0].last[0] or time == 0.:
        return False
    # One that time did not believe may come again, which listeners of TF refuse.
    if seconds == passage.stamp[0] and nanoseconds == passage.stamp[1]:
        return False
    count = passage.count[0]
    gather(passage.message, passage.places, passage.slots[:count], passage.markers[:count],
           passage.scale[0], passage.zero_is_missing[0] > 0, passage.rows)
    track_frame(model, chains, options, clock, blank, state, report, passage.rows, time)
    passage.stamp[0], passage.stamp[1], passage.time[0] = seconds, nanoseconds, time
    fill_answers(passage, model[0].table.parent, report[0])
    return True


@jit
def fill_answers(passage, parent, report):
    """Write stamp and numbers of the frame into the answers that are wanted."""
    if passage.wanted[ANGLES]:
        _fill(passage, ANGLES, report.angles)
    if passage.wanted[TRANSFORMS]:
        transforms = passage.transforms[:passage.numbers[TRANSFORMS] // 7]
        write_transforms(parent, report.link_rotations, report.link_positions,
                         report.wrist_rotation, report.wrist_position, transforms)
        _fill(passage, TRANSFORMS, transforms.reshape(transforms.size))
    if passage.wanted[CONFIDENCE]:
        _fill(passage, CONFIDENCE, report.confidence)


@jit
def _fill(passage, answer, numbers):
    doubles = passage.answers[answer]
    words = doubles.view(np.int32)
    for i in range(passage.stamps[answer]):
        at = passage.stamps_at[answer, i]
        words[at], words[at + 1] = passage.stamp[0], passage.stamp[1]
    for i in range(passage.numbers[answer]):
        doubles[passage.numbers_at[answer, i]] = numbers[i]


@jit
def note(passage, report, received, published):
    """Note how the last frame fared.

    Parameters
    ----------
    passage : Passage
        Changed.
    report : Report
    received, published : float
        [s]
    """
    at = passage.frames[0] % KEPT
    log, states = passage.log, passage.states
    log[at, RECEIVED], log[at, PUBLISHED], log[at, TIME] = received, published, passage.time[0]
    total, seen = 0., 0
    for i in range(len(report.residuals)):
        states[at, i] = report.marker_states[i]
        if report.residuals[i] >= 0.:
            total += report.residuals[i]
            seen += 1
    log[at, MISS] = total / seen if seen else 0.
    log[at, PALM] = report.palm[0]
    passage.frames[0] += 1


@jit
def look(passages, reports, log, states, seen):
    """Copy what was noted since the last look, and the last frame's report.

    Parameters
    ----------
    passages : packed Passage
        Changed.
    reports : packed Report
    log, states : ndarray
        As those of `Passage`, filled.
    seen : packed Report
        Filled.

    Returns
    -------
    kept, frames : int
        Rows that are filled, and frames that came.
    """
    passage = passages[0]
    frames = passage.frames[0] - passage.looked_at[0]
    kept = min(frames, KEPT)
    for i in range(kept):
        at = (passage.frames[0] - kept + i) % KEPT
        log[i] = passage.log[at]
        states[i] = passage.states[at]
    passage.looked_at[0] = passage.frames[0]
    if kept:
        overwrite(seen, reports)
    return kept, frames


class Glimpse(NamedTuple):
    """What is noted of a run of frames, as a `HandState` has it.

    Attributes
    ----------
    palm : PalmState
    marker_states : ndarray of int, shape (8,)
    residuals : ndarray, shape (1,)
        Their mean [m].
    """

    palm: PalmState
    marker_states: np.ndarray
    residuals: np.ndarray


def glimpses(log, states):
    """Return what is noted of frames, by runs in which it stays the same.

    Parameters
    ----------
    log, states : ndarray, shape (n, 5) and (n, 8)
        Of `look`.

    Returns
    -------
    list of (float, Glimpse)
        When the first frame of each run was published, and the last [s].
    """
    is_new = (states[1:] != states[:-1]).any(axis=1) | (log[1:, PALM] != log[:-1, PALM])
    found = []
    for run in np.split(np.arange(len(log)), np.flatnonzero(is_new) + 1):
        glimpse = Glimpse(PALM_STATES[int(log[run[0], PALM])], states[run[0]],
                          log[run, MISS].mean(keepdims=True))
        found += [(at, glimpse) for at in np.unique(log[run[[0, -1]], PUBLISHED]).tolist()]
    return found
