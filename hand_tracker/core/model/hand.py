"""Model of a person's hand: 25 revolute joints, their limits, axes and bone lengths.

The one source of joint names, link names, axes, limits and lengths: kinematics, URDF, node
parameters and documents derive from it.

A `Hand` is always given as a right hand: x distal (wrist to middle MCP), y towards the thumb,
z dorsal, in metres. `side` says whether it is mirrored.
"""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InvalidHand

FINGERS = ('index', 'middle', 'ring', 'little')
DIGITS = FINGERS + ('thumb',)
SIDES = ('right', 'left')
BOTH = 'both'  # sides at once, where a side is asked for
OTHER_SIDE = {'right': 'left', 'left': 'right'}
LEFT_HAND_MIRROR = np.array((1., -1., 1.))  # signs of the axes, of a left hand against a right

# Along the chain: abduction precedes flexion, so that one plane through the
# abduction axis holds all the flexion of a digit (the paper's planes Φi).
FINGER_JOINTS = ('cmc_flexion', 'mcp_abduction', 'mcp_flexion', 'pip_flexion', 'dip_flexion')
THUMB_JOINTS = ('cmc_abduction', 'cmc_flexion', 'mcp_abduction', 'mcp_flexion', 'ip_flexion')
FINGER_LINKS = ('metacarpal', 'knuckle', 'proximal', 'middle', 'distal')
THUMB_LINKS = ('saddle', 'metacarpal', 'knuckle', 'proximal', 'distal')

JOINTS = tuple(f'{finger}_{joint}' for finger in FINGERS for joint in FINGER_JOINTS) + tuple(
    f'thumb_{joint}' for joint in THUMB_JOINTS)
LINKS = tuple(f'{finger}_{link}' for finger in FINGERS for link in FINGER_LINKS) + tuple(
    f'thumb_{link}' for link in THUMB_LINKS)
ROOT = 'wrist'

# Joints that rest unless a layout shows them, as eight markers do not: at zero, the thumb's as the
# hand says.
RESTING_JOINTS = *(f'{finger}_cmc_flexion' for finger in FINGERS), 'thumb_mcp_abduction'

# Rows of `JOINTS`: abduction of each digit, (5,), its three flexions, (5, 3), CMC flexion of each
# finger, (4,). Digit of each joint, (25,).
ABDUCTION_JOINTS = np.array([JOINTS.index(
    'thumb_cmc_abduction' if digit == 'thumb' else f'{digit}_mcp_abduction')
    for digit in DIGITS])
FLEXION_JOINTS = np.array([[JOINTS.index(f'{digit}_{joint}_flexion') for joint in (
    ('cmc', 'mcp', 'ip') if digit == 'thumb' else ('mcp', 'pip', 'dip'))]
    for digit in DIGITS])
CMC_JOINTS = np.array([JOINTS.index(f'{finger}_cmc_flexion') for finger in FINGERS])
DIGIT_OF_JOINT = np.array([DIGITS.index(joint.split('_')[0]) for joint in JOINTS])

# [degrees] (extension, flexion) and (adduction, abduction) of each kind of joint.
# paper: Table 1. The finger CMC's have no entry there: the paper's palm is flat.
# wide: the ranges of motion of the AAOS where they exceed Table 1. Ours, from recorded grasps,
# unsourced: finger abduction, PIP to 115, thumb CMC flexion, thumb MCP and IP.
LIMIT_TABLES = {
    'paper': {
        'cmc_flexion': (0, 0), 'mcp_abduction': (-15, 15), 'mcp_flexion': (-10, 85),
        'pip_flexion': (-10, 95), 'dip_flexion': (-10, 90),
        'thumb_cmc_abduction': (-40, 30), 'thumb_cmc_flexion': (-20, 20),
        'thumb_mcp_abduction': (-10, 10), 'thumb_mcp_flexion': (-5, 30),
        'thumb_ip_flexion': (-10, 95),
    },
    'wide': {
        'cmc_flexion': (0, 0), 'mcp_abduction': (-25, 25), 'mcp_flexion': (-45, 90),
        'pip_flexion': (-10, 115), 'dip_flexion': (-10, 90),
        'thumb_cmc_abduction': (-40, 70), 'thumb_cmc_flexion': (-45, 45),
        'thumb_mcp_abduction': (-10, 10), 'thumb_mcp_flexion': (-10, 60),
        'thumb_ip_flexion': (-15, 95),
    },
}
WEARER_LIMITS = 'wearer'  # Table 1, widened to the range of motion that a calibration has seen
LIMIT_PRESETS = (*LIMIT_TABLES, WEARER_LIMITS)

