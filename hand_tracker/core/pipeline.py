"""The paper's method, one frame of a hand: `track_frame`, and each step as a kernel.

Every step takes the records of `records` and `options` whole, as packs of one
(`numerics.packs.packed`), and hands the kernels of the step's folder what they need.
"""
# mypy: allow-redefinition

import math
from functools import partial

import numpy as np

from .filtering.frame_clock import FrameClock, advance_clock
from .filtering.noise_estimate import noise_in_palm_frame, update_noise
from .filtering.tracks import clear_motion, position_deviation
from .inverse_kinematics.abduction_plane import REFERENCE_STEP
from .inverse_kinematics.angle_filter import filter_angles
from .inverse_kinematics.digit import Chains, solve_digits, solve_rooted_digit
from .inverse_kinematics.digit_angles import (
    INFERRED_DEVIATION,
    infer_principal_markers,
    refine_digits,
    solve_followed_digits,
)
from .inverse_kinematics.further_markers import lay_digits_flat
from .inverse_kinematics.palm import place_palm_by_spheres
from .inverse_kinematics.palm_arch import fit_principal_palm, lay_targets_flat, write_line
from .labelling.association import associate
from .labelling.digit_exchange import undo_exchanges
from .labelling.validity import (
    associate_rows,
    check_palm,
    find_valid,
    measure_rows,
    note_changes,
    reject_frozen,
)
from .model.capsules import Placement, place_capsules
from .model.hand import DIGIT_OF_JOINT
from .model.marker_rows import PRINCIPALS, ROW_CAPACITY
from .model.palm_triangle import fit_wrist
from .model.states import LOST, SEEN, TRACKED, WAITING
from .numerics.jit import jit
from .numerics.packs import Pack, overwrite
from .numerics.stack_memory import local_flags, local_floats
from .numerics.vectors import clamp, distance, length, store, subtract, vector
from .occlusion.digit_markers import track_digits
from .occlusion.palm_markers import expected_markers, track_palm
from .occlusion.prediction import Observation
from .occlusion.transdigital import limit_neighbour_difference, write_own_motion
from .options import KernelOptions
from .pose.contact import CONTACT_GAP, FRAME_ROUNDS, MAX_ROUNDS, Mobility, drag_hidden, separate
from .pose.continuity import blend
from .pose.report import (
    Report,
    hang_digits,
    write_deviation,
    write_marker_states,
    write_markers,
    write_pose,
    write_residuals,
    write_rows,
)
from .records import Model, State

FIRST_FRAME_SOLVES = 150    # repetitions of the inverse kinematics in the first frame
CONTACT_RELEASE_TIME = .05  # [s] in which a contact's change of the angles falls to 1/e
MOST_PALM_NOISE = .0035     # [m] that is learned of palm markers by their distances; ours
MIN_CONTACT_OFFSET = 1e-6   # [rad]


