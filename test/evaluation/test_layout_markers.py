"""Layouts with all their markers: each left out, hidden for a while, and worn."""

import json

import numpy as np
from helpers.capture_files import capture_path

from hand_tracker.cli.evaluate import main


def test_a_glove_without_a_landmark_on_its_palm_is_judged(tmp_path):
    """Its palm shows roughly where the fingers begin; a hidden marker is near where it was."""
    rows = tmp_path / 'rows.json'
    assert main(['layouts', str(capture_path('dfki__pillow')), '--quiet', '--json', str(rows)]) == 0
    found = {}
    for row in json.loads(rows.read_text()):
        found.setdefault(row['kind'], []).append(row['mean_mm'])
    assert {kind: len(errors) for kind, errors in found.items()} == {
        'worn': 13, 'left_out': 10, 'hidden': 13}
    means = {kind: np.mean(errors) for kind, errors in found.items()}
    assert means['worn'] < 1.5 and means['hidden'] < means['left_out'] < 5.