# [degrees] of the fingers' CMC joints where markers show the palm's arch, from a palm that is
# nearly flat: about the ranges of El-shennawy et al. (2001), 11, 7, 20 and 27, with a margin.
ARCH_LIMITS = ((-4, 8), (-4, 4), (-6, 20), (-8, 35))

# Relative to the hand's length [1] and breadth [1]: Buchholz et al., Ergonomics 35 (1992).
FINGER_BONES_OF_LENGTH = (
    (.245, .143, .097), (.266, .170, .108), (.244, .165, .107), (.204, .117, .093))
THUMB_BONES_OF_LENGTH = (.251, .196, .158)
MCP_OF_LENGTH = (.447, .446, .409, .368)
MCP_OF_BREADTH = (.251, 0., -.206, -.402)
# Unsourced: CMC joints, and the dorsal arch of the knuckles.
CMC_OF_LENGTH = .12
CMC_OF_MCP_BREADTH = .5
ARCH_OF_LENGTH = (-.015, 0., -.008, -.03)
THUMB_CMC_OF_LENGTH = (.075, .09, -.055)
# Unsourced: the thumb's saddle joint, for a relaxed thumb beside the palm.
THUMB_ABDUCTION_AXIS = (-.60, .79, .10)
THUMB_REST_DIRECTION = (.82, .37, -.44)

# Unsourced: radii of the capsules around the three bones [m], at `MEAN_LENGTH`.
CAPSULE_RADII = ((.009, .008, .007),) * 3 + ((.0075, .0065, .0055), (.011, .010, .009))
PALM_CAPSULE_RADIUS = .011
MEAN_LENGTH = .185   # [m]
MEAN_BREADTH = .085  # [m]

# Slope and offset [1, rad] of the fingers' DIP against their PIP.
# paper: its section on intradigital correlation. natural: ours, from captured hands that handle
# objects, whose tips 0.8 misses by 11.6 mm and 0.4 by 8.4; a smaller slope would fit them better,
# but no fist. Others: 2/3 commonly, 0.70 in cadavers. A line errs by 6 to 18 degrees in
# manipulation, Roda-Sales et al. (2022).
COUPLING_PRESETS = {'natural': (.4, 0.), 'paper': (.8, 0.)}
THUMB_COUPLING = (1., 0.)      # IP against MCP, in each preset; ours

# [degrees] of the last joint from its coupling, beside the errors of Roda-Sales et al.; ours.
USUAL_COUPLING_SPREAD = 12

# [degrees] of a relaxed hand: MCP and PIP of the fingers, CMC abduction and flexion, MCP
# abduction and flexion of the thumb. Fingers flex in all joints, PIP most (Lee & Jung, Int. J.
# Occup. Saf. Ergon. 20 (2014)), and more from index to little (Varghese et al., J. Clin. Diagn.
# Res. 14 (2020)); the amounts, and the thumb, are ours, near the medians of captured hands.
RELAXED_FINGERS = ((15, 25), (20, 30), (20, 35), (25, 35))
RELAXED_THUMB = (10, 5, 0, 10)
# [degrees] of the second flexion from the natural one beside the first; ours.
NATURAL_FLEXION_SPREAD = 20

# Shape of each array and number of a hand.
HAND_SHAPES: dict[str, tuple[int, ...]] = {
    'finger_cmc': (4, 3), 'finger_mcp': (4, 3), 'finger_bones': (4, 3), 'thumb_cmc': (3,),
    'thumb_bones': (3,), 'thumb_abduction_axis': (3,), 'thumb_rest_direction': (3,),
    'finger_abduction_axes': (4, 3), 'splay': (4,), 'phalanx_deviation': (4,), 'limits': (25, 2),
    'range_of_motion': (25, 2), 'coupling': (5, 2), 'coupling_spread': (5,),
    'natural_flexion': (5, 3), 'palm_synergy': (4,), 'radii': (5, 3), 'palm_radius': (),
    'thumb_mcp_abduction': (), 'thumb_roll': (), 'thumb_axis_distance': ()}
