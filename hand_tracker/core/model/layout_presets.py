"""Marker layouts by name: those that mocap systems, gloves and headsets use.

Names of the markers are as those systems write them, without the side. Offsets are ours, for
markers of 5 to 7 mm on skin, unless a comment says more: a calibration finds those of a person.
"""

from collections.abc import Callable

import numpy as np

from ..errors import InvalidLayout
from .hand import DIGITS, FINGERS
from .marker_layout import LANDMARKS_OF_DIGIT, MarkerLayout

# Name, landmark and offset (x along the bone, y towards the thumb, z dorsal) [mm].
Marker = tuple[str, str, tuple[float, float, float]]
NAMED_DIGITS = {**{finger: finger.capitalize() for finger in FINGERS}, 'little': 'Pinky',
                'thumb': 'Thumb'}
ON_WRIST_TOP, ON_KNUCKLE = (0., 0., 11.), (0., 0., 11.)
ON_JOINT, ON_NAIL = (0., 0., 9.), (-3., 0., 8.)
OF_ANYBODY = 2.5    # [mm] that a finger's marker is off its place on a usual hand; ours


def _layout(markers: list[Marker]) -> MarkerLayout:
    """Return the layout of markers."""
    names, places, offsets = zip(*markers)
    return MarkerLayout(places, np.multiply(offsets, 1e-3), names=names)


def _paper8_skin() -> MarkerLayout:
    """Return the paper's eight on the back of a usual hand, not at its joints."""
    offsets = (ON_WRIST_TOP, *[ON_KNUCKLE] * 2, *[ON_JOINT] * len(FINGERS), ON_NAIL)
    deviations = (*[0.] * 3, *[OF_ANYBODY] * len(FINGERS), 0.)
    return MarkerLayout(offsets=np.multiply(offsets, 1e-3),
                        deviations=np.multiply(deviations, 1e-3))


def _tips5_palm3() -> MarkerLayout:
    """Return wrist, two knuckles and the nails."""
    return _layout([
        ('wrist', 'wrist', ON_WRIST_TOP), ('index_mcp', 'index_mcp', ON_KNUCKLE),
        ('little_mcp', 'little_mcp', ON_KNUCKLE),
        *((f'{digit}_tip', f'{digit}_tip', ON_NAIL) for digit in DIGITS)])


def _optitrack_hand() -> MarkerLayout:
    """Return Motive's hand with fingers: two at the wrist, two below the knuckles, two a digit."""
    return _layout([
        ('WristOut', 'wrist', (0., -27., 5.)), ('WristIn', 'wrist', (0., 27., 5.)),
        ('HandOut', 'little_mcp', (-8., 6., 10.)), ('HandIn', 'index_mcp', (-8., -4., 11.)),
        *((f'{NAMED_DIGITS[digit]}{number}', LANDMARKS_OF_DIGIT[digit][landmark], offset)
          for digit in ('thumb', *FINGERS)
          for number, landmark, offset in ((1, 1 if digit == 'thumb' else 0, ON_JOINT),
                                           (2, 2, ON_NAIL)))])


def _dfki13() -> MarkerLayout:
    """Return the glove of DFKI's hand_embodiment: three on its back, two a digit."""
    return _layout([
        ('hand_top', 'middle_mcp', (-15., 8., 14.)), ('hand_left', 'middle_mcp', (-55., 20., 14.)),
        ('hand_right', 'middle_mcp', (-55., -25., 14.)),
        *((f'{digit}_{name}', LANDMARKS_OF_DIGIT[digit][landmark], offset)
          for digit in ('thumb', 'little', 'ring', 'middle', 'index')
          for name, landmark, offset in (
              ('tip', 2, (-8., 0., 9.)), ('middle', 1, (-11., 0., 10.))))])


def _sig18_19() -> MarkerLayout:
    """Return the 19 of Han et al. (2018): four on the thumb, three a finger, three on the back."""
    fingers = [(f'{NAMED_DIGITS[finger]}{joint.upper() if joint != "tip" else "Tip"}',
                f'{finger}_{joint}', offset)
               for finger in FINGERS
               for joint, offset in (('mcp', ON_KNUCKLE), ('pip', ON_JOINT), ('tip', ON_NAIL))]
    return _layout([
        ('ThumbCMC', 'thumb_cmc', (5., 0., 11.)), ('ThumbMCP', 'thumb_mcp', ON_JOINT),
        ('ThumbIP', 'thumb_ip', ON_JOINT), ('ThumbTip', 'thumb_tip', ON_NAIL), *fingers,
        # As on the hand of their first user, both sides alike.
        ('BackHand1', 'wrist', (26., -21., 17.)), ('BackHand2', 'wrist', (-8., -24., 13.)),
        ('BackHand3', 'wrist', (8., 11., 11.))])


