"""Named natural motions, each the same again for the same seed, at any rate.

They differ in what they ask of a tracker: spelling and grasps in shape, typing and piano in
speed of single fingers, shaking in speed of the whole hand, rest in calm.
"""

import numpy as np

from ..core.errors import HandTrackerError
from ..core.model.hand import DIGITS, JOINTS
from .gestures import GRASPS, LETTERS, REST, grasp_shape, shape_angles
from .layers import LayeredMotion, Strokes, Tremor, finger_stroke
from .motion import Motion, Sway, demo_motion

DURATION = 20.                      # [s]
DURATION_RANGE = (1., 3600.)        # [s]
RATE_RANGE = (1., 960.)             # [Hz]

# Unsourced: where and how the hand drifts while it does something [m, degrees].
CENTRE = (0., 0., 1.10, 0., -25., 0.)
DRIFT = (.05, .05, .03, 14., 10., 14.)
SHAKE = (.035, .045, .030, 16., 14., 12.)
SHAKE_RATE = (3., 5.5)              # [Hz]
# Rest tremor of Parkinson's disease is at 4 to 6 Hz, thumb against fingers (pill rolling).
TREMOR_RATE = (4., 6.)              # [Hz]
TREMOR_DEGREES = 2.5                # of the MCP joints
TREMOR_WRIST = (.0008, .0008, .0012, 1.2, .5, .5)


class UnknownMotion(HandTrackerError, ValueError):
    """There is no such motion, or not of this duration."""


def motion_named(name, hand, seed=1, duration=DURATION):
    """Return a motion.

    Parameters
    ----------
    name : str
        One of `MOTIONS`.
    hand : Hand
    seed : int
        Not used by 'demo'.
    duration : float
        The motion lasts at least so long, to the end of its last movement; 'demo' has its
        own [s].

    Returns
    -------
    Motion or LayeredMotion
        With `duration` and `sample(times)`.

    Raises
    ------
    UnknownMotion
        Naming what there is.
    """
    if name not in MOTIONS:
        raise UnknownMotion(f'motion: {name!r} is not one of {", ".join(MOTIONS)}')
    lowest, highest = DURATION_RANGE
    if not lowest <= duration <= highest:
        raise UnknownMotion(f'duration: {duration:g} s; allowed is {lowest:g} to {highest:g} s')
    # RandomState's streams are frozen for good; those of default_rng may change with numpy.
    return MOTIONS[name](hand, duration, np.random.RandomState(seed))


def drifting(random, strength=1.):
    """Return a slow seeded sway about the centre of the cameras' view."""
    unit = np.concatenate((np.ones(3), np.radians(np.ones(3))))
    period = random.uniform(7., 9.)
    amplitude = strength * np.outer((.6, .3, .1), DRIFT) * random.uniform(.7, 1.3, (3, 6))
    return Sway(period, CENTRE * unit, amplitude * unit, random.uniform(0., 2. * np.pi, (3, 6)))


def through(keys, hand, sway):
    """Return the motion through hand shapes.

    Parameters
    ----------
    keys : sequence of (shape, float, float, float or ndarray of shape (5,))
        A shape, the durations of the movement to it and of the rest in it, and by how much
        later each digit moves [s].
    hand : Hand
    sway : Sway

    Returns
    -------
    Motion
    """
    times, angles, clock = [], [], 0.
    for i, (shape, move, hold, delays) in enumerate(keys):
        delays = np.broadcast_to(delays, len(DIGITS)) * (i > 0)
        if i:
            times[-1] = times[-1] + delays
        arrival = clock + delays + move * (i > 0)
        clock = arrival.max() + hold
        times += [arrival, np.full(len(DIGITS), clock)]
        angles += [shape_angles(shape, hand)] * 2
    return Motion(np.array(times), np.array(angles), sway)


def spelling(hand, duration, random):
    """Spell: one hand shape after the other, some three in two seconds."""
    keys, clock, last = [(REST, 0., .2, 0.)], 0., None
    while clock < duration:
        letter = random.choice([name for name in LETTERS if name != last])
        move, hold = random.uniform(.22, .40), random.uniform(.12, .35)
        delays = random.uniform(0., .05, len(DIGITS))
        keys.append((LETTERS[letter], move, hold, delays))
        clock, last = clock + move + hold + delays.max(), letter
    return LayeredMotion(through(keys, hand, drifting(random)), hand)


def grasping(kind):
    """Return the motion of grasping objects of changing size in one way."""
    def grasps(hand, duration, random):
        keys, clock = [(REST, 0., .3, 0.)], 0.
        while clock < duration:
            # The hand opens wider than the object on its way there, then closes.
            for shape, move, hold in (
                    (GRASPS[kind][0], random.uniform(.4, .6), random.uniform(.05, .15)),
                    (grasp_shape(kind, random.uniform()), random.uniform(.35, .6),
                     random.uniform(.5, 1.2)),
                    (GRASPS[kind][0], random.uniform(.25, .4), 0.),
                    (REST, random.uniform(.4, .6), random.uniform(.1, .4))):
                delays = random.uniform(0., .06, len(DIGITS))
                keys.append((shape, move, hold, delays))
                clock += move + hold + delays.max()
        return LayeredMotion(through(keys, hand, drifting(random, 1.2)), hand)
    return grasps