# Both paths of a node run the very same code.
@partial(jit, is_whole=True)
def track_frame(model: Pack[Model], chains: Pack[Chains], options: Pack[KernelOptions],
                clock: Pack[FrameClock], blank: Pack[State], state: Pack[State],
                report: Pack[Report], markers: np.ndarray, time: float) -> bool:
    """Track one frame: the steps of the method, numbered as in `core`.

    The digits' markers are filtered in the wrist's frame: steps 2 to 4 come for the palm first.

    Parameters
    ----------
    model, chains, options : packed Model, Chains and KernelOptions
    clock : packed FrameClock
        Changed.
    blank : packed State
        State before the first frame.
    state, report : packed State and Report
        Changed.
    markers : ndarray, shape (n, 3)
        Measured positions, of the eight principal markers first; changed [m].
    time : float
        Time of the frame, NaN when unknown [s].

    Returns
    -------
    restarted : bool
        Whether time jumped back, so that tracking began anew.
    """
    step, restarted = begin_frame(model, clock, blank, state, markers, time)
    seen = local_flags(ROW_CAPACITY)[:len(markers)]
    iterations, has_more_rows = 0, model[0].rows.is_needed[0]
    # 1 Labelling: reject invalid measurements, associate the others with markers.
    fault = label_markers(model, chains, options, state, markers, seen, step)
    markers, seen = markers[:PRINCIPALS], seen[:PRINCIPALS]
    # 2, 3 Filtering and occlusion, palm: filter its markers, predict hidden ones.
    palm = predict_palm(model, options, state, markers, seen, step)
    if palm == LOST:
        # The digits' markers have located the palm; nothing is left to locate them by.
        seen[3:] = False
    if palm != WAITING:
        # 4 Inverse kinematics, palm: pose of the wrist, first joints of the digits.
        place_wrist(model, options, state)
        # 4 Inverse kinematics: place a digit's hidden principal marker by its other markers.
        if has_more_rows:
            infer_markers(model, chains, options, state, markers, seen, palm == LOST, step)
        # 2, 3 Filtering and occlusion, digits: the same; hidden ones follow the others.
        predict_digits(model, options, state, markers, seen, palm == TRACKED, step)
        # 4 Inverse kinematics, digits with several markers: from the last frame's angles.
        solve_multi_marker_digits(model, chains, state, seen, step)
        # 4 Inverse kinematics, fingers and thumb: abduction, then flexion within limits.
        iterations = solve_angles(model, chains, options, state, seen, step)
        # 4 Inverse kinematics: quiet angles, where the digits' markers constrain them little.
        estimate_angles(chains, options, state, step)
        if has_more_rows:
            refine_multi_marker_digits(model, chains, state, seen, step)
        # 5 Pose: continuous angles, digits apart from each other and from the palm.
        turn = options[0].reentry_rate * step if state[0].wrist.placed[0] else math.inf
        blend_angles(model, chains, options, state, seen, step)
        resolve_contact(model, chains, options, state, seen, step, turn)
    # 5 Pose: forward kinematics, states of the markers, deviations.
    write_report(model, chains, options, state, markers, seen, fault if fault else palm,
                 iterations, report)
    return restarted


@jit
def begin_frame(model: Pack[Model], clock: Pack[FrameClock], blank: Pack[State],
                state: Pack[State], markers: np.ndarray, time: float) -> tuple[float, bool]:
    """Advance the clock, and mirror a left hand's markers to a right hand's.

    Parameters
    ----------
    model, clock, blank, state : packs
        As for `track_frame`; clock and state are changed.
    markers : ndarray, shape (n, 3)
        Changed [m].
    time : float
        Of the frame, NaN when unknown [s].

    Returns
    -------
    step : float
        Time since the last frame [s].
    restarted : bool
        Whether time jumped back and the state was reset.
    """
    step, paused, restarted = advance_clock(clock[0], time)
    if restarted:
        overwrite(state, blank)
    if paused:
        clear_motion(state[0].palm)
        clear_motion(state[0].digits)
        state[0].rows.velocity[:] = 0.
    for i in range(len(markers)):
        for k in range(3):
            markers[i, k] *= model[0].mirror[k]
    return step, restarted