def _dfki13_skin() -> MarkerLayout:
    """Return DFKI's glove as on a hand of its recordings: its plate, and proximal phalanges."""
    return _layout([
        ('hand_top', 'middle_mcp', (-30., -17., 15.)), ('hand_left', 'wrist', (3., 7., 11.)),
        ('hand_right', 'wrist', (8., -25., 14.)),
        *((f'{digit}_{name}', LANDMARKS_OF_DIGIT[digit][landmark], offset)
          for digit in ('thumb', 'little', 'ring', 'middle', 'index')
          for name, landmark, offset in (
              ('tip', 2, (0., 0., 11.)),
              ('middle', 1 if digit == 'thumb' else 0, (-8., 0., 13.))))])


def _sig18_19_skin() -> MarkerLayout:
    """Return the 19 of Han et al. as their first user has them, the mean of both hands.

    A finger's 'MCP' and 'PIP' are then in the middle of the phalanges beyond these joints.
    """
    fingers = [(f'{NAMED_DIGITS[finger]}{name}', f'{finger}_{landmark}', offset)
               for finger in FINGERS
               for name, landmark, offset in (('MCP', 'pip', (-10., 1., 10.)),
                                              ('PIP', 'dip', (-10., 0., 12.)),
                                              ('Tip', 'tip', (-1., 0., 11.)))]
    return _layout([
        ('ThumbCMC', 'thumb_cmc', (20., 26., -1.)), ('ThumbMCP', 'thumb_mcp', (15., 2., 14.)),
        ('ThumbIP', 'thumb_ip', (8., -2., 10.)), ('ThumbTip', 'thumb_tip', (2., -1., 9.)),
        *fingers, ('BackHand1', 'wrist', (58., -17., 19.)),
        ('BackHand2', 'wrist', (23., -18., 19.)), ('BackHand3', 'wrist', (42., 17., 18.))])


def _kyutech23() -> MarkerLayout:
    """Return the 23 of Kyushu Institute of Technology: each joint and tip, four at the wrist."""
    fingers = [(f'{finger}_{joint}', ON_NAIL if joint == 'tip' else ON_JOINT)
               for finger in FINGERS for joint in ('pip', 'dip', 'tip')]
    places = [*((f'{finger}_mcp', ON_KNUCKLE) for finger in FINGERS), *fingers,
              ('thumb_mcp', ON_JOINT), ('thumb_ip', ON_JOINT), ('thumb_tip', ON_NAIL),
              # As on the hand of their first subject.
              ('wrist', (20., 0., 11.)), ('wrist', (23., 34., -22.)), ('wrist', (21., -28., 9.)),
              ('wrist', (-17., -6., 14.))]
    return _layout([(str(number), place, offset)
                    for number, (place, offset) in enumerate(places, 1)])


def _vicon_production5() -> MarkerLayout:
    """Return Shogun's production set with five finger markers: wrist, knuckles and nails."""
    return _layout([
        ('WRA', 'wrist', (0., 27., 5.)), ('WRB', 'wrist', (0., -27., 5.)),
        ('IHAND', 'index_mcp', (-6., -3., 11.)), ('OHAND', 'little_mcp', (-6., 3., 11.)),
        ('THM6', 'thumb_tip', ON_NAIL), ('IDX6', 'index_tip', ON_NAIL),
        ('MID6', 'middle_tip', ON_NAIL), ('RNG6', 'ring_tip', ON_NAIL),
        ('PNK6', 'little_tip', ON_NAIL)])


