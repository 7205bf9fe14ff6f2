"""Hand files: what people write is read, what is saved comes back, mistakes are named."""

import re
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
import yaml

from hand_tracker.core.errors import HandTrackerError, InvalidHand
from hand_tracker.core.model.hand import (
    JOINTS,
    SIDES,
    Hand,
    average_natural_flexion,
    preset_coupling,
    preset_limits,
)
from hand_tracker.core.model.layout_presets import preset_layout
from hand_tracker.core.model.marker_layout import MARKERS, PAPER_PLACES, MarkerLayout
from hand_tracker.files.hand_file import (
    BREADTH,
    COUPLING_OFFSET,
    HAND_FILE_KEYS,
    LENGTH,
    NATURAL_OFFSET,
    NATURAL_SLOPE,
    NATURAL_SPREAD,
    RADIUS,
    SPLAY,
    THUMB_FIELDS,
    InvalidHandFile,
    choose_hand,
    file_notes,
    load_hand,
    save_hand,
)
from hand_tracker.files.layout_file import choose_layout, save_layout

EXAMPLE = Path(__file__).parents[2] / 'config' / 'hand.yaml'


@pytest.fixture
def write(tmp_path):
    """Return a function that writes a hand file and returns its path."""
    def write_text(text):
        path = tmp_path / 'mine.yaml'
        path.write_text(text, encoding='utf-8')
        return path
    return write_text


def assert_same(hand, other, close=1e-12):
    for field in fields(Hand):
        a, b = getattr(hand, field.name), getattr(other, field.name)
        if field.name == 'side':
            assert a == b
        else:
            assert a == pytest.approx(np.asarray(b), rel=0., abs=close), field.name


def random_hand(rng):
    """Return a hand in which no number is round and none is a default."""
    mean = Hand.scaled(rng.uniform(.15, .22), rng.uniform(.07, .1))
    noise = {field.name: getattr(mean, field.name) * rng.uniform(.9, 1.1, np.shape(
        getattr(mean, field.name))) for field in fields(Hand) if field.name != 'side'}
    noise['finger_mcp'] = noise['finger_mcp'] + rng.uniform(-.002, .002, (4, 3))
    noise['finger_abduction_axes'] = (0., 0., 1.) + rng.uniform(-.3, .3, (4, 3))
    noise['splay'] = rng.uniform(-.2, .2, 4)
    noise['phalanx_deviation'] = rng.uniform(-.3, .3, 4)
    noise['range_of_motion'] = rng.uniform(0., 2., (25, 2)) * (-1., 1.)
    noise['thumb_mcp_abduction'] = rng.uniform(-.3, .3)
    noise['thumb_roll'] = rng.uniform(-.3, 1.)
    noise['thumb_axis_distance'] = rng.uniform(0., .02)
    noise['coupling'] = noise['coupling'] + rng.uniform(0., .3, (5, 2))
    return mean.replace(**noise, side=str(rng.choice(SIDES)))


@pytest.mark.parametrize('seed', range(20))
def test_saved_hand_comes_back(seed, tmp_path):
    rng = np.random.default_rng(seed)
    hand = random_hand(rng)
    places = ('thumb_cmc', 'ring_mcp', 'little_cmc', 'index_tip', 'middle_dip', 'ring_tip',
              'little_dip', 'thumb_ip')
    layout = MarkerLayout(places, rng.uniform(-.06, .06, (8, 3)), rng.uniform(0., .01, 8))
    save_hand(tmp_path / 'mine.yaml', hand, layout)
    read, read_layout = load_hand(tmp_path / 'mine.yaml')
    assert_same(read, hand, 1e-9)
    assert read_layout.places == layout.places
    assert read_layout.offsets == pytest.approx(layout.offsets, abs=1e-9)
    assert read_layout.deviations == pytest.approx(layout.deviations, abs=1e-9)


