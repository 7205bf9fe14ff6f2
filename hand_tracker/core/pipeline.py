"""The sequence of the paper, one frame of a hand: `track_frame`.

What it works on comes in one piece each (`packed`): the model of the hand, the choices of
method, what is kept from frame to frame, and what is told of the frame.
"""

import math
from typing import NamedTuple

import numpy as np

from .filtering.frame_clock import advance_clock
from .filtering.noise_estimate import NoiseEstimate, initial_noise, update_noise
from .filtering.smoothing import noise_in_palm_frame
from .filtering.tracks import Tracks, clear_motion, initial_tracks
from .inverse_kinematics.abduction_plane import FRAME
from .inverse_kinematics.digit import solve_digits
from .inverse_kinematics.palm import place_palm
from .labelling.association import HandBounds, Memory, blank_memory, identify
from .labelling.validity import find_valid, reject_frozen
from .model.capsules import Capsules, place_capsules
from .model.kinematics import JointTable
from .model.marker_layout import MARKERS, Mounting
from .model.states import LOST, TRACKED, WAITING
from .numerics.jit import jit, overwrite
from .numerics.vectors import clamp
from .occlusion.digit_markers import follow_digits
from .occlusion.palm_markers import check_palm, expected_markers, follow_palm
from .occlusion.transdigital import Habits, keep_near_neighbours, no_habits
from .pose.contact import GAP, carry, separate
from .pose.continuity import ease
from .pose.report import deviation, tell_confidence, tell_markers, tell_pose

AT_ONCE = 1e-9     # [s] in which digits that were never seen relax in the first frame
SETTLE = 150        # times that the first frame is solved
RELEASE = .05       # [s] in which digits that touched go back to where their markers are
LEAST_PARTED = 1e-6  # [rad]
SEEN_MOBILITY = .1  # of a seen digit among those that touch, against a hidden one's 1


class Model(NamedTuple):
    """What is known of the hand; of a right hand but for the last three.

    Attributes
    ----------
    template, rest : ndarray, shape (3, 3) and (5, 3)
        Markers of the palm, and of the digits of a relaxed hand, in the wrist's frame [m].
    levers : ndarray, shape (5,)
        Of `smoothing.levers`.
    prior, bounds : ndarray, shape (15, 15) and (3,)
        Of `shares_of` and `keep_near_neighbours`.
    hand_bounds : HandBounds
    capsules : Capsules
    table : JointTable
    mounting : Mounting
    mirror : ndarray, shape (3,)
        -1 on the axes that a left hand has mirrored.
    """

    template: np.ndarray
    rest: np.ndarray
    levers: np.ndarray
    prior: np.ndarray
    bounds: np.ndarray
    hand_bounds: HandBounds
    capsules: Capsules
    table: JointTable
    mounting: Mounting
    mirror: np.ndarray


class Choices(NamedTuple):
    """`TrackerOptions` as kernels take them."""

    by_spheres: bool
    by_fabrik: bool
    fabrik_tolerance: float
    fabrik_iterations: int
    palm_stretch: float
    palm_shrink: float
    palm_flatness: float
    frozen_frames: int
    smoothing: bool
    marker_noise: float
    inertia: float
    palm_from_fingers: bool
    transdigital_memory: float
    friction: float
    rigidity: bool
    penetration: float
    outlier_gate: float
    swap_margin: float
    patience: float
    max_prediction_time: float
    relax_time: float
    reentry_rate: float


def choices(options):
    """Return `Choices` of `TrackerOptions`."""
    special = {'by_spheres': options.palm_method == 'spheres',
               'by_fabrik': options.finger_ik == 'fabrik',
               'relax_time': options.relax_time if options.stale == 'relax' else 0.}
    return Choices(*(special[name] if name in special else kind(getattr(options, name))
                     for name, kind in Choices.__annotations__.items()))


