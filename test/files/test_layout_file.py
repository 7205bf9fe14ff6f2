"""Layout files: what is written comes back, and errors name file, field and what is allowed."""

import re

import numpy as np
import pytest

from hand_tracker.cli.layout import main
from hand_tracker.core.model.hand import Hand
from hand_tracker.core.model.layout_presets import LAYOUT_NAMES, LAYOUT_PRESETS, preset_layout
from hand_tracker.core.model.marker_layout import MARKERS, MarkerLayout
from hand_tracker.files.hand_file import InvalidHandFile, load_hand, save_hand
from hand_tracker.files.layout_file import choose_layout, load_layout, save_layout

PALM = ('{name: r, link: wrist}, {name: p, link: index_metacarpal}, '
        '{name: q, link: little_metacarpal}')


def written(path, text):
    path.write_text(text, encoding='utf-8')
    return path


def assert_same(layout, other):
    assert (layout.names, layout.places) == (other.names, other.places)
    for field in ('offsets', 'deviations', 'skin_shares'):
        assert getattr(layout, field) == pytest.approx(getattr(other, field))


@pytest.mark.parametrize('name', LAYOUT_PRESETS)
def test_what_is_saved_comes_back(tmp_path, name):
    layout = preset_layout(name)
    save_layout(tmp_path / 'layout.yaml', layout)
    assert_same(load_layout(tmp_path / 'layout.yaml'), layout)
    save_hand(tmp_path / 'hand.yaml', Hand.scaled(), layout)
    assert_same(load_hand(tmp_path / 'hand.yaml')[1], layout)


@pytest.mark.parametrize('name', LAYOUT_NAMES)
def test_a_preset_is_printed_and_written_as_a_list_to_adapt(tmp_path, name, capsys):
    assert main([name]) == 0
    printed = capsys.readouterr().out
    assert main([name, '-o', str(tmp_path / 'layout.yaml')]) == 0
    assert (tmp_path / 'layout.yaml').read_text(encoding='utf-8') == printed
    adapted = re.sub('- name: .*', '- name: mine', printed, count=1)
    found, preset = load_layout(written(tmp_path / 'mine.yaml', adapted)), preset_layout(name)
    assert found.names == ('mine', *preset.names[1:]) and found.places == preset.places
    assert found.offsets == pytest.approx(preset.offsets)


def test_all_fields_of_a_marker(tmp_path):
    found = load_layout(written(tmp_path / 'a.yaml', f'''
markers: [{PALM}, {{name: nail, link: index_distal, offset_mm: [-3, 1, 8], deviation_mm: 0.7}},
          {{name: 7, place: ring_pip, skin_share: 0.25}}]
'''))
    assert found.names == ('r', 'p', 'q', 'nail', '7')
    assert found.places[3:] == ('index_tip', 'ring_pip')
    assert found.offsets[3] == pytest.approx((-.003, .001, .008))
    assert found.deviations[3] == pytest.approx(.0007) and found.skin_shares[4] == .25


def test_a_preset_by_name_in_a_hand_file(tmp_path):
    _, layout = load_hand(written(tmp_path / 'hand.yaml', 'markers: sig18_19\n'))
    assert_same(layout, preset_layout('sig18_19'))


def test_the_papers_markers_on_the_skin_are_a_layout_too(tmp_path):
    layout = choose_layout('paper8_skin')
    assert layout.names == MARKERS and layout.places == MarkerLayout().places
    assert (layout.offsets[:, 2] > .007).all()
    _, of_file = load_hand(written(tmp_path / 'hand.yaml', 'markers: paper8_skin\n'))
    assert_same(of_file, layout)


def test_a_layout_is_chosen_by_name_or_by_file(tmp_path):
    assert_same(choose_layout('paper8'), MarkerLayout())
    save_layout(tmp_path / 'own.yaml', preset_layout('dfki13'))
    assert_same(choose_layout(str(tmp_path / 'own.yaml')), preset_layout('dfki13'))
    with pytest.raises(InvalidHandFile, match="layout: 'none.yaml' is no file, and no preset"):
        choose_layout('none.yaml')


@pytest.mark.parametrize('text, message', [
    ('{}', 'markers: missing; expected a list'),
    ('markers: nine', "markers: 'nine'; allowed are paper8"),
    ('markers: [3]', r'markers\[0\]: 3; expected a mapping of name'),
    ('markers: [{link: wrist}]', r'markers\[0\].name: None; expected a text'),
    ('markers: [{name: a}]', r'markers\[0\]: expected either link or place'),
    ('markers: [{name: a, link: wrist, place: wrist}]', 'expected either link or place'),
    ('markers: [{name: a, link: palm}]', r"markers\[0\].link: 'palm'; allowed are wrist, index_"),
    ('markers: [{name: a, link: wrist, offset_mm: [1, 2]}]',
     r'markers\[0\].offset_mm: \[1, 2\]; expected a list of 3 numbers'),
    ('markers: [{name: a, link: wrist, ofset_mm: [1, 2, 3]}]',
     r"markers\[0\].ofset_mm: unknown key; did you mean 'offset_mm'"),
    (f'markers: [{PALM}, {{name: p, link: wrist}}]', "names: 'p' stands twice"),
    ('markers: [{name: a, link: wrist}]', '1 given; allowed is 3 to 60 markers'),
])
def test_files_that_are_refused(tmp_path, text, message):
    path = written(tmp_path / 'bad.yaml', text)
    with pytest.raises(InvalidHandFile, match=message) as caught:
        load_layout(path)
    assert str(caught.value).startswith(str(path))


def test_offsets_are_in_millimetres(tmp_path):
    save_layout(tmp_path / 'a.yaml', preset_layout('tips5_palm3'))
    assert '11.0' in (tmp_path / 'a.yaml').read_text(encoding='utf-8')
    assert np.abs(preset_layout('tips5_palm3').offsets).max() == pytest.approx(.011)


def test_a_cut_file_is_told_by_its_line(tmp_path):
    save_layout(tmp_path / 'layout.yaml', preset_layout('kyutech23'))
    text = (tmp_path / 'layout.yaml').read_text(encoding='utf-8')
    cut = text[:text.index('offset_mm', len(text) // 2) + len('offset_mm: [-3')]
    path = written(tmp_path / 'cut.yaml', cut)
    with pytest.raises(InvalidHandFile) as refused:
        load_layout(path)
    line = len(cut.splitlines())
    assert str(refused.value).startswith(f'{path}:{line}:')
    assert 'the file ends there' in str(refused.value)
    assert str(refused.value).endswith('expected YAML, as in docs/layouts.md')
