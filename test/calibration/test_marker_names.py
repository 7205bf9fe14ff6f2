"""What markers are called in takes."""

import pytest

from hand_tracker.calibration.hand_labels import ids_of_both_hands
from hand_tracker.calibration.marker_names import (
    ON_PALM,
    NamedMarker,
    canonical_name,
    identify,
    is_knuckle,
    riding,
)
from hand_tracker.core.model.marker_layout import MarkerLayout


@pytest.mark.parametrize(('text', 'name'), (
    ('ThumbCMC', 'thumb_cmc'), ('PinkyTip', 'little_tip'), ('index_pip', 'index_pip'),
    ('R_Index_Tip', 'index_tip'), ('BackHand1', 'back_hand_1'), ('index', 'index_dip'),
    ('thumb', 'thumb_tip'), ('right wrist', 'wrist'), ('MiddleDIP', 'middle_dip')))
def test_usual_spellings(text, name):
    assert canonical_name(text) == name


def test_links_of_markers():
    found = identify(('index_mcp', 'index_pip', 'ring_dip', 'little_tip', 'thumb_mcp', 'thumb_ip',
                      'wrist', 'BackHand2', 'elbow', '17'))
    assert found[0] == NamedMarker('index_mcp', -1, ON_PALM)
    assert [marker.link for marker in found[1:6]] == [0, 1, 2, 0, 1]
    assert [marker.digit for marker in found[1:6]] == [0, 2, 3, 4, 4]
    assert [marker.link for marker in found[6:8]] == [ON_PALM, ON_PALM]
    assert found[8:] == [None, None]


def test_a_knuckle_that_is_not_rigid_rides_on_its_digit():
    moved = riding(NamedMarker('middle_mcp', -1, ON_PALM))
    assert moved == NamedMarker('middle_mcp', 1, 0) and is_knuckle(moved)
    back = NamedMarker('back_hand_1', -1, ON_PALM)
    assert riding(back) == back and not is_knuckle(back)


@pytest.mark.parametrize('name, expected', [
    ('RHand:index', ('right', 3)), ('Bob:LHand:index_mcp', ('left', 1)), ('R_index', ('right', 3)),
    ('Anna:left_thumb', ('left', 7)), ('Right:index', ('right', 3)), ('L:wrist', ('left', 0)),
    ('LH:index', ('left', 3)), ('HandR:index', ('right', 3)), ('Bob:RIndexDip', ('right', 3)),
    ('index', None), ('Harald:index', None), ('RHand:elbow', None), ('Chair:left_leg', None)])
def test_markers_of_both_hands_have_the_ids_of_their_side(name, expected):
    assert ids_of_both_hands(MarkerLayout())(name) == expected