class State(NamedTuple):
    """What is kept from frame to frame.

    Attributes
    ----------
    palm, digits : Tracks
        Of the palm's markers, and of the digits' in the wrist's frame.
    noise : Noise
    memory : Memory
    habits : Habits
    shares : ndarray, shape (15, 15)
        Of `shares_of`.
    rotation, position : ndarray, shape (3, 3) and (3,)
        The wrist [m].
    placed : ndarray of bool, shape (1,)
        Whether the palm was seen yet.
    angles, eased, offset, touched, parted : ndarray, shape (25,)
        As solved; without jumps, and what is left of them; with the digits apart, and by how
        much that is [rad].
    apart : ndarray, shape (3,)
        Of `keep_near_neighbours` [rad].
    pushed : ndarray, shape (5, 3)
        By how much contact carries the hidden digits' markers [m].
    last, still, stood : ndarray, shape (8, 3), (8,) and (3, 3)
        Of `reject_frozen`.
    expected, spread, known, verdict : ndarray, shape (8, 3), and (8,)
        Of this frame, of `identify`.
    measured : ndarray of bool, shape (5,)
        Whether the last joint of a digit was measured.
    changed : ndarray of bool, shape (5,)
        Of this frame: digits of which something else is known than before.
    roots : ndarray, shape (5, 3)
        Of this frame: first joints of the digits in the wrist's frame [m].
    """

    palm: Tracks
    digits: Tracks
    noise: NoiseEstimate
    memory: Memory
    habits: Habits
    shares: np.ndarray
    rotation: np.ndarray
    position: np.ndarray
    placed: np.ndarray
    angles: np.ndarray
    eased: np.ndarray
    offset: np.ndarray
    touched: np.ndarray
    parted: np.ndarray
    apart: np.ndarray
    pushed: np.ndarray
    last: np.ndarray
    still: np.ndarray
    stood: np.ndarray
    expected: np.ndarray
    spread: np.ndarray
    known: np.ndarray
    verdict: np.ndarray
    measured: np.ndarray
    changed: np.ndarray
    roots: np.ndarray


def blank_state(template, rest, relaxed, marker_noise):
    """Return the state before the first frame, of a relaxed hand.

    Parameters
    ----------
    template, rest : ndarray, shape (3, 3) and (5, 3)
        As of `Model`.
    relaxed : ndarray, shape (25,)
        Its angles [rad].
    marker_noise : float
        Of `TrackerOptions`.

    Returns
    -------
    State
    """
    count = len(MARKERS)
    return State(
        initial_tracks(template), initial_tracks(rest), initial_noise(count, marker_noise),
        blank_memory(), no_habits(), shares=np.zeros((rest.size, rest.size)), rotation=np.eye(3),
        position=np.zeros(3), placed=np.zeros(1, dtype=bool), angles=relaxed.copy(),
        eased=relaxed.copy(), offset=np.zeros(len(relaxed)), touched=relaxed.copy(),
        parted=np.zeros(len(relaxed)),
        apart=np.zeros(3), pushed=np.zeros(rest.shape), last=np.full((count, 3), np.nan),
        still=np.zeros(count, dtype=np.int64), stood=np.full((3, 3), np.nan),
        expected=np.zeros((count, 3)), spread=np.zeros(count), known=np.zeros(count, dtype=bool),
        verdict=np.zeros(count, dtype=np.int64), measured=np.zeros(len(rest), dtype=bool),
        changed=np.zeros(len(rest), dtype=bool), roots=np.zeros(rest.shape))


