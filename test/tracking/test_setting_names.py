"""Names of settings in messages."""

import numpy as np
import pytest
from helpers.point_files import hand_recording

from hand_tracker.calibration.hand_axes import with_recognised_axes
from hand_tracker.calibration.hand_markers import UnknownMarkers, choose_markers
from hand_tracker.files.point_recording import Axes, Said, conversion_note
from hand_tracker.tracking.setting_names import in_parameters


@pytest.mark.parametrize('text, said', [
    ('(as the hand is 62 mm wide then, more or less: --units), z up',
     '(as the hand is 62 mm wide then, more or less: units), z up'),
    ('left-handed axes (--handed left)?', 'left-handed axes (handed:=left)?'),
    ('a right hand, as its fingers bend (--side)', 'a right hand, as its fingers bend (side)'),
    ('expected --layout sig18_19, whose markers are all there, or --markers wrist=LABEL,... with',
     'expected layout:=sig18_19, whose markers are all there, or markers:=wrist=LABEL,... with'),
    ('cut (--partial reads what is there)', 'cut (partial:=true reads what is there)'),
    ('take--up.c3d: --updated, no option --at all', 'take--up.c3d: --updated, no option --at all'),
    ('a - b -- c', 'a - b -- c')])
def test_options_become_parameters(text, said):
    assert in_parameters(text) == said


def test_no_note_of_a_recording_names_an_option():
    recording = hand_recording(400)
    said = Said(False, False, False)
    mirrored = 1e3 * recording.points * np.array((-1., 1., 1.), dtype=np.float32)
    notes = with_recognised_axes(recording._replace(
        points=mirrored, format='BVH', said=said,
        notes=(conversion_note(Axes('m', 'z'), said),))).notes
    assert any('--units' in note and '--up' in note for note in notes)
    assert not any('--' in in_parameters(note) for note in notes)


def test_no_fault_of_the_markers_names_an_option():
    for side in ('left', 'right'):
        with pytest.raises(UnknownMarkers, match='--') as caught:
            choose_markers(hand_recording(labels=('R_Wrist', *map(str, range(7)))), side)
        assert '--' not in in_parameters(str(caught.value))