def test_values_on_the_edge_of_what_is_allowed_come_back(tmp_path):
    limits = np.tile((-np.pi, np.pi), (25, 1))
    hand = Hand.scaled(
        limits=limits, splay=(np.pi / 4, -np.pi / 4, 0., 0.), palm_radius=.05,
        finger_bones=np.full((4, 3), .2), thumb_bones=(.005,) * 3,
        coupling=((0., -np.pi / 2), (5., np.pi / 2)) + ((.8, 0.),) * 3)
    layout = MarkerLayout(offsets=np.full((8, 3), -.06))
    save_hand(tmp_path / 'mine.yaml', hand, layout)
    assert_same(load_hand(tmp_path / 'mine.yaml')[0], hand)


def test_example_is_the_default_hand():
    hand, layout = load_hand(EXAMPLE)
    assert_same(hand, Hand.scaled())
    assert layout.places == PAPER_PLACES
    assert (layout.offsets == 0.).all()


def test_example_shows_and_explains_every_key():
    text = EXAMPLE.read_text(encoding='utf-8')
    tree = yaml.safe_load(text)
    assert set(tree) == set(HAND_FILE_KEYS)
    for paragraph in text.split('\n\n'):
        assert re.search(r'^ *# \w', paragraph, re.MULTILINE), paragraph
    assert set(tree['markers']) == set(MARKERS)
    assert set(tree['thumb']) == set(THUMB_FIELDS)


@pytest.mark.parametrize('text', [
    'side: right', 'limits: paper', 'limits: wearer', 'coupling: natural', 'coupling:\n',
    'markers:\n'])
def test_what_is_left_out_is_the_default(write, text):
    hand, layout = load_hand(write(text))
    assert_same(hand, Hand.scaled())
    assert layout.places == PAPER_PLACES


def test_hand_written_file(write):
    hand, layout = load_hand(write("""
        side: left
        length_mm: 200
        breadth_mm: 90
        finger_bones_mm: {index: [50, 30, 20]}
        splay_deg: {little: -10}
        thumb: {bones_mm: [45, 35, 27], rest_direction: [1, 0, 0]}
        coupling: {ring: {slope: 0.7}, thumb: {offset_deg: 5}}
        limits: {preset: wide, index_pip_flexion_deg: [-5, 105.5]}
        radii_mm: {thumb: [12, 11, 10]}
        palm_radius_mm: 12.5
        markers:
          index: {place: index_tip, offset_mm: [0, 0, 6]}
          thumb: {offset_mm: [-4, 0, 8.5], deviation_mm: 1.5}
    """))
    bones = np.array(Hand.scaled(.2, .09).finger_bones)
    bones[0] = .05, .03, .02
    limits = preset_limits('wide')
    limits[JOINTS.index('index_pip_flexion')] = np.radians((-5., 105.5))
    radii = np.array(Hand.scaled(.2, .09).radii)
    radii[4] = .012, .011, .010
    coupling = ((.4, 0.), (.4, 0.), (.7, 0.), (.4, 0.), (1., np.radians(5.)))
    assert_same(hand, Hand.scaled(
        .2, .09, side='left', finger_bones=bones, splay=(0., 0., 0., np.radians(-10.)),
        thumb_bones=(.045, .035, .027), thumb_rest_direction=(1., 0., 0.), coupling=coupling,
        limits=limits, radii=radii, palm_radius=.0125))
    assert layout.places == PAPER_PLACES[:3] + ('index_tip',) + PAPER_PLACES[4:]
    assert layout.offsets[3] == pytest.approx((0., 0., .006))
    assert layout.offsets[7] == pytest.approx((-.004, 0., .0085))
    assert layout.deviations == pytest.approx((0.,) * 7 + (.0015,))


