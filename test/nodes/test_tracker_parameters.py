"""The tracker's parameters and the hand and options that they stand for, without ROS."""

import re
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
import yaml

from hand_tracker.core.errors import HandTrackerError
from hand_tracker.core.model.hand import (
    JOINTS,
    RESTING_JOINTS,
    SIDES,
    Hand,
    preset_coupling,
    preset_limits,
)
from hand_tracker.core.model.layout_presets import preset_layout
from hand_tracker.core.model.marker_layout import MARKERS, PAPER_PLACES, MarkerLayout
from hand_tracker.core.options import TrackerOptions
from hand_tracker.core.tracker import HandTracker
from hand_tracker.files.hand_file import load_hand, save_hand
from hand_tracker.nodes.tracker_parameters import (
    SEPARATE,
    SHARED,
    START,
    InvalidParameter,
    common_table,
    hand_table,
    labels_of_both,
    labels_table,
    live_settings,
    live_table,
    markers_parameter,
    names_of_both,
    start_of_hand,
    starting_hand,
    values_of_hand,
)
from hand_tracker.simulation.packaged_recordings import demo_recording

CONFIG = Path(__file__).parents[2] / 'config' / 'tracker.yaml'


def start(**values):
    """Return the hand and layout of a start; double underscores stand for dots."""
    given = {name.replace('__', '.'): value for name, value in values.items()}
    defaults = {row.name: row.default for row in START}
    assert set(given) <= set(defaults)
    return starting_hand({**defaults, **given})


def live(hand, values=()):
    """Return the settings of some values, the others at their defaults."""
    defaults = {row.name: row.default for row in live_table(hand)}
    assert set(values) <= set(defaults)
    return live_settings(hand, {**defaults, **dict(values)})


def same(one, other, *but):
    """Return whether two hands are alike, but for some fields."""
    return all(np.array_equal(getattr(one, field.name), getattr(other, field.name))
               for field in fields(Hand) if field.name not in but)


def test_defaults_are_the_mean_hand_and_the_papers_markers():
    hand, layout = start()
    assert same(hand, Hand.scaled())
    assert layout.places == PAPER_PLACES


def test_size_side_preset_and_thumb():
    hand, _ = start(hand_length=.2, hand_breadth=.09, side='left', limits__preset='wide',
                    coupling__preset='paper', thumb='index_mcp')
    expected = Hand.scaled(.2, .09, side='left', limits=preset_limits('wide'),
                           coupling=preset_coupling('paper')).with_paper_thumb()
    assert same(hand, expected)


def test_hand_file_gives_way_to_what_is_given(tmp_path):
    file = tmp_path / 'hand.yaml'
    mine = Hand.scaled(.2, .1, side='left', limits=.5 * preset_limits('wide'),
                       coupling=((.6, .1),) * 5)
    save_hand(file, mine, MarkerLayout(offsets=np.full((8, 3), .003)))
    hand, layout = start(hand_file=str(file))
    assert hand.side == 'left'
    assert np.allclose(hand.limits, mine.limits, rtol=0, atol=1e-12)
    assert np.allclose(hand.coupling, mine.coupling, rtol=0, atol=1e-12)
    assert np.allclose(layout.offsets, .003)
    hand, _ = start(hand_file=str(file), side='right', limits__preset='paper',
                    coupling__preset='natural')
    assert np.array_equal(hand.coupling, preset_coupling('natural'))
    assert hand.side == 'right'
    assert np.array_equal(hand.limits, preset_limits('paper'))
    assert np.allclose(hand.finger_bones, mine.finger_bones)


def test_limits_of_the_wearer_are_chosen_by_name(tmp_path):
    shown = np.tile((-.6, .3), (25, 1))
    save_hand(tmp_path / 'hand.yaml', Hand.scaled(range_of_motion=shown), MarkerLayout())
    for preset in ('paper', 'wearer', 'wide'):
        hand, _ = start(hand_file=str(tmp_path / 'hand.yaml'), limits__preset=preset)
        assert np.allclose(hand.limits, preset_limits(preset, shown), rtol=0, atol=1e-12)
    assert np.array_equal(start(limits__preset='wearer')[0].limits, preset_limits('paper'))


def test_hand_file_in_the_home_folder(tmp_path, monkeypatch):
    monkeypatch.setenv('HOME', str(tmp_path))
    save_hand(tmp_path / 'hand.yaml', Hand.scaled(side='left'), MarkerLayout())
    assert start(hand_file='~/hand.yaml')[0].side == 'left'