@jit
def track_frame(model, chains, options, clock, blank, state, report, markers, time):
    """Bring the state to the next frame, and tell of it.

    Parameters
    ----------
    model, chains, options : packed Model, Chains and Choices
    clock : packed Clock
        Changed.
    blank : packed State
        Of the beginning.
    state, report : packed State and Report
        Changed.
    markers : ndarray, shape (8, 3)
        Changed [m].
    time : float
        Of the frame, NaN where it is not known [s].

    Returns
    -------
    restarted : bool
        Whether time jumped back, so that all began anew.
    """
    step, restarted = begin_frame(model, clock, blank, state, markers, time)
    seen = np.empty(8, dtype=np.bool_)
    iterations = 0
    # 1 occlusion: what is no measurement
    fault = judge_markers(model, options, state, markers, seen, step)
    # 1 occlusion, 2 palm: its markers, hidden ones predicted; the wrist's pose
    palm = follow_wrist(model, options, state, markers, seen, step)
    if palm == LOST:
        # The digits tell of the palm alone.
        seen[3:] = False
    if palm != WAITING:
        # 1 occlusion: the digits' markers in the palm's frame, hidden ones predicted
        follow_fingers(model, options, state, markers, seen, palm == TRACKED, step)
        # 3 fingers, 4 thumb: planes, flexion within limits, intradigital correlation
        iterations = solve_angles(model, chains, options, state, seen, step)
        # 1 rigidity, friction: digits touch, and carry hidden ones
        touch(model, chains, options, state, seen, step)
    # 5 angles: the pose is their forward kinematics
    tell(model, chains, options, state, markers, seen, fault if fault else palm, iterations,
         report)
    return restarted


@jit
def begin_frame(model, clock, blank, state, markers, time):
    """Turn the markers into a right hand's; return the time that passed, and if all is new."""
    step, paused, restarted = advance_clock(clock[0], time)
    if restarted:
        overwrite(state, blank)
    if paused:
        clear_motion(state[0].palm)
        clear_motion(state[0].digits)
    # The method is worked out for a right hand; a left one is mirrored at the door.
    for i in range(8):
        for k in range(3):
            markers[i, k] *= model[0].mirror[k]
    return step, restarted


@jit
def judge_markers(model, options, state, markers, seen, step):
    """Put the measurements in order, and find which are none; return the palm's fault."""
    model, options, state = model[0], options[0], state[0]
    palm, digits = state.palm, state.digits
    find_valid(markers, seen)
    reject_frozen(markers, seen, state.last, state.still, state.stood,
                  options.frozen_frames)
    expected_markers(palm, digits, model.template, step, state.expected)
    for i in range(8):
        state.spread[i] = deviation(palm.covariance[i] if i < 3 else digits.covariance[i - 3])
        state.known[i] = palm.known[i] if i < 3 else digits.known[i - 3]
    identify(markers, seen, state.expected, state.spread, state.known, step, model.hand_bounds,
             state.memory, options.outlier_gate, options.swap_margin, options.patience,
             state.verdict)
    update_noise(state.noise, markers, seen, step, options.marker_noise)
    fault = check_palm(
        markers, seen, model.template, state.rotation, state.position, state.placed[0] > 0,
        options.palm_stretch, options.palm_shrink, options.palm_flatness)
    _note_changes(palm, digits, seen, state.changed)
    return fault


@jit
def _note_changes(palm, digits, seen, changed):
    """Write of which digits something else is known than in the last frame, shape (5,)."""
    of_palm = False
    for i in range(3):
        of_palm = of_palm or seen[i] != palm.seen[i]
    lost = not (seen[0] or seen[1] or seen[2])
    for i in range(5):
        changed[i] = of_palm or (seen[3 + i] and not lost) != digits.seen[i]


@jit
def follow_wrist(model, options, state, markers, seen, step):
    """Follow the palm's markers and place the wrist; return the `PalmState`."""
    model, options, state = model[0], options[0], state[0]
    found = follow_palm(
        markers, seen, state.palm, state.digits, state.rotation, state.position,
        model.template, state.placed[0] > 0, step, state.noise.deviation, options.smoothing,
        options.inertia, options.palm_from_fingers, options.max_prediction_time)
    if found != WAITING:
        for i in range(5):
            for k in range(3):
                state.roots[i, k] = model.hand_bounds.roots[i, k]
        place_palm(state.palm.mean, model.template, options.by_spheres, state.rotation,
                   state.position, state.roots)
    return found