LENGTH_RANGE = (.005, .2)      # [m] of one bone
POSITION_RANGE = .3            # [m] of a joint from the wrist
ANGLE_RANGE = np.pi            # [rad] of a limit
SLOPE_RANGE = (0., 5.)         # [1] of a coupling
COUPLING_OFFSET_RANGE = (-np.pi / 2, np.pi / 2)  # [rad]
COUPLING_SPREAD_RANGE = (np.pi / 90, np.pi / 2)  # [rad]
# To the ends of the CMC joints' ranges at 85 degrees of MCP flexion, El-shennawy et al. (2001) [1].
PALM_SYNERGY = (0., 0., .2, .3)
PALM_SYNERGY_RANGE = (0., .6)
NATURAL_SLOPE_RANGE = (-2., 5.)                  # [1] of a natural flexion
NATURAL_OFFSET_RANGE = (-np.pi / 2, np.pi / 2)   # [rad]
NATURAL_SPREAD_RANGE = (np.pi / 90, np.pi / 2)   # [rad]
RADIUS_RANGE = (.001, .05)     # [m] of a capsule
SPLAY_RANGE = np.pi / 4        # [rad] to either side
PHALANX_DEVIATION_RANGE = np.pi / 9              # [rad] to either side
THUMB_MCP_ABDUCTION_RANGE = (-np.pi / 4, np.pi / 4)  # [rad]
THUMB_ROLL_RANGE = (-np.pi / 2, np.pi / 2)           # [rad]
THUMB_AXIS_DISTANCE_RANGE = (0., .03)                # [m]
HAND_LENGTH_RANGE = (.10, .26)   # [m]
HAND_BREADTH_RANGE = (.04, .14)  # [m]


def joint_kind(joint: str) -> str:
    """Return the key of `joint` in the limit presets: fingers share theirs."""
    digit, _, kind = joint.partition('_')
    return joint if digit == 'thumb' else kind


def preset_limits(preset: str = 'paper', range_of_motion: ArrayLike | None = None) -> np.ndarray:
    """Return the joint limits of a preset.

    Parameters
    ----------
    preset : {'paper', 'wide', 'wearer'}
        'paper' is Table 1 of the paper; 'wide' adds wider published ranges of motion; 'wearer' is
        Table 1 widened to the person's own range of motion, never narrowed.
    range_of_motion : array_like, shape (25, 2), optional
        As `Hand.range_of_motion`, for 'wearer'; Table 1 alone when left out [rad].

    Returns
    -------
    ndarray, shape (25, 2)
        Lower and upper limit of each joint [rad].

    Raises
    ------
    InvalidHand
        If there is no such preset.
    """
    if preset not in LIMIT_PRESETS:
        raise InvalidHand(f"limits: no preset '{preset}'; there are {', '.join(LIMIT_PRESETS)}")
    table = LIMIT_TABLES['paper' if preset == WEARER_LIMITS else preset]
    limits = np.radians([table[joint_kind(joint)] for joint in JOINTS])
    if preset == WEARER_LIMITS and range_of_motion is not None:
        return widened_limits(limits, np.asarray(range_of_motion))
    return limits


def widened_limits(limits: np.ndarray, range_of_motion: np.ndarray) -> np.ndarray:
    """Return joint limits widened to a range of motion, each of shape (25, 2) [rad]."""
    return np.column_stack((np.minimum(limits[:, 0], range_of_motion[:, 0]),
                            np.maximum(limits[:, 1], range_of_motion[:, 1])))


def preset_coupling(preset: str = 'natural') -> np.ndarray:
    """Return the intradigital correlation (DIP against PIP) of a preset.

    Parameters
    ----------
    preset : {'natural', 'paper'}
        'paper' flexes the DIP by 0.8 of the PIP; 'natural' by less, as in handling objects.

    Returns
    -------
    ndarray, shape (5, 2)
        Slope and offset of each digit, index finger to thumb [1, rad].

    Raises
    ------
    InvalidHand
        If there is no such preset.
    """
    if preset not in COUPLING_PRESETS:
        raise InvalidHand(
            f"coupling: no preset '{preset}'; there are {', '.join(COUPLING_PRESETS)}")
    return np.array((COUPLING_PRESETS[preset],) * len(FINGERS) + (THUMB_COUPLING,))


