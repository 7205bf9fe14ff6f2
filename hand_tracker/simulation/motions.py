"""Named hand motions, reproducible by seed and independent of the sampling rate.

Fingerspelling and grasps vary the hand's shape, typing and piano move single fingers fast,
shaking moves the whole hand fast, rest tremor tests the tracker's stability, and the range of
motion is what a calibration asks for.
"""

import math
from collections.abc import Callable, Iterable

import numpy as np

from ..core.errors import HandTrackerError
from ..core.model.hand import DIGITS, JOINTS, Hand
from .gestures import GRASPS, LETTER_SHAPES, REST_SHAPE, Shape, grasp_shape, shape_angles
from .layers import LayeredMotion, Strokes, Tremor, finger_stroke
from .motion import SI_OF_SWAY, Keyframe, Motion, Sway, demo_motion, motion_through
from .motion_names import MOTION_DURATION
from .range_of_motion import range_of_motion

HandMotion = Motion | LayeredMotion
MotionMaker = Callable[[Hand, float, np.random.RandomState], HandMotion]

DURATION_RANGE = (1., 3600.)        # [s]
FRAME_RATE_RANGE = (1., 960.)             # [Hz]

# Pose and movement of the wrist: x, y, z [m], roll, pitch, yaw [degrees]; unsourced.
WRIST_CENTRE = np.array((0., 0., 1.10, 0., -25., 0.))
WRIST_DRIFT = np.array((.05, .05, .03, 14., 10., 14.))
WRIST_SHAKE = np.array((.035, .045, .030, 16., 14., 12.))
SHAKE_RATE = (3., 5.5)              # [Hz]
# Parkinsonian rest tremor: 4 to 6 Hz, thumb against fingers (pill rolling).
TREMOR_RATE = (4., 6.)              # [Hz]
FINGER_TREMOR = 2.5                 # [degrees] of the MCP joints
WRIST_TREMOR = (.0008, .0008, .0012, 1.2, .5, .5)


class UnknownMotion(HandTrackerError, ValueError):
    """Unknown name of a motion, or a duration out of range."""


def motion_named(name: str, hand: Hand, seed: int | tuple[int, ...] = 1,
                 duration: float = MOTION_DURATION) -> HandMotion:
    """Return a named motion of a hand.

    Parameters
    ----------
    name : str
        One of `MOTIONS`.
    hand : Hand
    seed : int
        Of the random movements; 'demo' has none.
    duration : float
        Least duration: the motion ends with its last movement. 'demo' has its own [s].

    Returns
    -------
    Motion or LayeredMotion
        With `duration` and `sample(times)`.

    Raises
    ------
    UnknownMotion
        Naming the known motions, or the allowed durations.
    """
    if name not in MOTIONS:
        raise UnknownMotion(f'motion: {name!r} is not one of {", ".join(MOTIONS)}')
    lowest, highest = DURATION_RANGE
    if not lowest <= duration <= highest:
        raise UnknownMotion(f'duration: {duration:g} s; allowed is {lowest:g} to {highest:g} s')
    # RandomState's streams are frozen for good; those of default_rng may change with numpy.
    return MOTIONS[name](hand, duration, np.random.RandomState(seed))


def _slow_sway(random: np.random.RandomState, strength: float = 1.) -> Sway:
    """Return a random slow sway of the wrist about the cameras' view, scaled by `strength` [1]."""
    period = random.uniform(7., 9.)
    amplitude = strength * np.outer((.6, .3, .1), WRIST_DRIFT) * random.uniform(.7, 1.3, (3, 6))
    return Sway(period, WRIST_CENTRE * SI_OF_SWAY, amplitude * SI_OF_SWAY,
                random.uniform(0., 2. * np.pi, (3, 6)))


def _resting_motion(shape: Shape, duration: float, hand: Hand, sway: Sway) -> Motion:
    """Return a motion that rests in one hand shape for `duration` [s]."""
    return motion_through([Keyframe(shape_angles(shape, hand), 0., duration)], sway)