@jit
def follow_fingers(model, options, state, markers, seen, learning, step):
    """Follow the digits' markers in the palm's frame."""
    model, options, state = model[0], options[0], state[0]
    # Doubtful labels teach nothing.
    learning = learning and state.memory.doubt[0] == 0.
    noise = np.empty(5)
    for i in range(5):
        noise[i] = noise_in_palm_frame(
            state.noise.deviation[3 + i], state.palm.covariance, model.levers[i])
    follow_digits(
        markers[3:], seen[3:], state.digits, state.rotation, state.position, model.rest,
        state.habits, model.prior, state.shares, state.pushed, step, noise, options.smoothing,
        options.inertia, options.transdigital_memory, learning, options.max_prediction_time,
        options.relax_time if state.placed[0] else AT_ONCE)


@jit
def solve_angles(model, chains, options, state, seen, step):
    """Solve the digits, and let their angles go on without jumps; return FABRIK's iterations."""
    model, chains, options, state = model[0], chains[0], options[0], state[0]
    # A fist at the first frame has no history: it settles.
    for _ in range(0 if state.placed[0] else SETTLE):
        solve_digits(chains, state.roots, state.digits.mean, state.angles, FRAME, False, 0., 0)
    iterations = solve_digits(
        chains, state.roots, state.digits.mean, state.angles, step, options.by_fabrik,
        options.fabrik_tolerance, options.fabrik_iterations)
    keep_near_neighbours(
        state.angles, seen[3:], model.bounds, state.apart, chains.lower, chains.upper)
    for i in range(5):
        if chains.measured[i] != state.measured[i]:
            state.measured[i] = chains.measured[i]
            state.changed[i] = True
    if not state.placed[0]:
        state.placed[0] = True
        state.changed[:] = False
        for joint in range(25):
            state.eased[joint] = state.angles[joint]
    predicted = ~seen[3:]
    if not seen[:3].all():
        predicted[:] = True
    ease(state.angles, state.eased, state.offset, state.changed, predicted, step,
         options.reentry_rate, chains.lower, chains.upper)
    return iterations


@jit
def touch(model, chains, options, state, seen, step):
    """Move apart the digits that are in each other; note how they carry the hidden ones."""
    model, chains, options, state = model[0], chains[0], options[0], state[0]
    angles, before = state.touched, state.touched.copy()
    for joint in range(25):
        angles[joint] = state.eased[joint]
    if options.rigidity:
        # They part as they did in the last frame: no contact flickers.
        kept = math.exp(-step / RELEASE)
        for joint in range(25):
            angles[joint] = clamp(angles[joint] + kept * state.parted[joint],
                                  chains.lower[joint], chains.upper[joint])
        mobility = np.ones(5)
        for i in range(5):
            if seen[3 + i]:
                mobility[i] = SEEN_MOBILITY
        separate(model.capsules, angles, chains.lower, chains.upper,
                 chains.coupling[:, 0].copy(), mobility, options.penetration)
        for joint in range(25):
            parted = angles[joint] - state.eased[joint]
            state.parted[joint] = parted if abs(parted) >= LEAST_PARTED else 0.
    state.pushed[:] = 0.
    if options.friction > 0. and not seen[3:].all():
        ends = np.empty((2, len(model.capsules.link), 2, 3))
        place_capsules(model.capsules, before, ends[0])
        place_capsules(model.capsules, angles, ends[1])
        carry(model.capsules, ends[0], ends[1], ~seen[3:], GAP, options.friction, state.pushed)


@jit
def tell(model, chains, options, state, markers, seen, palm, iterations, report):
    """Write the frame's `Report`."""
    model, chains, options, state, report = model[0], chains[0], options[0], state[0], report[0]
    tell_pose(model.table, state.touched, chains.lower, chains.upper, state.rotation,
              state.position, model.mirror, report)
    tell_markers(markers, seen, state.verdict, state.palm, state.digits, model.mounting,
                 state.rotation, state.position, model.mirror, options.max_prediction_time,
                 report)
    tell_confidence(state.palm, state.digits, state.offset, state.placed[0] > 0, report)
    report.palm[0], report.iterations[0] = palm, iterations