def average_natural_flexion() -> np.ndarray:
    """Return the natural flexion of an average person, between the straight and the relaxed hand.

    Returns
    -------
    ndarray, shape (5, 3)
        As `Hand.natural_flexion` [1, rad, rad].
    """
    return np.array([(second / first, 0., np.radians(NATURAL_FLEXION_SPREAD))
                     for first, second in (*RELAXED_FINGERS, RELAXED_THUMB[1::2])])


@dataclass(frozen=True, eq=False)
class Hand:
    """Hand of one person, in the coordinates of a right hand [m, rad].

    Parameters
    ----------
    finger_cmc, finger_mcp : array_like, shape (4, 3)
        CMC and MCP joints of index to little finger from the wrist, palm flat [m].
    finger_bones : array_like, shape (4, 3)
        Length of the proximal, middle and distal phalanx [m].
    thumb_cmc : array_like, shape (3,)
        CMC joint of the thumb from the wrist [m].
    thumb_bones : array_like, shape (3,)
        Length of the thumb's metacarpal, proximal and distal phalanx [m].
    thumb_abduction_axis, thumb_rest_direction : array_like, shape (3,)
        Saddle joint: axis of abduction, fixed in the palm, and direction of the metacarpal at
        zero angles. The flexion axis is normal to both. Normalised.
    thumb_mcp_abduction : float
        Angle of the thumb's MCP abduction, which stays: the phalanges bend in another plane than
        the metacarpal [rad].
    thumb_roll : float
        Angle about the metacarpal, right-handed about its direction to the tip (from y to z), by
        which the flexion axes of the thumb's MCP and IP are turned against that of its CMC;
        positive turns the pad palmar, away from the fingers [rad].
    thumb_axis_distance : float
        Distance of the CMC's flexion axis from its abduction axis, towards the metacarpal: the
        axes of a saddle joint do not meet. `thumb_cmc` is on the axis of abduction [m].
    finger_abduction_axes : array_like, shape (4, 3)
        Axes of the fingers' abduction, fixed in the palm; dorsal in the paper. Normalised.
    splay : array_like, shape (4,)
        Direction of the straight fingers at zero angles, from x towards the thumb [rad].
    phalanx_deviation : array_like, shape (4,)
        Angle by which the middle phalanx of each finger points out of the finger's plane,
        towards the thumb; the distal one is parallel to the plane again [rad].
    limits : array_like, shape (25, 2)
        Lower and upper limit of each joint, in the order of `JOINTS` [rad].
    range_of_motion : array_like, shape (25, 2)
        Least and greatest angle of each joint that a calibration has seen, with a margin; both 0
        where it has seen none. The limits 'wearer' follow from it [rad].
    coupling : array_like, shape (5, 2)
        Intradigital correlation: slope and offset of DIP = slope PIP + offset; of the thumb's IP =
        slope MCP + offset [1, rad].
    coupling_spread : array_like, shape (5,)
        Standard deviation of each digit's last joint from its coupling: its weight beside markers
        that show that joint too [rad].
    natural_flexion : array_like, shape (5, 3)
        Slope, offset and spread of each digit's second flexion over its first, as this person
        moves: PIP = slope MCP + offset; the thumb's MCP = slope CMC + offset. It decides where a
        marker constrains nothing, the more the smaller the spread [1, rad, rad].
    palm_synergy : array_like, shape (4,)
        CMC flexion of each finger per mean MCP flexion of ring and little finger, where the palm
        cups and no marker shows it [1].
    radii : array_like, shape (5, 3)
        Radius of the capsules around the three bones of each digit [m].
    palm_radius : float
        Radius of the capsules around the metacarpals of the fingers [m].
    side : {'right', 'left'}
        A left hand is the mirror image of these numbers.

    Raises
    ------
    InvalidHand
        With the field, its value and the allowed values.
    """

    finger_cmc: np.ndarray
    finger_mcp: np.ndarray
    finger_bones: np.ndarray
    thumb_cmc: np.ndarray
    thumb_bones: np.ndarray
    thumb_abduction_axis: np.ndarray = field(
        default_factory=lambda: np.array(THUMB_ABDUCTION_AXIS))
    thumb_rest_direction: np.ndarray = field(
        default_factory=lambda: np.array(THUMB_REST_DIRECTION))
    thumb_mcp_abduction: float = 0.
    thumb_roll: float = 0.
    thumb_axis_distance: float = 0.
    finger_abduction_axes: np.ndarray = field(
        default_factory=lambda: np.array(((0., 0., 1.),) * 4))
    splay: np.ndarray = field(default_factory=lambda: np.zeros(4))
    phalanx_deviation: np.ndarray = field(default_factory=lambda: np.zeros(4))
    limits: np.ndarray = field(default_factory=preset_limits)
    range_of_motion: np.ndarray = field(default_factory=lambda: np.zeros((len(JOINTS), 2)))
    coupling: np.ndarray = field(default_factory=preset_coupling)
    coupling_spread: np.ndarray = field(
        default_factory=lambda: np.full(len(DIGITS), np.radians(USUAL_COUPLING_SPREAD)))
    natural_flexion: np.ndarray = field(default_factory=average_natural_flexion)
    palm_synergy: np.ndarray = field(default_factory=lambda: np.array(PALM_SYNERGY))
    radii: np.ndarray = field(default_factory=lambda: np.array(CAPSULE_RADII))
    palm_radius: float = PALM_CAPSULE_RADIUS
    side: str = 'right'

    def __post_init__(self) -> None:
        for name, shape in HAND_SHAPES.items():
            object.__setattr__(self, name, _array(name, getattr(self, name), shape))
        if self.side not in SIDES:
            raise InvalidHand(f'side: {self.side!r} is not one of {", ".join(SIDES)}')
        self._check_ranges()
        self._normalise_directions()
        self._check_directions()

    def _check_ranges(self) -> None:
        """Refuse lengths, angles, couplings and radii outside their ranges."""
        for name in ('finger_bones', 'thumb_bones'):
            _require(name, getattr(self, name), *LENGTH_RANGE, 'm')
        for name in ('finger_cmc', 'finger_mcp', 'thumb_cmc'):
            _require(name, getattr(self, name), -POSITION_RANGE, POSITION_RANGE, 'm')
        for name in ('radii', 'palm_radius'):
            _require(name, getattr(self, name), *RADIUS_RANGE, 'm')
        _require('thumb_mcp_abduction', self.thumb_mcp_abduction, *THUMB_MCP_ABDUCTION_RANGE, 'rad')
        _require('thumb_roll', self.thumb_roll, *THUMB_ROLL_RANGE, 'rad')
        _require('thumb_axis_distance', self.thumb_axis_distance, *THUMB_AXIS_DISTANCE_RANGE, 'm')
        _require('splay', self.splay, -SPLAY_RANGE, SPLAY_RANGE, 'rad')
        _require('phalanx_deviation', self.phalanx_deviation, -PHALANX_DEVIATION_RANGE,
                 PHALANX_DEVIATION_RANGE, 'rad')
        for name in ('limits', 'range_of_motion'):
            _require(name, getattr(self, name), -ANGLE_RANGE, ANGLE_RANGE, 'rad')
            for joint, (lower, upper) in zip(JOINTS, getattr(self, name)):
                if lower > upper:
                    raise InvalidHand(
                        f'{name} of {joint}: {np.degrees(lower):g} to {np.degrees(upper):g} '
                        'degrees; the lower limit must not exceed the upper')
        _require('coupling slope', self.coupling[:, 0], *SLOPE_RANGE, '')
        _require('coupling offset', self.coupling[:, 1], *COUPLING_OFFSET_RANGE, 'rad')
        _require('coupling spread', self.coupling_spread, *COUPLING_SPREAD_RANGE, 'rad')
        for column, (name, bounds, unit) in enumerate((
                ('slope', NATURAL_SLOPE_RANGE, ''), ('offset', NATURAL_OFFSET_RANGE, 'rad'),
                ('spread', NATURAL_SPREAD_RANGE, 'rad'))):
            _require(f'natural_flexion {name}', self.natural_flexion[:, column], *bounds, unit)
        _require('palm_synergy', self.palm_synergy, *PALM_SYNERGY_RANGE, '')

    def _normalise_directions(self) -> None:
        """Give axes and rest direction length 1."""
        for name in ('thumb_abduction_axis', 'thumb_rest_direction', 'finger_abduction_axes'):
            vectors = getattr(self, name)
            sizes = np.linalg.norm(vectors, axis=-1, keepdims=True)
            if (sizes < 1e-6).any():
                raise InvalidHand(f'{name}: {vectors} has no direction')
            # Keep unit vectors bit for bit, so that a copy equals its source.
            sizes[np.abs(sizes - 1.) <= 1e-15] = 1.
            object.__setattr__(self, name, _frozen(vectors / sizes))

    def _check_directions(self) -> None:
        """Refuse axes and knuckles that no right hand has."""
        if abs(self.thumb_abduction_axis @ self.thumb_rest_direction) > .95:
            raise InvalidHand(
                'thumb_rest_direction: within 18 degrees of thumb_abduction_axis; '
                'the saddle joint needs two distinct axes')
        for finger, axis in zip(FINGERS, self.finger_abduction_axes):
            if axis[2] < .5:
                raise InvalidHand(f'finger_abduction_axes of {finger}: {axis} is more than '
                                  '60 degrees from dorsal (0, 0, 1)')
        triangle = np.cross(self.finger_mcp[0], self.finger_mcp[3])
        if triangle[2] > -1e-5:
            raise InvalidHand(
                'finger_mcp: the index MCP must lie on the thumb side (greater y) of the little, '
                f'both distal of the wrist; got {self.finger_mcp[0]} and {self.finger_mcp[3]}')

    @classmethod
    def scaled(cls, length: float = MEAN_LENGTH, breadth: float = MEAN_BREADTH,
               **fields: Any) -> 'Hand':
        """Return the mean hand scaled to a length and a breadth.

        Parameters
        ----------
        length : float
            From the wrist crease to the tip of the middle finger [m].
        breadth : float
            Across the knuckles of index and little finger [m].
        **fields
            Any other field of `Hand`.

        Raises
        ------
        InvalidHand
            If length or breadth is out of range, or as for `Hand`.
        """
        _require('length', length, *HAND_LENGTH_RANGE, 'm')
        _require('breadth', breadth, *HAND_BREADTH_RANGE, 'm')
        mcp = np.column_stack((
            np.multiply(MCP_OF_LENGTH, length), np.multiply(MCP_OF_BREADTH, breadth),
            np.multiply(ARCH_OF_LENGTH, length)))
        defaults = {
            'finger_cmc': cmc_joints(mcp, length),
            'finger_mcp': mcp,
            'finger_bones': np.multiply(FINGER_BONES_OF_LENGTH, length),
            'thumb_cmc': np.multiply(THUMB_CMC_OF_LENGTH, length),
            'thumb_bones': np.multiply(THUMB_BONES_OF_LENGTH, length),
            'radii': np.multiply(CAPSULE_RADII, length / MEAN_LENGTH),
            'palm_radius': PALM_CAPSULE_RADIUS * length / MEAN_LENGTH,
        }
        return cls(**{**defaults, **fields})

    def replace(self, **fields: Any) -> 'Hand':
        """Return a copy with other values of the named fields."""
        return replace(self, **fields)

    def bone_ends(self) -> np.ndarray:
        """Return the far end of each digit's bones in the frame of its link, (5, 3, 3) [m]."""
        ends = np.zeros((len(DIGITS), 3, 3))
        ends[:, :, 0] = *self.finger_bones, self.thumb_bones
        middle = self.finger_bones[:, 1]
        ends[:len(FINGERS), 1, 0] = middle * np.cos(self.phalanx_deviation)
        ends[:len(FINGERS), 1, 1] = middle * np.sin(self.phalanx_deviation)
        return ends

    def resting_thumb_cmc(self) -> np.ndarray:
        """Return the thumb's CMC joint at zero angles, on the axis of flexion, (3,) [m]."""
        axis, rest = self.thumb_abduction_axis, self.thumb_rest_direction
        ahead = rest - (rest @ axis) * axis
        return self.thumb_cmc + self.thumb_axis_distance * ahead / np.linalg.norm(ahead)

    def relaxed(self) -> np.ndarray:
        """Return the joint angles of the relaxed hand, within its limits, shape (25,) [rad]."""
        angles = np.zeros((len(DIGITS), len(FINGER_JOINTS)))
        angles[:len(FINGERS), 2:4] = np.radians(RELAXED_FINGERS)
        angles[len(FINGERS), :4] = np.radians(RELAXED_THUMB)
        angles[len(FINGERS), 2] = self.thumb_mcp_abduction
        return self.coupled(np.clip(angles.ravel(), *self.limits.T), self.limits)

    def coupled(self, angles: np.ndarray, limits: np.ndarray) -> np.ndarray:
        """Return angles with the last joint of each digit at its coupling, within limits.

        Parameters
        ----------
        angles : ndarray, shape (..., 25)
            [rad]
        limits : ndarray, shape (25, 2)
            Of which those of the last joints count [rad].

        Returns
        -------
        ndarray, shape (..., 25)
            [rad]
        """
        middle, last = FLEXION_JOINTS[:, 1:].T
        angles = angles.copy()
        angles[..., last] = np.clip(
            self.coupling[:, 0] * angles[..., middle] + self.coupling[:, 1], *limits[last].T)
        return angles

    def mirrored(self) -> 'Hand':
        """Return this hand with the other side."""
        return self.replace(side=OTHER_SIDE[self.side])

    def as_right(self) -> 'Hand':
        """Return this hand as a right one, itself where it is one."""
        return self if self.side == 'right' else self.mirrored()

    def with_open_palm(self) -> 'Hand':
        """Return this hand with the usual limits of those CMC joints that are locked at zero."""
        limits = np.array(self.limits)
        for row, usual in zip(CMC_JOINTS, np.radians(ARCH_LIMITS)):
            if not limits[row].any():
                limits[row] = usual
        return self.replace(limits=limits)

    def with_paper_thumb(self) -> 'Hand':
        """Return this hand with the paper's thumb plane, through CMC, tip and index MCP.

        The plane of a digit holds its abduction axis: the axis that points from the index
        MCP to the thumb's CMC gives the paper's plane F(5,1) F(5,4) F(1,2).
        """
        cmc = self.resting_thumb_cmc()
        return self.replace(thumb_cmc=cmc, thumb_abduction_axis=cmc - self.finger_mcp[0],
                            thumb_roll=0., thumb_axis_distance=0.)