def test_limits_of_the_wearer(write):
    shown = 'range_of_motion: {index_pip_flexion_deg: [20, 110], ring_mcp_flexion_deg: [-30, 40]}'
    hand, _ = load_hand(write(f'limits: wearer\n{shown}'))
    index, ring = JOINTS.index('index_pip_flexion'), JOINTS.index('ring_mcp_flexion')
    range_of_motion = np.zeros((25, 2))
    range_of_motion[[index, ring]] = np.radians(((20., 110.), (-30., 40.)))
    limits = preset_limits('paper')
    limits[index, 1], limits[ring, 0] = np.radians((110., -30.))
    assert_same(hand, Hand.scaled(limits=limits, range_of_motion=range_of_motion))
    # What a calibration has seen is kept for other presets, and for limits of single joints.
    path = write(f'limits: {{preset: wearer, index_pip_flexion_deg: [0, 90]}}\n{shown}')
    limits[index] = np.radians((0., 90.))
    assert_same(load_hand(path)[0], hand.replace(limits=limits))
    for preset in ('paper', 'wide', 'wearer'):
        assert_same(choose_hand(path, limits=preset)[0],
                    hand.replace(limits=preset_limits(preset, range_of_motion)))


@pytest.mark.parametrize('preset', ['paper', 'wide', 'wearer'])
def test_limits_of_a_preset_are_saved_by_its_name(tmp_path, preset):
    shown = np.tile((-.4, 1.7), (25, 1))
    hand = Hand.scaled(range_of_motion=shown, limits=preset_limits(preset, shown))
    save_hand(tmp_path / 'mine.yaml', hand, MarkerLayout())
    assert yaml.safe_load((tmp_path / 'mine.yaml').read_text(encoding='utf-8'))['limits'] == preset
    assert_same(load_hand(tmp_path / 'mine.yaml')[0], hand)


@pytest.mark.parametrize('text', ['', '# nothing\n', '{}'])
def test_an_empty_file_is_not_taken_for_the_mean_hand(write, text):
    path = write(text)
    with pytest.raises(InvalidHandFile, match=re.escape(
            f'{path}: it is empty; expected at least one of side, length_mm, breadth_mm')):
        load_hand(path)


def test_natural_flexion_of_single_digits(write):
    hand, _ = load_hand(write('natural_flexion: {ring: {slope: -0.5, spread_deg: 8}}'))
    natural = average_natural_flexion()
    natural[2] = -.5, 0., np.radians(8.)
    assert_same(hand, Hand.scaled(natural_flexion=natural))


def test_coupling_of_a_preset_and_of_single_digits(write):
    hand, _ = load_hand(write('coupling: paper'))
    assert_same(hand, Hand.scaled(coupling=preset_coupling('paper')))
    hand, _ = load_hand(write('coupling: {preset: paper, ring: {offset_deg: 5}}'))
    coupling = preset_coupling('paper')
    coupling[2, 1] = np.radians(5.)
    assert_same(hand, Hand.scaled(coupling=coupling))