@pytest.mark.parametrize('values, said', [
    ({'hand_file': 'nowhere.yaml'}, 'hand_file: nowhere.yaml: No such file'),
    ({'hand_file': 'x.yaml', 'hand_length': .2}, 'hand_length, hand_breadth: they scale'),
    ({'hand_file': 'x.yaml', 'hand_breadth': .09}, 'hand_length, hand_breadth: they scale'),
    ({'prefix': '/right_'}, "prefix: '/right_'"),
    ({'mocap_frame': '/world'}, "mocap_frame: '/world'"),
    ({'wrist_frame': '/wrist'}, "wrist_frame: '/wrist'"),
    ({'wrist_frame': ''}, "wrist_frame: ''")])
def test_refused_at_the_start(values, said):
    with pytest.raises(HandTrackerError, match='^' + said):
        start(**values)


@pytest.mark.parametrize('preset', ['paper', 'wide'])
def test_live_defaults_are_those_of_the_hand_bit_for_bit(preset):
    hand = Hand.scaled(limits=preset_limits(preset), coupling=((.7, np.radians(3.)),) * 5)
    settings = live(hand)
    assert same(settings.hand, hand)
    assert settings.options == TrackerOptions()
    assert [settings.labels.slot('any', i) for i in range(9)] == [*range(8), None]
    assert (settings.unit_scale, settings.zero_is_missing) == (1., True)


def test_every_limit_and_coupling_reaches_its_joint():
    hand = Hand.scaled()
    for i, joint in enumerate(JOINTS):
        settings = live(hand, {f'limits.{joint}.lower_deg': -7., f'limits.{joint}.upper_deg': 8.})
        assert np.array_equal(settings.hand.limits[i], np.radians((-7., 8.)))
        assert same(settings.hand, hand, 'limits')
        assert np.count_nonzero(settings.hand.limits != hand.limits) <= 2
    settings = live(hand, {'coupling.ring.slope': .6, 'coupling.ring.offset_deg': 2.})
    assert np.array_equal(settings.hand.coupling[2], (.6, np.radians(2.)))
    assert np.array_equal(np.delete(settings.hand.coupling, 2, 0), np.delete(hand.coupling, 2, 0))


def test_every_option_is_a_parameter():
    changed = {}
    for row in live_table(Hand.scaled()):
        if row.name in {option.name for option in fields(TrackerOptions)}:
            if isinstance(row.default, bool):
                changed[row.name] = not row.default
            elif row.choices:
                changed[row.name] = row.choices[-1]
            else:
                changed[row.name] = type(row.default)(row.range[0])
            assert row.description
    assert live(Hand.scaled(), changed).options == TrackerOptions(**changed)
    assert len(changed) == len(fields(TrackerOptions))


def test_the_parameter_file_documents_the_defaults_and_replaces_nothing_of_a_hand_file():
    defaults = {row.name: row.default for row in START + live_table(Hand.scaled())}
    text = CONFIG.read_text()
    given = yaml.safe_load(text)['/**']['ros__parameters']
    uncommented = re.sub(r'(?m)^    # (?=[a-z_.]+: )', '    ', text)
    documented = yaml.safe_load(uncommented)['/**']['ros__parameters']
    for name, value in documented.items():
        assert (type(value), value) == (type(defaults[name]), defaults[name]), name
    families = re.compile(r'limits\..*_deg|coupling\.(?!preset)')
    assert {name for name in documented if not families.match(name)} == {
        name for name in defaults if not families.match(name)}
    assert len([name for name in documented if families.match(name)]) >= 4
    shared = {'hand_file', 'hand_length', 'hand_breadth', 'side', 'thumb', 'limits.preset',
              'coupling.preset', 'prefix', 'broadcast'}
    assert [name for name in given if name in shared or families.match(name)] == []


def test_limits_without_effect_say_so():
    joints = {row.name.split('.')[1] for row in live_table(Hand.scaled())
              if 'does nothing where' in row.description}
    assert joints == set(RESTING_JOINTS) < set(JOINTS)
    moved = HandTracker(Hand.scaled(limits=preset_limits('wide')))
    reached = np.zeros(len(JOINTS))
    for markers in demo_recording(rate=20.).markers:
        reached = np.maximum(reached, np.abs(moved.update(markers).angles))
    assert {joint for joint, angle in zip(JOINTS, reached) if angle == 0.} == set(RESTING_JOINTS)


def test_labels_units_and_zeros():
    settings = live(Hand.scaled(), {
        **{f'labels.{marker}': f'leds/{i}' for i, marker in enumerate(MARKERS)},
        'labels.thumb': 'thumb/*', 'unit_scale': .001, 'zero_is_missing': False,
        'display_rate': 25.})
    assert settings.labels.slot('leds', 6) == 6
    assert settings.labels.slot('thumb', 70) == 7
    assert settings.labels.slot('ids', 6) is None
    assert (settings.unit_scale, settings.zero_is_missing) == (.001, False)
    assert settings.display_rate == 25.