def _landmark_layout(wrist: str, thumb: tuple[str, ...], finger: str, joints: tuple[str, ...],
                     digits: tuple[str, ...], palm: str = '') -> MarkerLayout:
    """Return a layout of joint centres: landmarks of the hand, not markers on skin."""
    at = (0., 0., 0.)
    found: list[Marker] = [(wrist, 'wrist', at)]
    if palm:
        found.insert(0, (palm, 'middle_mcp', (-45., 0., 0.)))
    found += [(name, place, at) for name, place in zip(
        thumb, ('thumb_cmc', *LANDMARKS_OF_DIGIT['thumb']))]
    landmarks = ('cmc', 'mcp', 'pip', 'dip', 'tip')[-len(joints):]
    found += [(finger.format(digit=name, joint=joint), f'{digit}_{landmark}', at)
              for digit, name in zip(FINGERS, digits) for joint, landmark in zip(joints, landmarks)]
    return _layout(found)


def _mediapipe21() -> MarkerLayout:
    """Return MediaPipe's 21 landmarks."""
    return _landmark_layout(
        'WRIST', ('THUMB_CMC', 'THUMB_MCP', 'THUMB_IP', 'THUMB_TIP'), '{digit}_FINGER_{joint}',
        ('MCP', 'PIP', 'DIP', 'TIP'), ('INDEX', 'MIDDLE', 'RING', 'PINKY'))


def _webxr25() -> MarkerLayout:
    """Return the 25 joints of WebXR."""
    joints = ('metacarpal', 'phalanx-proximal', 'phalanx-intermediate', 'phalanx-distal', 'tip')
    return _landmark_layout(
        'wrist', ('thumb-metacarpal', 'thumb-phalanx-proximal', 'thumb-phalanx-distal',
                  'thumb-tip'), '{digit}-finger-{joint}', joints,
        ('index', 'middle', 'ring', 'pinky'))


def _openxr26() -> MarkerLayout:
    """Return the 26 joints of OpenXR: WebXR's and the palm."""
    return _landmark_layout(
        'WRIST', ('THUMB_METACARPAL', 'THUMB_PROXIMAL', 'THUMB_DISTAL', 'THUMB_TIP'),
        '{digit}_{joint}', ('METACARPAL', 'PROXIMAL', 'INTERMEDIATE', 'DISTAL', 'TIP'),
        ('INDEX', 'MIDDLE', 'RING', 'LITTLE'), palm='PALM')


PAPER_LAYOUT = 'paper8'
LAYOUT_PRESETS: dict[str, Callable[[], MarkerLayout]] = {
    PAPER_LAYOUT: MarkerLayout,
    'tips5_palm3': _tips5_palm3,
    'vicon_production5': _vicon_production5,
    'dfki13': _dfki13,
    'optitrack_hand': _optitrack_hand,
    'sig18_19': _sig18_19,
    'kyutech23': _kyutech23,
    'mediapipe21': _mediapipe21,
    'webxr25': _webxr25,
    'openxr26': _openxr26,
}
# Beside them, as their markers are those of other presets, by which they are recognised: where
# people wear them, for who has not calibrated yet.
SKIN_LAYOUT = 'paper8_skin'
SKIN_LAYOUTS: dict[str, Callable[[], MarkerLayout]] = {
    SKIN_LAYOUT: _paper8_skin,
    'dfki13_skin': _dfki13_skin,
    'sig18_19_skin': _sig18_19_skin,
}
LAYOUT_NAMES = (*LAYOUT_PRESETS, *SKIN_LAYOUTS)
JOINT_CENTRE_PRESETS = 'mediapipe21', 'webxr25', 'openxr26'  # of skeletons: nobody wears them


def preset_layout(name: str) -> MarkerLayout:
    """Return the layout of a preset.

    Parameters
    ----------
    name : str
        One of `LAYOUT_NAMES`.

    Returns
    -------
    MarkerLayout

    Raises
    ------
    InvalidLayout
        If there is no such preset.
    """
    if name not in LAYOUT_NAMES:
        raise InvalidLayout(f"layout: no preset '{name}'; there are {', '.join(LAYOUT_NAMES)}")
    return {**LAYOUT_PRESETS, **SKIN_LAYOUTS}[name]()


def skin_preset(layout: MarkerLayout) -> str:
    """Return the preset with a preset's markers where people wear them, else empty."""
    for name in SKIN_LAYOUTS:
        plain = preset_layout(name.removesuffix('_skin'))
        if (layout.names, layout.places) == (plain.names, plain.places) and np.array_equal(
                layout.offsets, plain.offsets):
            return name
    return ''