@pytest.mark.parametrize('text, message', [
    ('lenght_mm: 180', "lenght_mm: unknown key; did you mean 'length_mm'?"),
    ('length: 180', "length: unknown key; did you mean 'length_mm'?"),
    ('zzz: 1', 'zzz: unknown key; allowed are side, length_mm, breadth_mm'),
    ('left: {hand_tracker: {ros__parameters: {side: left}}}',
     'left: unknown key; the file is of ROS parameters, for --params-file'),
    ('1: 2', '1: unknown key; allowed are side'),
    ('finger_bones_mm: {pinky: [1, 2, 3]}',
     'finger_bones_mm.pinky: unknown key; allowed are index, middle, ring, little'),
    ('thumb: {cmc: [1, 2, 3]}', "thumb.cmc: unknown key; did you mean 'cmc_mm'?"),
    ('limits: {index_pip_flexion: [0, 90]}',
     "limits.index_pip_flexion: unknown key; did you mean 'index_pip_flexion_deg'?"),
    ('markers: {index: {offset: [0, 0, 0]}}',
     "markers.index.offset: unknown key; did you mean 'offset_mm'?"),
    ('side: Left', "side: 'Left'; allowed are right, left"),
    ('limits: narrow', "limits: 'narrow'; allowed are paper, wide, wearer"),
    ('limits: [0, 1]', 'limits: [0, 1]; allowed are paper, wide, wearer'),
    ('limits: {preset: none}', "limits.preset: 'none'; allowed are paper, wide, wearer"),
    ('limits: {ring_dip_flexion_deg: [50, 5]}', 'limits of ring_dip_flexion: 50 to 5 degrees; '
     'the lower limit must not exceed the upper'),
    ('limits: {ring_dip_flexion_deg: [-5, 190]}',
     'limits.ring_dip_flexion_deg[1]: 190; allowed is -180 to 180 degrees'),
    ('limits: {ring_dip_flexion_deg: 90}',
     'limits.ring_dip_flexion_deg: 90; expected a list of 2 numbers'),
    ('length_mm: 18.5', 'length_mm: 18.5; allowed is 100 to 260 mm'),
    ('breadth_mm: long', "breadth_mm: 'long'; expected a number"),
    ('breadth_mm: true', 'breadth_mm: True; expected a number'),
    ('breadth_mm: [85]', 'breadth_mm: [85]; expected a number'),
    ('breadth_mm: .nan', 'breadth_mm: nan; allowed is 40 to 140 mm'),
    ('palm_radius_mm: .inf', 'palm_radius_mm: inf; allowed is 1 to 50 mm'),
    ('finger_bones_mm: {ring: [45, 0.026, 19]}',
     'finger_bones_mm.ring[1]: 0.026; allowed is 5 to 200 mm'),
    ('finger_bones_mm: {ring: [45, 26]}',
     'finger_bones_mm.ring: [45, 26]; expected a list of 3 numbers'),
    ('finger_bones_mm: [45, 26]',
     'finger_bones_mm: [45, 26]; expected a mapping of index, middle, ring, little'),
    ('finger_mcp_mm: {index: [900, 20, 0]}',
     'finger_mcp_mm.index[0]: 900; allowed is -300 to 300 mm'),
    ('splay_deg: {index: 60}', 'splay_deg.index: 60; allowed is -45 to 45 degrees'),
    ('radii_mm: {thumb: [11, 10, 90]}', 'radii_mm.thumb[2]: 90; allowed is 1 to 50 mm'),
    ('coupling: {index: {slope: -1}}', 'coupling.index.slope: -1; allowed is 0 to 5'),
    ('coupling: {index: {offset_deg: 91}}',
     'coupling.index.offset_deg: 91; allowed is -90 to 90 degrees'),
    ('coupling: strict', "coupling: 'strict'; allowed are natural, paper"),
    ('coupling: {preset: 0.8}', 'coupling.preset: 0.8; allowed are natural, paper'),
    ('coupling: {pinky: {slope: 1}}', 'coupling.pinky: unknown key'),
    ('natural_flexion: {index: {spread_deg: 1}}',
     'natural_flexion.index.spread_deg: 1; allowed is 2 to 90 degrees'),
    ('natural_flexion: {index: {ratio: 1}}', 'natural_flexion.index.ratio: unknown key; allowed'),
    ('natural_flexion: wide', "natural_flexion: 'wide'; expected a mapping of index, middle"),
    ('coupling: {index: 0.8}', 'coupling.index: 0.8; expected a mapping of slope, offset_deg'),
    ('thumb: {abduction_axis: [0, 0, 0]}', 'thumb_abduction_axis: [0. 0. 0.] has no direction'),
    ('finger_mcp_mm: {index: [80, -60, 0]}',
     'finger_mcp: the index MCP must lie on the thumb side'),
    ('abduction_axes: {ring: [0, 0, -1]}', 'finger_abduction_axes of ring: [ 0.  0. -1.] is more'),
    ('markers: {index: {place: index_pip}}',
     "marker index: place 'index_pip' is not one of index_dip, index_tip"),
    ('markers: {index: {offset_mm: [0, 0, 200]}}',
     'markers.index.offset_mm[2]: 200; allowed is -60 to 60 mm'),
    ('markers: {index: {deviation_mm: -1}}',
     'markers.index.deviation_mm: -1; allowed is 0 to 10 mm'),
    ('just words', "the file: 'just words'; expected a mapping of side, length_mm"),
    (f"'{80 * '<link/>'}'", f"the file: '{(80 * '<link/>')[:59]} ...; expected a mapping of side"),
])
def test_mistakes_are_named_with_file_field_and_what_is_allowed(write, text, message):
    path = write(text)
    with pytest.raises(InvalidHandFile, match=re.escape(f'{path}: {message}')):
        load_hand(path)