@pytest.mark.parametrize('values, said', [
    ({'limits.index_mcp_flexion.upper_deg': -11.}, 'limits of index_mcp_flexion: -10 to -11'),
    ({'coupling.index.slope': 6.}, 'coupling slope'),
    ({'finger_ik': 'magic'}, "finger_ik: 'magic'"),
    ({'labels.wrist': 7}, "labels.thumb: '7' is already wrist's"),
    ({'labels.wrist': None}, 'labels.wrist: None')])
def test_refused_at_run_time(values, said):
    with pytest.raises(HandTrackerError, match='^' + said):
        live(Hand.scaled(), values)


def test_names_are_distinct_and_described():
    rows = START + live_table(Hand.scaled())
    assert len({row.name for row in rows}) == len(rows)
    for row in rows:
        assert row.description
        assert not row.choices or row.default in row.choices
        assert not row.range or row.range[0] <= row.default <= row.range[1]
        assert isinstance(row.default, (bool, str)) or row.range


def test_a_file_of_nested_keys_can_hold_all():
    """As `ros2 param dump` writes it."""
    names = {row.name for row in START + live_table(Hand.scaled())}
    sections = {name[:end] for name in names for end, letter in enumerate(name) if letter == '.'}
    assert sections and not sections & names


def both(**values):
    """Return the values of the start of both hands, by side."""
    given = {name.replace('__', '.'): value for name, value in values.items()}
    defaults = {row.name: row.default
                for row in (*START, *(row for side in SIDES for row in start_of_hand(side)))}
    assert set(given) <= set(defaults)
    return {side: values_of_hand({**defaults, 'side': 'both', **given}, side) for side in SIDES}


def test_each_of_both_hands_has_its_own_side_hand_file_and_limits(tmp_path):
    path, other = tmp_path / 'hand.yaml', tmp_path / 'other.yaml'
    save_hand(path, Hand.scaled(.2, .09), MarkerLayout())
    save_hand(other, Hand.scaled(.17, .08, side='left'), MarkerLayout())
    found = {side: starting_hand(values)[0] for side, values in both(
        hand_file=str(path), left__hand_file=str(other)).items()}
    assert same(found['right'], load_hand(path)[0])
    assert same(found['left'], load_hand(other)[0])
    mirrored = starting_hand(both(hand_file=str(path))['left'])[0]
    assert same(mirrored, load_hand(path)[0].mirrored())
    hand = found['left']
    values = {row.name: row.default for row in (
        *hand_table(hand, 'left.'), *common_table(), *labels_table())}
    values['left.limits.index_pip_flexion.upper_deg'] = 30.
    limits = live_settings(hand, values, scope='left.').hand.limits
    assert limits[JOINTS.index('index_pip_flexion'), 1] == pytest.approx(np.radians(30.))


def test_names_that_both_hands_would_have_are_refused():
    for name in 'prefix', 'wrist_frame':
        with pytest.raises(InvalidParameter, match=f"{name}: 'mine'; expected auto"):
            both(**{name: 'mine'})


def test_both_hands_wear_the_same_markers(tmp_path):
    defaults = {row.name: row.default
                for row in (*START, *(row for side in SIDES for row in start_of_hand(side)))}
    assert names_of_both({**defaults, 'layout': 'sig18_19'}) == preset_layout('sig18_19').names
    path = tmp_path / 'hand.yaml'
    save_hand(path, Hand.scaled(), preset_layout('tips5_palm3'))
    with pytest.raises(InvalidParameter, match='hand.yaml.* have 8 and 8 markers; expected the '
                       'same for both hands'):
        names_of_both({**defaults, 'right.hand_file': str(path)})
    values = {row.name: row.default for row in (
        *labels_table(('a', 'b')), *(markers_parameter(side, SHARED) for side in SIDES))}
    assert labels_of_both(values, SHARED, ('a', 'b'))['left'].labels == ('left/0', 'left/1')


def test_markers_of_both_hands_are_told_apart():
    values = {row.name: row.default for row in labels_table()}
    for topics, expected in (SHARED, ('right/3', 'left/3')), (SEPARATE, ('3', '3')):
        rows = {row.name: row.default for row in (
            markers_parameter(side, topics) for side in SIDES)}
        found = labels_of_both({**values, **rows}, topics)
        assert tuple(found[side].labels[3] for side in SIDES) == expected
    with pytest.raises(HandTrackerError, match="left.markers: 'x'; expected namespace/id"):
        labels_of_both({**values, 'right.markers': '0', 'left.markers': 'x'}, SHARED)
    with pytest.raises(HandTrackerError, match='of both hands'):
        labels_of_both({**values, 'right.markers': 0, 'left.markers': 7}, SHARED)
