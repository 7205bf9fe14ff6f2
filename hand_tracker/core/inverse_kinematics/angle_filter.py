"""Kalman filter of a digit's angles, for poses in which its marker hardly constrains them.

The marker's direction determines the first flexion exactly. Only two angles of a digit have to be
estimated: abduction by the direction of the digit's plane, and the second flexion by the distance
of the marker from the first joint, its reach. Near straight half a millimetre of reach is ten
degrees of the second flexion; in a fist it is as much of abduction.

Both angles have a Kalman filter of one state, a random walk whose process noise follows the
innovation: noise is averaged, and motion beyond the noise followed within a frame or two, without
the overshoot of a filter of velocity. Without information by the marker the person's natural
flexion decides (`Hand.natural_flexion`); where skin is known to move the marker, natural flexion
and reach are weighed against each other first. The measurement bounds the estimate: its distance
from the marker is at most the noise and the motion of the skin, less beyond reach, and the first
flexion aims at the marker. Ours; no source.
"""

import math
from typing import NamedTuple

import numpy as np

from ..model.hand import ABDUCTION_JOINTS, DIGIT_OF_JOINT, FLEXION_JOINTS
from ..numerics.jit import jit
from ..numerics.vectors import Vector, clamp, components, frame, subtract, vector
from ..occlusion.prediction import Observation
from .abduction_plane import FIST_NEAR, in_plane, plane_direction
from .digit import Chains, linkage_of, natural_flexion_of, planar_marker
from .flexion import (
    AVERAGE_SPREAD,
    MAX_SECOND_HINGE_SPEED,
    Linkage,
    NaturalFlexion,
    aim_end,
    chain_end,
    chain_reach,
    coupled_angle,
    flexion_of,
)

# Time constant of the mean innovation, which is taken for motion [s].
INNOVATION_TIME = .0045
# Variance of a smoothed marker over that of its noise: errors of consecutive frames are alike.
FLEXION_NOISE_VARIANCE = 2.4
ABDUCTION_NOISE_VARIANCE = 4.   # more, as digits abduct more slowly than they bend
FIST_CERTAIN = .28         # [1] of the reach in front of the joint, where the plane is certain
# Weight of what is natural, as the variance of its mean over a second [rad² s]; that of flexion at
# the average spread.
NATURAL_FLEXION_VARIANCE = 3e-4
NEUTRAL_ABDUCTION_VARIANCE = 4e-3
# Distance of the estimate from the marker: standard deviations, but never more than [m].
FLEXION_BOUND = 1.15
ABDUCTION_BOUND = .6
LARGEST_MISS = 1e-3
UNREACHABLE = 3e-3         # [m] that any angle misses the marker by, where the bound is half
BOUND_STEPS = 4            # to the angle at the bound
BOUND_SHARE = .95          # [1] of the bound that is near enough to it
FIST_MISS = 8e-4           # [m] more in a fist, where a millimetre of a marker's place is abduction
UNREACHED_NOISE = .3       # [1] of the noise that a marker beyond reach may straighten a digit by
LONGEST_STEP = .05         # [s] at which the time step is capped
FIRST_STEP = .01           # [s] that natural flexion counts for as a digit begins beyond reach
BEYOND_REACH = 1e-4        # [m] of a marker that tells nothing of the flexion
SHIFT_TIME = .5            # [s] time constant of a hidden digit's shift
REACQUISITION_VARIANCE = .05        # [rad²] where the evidence of a digit changed
LARGEST_MOTION = 1.        # [rad] that an innovation is taken for
LIKELY_STEPS = 4           # of Gauss and Newton to the likeliest flexion
LONGEST_LIKELY_STEP = .3   # [rad]
SLOPE_STEP = 1e-3          # [rad] between flexions whose reaches give a slope


class AngleFilter(NamedTuple):
    """Estimated angles of the digits.

    Attributes
    ----------
    angles : ndarray, shape (25,)
        [rad]
    variance : ndarray, shape (5, 2)
        Of each digit's abduction and second flexion [rad²].
    shift : ndarray, shape (25,)
        Of the angles from the solved ones; a hidden digit keeps it for a while [rad].
    running : ndarray of bool, shape (5,)
        Whether the digit was seen in the last frame.
    """

    angles: np.ndarray
    variance: np.ndarray
    shift: np.ndarray
    running: np.ndarray