@pytest.mark.parametrize('text, message', [
    ('side: right\nlength_mm: [1, 2\nbreadth_mm: 3',
     ':2:12: a list in [ ] that is not closed, or lacks a comma; expected YAML'),
    ('side: right\n\tlength_mm: 180', ':2:1: a tab; expected spaces'),
    ('side: right\nfinger_mcp_mm:\n  index: [80, ',
     ':3:15: a list in [ ] or a mapping in { } that is not closed (the file ends there, perhaps '
     'cut off); expected YAML, as in config/hand.yaml'),
    ('side: right\nlength_m', ":2:1: a key without ':' and a value (the file ends there"),
    ('length_mm: 180\nlength\nside: left', ":2:1: a key without ':' and a value; expected"),
    ('side: "right\nlength_mm: 180', ':1:7: a text in quotes that is not closed'),
    ('thumb:\n    roll_deg: 1\n  cmc_mm: [1, 2, 3]', ':3:3: another indentation than'),
    ('side: \0', ': no YAML text: character 0x0; expected text in UTF-8'),
    ('length_mm: 180\nside: left\nlength_mm: 190', ":3:1: key 'length_mm' stands twice"),
    ('thumb:\n  cmc_mm: [1, 2, 3]\n  cmc_mm: [1, 2, 3]', ":3:3: key 'cmc_mm' stands twice"),
    ('? [1]\n: 2', ':1:3: a list or a mapping as a key'),
    ('thumb: &a {}\nlimits: *a', ":2:9: alias '*a', which is not read"),
    ('side: ' + '[' * 50, ':1:56: nested more than 50 deep'),
    ('length_mm: 0x' + 'f' * 4000, ':1:12: an integer of more than 64 bits'),
    ('side: 2001-99-99', ': no YAML text: month must be in 1..12'),
    ('side: ' + ' ' * 2**20, ': no YAML text: more than 1048576 characters'),
    ('side: !!python/name:os.system', ':1:7: a tag, which is not read'),
])
def test_wrong_yaml_gives_file_line_and_column(write, text, message):
    path = write(text)
    with pytest.raises(InvalidHandFile, match=re.escape(f'{path}{message}')):
        load_hand(path)


def test_other_text_than_yaml_is_told_what_is_expected(write):
    with pytest.raises(InvalidHandFile, match='; expected YAML, as in config/hand.yaml$'):
        load_hand(write('# A title\n\nText: with `code`: and more.'))


def test_files_that_are_no_text_are_refused(tmp_path):
    binary = tmp_path / 'binary.yaml'
    binary.write_bytes(b'\xff\xfe\x00\xd8')
    for path, message in ((tmp_path / 'none.yaml', 'No such file or directory'),
                          (tmp_path, 'Is a directory'), (binary, 'no YAML text: byte 0xff;')):
        with pytest.raises(InvalidHandFile, match=re.escape(f'{path}: {message}')) as refused:
            load_hand(path)
        assert isinstance(refused.value, HandTrackerError)


@pytest.mark.parametrize('quantity, accept', [
    (LENGTH, lambda v: Hand.scaled(length=v)),
    (BREADTH, lambda v: Hand.scaled(breadth=v)),
    (RADIUS, lambda v: Hand.scaled(palm_radius=v)),
    (RADIUS, lambda v: Hand.scaled(radii=np.full((5, 3), v))),
    (SPLAY, lambda v: Hand.scaled(splay=(v,) * 4)),
    (COUPLING_OFFSET, lambda v: Hand.scaled(coupling=((.8, v),) * 5)),
    (NATURAL_SLOPE, lambda v: Hand.scaled(natural_flexion=((v, 0., .3),) * 5)),
    (NATURAL_OFFSET, lambda v: Hand.scaled(natural_flexion=((1., v, .3),) * 5)),
    (NATURAL_SPREAD, lambda v: Hand.scaled(natural_flexion=((1., 0., v),) * 5)),
])
def test_ranges_in_human_units_are_the_hands(quantity, accept):
    for edge, beyond in ((quantity.lower, -1.), (quantity.upper, 1.)):
        accept(quantity.to_si(edge))
        with pytest.raises(InvalidHand, match='allowed is'):
            accept(quantity.to_si(edge + .001 * beyond))


