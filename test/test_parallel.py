"""Tasks in processes and on a cluster: an error or a death ends no other task."""

import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import psutil
import pytest
from distributed import LocalCluster
from helpers.point_files import hand_recording
from helpers.tasks import killed_once, square

from benchmarks.repository import REPOSITORY
from hand_tracker.cli.track import main
from hand_tracker.files.bags import write_bag
from hand_tracker.files.recordings import write_recording
from hand_tracker.parallel import (
    ClusterUnavailable,
    Interruptions,
    WorkerKilled,
    run_tasks,
)
from hand_tracker.simulation.packaged_recordings import demo_recording, recording_messages

NEEDS = 'distributed', 'joblib', 'psutil'
PATIENCE = 400.    # [s], on a busy machine, with kernels to compile


@pytest.fixture(scope='module')
def cluster():
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as found:
        yield found


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


def worker_that_writes(pids, folder, command):
    """Return the process of a worker that is in the middle of a file in or beside a folder."""
    until = time.monotonic() + PATIENCE
    while time.monotonic() < until and command.poll() is None:
        for pid in pids():
            with suppress(psutil.Error):
                if any(folder.parent in Path(one.path).parents and one.mode != 'r'
                       for one in psutil.Process(pid).open_files()):
                    return pid
        time.sleep(.002)
    raise AssertionError('no worker wrote a file', command.poll())


def test_a_cluster_tracks_again_what_a_killed_worker_was_at(cluster, tmp_path):
    takes, folder = tmp_path / 'takes', tmp_path / 'new' / 'out'
    takes.mkdir()
    folder.parent.mkdir()
    demo = demo_recording()
    names = [f'take_{number}' for number in range(4)]
    for number, name in enumerate(names):
        part = slice(100 * number, 100 * number + 400)
        write_bag(takes / f'{name}.mcap', recording_messages(demo._replace(
            stamps=demo.stamps[part], markers=demo.markers[part], angles=demo.angles[part]),
            'right'))
    command = subprocess.Popen(
        [sys.executable, '-m', 'hand_tracker', 'track', str(takes), '-o', str(folder),
         '--cluster', cluster.scheduler_address], env={**os.environ, 'PYTHONPATH': str(REPOSITORY)},
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        killed = worker_that_writes(
            lambda: [nanny.pid for nanny in cluster.workers.values() if nanny.pid], folder, command)
        os.kill(killed, signal.SIGKILL)
        table, said = command.communicate(timeout=PATIENCE)
    finally:
        command.kill()
    assert command.returncode == 0, said
    assert [line.split()[:3] for line in table.splitlines()[1:-1]] == [
        [name, '400', '100.0'] for name in names]
    assert table.endswith(f'{folder}: 4 recordings tracked\n')
    assert sorted(path.name for path in folder.iterdir() if path.is_file()) == [
        f'{name}.csv' for name in names]
    assert main([str(takes / 'take_3.mcap'), '-o', str(tmp_path / 'alone.csv')]) == 0
    assert (folder / 'take_3.csv').read_bytes() == (tmp_path / 'alone.csv').read_bytes()
    for name in names:
        assert len((folder / f'{name}.csv').read_text().splitlines()) == 401


def test_a_cluster_tracks_recordings(cluster, tmp_path, capsys):
    write_recording(tmp_path / 'one.mcap', hand_recording())
    (tmp_path / 'two.mcap').write_bytes((tmp_path / 'one.mcap').read_bytes())
    (tmp_path / 'bad.mcap').write_bytes((tmp_path / 'one.mcap').read_bytes()[:900])
    folder = tmp_path / 'out'
    assert main([str(tmp_path), '-o', str(folder), '--cluster', cluster.scheduler_address]) == 1
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