class DigitEvidence(NamedTuple):
    """Noise and history of one frame's marker of a digit.

    Attributes
    ----------
    noise : float
        Standard deviation of the marker on an axis [m].
    step : float
        Time since the last frame; 0 if the marker was hidden there, or the stamp is repeated [s].
    begins : bool
        Whether the marker was hidden in the last frame.
    leap : float
        Additional variance of the angles after a change of the evidence [rad²].
    """

    noise: float
    step: float
    begins: bool
    leap: float


def initial_angle_filter(angles: np.ndarray) -> AngleFilter:
    """Return the `AngleFilter` before the first frame, at angles of shape (25,) [rad]."""
    return AngleFilter(angles.copy(), np.zeros((5, 2)), np.zeros(len(angles)),
                       np.zeros(5, dtype=bool))


@jit
def filter_angles(chains: Chains, roots: np.ndarray, observation: Observation, solved: np.ndarray,
                  published: np.ndarray, changed: np.ndarray, step: float,
                  state: AngleFilter) -> None:
    """Estimate the angles of the seen digits; those of hidden ones go over to the solved ones.

    Parameters
    ----------
    chains : Chains
    roots : ndarray, shape (5, 3)
        First joints of the digits, in the wrist's frame [m].
    observation : Observation
        Of the digits' smoothed markers, in the wrist's frame.
    solved : ndarray, shape (25,)
        By inverse kinematics [rad].
    published : ndarray, shape (25,)
        Of the last frame: start of a digit seen again [rad].
    changed : ndarray of bool, shape (5,)
        Digits whose evidence differs from the last frame's.
    step : float
        Time since the last frame [s].
    state : AngleFilter
        Updated.
    """
    kept = math.exp(-step / SHIFT_TIME)
    for joint in range(25):
        digit = DIGIT_OF_JOINT[joint]
        estimated = joint == ABDUCTION_JOINTS[digit] or joint == FLEXION_JOINTS[digit, 1]
        if not observation.seen[digit]:
            # As a marker vanishes nothing moves.
            state.shift[joint] *= kept
            state.angles[joint] = clamp(
                solved[joint] + state.shift[joint], chains.lower[joint], chains.upper[joint])
        elif not estimated:
            state.angles[joint] = solved[joint]
        elif not state.running[digit]:
            state.angles[joint] = published[joint]
    for digit in range(5):
        begins = not state.running[digit]
        state.running[digit] = observation.seen[digit]
        if begins:
            state.variance[digit, :] = 0.
        if observation.seen[digit]:
            measured = components(frame(chains.base[digit]), subtract(
                vector(observation.positions[digit]), vector(roots[digit])))
            marker = measured
            if not chains.is_planar[digit]:
                marker = planar_marker(chains, digit, measured, solved)
            evidence = DigitEvidence(
                observation.noise[digit], 0. if begins else min(step, LONGEST_STEP), begins,
                # A leap is blended in later: it has to be in this frame.
                REACQUISITION_VARIANCE if begins or changed[digit] else 0.)
            _estimate_abduction(chains, digit, marker, evidence, state)
            _estimate_flexion(chains, digit, marker, evidence, solved, state)
            if not chains.is_planar[digit]:
                _follow_bend(chains, digit, marker,
                             planar_marker(chains, digit, measured, state.angles), state.angles)
    for joint in range(25):
        if observation.seen[DIGIT_OF_JOINT[joint]]:
            state.shift[joint] = state.angles[joint] - solved[joint]


@jit
def observe_angle(innovation: float, slope: float, noise_variance: float, shown: float,
                  variance: float) -> tuple[float, float]:
    """Return the Kalman correction of an angle by a scalar observation, and its variance.

    Parameters
    ----------
    innovation : float
        Observed less expected [unit].
    slope : float
        Of the observation by the angle [unit/rad].
    noise_variance : float
        Of the observation [unit²].
    shown : float
        Share of the innovation taken for motion [1].
    variance : float
        Of the angle before [rad²].

    Returns
    -------
    correction, variance : float
        [rad, rad²]
    """
    moved = shown * abs(innovation)
    moved = moved / abs(slope) if moved < abs(slope) * LARGEST_MOTION else LARGEST_MOTION
    variance += moved * moved
    gain = variance * slope / (slope * slope * variance + noise_variance)
    return gain * innovation, variance * (1. - gain * slope)


@jit
def pull_angle(distance: float, mean_variance: float, step: float,
               variance: float) -> tuple[float, float]:
    """Return the correction of an angle towards a natural one, and its variance.

    Parameters
    ----------
    distance : float
        The natural angle less this one [rad].
    mean_variance : float
        Of the natural angle, as mean over a second [rad² s].
    step : float
        [s]
    variance : float
        Of the angle before [rad²].

    Returns
    -------
    correction, variance : float
        [rad, rad²]
    """
    gain = variance * step / (variance * step + mean_variance)
    return gain * distance, variance * (1. - gain)