# --- the hand that somebody chooses

def test_chosen_hand_is_the_mean_one_of_the_size_asked_for():
    hand, layout = choose_hand(length=.2, breadth=.09)
    assert_same(hand, Hand.scaled(.2, .09))
    assert layout.places == MarkerLayout().places
    assert_same(choose_hand()[0], Hand.scaled())


def test_chosen_hand_is_that_of_the_file_with_what_is_asked_for_in_its_place(write):
    path = write('{side: left, limits: wide, coupling: paper, markers: {thumb: {place: thumb_ip}}}')
    hand, layout = choose_hand(path)
    assert_same(hand, load_hand(path)[0])
    assert layout.places[MARKERS.index('thumb')] == 'thumb_ip'
    asked = {'side': 'right', 'limits': preset_limits('paper'),
             'coupling': preset_coupling('natural')}
    for (name, value), preset in zip(asked.items(), ('right', 'paper', 'natural')):
        assert_same(choose_hand(path, **{name: preset})[0], hand.replace(**{name: value}))


def test_a_layout_of_the_same_markers_keeps_the_places_of_the_hand_file(tmp_path):
    path, preset = tmp_path / 'mine.yaml', preset_layout('kyutech23')
    fitted = preset.with_offsets(preset.offsets + .002)
    save_hand(path, Hand.scaled(), fitted.in_order(fitted.names[::-1]))
    _, layout = choose_hand(path, layout='kyutech23')
    assert layout.names == preset.names and layout.places == preset.places
    np.testing.assert_allclose(layout.offsets, fitted.offsets, atol=1e-9)
    assert file_notes(path, layout='kyutech23') == []
    # Of others the layout's are taken.
    for name in ('dfki13', 'paper8_skin'):
        _, layout = choose_hand(path, layout=name)
        np.testing.assert_array_equal(layout.offsets, choose_layout(name).offsets)
        note, = file_notes(path, layout=name)
        assert f'layout {name} take the place' in note


def test_a_layout_of_the_same_names_elsewhere_takes_the_place_of_the_hand_files(tmp_path):
    path, other = tmp_path / 'mine.yaml', tmp_path / 'other.yaml'
    names = ('w', 'i', 'l', 'm1', 'm2')
    one, two = (MarkerLayout(('wrist', 'index_mcp', 'little_mcp', *places), np.full((5, 3), .005),
                             names=names) for places in (('index_tip', 'thumb_tip'),
                                                         ('ring_tip', 'thumb_ip')))
    save_hand(path, Hand.scaled(), one)
    save_layout(other, two)
    assert choose_hand(path, layout=str(other))[1].places == two.places
    note, = file_notes(path, layout=str(other))
    assert 'take the place' in note


def test_calibrated_places_of_the_papers_eight_are_kept_beside_a_usual_layout(tmp_path):
    path, fitted = tmp_path / 'mine.yaml', MarkerLayout(offsets=np.full((8, 3), .006))
    save_hand(path, Hand.scaled(), fitted)
    np.testing.assert_allclose(choose_hand(path, layout='paper8_skin')[1].offsets, fitted.offsets)
    save_hand(path, Hand.scaled(), MarkerLayout())
    usual = choose_layout('paper8_skin').offsets
    np.testing.assert_array_equal(choose_hand(path, layout='paper8_skin')[1].offsets, usual)
    assert file_notes(path, layout='paper8_skin') == []