@jit
def label_markers(model: Pack[Model], chains: Pack[Chains], options: Pack[KernelOptions],
                  state: Pack[State], markers: np.ndarray, seen: np.ndarray, step: float) -> int:
    """Reject invalid measurements and exchange wrong labels, by where markers are expected.

    With more than the eight markers, the palm is fitted to all of them first.

    Parameters
    ----------
    model, chains, options, state : packs
        As for `track_frame`; the state is changed.
    markers : ndarray, shape (n, 3)
        Changed [m].
    seen : ndarray of bool, shape (n,)
        Whether each is measured; replaced.
    step : float
        Since the last frame [s].

    Returns
    -------
    int
        TRACKED, or the `PalmState` that names the palm's fault.
    """
    model, chains, options, state = model[0], chains[0], options[0], state[0]
    palm, digits = state.palm, state.digits
    find_valid(markers, seen)
    reject_frozen(markers, seen, state.last_markers, state.repeats, state.repeated_distances,
                  options.frozen_frames)
    # As measured: the markers of a fitted palm do not vary.
    sides, are_seen = local_floats((1, 3)), local_flags(1)
    are_seen[0] = seen[0] and seen[1] and seen[2]
    for i in range(3):
        sides[0, i] = distance(
            vector(markers[i]), vector(markers[(i + 1) % 3])) / math.sqrt(2.)
    update_noise(state.palm_noise, sides, are_seen, step, MOST_PALM_NOISE)
    if model.rows.is_needed[0]:
        undo_exchanges(model.rows, state.rows, state.wrist, markers, seen, step,
                       options.labelling.swap_margin > 0.)
        measure_rows(model.rows, state.rows, markers, seen, step)
        if not options.angle_filter:
            state.average.consecutive[:] = 0
        fit_principal_palm(model.rows, state.rows, state.average, chains.lower, chains.upper,
                           state.separated, state.wrist, state.fitted, markers, seen, step)
    markers, seen = markers[:PRINCIPALS], seen[:PRINCIPALS]
    expected_markers(palm, digits, model.template, step, state.expected.position)
    for i in range(8):
        deviation = position_deviation(
            palm.covariance[i] if i < 3 else digits.covariance[i - 3])
        if i >= 3:
            # The palm by which a frame's digits are judged turns with the noise of its markers,
            # at worst all of it on one axis.
            gain = 3. * (1. + model.levers[i - 3])
            deviation = math.hypot(deviation, math.sqrt(gain) * state.palm_noise.deviation[0])
        state.expected.deviation[i] = deviation
        state.expected.speed[i] = length(vector(palm.pace[i] if i < 3 else digits.pace[i - 3]))
        state.expected.known[i] = palm.known[i] if i < 3 else digits.known[i - 3]
    associate(markers, seen, state.expected, step, model.hand_bounds, state.association,
              options.labelling, state.verdict[:])
    update_noise(state.noise, markers, seen, step, options.marker_noise)
    fault = check_palm(markers, seen, model.template, state.wrist, options.palm_limits)
    palm_changed = note_changes(palm, digits, seen, state.changed)
    if model.rows.is_needed[0]:
        associate_rows(model.rows, state.rows, markers, seen, palm_changed, state.changed)
    return fault


@jit
def predict_palm(model: Pack[Model], options: Pack[KernelOptions], state: Pack[State],
                 markers: np.ndarray, seen: np.ndarray, step: float) -> int:
    """Filter the palm's markers and predict hidden ones; return the `PalmState`.

    Parameters
    ----------
    model, options, state : packs
        As for `track_frame`; the state is changed.
    markers : ndarray, shape (8, 3)
        [m]
    seen : ndarray of bool, shape (8,)
        Whether each principal marker is measured.
    step : float
        Since the last frame [s].
    """
    model, options, state = model[0], options[0], state[0]
    if not (seen[0] and seen[1] and seen[2]):
        if state.palm.seen[0] and state.palm.seen[1] and state.palm.seen[2]:
            write_own_motion(state.transdigital.statistics, model.prior.correlation,
                             state.digits.own_motion)
        state.palm.line[:] = 0.
        are_placed = math.isfinite(markers[0, 0] + markers[1, 0] + markers[2, 0])
        if model.rows.has_several[5] and are_placed:
            write_line(model.rows, state.rows, state.palm.line)
    return track_palm(Observation(markers, seen, state.noise.deviation), step, state.palm,
                      state.digits, state.wrist, state.palm_shape, options.prediction)


@jit
def place_wrist(model: Pack[Model], options: Pack[KernelOptions], state: Pack[State]) -> None:
    """Place the wrist and the digits' first joints by the palm's markers."""
    model, options, state = model[0], options[0], state[0]
    for i in range(5):
        for k in range(3):
            state.roots[i, k] = model.hand_bounds.roots[i, k]
    rotation, position = state.wrist.rotation, state.wrist.position
    if options.by_spheres:
        place_palm_by_spheres(state.palm.mean, model.template, rotation, position, state.roots)
    else:
        fit_wrist(state.palm.mean, model.template, rotation, position)


