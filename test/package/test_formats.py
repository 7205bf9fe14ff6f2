"""The README's commands for files run, each on a file of its name."""

import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest
from helpers.bodies import body_that_carries
from helpers.point_files import hand_recording

from benchmarks.repository import REPOSITORY
from hand_tracker.__main__ import main
from hand_tracker.files.bvh_file import write_bvh_motion
from hand_tracker.files.recordings import VICON_CSV, write_recording

README = (REPOSITORY / 'README.md').read_text(encoding='utf-8')
README_COMMANDS = re.findall(r'^\| .* \| `(hand_tracker [^`]*)` \|$', README, re.MULTILINE)
VICON_NAMES = {'R_Wrist': 'Anna:WRA', 'R_IndexMCP': 'Anna:FIN', 'R_PinkyMCP': 'Anna:PIN'}
LAB_NAMES = re.search('own are said so: `([^`]*)`', README).group(1)


@pytest.fixture(scope='module')
def recordings(tmp_path_factory):
    """Return a folder with the files that the README names."""
    folder = tmp_path_factory.mktemp('recordings')
    recording = hand_recording(480, start=100)
    for name in ('take.c3d', 'take.trc', 'take.tsv', 'optitrack.csv', 'take.npz', 'take.mcap'):
        write_recording(folder / name, recording)
    write_recording(folder / 'vicon.csv', recording, VICON_CSV)
    own = tuple(VICON_NAMES.get(label, label) for label in recording.labels)
    write_recording(folder / 'lab.csv', recording._replace(labels=own), VICON_CSV)
    assert main(['track', str(folder / 'take.c3d'), '-o', str(folder / 'hand.bvh')]) == 0
    write_bvh_motion(folder / 'body.bvh', body_that_carries(recording.points[:, 0]))
    return folder


def test_the_readme_has_a_command_for_every_format():
    assert len(README_COMMANDS) >= 11
    for suffix in ('.c3d', '.trc', '.tsv', '.csv', '.bvh', '.npz', '.mcap', '.glb'):
        assert any(suffix in command for command in README_COMMANDS)


def test_the_packaged_recording_makes_the_files_of_the_table(monkeypatch, tmp_path):
    line = re.search('`hand_tracker convert (\\S+) (take.c3d)`, and so ([^;]*); `(\\S+)` '
                     'with `([^`]*)`', README)
    recording, first, others, last, form = line.groups()
    names = {first, *re.findall('`([^`]*)`', others)}
    used = {shlex.split(command)[2] for command in README_COMMANDS}
    assert used == {*names, last, 'body.bvh'}
    monkeypatch.chdir(tmp_path)
    # A skeleton is tracked, as another test has it.
    for words in [*([name] for name in names - {'hand.bvh'}), [last, *form.split()]]:
        assert main(['convert', str(REPOSITORY / recording), *words]) == 0
    assert 'wrist' in (tmp_path / last).read_text(encoding='utf-8').splitlines()[2]


@pytest.mark.parametrize('command', README_COMMANDS)
def test_the_commands_of_the_readme_run(recordings, monkeypatch, command):
    monkeypatch.chdir(recordings)
    before = {path: path.stat().st_mtime_ns for path in recordings.iterdir()}
    words = shlex.split(command)[1:]
    assert main(words) == 0
    if words[0] != 'inspect':
        output = Path(words[words.index('-o') + 1] if '-o' in words else words[2])
        assert output.stat().st_size > 500
    assert {path: path.stat().st_mtime_ns for path in before} == before


def test_names_of_a_lab_are_taken_as_the_readme_says_them(recordings, tmp_path):
    words = ['track', str(recordings / 'lab.csv'), '-o', str(tmp_path / 'angles.csv')]
    assert main(words) == 1
    assert main([*words, *shlex.split(LAB_NAMES)]) == 0


def test_what_the_commands_of_the_readme_leave_is_ignored():
    if not (REPOSITORY / '.git').exists() or shutil.which('git') is None:
        pytest.skip('needs a clone and git')
    names = {'my_hand.yaml', 'my_hand.png', 'my_robot.yaml', 'my_robot.png', 'markers.npy',
             'angles.csv', 'take.pdf'}
    for command in README_COMMANDS:
        words = shlex.split(command)[1:]
        names |= {word for word in words[1:] if re.fullmatch('\\w+\\.\\w+', word)}
    found = subprocess.run(['git', 'check-ignore', *sorted(names)], cwd=REPOSITORY,
                           capture_output=True, text=True).stdout.split()
    assert set(found) == names
    # In the root alone.
    assert subprocess.run(['git', 'check-ignore', 'docs/take.c3d', 'test/my_hand.yaml'],
                          cwd=REPOSITORY, capture_output=True).stdout == b''