@jit
def _estimate_abduction(chains: Chains, digit: int, marker: Vector, evidence: DigitEvidence,
                        state: AngleFilter) -> None:
    """Estimate a digit's abduction by the direction of its plane."""
    joint = ABDUCTION_JOINTS[digit]
    sign = chains.sign[digit]
    low, high = chains.turn_limits[digit]
    direction, weight, certain = plane_direction(
        marker, chains.lateral[digit], chains.length[digit], FIST_NEAR, FIST_CERTAIN, evidence.step)
    direction = clamp(direction, low, high)
    turn, variance = sign * state.angles[joint], state.variance[digit, 0]
    distance = math.hypot(marker[0], marker[1])
    if weight > 0.:
        noise = evidence.noise / (distance * weight)
        shown = weight * (1. - math.exp(-evidence.step / INNOVATION_TIME))
        correction, left = observe_angle(
            direction - turn, 1., ABDUCTION_NOISE_VARIANCE * noise * noise, shown,
            variance + evidence.leap)
        turn += correction
        variance = min(variance, left) if evidence.leap > 0. else left
    correction, variance = pull_angle(-turn, NEUTRAL_ABDUCTION_VARIANCE, evidence.step, variance)
    turn += correction
    if marker[0] > 0. and certain > 0.:
        most = (min(ABDUCTION_BOUND * evidence.noise, LARGEST_MISS)
                + FIST_MISS * (1. - certain) / certain) / distance
        turn = clamp(turn, direction - most, direction + most)
    state.variance[digit, 0] = variance
    state.angles[joint] = clamp(sign * clamp(turn, low, high), chains.lower[joint],
                                chains.upper[joint])


@jit
def _estimate_flexion(chains: Chains, digit: int, marker: Vector, evidence: DigitEvidence,
                      solved: np.ndarray, state: AngleFilter) -> None:
    """Estimate a digit's second flexion by its reach; aim the first at the marker."""
    first, second, third = FLEXION_JOINTS[digit]
    hinges = chains.hinges[digit]
    linkage = linkage_of(chains, digit)
    if hinges == 3:
        # Where the third bends on alone it keeps what it has beyond the coupling.
        beyond = solved[third] - coupled_angle(linkage, solved[second])
        linkage = Linkage(linkage.bones, linkage.droop, linkage.lower, linkage.upper,
                          linkage.slope, linkage.offset + beyond, hinges)
    turn = chains.sign[digit] * state.angles[ABDUCTION_JOINTS[digit]]
    target = in_plane(marker, turn, chains.tilt[digit])
    natural = natural_flexion_of(chains, digit)
    found = solved[second]
    if chains.skin[digit] > 0.:
        found = _likely_flexion(linkage, target, found, natural, chains.skin[digit])
    angle, variance = state.angles[second], state.variance[digit, 1]
    straight = chains.start[digit] if hinges == 3 else -linkage.droop
    before = angle

    reach_found = chain_reach(linkage, found)
    reach_before = chain_reach(linkage, angle)
    beyond_reach = math.hypot(target[0], target[1]) - reach_found
    begins_blind = evidence.begins and beyond_reach > BEYOND_REACH
    crossed = (angle - straight) * (found - straight) < 0.
    if crossed:
        # Bent to the other side: the distance of the reaches says nothing of the way.
        slope = _slope(linkage, found)
        innovation = slope * (found - angle)
    else:
        slope = ((reach_found - reach_before) / (found - angle)
                 if abs(found - angle) > SLOPE_STEP else _slope(linkage, angle))
        unreached = UNREACHED_NOISE * evidence.noise
        innovation = reach_found - reach_before + clamp(beyond_reach, -unreached, unreached)
    correction, left = observe_angle(
        innovation, slope, FLEXION_NOISE_VARIANCE * evidence.noise * evidence.noise,
        1. - math.exp(-evidence.step / INNOVATION_TIME), variance + evidence.leap)
    variance = min(variance, left) if evidence.leap > 0. and not begins_blind else left
    bent = angle + found >= 2. * straight    # where one is straight, the other decides
    angle += correction
    aim = max(_aim(linkage, target, angle)[0], natural.least)
    usual = natural.offset + natural.slope * aim
    looseness = natural.spread / AVERAGE_SPREAD
    correction, variance = pull_angle(
        usual - angle, NATURAL_FLEXION_VARIANCE * looseness * looseness,
        FIRST_STEP if begins_blind else evidence.step, variance)
    angle += correction
    if not crossed:
        angle = max(angle, straight) if bent else min(angle, straight)
    angle = clamp(angle, linkage.lower[1], linkage.upper[1])
    state.variance[digit, 1] = variance

    # The measurement bounds the estimate.
    least = _aim(linkage, target, found)[1]
    aim, miss = _aim(linkage, target, angle)
    excess = miss - least
    most = min(FLEXION_BOUND * evidence.noise, LARGEST_MISS) / (1. + (least / UNREACHABLE) ** 2)
    if excess > most:
        # False position between the found angle, within the bound, and the free one.
        inside, excess_inside, outside, free = 0., 0., 1., angle
        for _ in range(BOUND_STEPS):
            share = inside + (outside - inside) * (
                BOUND_SHARE * most - excess_inside) / (excess - excess_inside)
            aim, miss = _aim(linkage, target, found + share * (free - found))
            if miss - least > most:
                outside, excess = share, miss - least
            else:
                inside, excess_inside = share, miss - least
                if excess_inside > (2. * BOUND_SHARE - 1.) * most:
                    break
        angle = found + inside * (free - found)
        aim, _ = _aim(linkage, target, angle)
    farthest = MAX_SECOND_HINGE_SPEED * evidence.step
    two_bends = straight > max(linkage.lower[1], 0.)
    if two_bends and abs(angle - before) > farthest > 0.:
        # Two bends may fit alike: from one to the other without a leap.
        angle = before + math.copysign(farthest, angle - before)
        aim, _ = _aim(linkage, target, angle)
    state.angles[first] = aim
    state.angles[second] = angle
    state.angles[third] = coupled_angle(linkage, angle)