@jit
def infer_markers(model: Pack[Model], chains: Pack[Chains], options: Pack[KernelOptions],
                  state: Pack[State], markers: np.ndarray, seen: np.ndarray, is_lost: bool,
                  step: float) -> None:
    """Place each digit's hidden principal marker by the digit's others, outliers refused.

    Parameters
    ----------
    model, chains, options, state : packs
        As for `track_frame`; the state is changed.
    markers : ndarray, shape (8, 3)
        Changed [m].
    seen : ndarray of bool, shape (8,)
        Changed.
    is_lost : bool
        Whether no marker of the palm is seen: then no digit is placed by its own.
    step : float
        Since the last frame [s].
    """
    model, chains, state, labelling = model[0], chains[0], state[0], options[0].labelling
    if is_lost:
        state.rows.is_measured[:] = False
        state.rows.is_fitted[:] = False
        state.rows.verdict[:] = SEEN
        state.rows.away_for[:] += step
        return
    # The noise of each marker is learned up to what filters may smooth, the palm's beyond it.
    noise = local_floats(PRINCIPALS)
    for i in range(PRINCIPALS):
        noise[i] = max(state.noise.deviation[i], state.palm_noise.deviation[0])
    lay_digits_flat(chains, model.rows, state.rows, state.wrist, state.changed, noise, step,
                    labelling.outlier_gate > 0., labelling.patience)
    infer_principal_markers(chains, model.rows, state.rows, state.wrist, state.angles, markers,
                            seen, step)


@jit
def predict_digits(model: Pack[Model], options: Pack[KernelOptions], state: Pack[State],
                   markers: np.ndarray, seen: np.ndarray, palm_tracked: bool, step: float) -> None:
    """Filter the digits' markers in the wrist's frame and predict hidden ones.

    Parameters
    ----------
    model, options, state : packs
        As for `track_frame`; the state is changed.
    markers : ndarray, shape (8, 3)
        [m]
    seen : ndarray of bool, shape (8,)
        Whether each principal marker is measured.
    palm_tracked : bool
        Whether the palm is tracked: only then the digits' statistics learn from the frame.
    step : float
        Since the last frame [s].
    """
    model, options, state = model[0], options[0], state[0]
    has_several = model.rows.has_several
    # Doubtful labels must not enter the statistics.
    learning = palm_tracked and state.association.doubted_for[0] == 0.
    for i in range(5):
        # Where its other markers place it, little is known of the principal one.
        is_inferred = seen[3 + i] and has_several[i] and not state.rows.is_measured[3 + i]
        state.digit_noise[i] = INFERRED_DEVIATION if is_inferred else noise_in_palm_frame(
            state.noise.deviation[3 + i], state.palm.covariance, model.levers[i])
    track_digits(Observation(markers[3:], seen[3:], state.digit_noise), step, state.digits,
                 state.wrist, state.transdigital, model.prior, state.pushes, options.prediction,
                 learning)


@jit
def solve_multi_marker_digits(model: Pack[Model], chains: Pack[Chains], state: Pack[State],
                              seen: np.ndarray, step: float) -> None:
    """Solve digits with several markers by Gauss-Newton from the last frame's angles.

    Seen digits whose evidence changed, or whose solution fits badly, wait for the closed form by
    their principal marker.

    Parameters
    ----------
    model, chains, state : packs
        As for `track_frame`; the state is changed.
    seen : ndarray of bool, shape (8,)
        Whether each principal marker is measured.
    step : float
        Since the last frame [s].
    """
    model, chains, state = model[0], chains[0], state[0]
    rows = state.rows
    for digit in range(5):
        rows.is_solved[digit] = False
    if model.rows.has_several[:5].any() and state.wrist.placed[0]:
        solve_followed_digits(
            chains, model.rows, rows, seen, state.digits.mean, state.changed, state.angles, step)
    for digit in range(5):
        rows.is_followed[digit] = seen[3 + digit] and not rows.is_solved[digit]


@jit
def solve_angles(model: Pack[Model], chains: Pack[Chains], options: Pack[KernelOptions],
                 state: Pack[State], seen: np.ndarray, step: float) -> int:
    """Solve the digits' angles; hidden fingers stay in their candidate space.

    Parameters
    ----------
    model, chains, options, state : packs
        As for `track_frame`; the state is changed.
    seen : ndarray of bool, shape (8,)
        Whether each principal marker is measured.
    step : float
        Since the last frame [s].

    Returns
    -------
    int
        Iterations of FABRIK, over all digits; the repetitions of the first frame do not count.
    """
    model, chains, options, state = model[0], chains[0], options[0], state[0]
    targets = state.rows.targets
    for i in range(5):
        store(targets, i, vector(state.digits.mean[i]))
    if model.rows.is_cupping[0]:
        lay_targets_flat(model.rows, state.rows, state.angles)
    # Abduction follows slowly in a fist: the first frame, without history, iterates it.
    for _ in range(0 if state.wrist.placed[0] else FIRST_FRAME_SOLVES):
        solve_digits(chains, state.roots, targets, state.angles, REFERENCE_STEP,
                     options.by_fabrik, options.fabrik_tolerance, options.fabrik_iterations)
    iterations = 0
    for i in range(5):
        if not state.rows.is_solved[i]:
            iterations += solve_rooted_digit(
                chains, i, subtract(vector(targets[i]), vector(state.roots[i])), state.angles,
                step, options.by_fabrik, options.fabrik_tolerance, options.fabrik_iterations)
    limit_neighbour_difference(state.angles, seen[3:], model.flexion_bounds,
                               state.neighbour_difference, chains.lower, chains.upper)
    return iterations