def striking(posture, pause, height, pattern, strength):
    """Return the motion of fingers that strike one after the other.

    Parameters
    ----------
    posture : (fingers, thumb)
        [degrees]
    pause : (float, float)
        Between two strokes' starts [s].
    height : (float, float)
        Of the MCP's flexion [degrees].
    pattern : callable
        Draws the next run of digits from a RandomState.
    strength : float
        Of the drift.
    """
    def strikes(hand, duration, random):
        sway = drifting(random, strength)
        starts, rises, stays, falls, changes = [], [], [], [], []
        clock, last = .3, None
        while clock < duration:
            for digit in pattern(random):
                # A finger comes back before it strikes again.
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
        base = through([(posture, 0., max(duration, end), 0.)], hand, sway)
        return LayeredMotion(base, hand, strokes)
    return strikes


def scattered(random):
    """Return the digits of some typed word: the thumb is for the space after it."""
    return [*random.choice(4, random.randint(2, 8), p=(.35, .3, .2, .15)), 4]


def passage(random):
    """Return the digits of a scale, an arpeggio or a trill on a keyboard."""
    scale = [4, 0, 1, 2, 3]
    runs = (scale + scale[-2::-1], [4, 0, 1, 3, 1, 0], [1, 2] * 4, [4, 1, 0, 2, 1, 3])
    return runs[random.randint(len(runs))]


def shaking(hand, duration, random):
    """Shake the whole hand as one shakes off water, the fingers loose."""
    base_rate = random.uniform(*SHAKE_RATE)
    unit = np.concatenate((np.ones(3), np.radians(np.ones(3))))
    # Harmonic 1 is a slow drift, harmonic 8 the shaking itself.
    amplitude = np.zeros((8, 6))
    amplitude[0] = .4 * np.array(DRIFT)
    amplitude[7] = SHAKE * random.uniform(.6, 1., 6)
    sway = Sway(8. / base_rate, CENTRE * unit, amplitude * unit,
                random.uniform(0., 2. * np.pi, (8, 6)))
    loose = np.zeros((1, len(JOINTS)))
    for j, joint in enumerate(JOINTS):
        loose[0, j] = np.radians(6. if joint.endswith('mcp_flexion') else
                                 4. if joint.endswith('pip_flexion') else 0.)
    phase = np.repeat(random.uniform(0., .6, len(DIGITS)), 5)[None]
    return LayeredMotion(through([(REST, 0., duration, 0.)], hand, sway), hand,
                         tremor=Tremor(np.array([base_rate]), loose, phase))


def resting(hand, duration, random):
    """Rest with a tremor of 4 to 6 Hz, the thumb against the fingers."""
    unit = np.concatenate((np.ones(3), np.radians(np.ones(3))))
    # Three near frequencies beat: the tremor swells and ebbs.
    rates = np.sort(random.uniform(*TREMOR_RATE, 3))
    shares = np.array((.3, .5, .2))
    per_joint = np.zeros(len(JOINTS))
    for j, joint in enumerate(JOINTS):
        per_joint[j] = {'mcp_flexion': 1., 'pip_flexion': .8, 'cmc_flexion': .8,
                        'mcp_abduction': .2}.get(joint.partition('_')[2], 0.) * (
                            0. if 'cmc' in joint and 'thumb' not in joint else 1.)
    along = np.repeat((0., .2, .4, .6, np.pi), 5)
    amplitude = np.radians(TREMOR_DEGREES) * np.outer(shares, per_joint)
    phase = random.uniform(0., 2. * np.pi, (3, 1)) + along
    # The wrist's tremor is at whole harmonics of two seconds: 4, 4.5, 5, ... Hz.
    wrist = np.zeros((12, 6))
    wrist[7:12] = np.outer((.2, .3, .3, .15, .05), TREMOR_WRIST)
    wrist[0] = .05 * np.array(DRIFT)
    sway = Sway(2., CENTRE * unit, wrist * unit, random.uniform(0., 2. * np.pi, wrist.shape))
    return LayeredMotion(through([(REST, 0., duration, 0.)], hand, sway), hand,
                         tremor=Tremor(rates, amplitude, phase))


# Name: what makes it of (hand, duration, random).
MOTIONS = {
    'demo': lambda hand, duration, random: demo_motion(hand),
    'spelling': spelling,
    'power_grasp': grasping('power'),
    'precision_grasp': grasping('precision'),
    'lateral_grasp': grasping('lateral'),
    'typing': striking(REST, (.09, .22), (10., 22.), scattered, .35),
    'piano': striking(REST, (.10, .18), (14., 28.), passage, .5),
    'shaking': shaking,
    'tremor': resting,
}