@jit
def _follow_bend(chains: Chains, digit: int, before: Vector, after: Vector,
                 angles: np.ndarray) -> None:
    """Correct abduction and first flexion for the shift of the planar marker by a new bend."""
    abduction, first = ABDUCTION_JOINTS[digit], FLEXION_JOINTS[digit, 0]
    turn = math.atan2(after[1], after[0]) - math.atan2(before[1], before[0])
    aim = (flexion_of(math.hypot(after[0], after[1]), after[2])
           - flexion_of(math.hypot(before[0], before[1]), before[2]))
    angles[abduction] = clamp(angles[abduction] + chains.sign[digit] * turn,
                              chains.lower[abduction], chains.upper[abduction])
    angles[first] = clamp(angles[first] + aim, chains.lower[first], chains.upper[first])


@jit
def _likely_flexion(linkage: Linkage, target: tuple[float, float], found: float,
                    natural: NaturalFlexion, skin: float) -> float:
    """Return the likeliest second flexion by uncertain reach and natural flexion (MAP).

    Parameters
    ----------
    linkage, target
        Of the digit.
    found : float
        Second flexion of exactly this reach [rad].
    natural : NaturalFlexion
    skin : float
        Standard deviation of the reach [m].

    Returns
    -------
    float
        [rad]
    """
    wanted = math.hypot(target[0], target[1])
    angle = found
    for _ in range(LIKELY_STEPS):
        by_reach = _slope(linkage, angle) / skin
        shortage = (wanted - chain_reach(linkage, angle)) / skin
        aim = _aim(linkage, target, angle)[0]
        # The line without its bend at `least`, which would add to the noise.
        unnatural = (natural.offset + natural.slope * aim - angle) / natural.spread
        ahead = _aim(linkage, target, angle + SLOPE_STEP)[0]
        by_nature = (1. - natural.slope * (ahead - aim) / SLOPE_STEP) / natural.spread
        step = (by_reach * shortage + by_nature * unnatural) / (
            by_reach * by_reach + by_nature * by_nature)
        angle = clamp(angle + clamp(step, -LONGEST_LIKELY_STEP, LONGEST_LIKELY_STEP),
                      linkage.lower[1], linkage.upper[1])
    return angle


@jit
def _slope(linkage: Linkage, angle2: float) -> float:
    """Return the derivative of the reach by the second flexion [m/rad]."""
    half = .5 * SLOPE_STEP
    return (chain_reach(linkage, angle2 + half)
            - chain_reach(linkage, angle2 - half)) / SLOPE_STEP


@jit
def _aim(linkage: Linkage, target: tuple[float, float],
         angle2: float) -> tuple[float, float]:
    """Return the first flexion to aim a chain at the target, and the end's distance from it."""
    along, height = target
    x, y = chain_end(linkage, angle2)
    return aim_end(along, height, linkage, x, y)
