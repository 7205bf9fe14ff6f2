"""Labels of both hands in one message."""

import pytest

from hand_tracker.messages.labels import (
    DEFAULT_LABELS,
    InvalidLabel,
    LabelMap,
    label_maps,
    labels_of_hand,
)
from hand_tracker.messages.marker_array import ADD, REPORTED, SPHERE, Head, find_sources


@pytest.mark.parametrize(('labels', 'markers', 'expected'), [
    (('3', '4'), 'left/0', ('left/3', 'left/4')),
    (('3', 4), '8', ('11', '12')),
    (('3', ''), 'leds/8', ('leds/11', '')),
    (('leds/3', 'thumb/*', '-2'), '8', ('leds/11', 'thumb/*', '6')),
    (('3', '4'), '0', ('3', '4')),
    (('3',), 'a/b/0', ('a/b/3',))])
def test_labels_of_a_hand_are_moved_to_its_markers(labels, markers, expected):
    assert labels_of_hand(labels, markers) == expected


@pytest.mark.parametrize(('labels', 'markers', 'said'), [
    (('3',), 'left', "'left'; expected namespace/id"), (('3',), '', "''; expected"),
    (('3',), '-8', "'-8'; expected"), (('leds/3',), 'left/0', "'leds/3'; expected an id")])
def test_other_places_are_refused(labels, markers, said):
    with pytest.raises(InvalidLabel, match=said):
        labels_of_hand(labels, markers)


def test_the_most_precise_label_of_both_hands_wins():
    right, left = label_maps(DEFAULT_LABELS, {'right': '0', 'left': 'left/0'}).values()
    assert (right.slot('leds', 3), left.slot('leds', 3)) == (3, None)
    assert (right.slot('left', 3), left.slot('left', 3)) == (None, 3)
    assert left.is_of_other_hand('leds', 3) and right.is_of_other_hand('left', 3)
    assert not right.is_of_other_hand('leds', 9) and not left.is_of_other_hand('leds', 9)


def test_a_label_of_both_hands_is_refused():
    with pytest.raises(InvalidLabel, match="'5' is a marker of both hands"):
        label_maps(DEFAULT_LABELS, {'right': '0', 'left': '5'})
    label_maps(DEFAULT_LABELS, {'right': '0', 'left': '8'})


def test_a_place_that_is_refused_is_named_by_its_hand():
    with pytest.raises(InvalidLabel, match="left.markers: 'x'; expected"):
        label_maps(DEFAULT_LABELS, {'right': '0', 'left': 'x'})


def test_markers_in_the_other_sides_namespace_count_only_by_a_label_that_gives_it():
    right = LabelMap(not_of='left')
    assert [right.slot(space, 3) for space in ('', 'hand', 'right', 'left')] == [3, 3, 3, None]
    assert not right.is_of_other_hand('left', 3)
    named = LabelMap(['left/5', *'1234567'], not_of='left')
    assert (named.slot('left', 5), named.slot('left', 3)) == (0, None)
    assert LabelMap(['left/*', *'1234567'], not_of='left').slot('left', 3) == 0
    # Markers without a namespace are nobody else's.
    assert LabelMap().slot('', 3) == 3


def test_the_other_hands_markers_leave_room_for_those_that_nobody_knows():
    heads = [Head('mocap', space, number, SPHERE, ADD, 0)
             for space, first in (('left', 0), ('', 20)) for number in range(first, first + 10)]
    unknown = find_sources(heads, LabelMap(not_of='left'), '').unknown
    assert [label for label in unknown if label[0]] == [('left', 0)]
    assert len(unknown) == REPORTED + 1