@jit
def estimate_angles(chains: Pack[Chains], options: Pack[KernelOptions], state: Pack[State],
                    step: float) -> None:
    """Estimate the seen digits' angles within the noise of their markers.

    Parameters
    ----------
    chains, options, state : packs
        As for `track_frame`; the state is changed.
    step : float
        Since the last frame [s].
    """
    chains, options, state = chains[0], options[0], state[0]
    for i in range(5):
        if chains.measured[i] != state.measured[i]:
            state.measured[i] = chains.measured[i]
            state.changed[i] = True
    if not options.angle_filter:
        for joint in range(25):
            state.estimate.angles[joint] = state.angles[joint]
        return
    filter_angles(chains, state.roots,
                  Observation(state.rows.targets, state.rows.is_followed, state.digit_noise),
                  state.angles, state.blended if state.wrist.placed[0] else state.angles,
                  state.changed, step, state.estimate)


@jit
def refine_multi_marker_digits(model: Pack[Model], chains: Pack[Chains], state: Pack[State],
                               seen: np.ndarray, step: float) -> None:
    """Solve the remaining digits with several markers, starting from the closed form.

    Hidden, a digit goes on from these angles: there is nothing to add to the solved ones then.

    Parameters
    ----------
    model, chains, state : packs
        As for `track_frame`; the state is changed.
    seen : ndarray of bool, shape (8,)
        Whether each principal marker is measured.
    step : float
        Since the last frame [s].
    """
    model, chains, state = model[0], chains[0], state[0]
    if model.rows.has_several[:5].any():
        refine_digits(chains, model.rows, state.rows, state.average, seen, state.estimate.angles,
                      step)
        for joint in range(25):
            if model.rows.has_several[DIGIT_OF_JOINT[joint]]:
                state.estimate.shift[joint] = 0.


@jit
def blend_angles(model: Pack[Model], chains: Pack[Chains], options: Pack[KernelOptions],
                 state: Pack[State], seen: np.ndarray, step: float) -> None:
    """Blend the angles in where a marker vanished, came back or changed its label.

    In the first frame with a palm they are taken as they are; the wrist is placed from then on.

    Parameters
    ----------
    model, chains, options, state : packs
        As for `track_frame`; the state is changed.
    seen : ndarray of bool, shape (8,)
        Whether each principal marker is measured.
    step : float
        Since the last frame [s].
    """
    has_several = model[0].rows.has_several
    chains, options, state = chains[0], options[0], state[0]
    if not state.wrist.placed[0]:
        state.wrist.placed[0] = True
        state.changed[:] = False
        for joint in range(25):
            state.blended[joint] = state.estimate.angles[joint]
    palm_is_seen = seen[:3].all()
    predicted, unmeasured = local_flags(5), local_flags(5)
    for i in range(5):
        predicted[i] = not (palm_is_seen and seen[3 + i])
        unmeasured[i] = predicted[i] or has_several[i] and not state.rows.is_measured[3 + i]
    blend(state.estimate.angles, state.blended, state.offset, state.changed, predicted, step,
          options.reentry_rate, chains.lower, chains.upper, state.pace, unmeasured)


