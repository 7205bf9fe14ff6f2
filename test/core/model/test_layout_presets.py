"""Layouts of any markers: presets, what is refused, principal markers, what they show."""

import numpy as np
import pytest
from helpers.hands import markers_of

from hand_tracker.core.errors import InvalidLayout
from hand_tracker.core.model.hand import FINGERS, JOINTS, LINKS, RESTING_JOINTS, Hand
from hand_tracker.core.model.layout_presets import (
    LAYOUT_PRESETS,
    SKIN_LAYOUTS,
    preset_layout,
    skin_preset,
)
from hand_tracker.core.model.marker_layout import (
    ALL_LANDMARKS,
    MARKERS,
    PAPER_PLACES,
    MarkerLayout,
    landmark_on_link,
    require_solvable,
)
from hand_tracker.core.model.observability import unobserved_joints

COUNTS = {'paper8': 8, 'tips5_palm3': 8, 'vicon_production5': 9, 'dfki13': 13,
          'optitrack_hand': 14, 'sig18_19': 19, 'kyutech23': 23, 'mediapipe21': 21,
          'webxr25': 25, 'openxr26': 26}
RESTING_ANGLES = np.zeros(len(JOINTS))
PALM = [('r', 'wrist'), ('p', 'index_mcp'), ('q', 'little_mcp')]


def layout(*markers, **fields):
    names, places = zip(*markers)
    return MarkerLayout(places, names=names, **fields)


@pytest.mark.parametrize('name', LAYOUT_PRESETS)
def test_presets_have_their_markers_and_can_be_solved(name):
    found = preset_layout(name)
    assert len(found.names) == len(set(found.names)) == COUNTS[name]
    for side in ('right', 'left'):
        hand = Hand.scaled(side=side)
        require_solvable(found.principal_mounting(hand.replace(side='right')))
        assert len(found.mounting(hand).link) == COUNTS[name]
    assert sorted((*found.principal, *found.further)) == list(range(COUNTS[name]))


@pytest.mark.parametrize('name', SKIN_LAYOUTS)
def test_markers_where_people_wear_them_have_the_names_of_their_preset(name):
    plain, worn = preset_layout(name.removesuffix('_skin')), preset_layout(name)
    assert worn.names == plain.names
    require_solvable(worn.principal_mounting(Hand.scaled()))
    assert skin_preset(plain) == name
    assert skin_preset(worn) == skin_preset(preset_layout('kyutech23')) == ''


def test_the_plate_of_a_glove_is_as_large_as_the_one_of_its_recordings():
    top, left, right = markers_of(Hand.scaled(), RESTING_ANGLES, preset_layout('dfki13_skin'))[:3]
    # Medians of the distances in `dfki__pillow`.
    assert [np.linalg.norm(a - b) for a, b in ((top, left), (left, right), (top, right))] == (
        pytest.approx([.0552, .0324, .0448], abs=5e-4))


def test_no_such_preset():
    with pytest.raises(InvalidLayout, match="no preset 'nine'; there are paper8, "):
        preset_layout('nine')


def test_a_marker_at_each_landmark_is_at_the_end_of_its_link():
    hand = Hand.scaled()
    for place in ALL_LANDMARKS:
        link, position = landmark_on_link(hand, place, rides=True)
        assert link == -1 or LINKS[link].startswith(place.split('_')[0])
        assert position.shape == (3,)
    assert LINKS[landmark_on_link(hand, 'ring_mcp', rides=True)[0]] == 'ring_metacarpal'


@pytest.mark.parametrize('markers, fields, message', [
    (PALM[:2], {}, r'names: 2 given; allowed is 3 to 60'),
    ([*PALM, ('q', 'index_tip')], {}, "names: 'q' stands twice"),
    ([*PALM[:2], ('a', 'index_tip')], {}, '2 markers at wrist, .*; expected at least three'),
    ([*PALM, ('a', 'index_nail')], {}, "marker a: place 'index_nail' is not one of wrist, "),
    (PALM, {'offsets': np.full((3, 3), .1)}, r'marker r: offset .* allowed is -0.06 to 0.06 m'),
    (PALM, {'deviations': [0., 0., .1]}, 'marker q: deviation 0.1; allowed is 0 to 0.01 m'),
    (PALM, {'skin_shares': [0., 9., 0.]}, 'marker p: skin_share 9; allowed is -1 to 1.5'),
])
def test_layouts_that_are_refused(markers, fields, message):
    with pytest.raises(InvalidLayout, match=message):
        layout(*markers, **fields)


def test_the_papers_places_are_principal_wherever_they_stand():
    order = np.random.default_rng(0).permutation(len(PAPER_PLACES))
    found = layout(*((f'm{i}', PAPER_PLACES[i]) for i in order), ('more', 'middle_mcp'))
    assert [found.places[row] for row in found.principal] == list(PAPER_PLACES)
    assert [found.names[row] for row in found.further] == ['more']


def test_a_digit_without_a_marker_has_no_principal_one():
    found = layout(*PALM, ('a', 'index_tip'), ('b', 'middle_pip'))
    assert dict(zip(MARKERS, found.principal)) == {
        'wrist': 0, 'index_mcp': 1, 'little_mcp': 2, 'index': 3, 'middle': -1, 'ring': -1,
        'little': -1, 'thumb': -1}


def test_eight_markers_do_not_show_what_the_paper_couples():
    missing = set(unobserved_joints(Hand.scaled(), MarkerLayout()))
    assert missing >= set(RESTING_JOINTS) | {f'{finger}_dip_flexion' for finger in FINGERS}
    assert not missing & {f'{finger}_{joint}' for finger in FINGERS
                          for joint in ('mcp_flexion', 'mcp_abduction')}


def test_all_landmarks_show_all_joints_but_those_of_the_central_palm():
    hand = Hand.scaled().with_open_palm()
    assert set(unobserved_joints(hand, preset_layout('openxr26'))) <= {
        'index_cmc_flexion', 'middle_cmc_flexion', 'thumb_mcp_abduction'}
    palm_only = layout(*PALM)
    assert set(unobserved_joints(hand, palm_only)) >= {
        joint for joint in JOINTS if 'cmc' not in joint}