def spelling(hand: Hand, duration: float, random: np.random.RandomState) -> LayeredMotion:
    """Return fingerspelling for `duration` [s]: random letters, about three in two seconds."""
    keys, clock, last = [Keyframe(shape_angles(REST_SHAPE, hand), 0., .2)], 0., None
    while clock < duration:
        letter = random.choice([name for name in LETTER_SHAPES if name != last])
        move, hold = random.uniform(.22, .40), random.uniform(.12, .35)
        delays = random.uniform(0., .05, len(DIGITS))
        keys.append(Keyframe(shape_angles(LETTER_SHAPES[letter], hand), move, hold, delays))
        clock, last = clock + move + hold + delays.max(), letter
    return LayeredMotion(motion_through(keys, _slow_sway(random)), hand)


def _grasping(kind: str) -> MotionMaker:
    """Return the maker of a motion that repeats a grasp on objects of random size.

    Parameters
    ----------
    kind : {'power', 'precision', 'lateral'}
    """
    def grasps(hand: Hand, duration: float, random: np.random.RandomState) -> LayeredMotion:
        keys, clock = [Keyframe(shape_angles(REST_SHAPE, hand), 0., .3)], 0.
        while clock < duration:
            # The preshaped hand opens wider than the object, then closes on it.
            for shape, move, hold in (
                    (GRASPS[kind][0], random.uniform(.4, .6), random.uniform(.05, .15)),
                    (grasp_shape(kind, random.uniform()), random.uniform(.35, .6),
                     random.uniform(.5, 1.2)),
                    (GRASPS[kind][0], random.uniform(.25, .4), 0.),
                    (REST_SHAPE, random.uniform(.4, .6), random.uniform(.1, .4))):
                delays = random.uniform(0., .06, len(DIGITS))
                keys.append(Keyframe(shape_angles(shape, hand), move, hold, delays))
                clock += move + hold + delays.max()
        return LayeredMotion(motion_through(keys, _slow_sway(random, 1.2)), hand)
    return grasps


def _striking(posture: Shape, pause: tuple[float, float], height: tuple[float, float],
              pattern: Callable[[np.random.RandomState], Iterable[int]],
              strength: float) -> MotionMaker:
    """Return the maker of a motion of single-finger strokes, as on a keyboard.

    Parameters
    ----------
    posture : (fingers, thumb)
        Hand shape between strokes [degrees].
    pause : (float, float)
        Least and greatest time between the starts of two strokes [s].
    height : (float, float)
        Least and greatest flexion of the MCP [degrees].
    pattern : callable
        Draws the next run of digits from a RandomState.
    strength : float
        Scale of the wrist's sway [1].
    """
    def strikes(hand: Hand, duration: float, random: np.random.RandomState) -> LayeredMotion:
        sway = _slow_sway(random, strength)
        starts: list[float] = []
        rises, stays, falls, changes = [], [], [], []
        clock, last = .3, None
        while clock < duration:
            for digit in pattern(random):
                # A finger has returned before it strikes again.
                clock = clock + random.uniform(*pause) + (.12 if digit == last else 0.)
                mcp = np.radians(random.uniform(*height))
                starts.append(clock)
                rises.append(random.uniform(.055, .09))
                stays.append(random.uniform(.01, .06))
                falls.append(random.uniform(.07, .12))
                changes.append(finger_stroke(digit, mcp, .5 * mcp))
                last = digit
        strokes = Strokes(*(np.array(part) for part in (starts, rises, stays, falls, changes)))
        end = starts[-1] + rises[-1] + stays[-1] + falls[-1]
        base = _resting_motion(posture, max(duration, end), hand, sway)
        return LayeredMotion(base, hand, strokes)
    return strikes


def _typed_digits(random: np.random.RandomState) -> list[int]:
    """Return the digits of a random typed word, fingers and then the thumb for the space."""
    return [*random.choice(4, random.randint(2, 8), p=(.35, .3, .2, .15)), 4]


def _piano_digits(random: np.random.RandomState) -> list[int]:
    """Return the digits of a random scale, arpeggio or trill on a keyboard."""
    scale = [4, 0, 1, 2, 3]
    runs = (scale + scale[-2::-1], [4, 0, 1, 3, 1, 0], [1, 2] * 4, [4, 1, 0, 2, 1, 3])
    return runs[random.randint(len(runs))]