def cmc_joints(mcp: np.ndarray, length: float) -> np.ndarray:
    """Return the usual CMC joints of fingers with MCP joints (4, 3), shape (4, 3) [m].

    `length` is the hand's [m].
    """
    return mcp * (0., CMC_OF_MCP_BREADTH, 0.) + (CMC_OF_LENGTH * length, 0., 0.)


def has_size_of(hand: Hand, other: Hand) -> bool:
    """Return whether two hands have the same knuckles, bones and thumb joint: the same size."""
    return all(np.array_equal(getattr(hand, name), getattr(other, name)) for name in (
        'finger_mcp', 'finger_bones', 'thumb_cmc', 'thumb_bones', 'thumb_axis_distance',
        'thumb_roll'))


def _frozen(array: np.ndarray) -> np.ndarray:
    """Return the array, made read-only."""
    array.setflags(write=False)
    return array


def _array(name: str, value: ArrayLike, shape: tuple[int, ...]) -> np.ndarray | float:
    """Return a field's value as a read-only array of finite numbers, or as a float."""
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError):
        raise InvalidHand(f'{name}: {value!r} is not made of numbers') from None
    if array.shape != shape:
        raise InvalidHand(f'{name}: its shape is {array.shape}; expected {shape}')
    if not np.isfinite(array).all():
        raise InvalidHand(f'{name}: {value!r} has numbers that are not finite')
    return float(array) if shape == () else _frozen(array)


def _require(name: str, value: ArrayLike, lower: float, upper: float, unit: str) -> None:
    """Raise `InvalidHand` if a number of a field is not in [lower, upper]."""
    values = np.atleast_1d(value)
    is_allowed = (values >= lower) & (values <= upper)
    if not is_allowed.all():
        place = tuple(int(i) for i in np.argwhere(~is_allowed)[0])
        index = '' if np.ndim(value) == 0 else str(list(place))
        raise InvalidHand(
            f'{name}{index}: {values[place]:g}; allowed is {lower:g} to {upper:g} {unit}'.rstrip())
