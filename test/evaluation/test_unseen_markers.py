"""Unseen markers: what is fitted and judged, the baselines, and rows."""

import json

import numpy as np
import pytest
from helpers.capture_files import capture_path
from helpers.skin_markers import EVERY_JOINT, WORN_PLACES, simulated_take

from hand_tracker.__main__ import main
from hand_tracker.calibration.marker_fit import fit_markers
from hand_tracker.calibration.take_files import load_take
from hand_tracker.calibration.takes import InvalidTake
from hand_tracker.core.model.hand import Hand
from hand_tracker.evaluation import unseen_markers
from hand_tracker.evaluation.evaluation_options import Options
from hand_tracker.evaluation.plain_markers import fit_plain_markers, plain_markers
from hand_tracker.evaluation.ridge_markers import fit_ridge, ridge_markers
from hand_tracker.evaluation.unseen_markers import MARKER_METHODS, judge, judgements

UNSEEN = tuple(name for name in EVERY_JOINT if name not in WORN_PLACES)


@pytest.fixture(scope='module')
def takes():
    """Return three short takes of one hand, in different motions."""
    return tuple(
        simulated_take(Hand.scaled(.19, .09), EVERY_JOINT, seconds=4., motions=(motion,))[0]
        ._replace(name=motion) for motion in ('spelling', 'power_grasp', 'piano'))


@pytest.fixture(scope='module')
def fit(takes):
    return fit_markers(takes, 'wide')


def test_each_take_is_left_out_in_turn(takes):
    found = judgements(takes, ())
    assert [[take.name for take in one.judged] for one in found] == [
        [take.name] for take in takes]
    assert all(len(one.fitted) == 2 and one.judged[0] not in one.fitted for one in found)


def test_given_takes_are_fitted_and_the_others_judged(takes):
    assert judgements(takes[:1], takes[1:]) == [(takes[1:], takes[:1])]


def test_of_a_take_alone_the_first_fifth_is_fitted(takes):
    found, = judgements(takes[:1], ())
    assert len(found.fitted[0].points) == len(takes[0].points) / 5
    assert len(found.judged[0].points) == len(takes[0].points) * 4 / 5
    cut = takes[0]._replace(sequence=np.arange(len(takes[0].points)) // 12)
    found, = judgements((cut,), ())
    assert set(found.fitted[0].sequence) == {0, 1}
    assert not set(found.fitted[0].sequence) & set(found.judged[0].sequence)


def test_takes_of_other_hands_are_not_mixed(takes):
    other = takes[0]._replace(side='left')
    found = judgements((*takes[:2], other), ())
    assert [len(one.fitted) for one in found] == [1, 1, 1]


def test_no_baseline_gets_an_unseen_marker(takes, fit):
    points = takes[0].columns((*fit.worn, *UNSEEN))
    plain = fit_plain_markers((*fit.worn, *UNSEEN), points, fit.worn)
    ridge = fit_ridge(points[:, :8], points[:, 8:])
    for found in (plain_markers(plain, UNSEEN, points[:, :8]),
                  ridge_markers(ridge, points[:, :8])):
        assert found.shape == points[:, 8:].shape
    # On the motion that it was fitted to the regression is near.
    near = np.linalg.norm(ridge_markers(ridge, points[:, :8]) - points[:, 8:], axis=2)
    assert near.mean() < .004


def test_no_plain_hand_is_fitted_to_the_worn_markers_alone(takes, fit):
    with pytest.raises(InvalidTake, match='no marker thumb_mcp, .*: a plain hand'):
        fit_plain_markers(fit.worn, takes[0].columns(fit.worn), fit.worn)


def test_rows_of_a_simulated_hand(takes, fit, monkeypatch):
    monkeypatch.setattr(unseen_markers, 'fit_markers', lambda *_: fit)
    task = judgements(takes[:1], takes[1:])[0]
    rows = judge(task)
    assert [row['evaluation'] for row in rows] == ['markers'] * 3 * len(UNSEEN)
    assert {row['method'] for row in rows} == set(MARKER_METHODS)
    assert {row['marker'] for row in rows} == set(UNSEEN)
    assert {row['frames'] for row in rows} == {len(takes[0].points)}
    ours = [row['mean_mm'] for row in rows if row['method'] == 'hand_tracker']
    assert np.mean(ours) < 6.
    table, = unseen_markers.tables(rows)
    assert table.lines[-1][0] == 'all'
    assert unseen_markers.losses(rows).reason


def test_what_cannot_be_fitted_is_reported(takes):
    broken = takes[0]._replace(points=np.full_like(takes[0].points, np.nan))
    options = Options(takes=(takes[0], broken), quiet=True)
    with pytest.raises(Exception, match='none of the takes can be judged'):
        list(unseen_markers.evaluate(options))
    assert options.left_out


def test_the_command_writes_rows(takes, fit, monkeypatch, tmp_path):
    monkeypatch.setattr(unseen_markers, 'fit_markers', lambda *_: fit)
    files = []
    for take in takes:
        files.append(str(tmp_path / f'{take.name}.npz'))
        np.savez(files[-1], markers=take.points, marker_names=np.array(take.names),
                 side=take.side, rate_hz=take.rate)
    output = tmp_path / 'rows.json'
    assert main(['evaluate', 'markers', files[0], '--fit', *files[1:], '--json', str(output),
                 '--output', str(tmp_path), '--quiet']) == 0
    rows = json.loads(output.read_text(encoding='utf-8'))
    assert set(rows[0]) == {
        'evaluation', 'recording', 'method', 'marker', 'mean_mm', 'p95_mm', 'frames'}
    assert {row['recording'] for row in rows} == {'spelling'}
    assert (tmp_path / 'markers.png').exists()


def test_real_markers_that_the_tracker_did_not_get():
    takes = [load_take(capture_path(f'kyutech_s1__trial4_task{task}')) for task in (3, 5, 6, 7)]
    rows = judge(judgements(takes[:1], takes[1:])[0])
    means = {method: np.mean([row['mean_mm'] for row in rows if row['method'] == method])
             for method in MARKER_METHODS}
    assert means['hand_tracker'] < 4. < means['plain']
    assert means['hand_tracker'] < means['ridge']
