"""Tasks in processes and on a cluster: an error or a death ends no other task."""

import pytest
from distributed import LocalCluster
from helpers.point_files import hand_recording
from helpers.tasks import killed_once, square

from hand_tracker.cli.track import main
from hand_tracker.files.recordings import write_recording
from hand_tracker.parallel import (
    ClusterUnavailable,
    Interruptions,
    WorkerKilled,
    run_tasks,
)

NEEDS = 'distributed', 'joblib'


@pytest.fixture(scope='module')
def cluster():
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as found:
        yield found.scheduler_address


def test_errors_and_faults_end_their_own_task_alone():
    found = list(run_tasks(square, [1, 3, 4, 5], 1, Interruptions()))
    assert [one.value for one in found] == [1, None, None, 25]
    assert [one.lines[-1] for one in found] == ['1', 'three is no number',
                                                'ZeroDivisionError: four', '25']
    assert found[0].lines[0] == 'at 1'


def test_a_killed_process_is_told_of(tmp_path):
    tasks = [(number, str(tmp_path / 'begun')) for number in range(4)]
    with pytest.raises(WorkerKilled, match='a process was killed'):
        list(run_tasks(killed_once, tasks, 2, Interruptions()))


def test_a_cluster_does_again_what_a_killed_worker_was_at(cluster, tmp_path):
    tasks = [(number, str(tmp_path / 'begun')) for number in range(6)]
    found = list(run_tasks(killed_once, tasks, 1, Interruptions(), cluster))
    assert (tmp_path / 'begun').exists()
    assert [one.value for one in found] == list(range(6))


def test_a_cluster_tracks_recordings(cluster, tmp_path, capsys):
    write_recording(tmp_path / 'one.mcap', hand_recording())
    (tmp_path / 'two.mcap').write_bytes((tmp_path / 'one.mcap').read_bytes())
    (tmp_path / 'bad.mcap').write_bytes((tmp_path / 'one.mcap').read_bytes()[:900])
    folder = tmp_path / 'out'
    assert main([str(tmp_path), '-o', str(folder), '--cluster', cluster]) == 1
    table, errors = capsys.readouterr()
    assert 'only 2 of 3 recordings tracked' in errors
    assert [line.split()[0] for line in table.splitlines()] == ['recording', 'bad', 'one', 'two']
    assert sorted(path.name for path in folder.iterdir()) == ['one.csv', 'two.csv']


def test_a_cluster_that_does_not_answer_is_named(monkeypatch):
    monkeypatch.setattr('hand_tracker.parallel.CLUSTER_TIMEOUT', .2)
    with pytest.raises(ClusterUnavailable, match='no scheduler answers'):
        list(run_tasks(square, [1], 1, Interruptions(), 'tcp://127.0.0.1:1'))
    with pytest.raises(ClusterUnavailable, match='no address of a scheduler'):
        list(run_tasks(square, [1], 1, Interruptions(), 'there'))