@jit
def resolve_contact(model: Pack[Model], chains: Pack[Chains], options: Pack[KernelOptions],
                    state: Pack[State], seen: np.ndarray, step: float, turn: float) -> None:
    """Separate hidden digits from others (rigidity); drag them along (friction).

    Parameters
    ----------
    model, chains, options, state : packs
        As for `track_frame`; the state is changed.
    seen : ndarray of bool, shape (8,)
        Whether each principal marker is measured.
    step : float
        Since the last frame [s].
    turn : float
        By how much a hidden digit's angle may turn; infinite in the first frame [rad].
    """
    model, chains, options, state = model[0], chains[0], options[0], state[0]
    # Slices are arrays to numba, as the poses of a simulation are, and fields are not: so
    # `separate` is compiled once.
    angles, ends = state.separated[:], state.capsule_ends[:]
    placement = Placement(local_floats((25, 3, 3)), local_floats((25, 3)), ends[1])
    all_seen, any_seen = seen[3:].all(), seen[3:].any()
    is_dragging = options.friction > 0. and not all_seen
    if is_dragging:
        if not state.are_placed[0]:
            place_capsules(model.capsules, angles, placement)
        ends[0] = ends[1]
    is_placed = False
    last = local_floats(25)
    for joint in range(25):
        last[joint] = angles[joint]
        angles[joint] = state.blended[joint]
    if options.rigidity:
        # Starting from the last frame's solution keeps a contact from flickering.
        kept = math.exp(-step / CONTACT_RELEASE_TIME) if any_seen else 1.
        for joint in range(25):
            angles[joint] = clamp(angles[joint] + kept * state.contact_offset[joint],
                                  chains.lower[joint], chains.upper[joint])
        # What is seen is where it is, and hidden digits give way; where none is seen, all stay as
        # they are.
        if any_seen and not all_seen:
            slope, weight = local_floats(5), local_floats(6)
            for digit in range(5):
                slope[digit] = chains.coupling[digit, 0]
                weight[digit] = 0. if seen[3 + digit] else 1.
            separate(model.capsules, angles,
                     Mobility(chains.lower[:], chains.upper[:], slope, weight),
                     options.penetration, placement,
                     FRAME_ROUNDS if turn < math.inf else MAX_ROUNDS)
            is_placed = True
        for joint in range(25):
            # A digit that overlapped as it was seen leaves the others without a leap.
            if not seen[3 + DIGIT_OF_JOINT[joint]] and abs(angles[joint] - last[joint]) > turn:
                angles[joint] = last[joint] + math.copysign(turn, angles[joint] - last[joint])
                is_placed = False
            offset = angles[joint] - state.blended[joint]
            state.contact_offset[joint] = offset if abs(offset) >= MIN_CONTACT_OFFSET else 0.
    state.pushes[:] = 0.
    state.are_placed[0] = is_dragging
    if is_dragging:
        if not is_placed:
            place_capsules(model.capsules, angles, placement)
        drag_hidden(model.capsules, ends[0], ends[1], seen[3:], CONTACT_GAP, options.friction,
                    state.pushes)


@jit
def write_report(model: Pack[Model], chains: Pack[Chains], options: Pack[KernelOptions],
                 state: Pack[State], markers: np.ndarray, seen: np.ndarray, palm: int,
                 iterations: int, report: Pack[Report]) -> None:
    """Write the frame's `Report`, of the hand's own side.

    Parameters
    ----------
    model, chains, options, state, report : packs
        As for `track_frame`; the report is changed.
    markers : ndarray, shape (8, 3)
        [m]
    seen : ndarray of bool, shape (8,)
        Whether each principal marker is measured.
    palm : int
        `PalmState` of the frame.
    iterations : int
        Of FABRIK, over all digits.
    """
    model, chains, options, state, report = model[0], chains[0], options[0], state[0], report[0]
    write_pose(model.table, state.separated, chains.lower, chains.upper, state.wrist,
               model.mirror, report)
    if options.by_spheres and state.wrist.placed[0]:
        hang_digits(state.roots, model.hand_bounds.roots, model.mirror, report)
    write_markers(markers, seen, state.palm, state.digits, state.wrist, model.mirror, report)
    write_marker_states(seen, state.verdict, state.palm, state.digits,
                        options.prediction.max_prediction_time, report)
    if model.rows.is_needed[0]:
        write_rows(model.rows, state.rows, options.prediction.max_prediction_time, model.mirror,
                   report)
    else:
        write_residuals(seen, model.mounting, report)
    write_deviation(chains, model.mounting, state.palm, state.digits, state.rows.deviation,
                    state.offset, state.wrist.placed[0] > 0, report)
    report.palm[0], report.iterations[0] = palm, iterations