def shaking(hand: Hand, duration: float, random: np.random.RandomState) -> LayeredMotion:
    """Return fast shaking of the hand with passively moving fingers, for `duration` [s]."""
    base_rate = random.uniform(*SHAKE_RATE)
    # Harmonic 1 is a slow drift, harmonic 8 the shaking itself.
    amplitude = np.zeros((8, 6))
    amplitude[0] = .4 * WRIST_DRIFT
    amplitude[7] = WRIST_SHAKE * random.uniform(.6, 1., 6)
    sway = Sway(8. / base_rate, WRIST_CENTRE * SI_OF_SWAY, amplitude * SI_OF_SWAY,
                random.uniform(0., 2. * np.pi, (8, 6)))
    loose = np.zeros((1, len(JOINTS)))
    for j, joint in enumerate(JOINTS):
        loose[0, j] = np.radians(6. if joint.endswith('mcp_flexion') else
                                 4. if joint.endswith('pip_flexion') else 0.)
    phase = np.repeat(random.uniform(0., .6, len(DIGITS)), 5)[None]
    return LayeredMotion(_resting_motion(REST_SHAPE, duration, hand, sway), hand,
                         tremor=Tremor(np.array([base_rate]), loose, phase))


def _rest_tremor(hand: Hand, duration: float, random: np.random.RandomState) -> LayeredMotion:
    """Return rest with a tremor of 4 to 6 Hz, thumb against fingers, for `duration` [s]."""
    # Three close frequencies beat, so that the amplitude varies.
    rates = np.sort(random.uniform(*TREMOR_RATE, 3))
    shares = np.array((.3, .5, .2))
    per_joint = np.zeros(len(JOINTS))
    for j, joint in enumerate(JOINTS):
        per_joint[j] = {'mcp_flexion': 1., 'pip_flexion': .8, 'cmc_flexion': .8,
                        'mcp_abduction': .2}.get(joint.partition('_')[2], 0.) * (
                            0. if 'cmc' in joint and 'thumb' not in joint else 1.)
    along = np.repeat((0., .2, .4, .6, np.pi), 5)
    amplitude = np.radians(FINGER_TREMOR) * np.outer(shares, per_joint)
    phase = random.uniform(0., 2. * np.pi, (3, 1)) + along
    # The wrist's tremor is at whole harmonics of two seconds: 4, 4.5, 5, ... Hz.
    wrist = np.zeros((12, 6))
    wrist[7:12] = np.outer((.2, .3, .3, .15, .05), WRIST_TREMOR)
    wrist[0] = .05 * WRIST_DRIFT
    sway = Sway(2., WRIST_CENTRE * SI_OF_SWAY, wrist * SI_OF_SWAY,
                random.uniform(0., 2. * np.pi, wrist.shape))
    return LayeredMotion(_resting_motion(REST_SHAPE, duration, hand, sway), hand,
                         tremor=Tremor(rates, amplitude, phase))


def _ranging(hand: Hand, duration: float, random: np.random.RandomState) -> LayeredMotion:
    """Return the range-of-motion sequence of a calibration, repeated to last `duration` [s]."""
    once = list(range_of_motion(hand))
    lasts = sum(key.move + key.hold for key in once) - once[0].move
    rounds = math.ceil(duration / lasts)
    return LayeredMotion(motion_through(once * rounds, _slow_sway(random)), hand)


# Name: maker, a function of (hand, duration [s], random state).
MOTIONS: dict[str, MotionMaker] = {
    'demo': lambda hand, duration, random: demo_motion(hand),
    'spelling': spelling,
    'power_grasp': _grasping('power'),
    'precision_grasp': _grasping('precision'),
    'lateral_grasp': _grasping('lateral'),
    'typing': _striking(REST_SHAPE, (.09, .22), (10., 22.), _typed_digits, .35),
    'piano': _striking(REST_SHAPE, (.10, .18), (14., 28.), _piano_digits, .5),
    'shaking': shaking,
    'tremor': _rest_tremor,
    'range_of_motion': _ranging,
}
