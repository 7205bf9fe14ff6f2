"""Recordings of an object store, tracked into another of its folders."""

import fsspec
import pytest
from helpers.point_files import hand_recording

from hand_tracker.__main__ import main as hand_tracker
from hand_tracker.cli.track import main
from hand_tracker.files.recordings import write_recording
from hand_tracker.files.remote_files import RemoteFileError, Url, local_copy, located, matching

NEEDS = ('fsspec',)


@pytest.fixture
def store(tmp_path):
    """Return a store with two recordings in memory."""
    write_recording(tmp_path / 'take.mcap', hand_recording())
    memory = fsspec.filesystem('memory')
    for name in ('one', 'two'):
        memory.put_file(str(tmp_path / 'take.mcap'), f'/takes/{name}.mcap')
    yield memory
    memory.store.clear()
    memory.pseudo_dirs[:] = ['']


def test_recordings_of_a_store_are_tracked_into_it(store, tmp_path, capsys):
    assert main(['memory://takes/*.mcap', '-o', 'memory://angles']) == 0
    assert main([str(tmp_path / 'take.mcap'), '-o', str(tmp_path / 'here.csv')]) == 0
    for name in ('one', 'two'):
        assert store.cat(f'/angles/{name}.csv') == (tmp_path / 'here.csv').read_bytes()
    capsys.readouterr()
    assert main(['memory://takes/*.mcap', '-o', 'memory://angles', '--resume']) == 0
    assert capsys.readouterr().out.count('already there') == 2
    assert main(['memory://takes/one.mcap', '-o', str(tmp_path / 'copied.csv')]) == 0
    assert (tmp_path / 'copied.csv').read_bytes() == (tmp_path / 'here.csv').read_bytes()


def test_what_is_not_there_is_named(store):
    assert located('s3://bucket/a.c3d') == 's3://bucket/a.c3d'
    assert not isinstance(located('a.c3d'), Url)
    with pytest.raises(RemoteFileError, match='no file there'):
        matching(Url('memory://takes/*.c3d'))
    with pytest.raises(RemoteFileError, match='memory://takes/three.mcap: FileNotFound'):
        with local_copy(Url('memory://takes/three.mcap')):
            pass
    with pytest.raises(RemoteFileError, match='nosuch://a'):
        with local_copy(Url('nosuch://a')):
            pass


@pytest.mark.parametrize('command', [
    ['inspect', 'memory://takes/take.c3d'], ['convert', 's3://takes/take.c3d', 'take.csv'],
    ['plot', 'file:///takes/take.c3d', '-o', 'take.pdf']])
def test_commands_that_read_no_urls_say_so(command, capsys):
    assert hand_tracker(command) == 1
    assert 'is elsewhere; hand_tracker track alone reads URLs' in capsys.readouterr().err


def test_messages_name_the_url_of_a_recording(store, tmp_path, capsys):
    assert main(['memory://takes/one.mcap', '-o', str(tmp_path / 'one.csv')]) == 0
    assert 'memory://takes/one.mcap: no hand file' in capsys.readouterr().err
    store.pipe('/takes/cut.mcap', store.cat('/takes/one.mcap')[:2000])
    assert main(['memory://takes/cut.mcap', '-o', str(tmp_path / 'cut.csv')]) == 1
    message = capsys.readouterr().err
    assert 'memory://takes/cut.mcap: ' in message and 'hand_tracker-' not in message
