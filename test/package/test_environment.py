"""The set-up scripts: a failure says what is missing and how to get it. Nothing is downloaded."""

import os
import shutil
import subprocess
import sys
import time

import pytest

from benchmarks.repository import REPOSITORY

PATIENCE = 240.  # [s], on a busy machine
TOOLS = (
    'bash', 'cat', 'cut', 'dirname', 'env', 'find', 'flock', 'grep', 'mkdir', 'rm', 'sha256sum',
    'sleep', 'sort', 'tail', 'touch',
)

# A Python that knows nothing but how the set-up calls it: its probes, -m venv and -m pip.
FAKE_PYTHON = """#!/usr/bin/env bash
case "$*" in
  *'import rclpy'*) [[ -e $(dirname "$0")/packages ]] ;;
  *version_info*) exit {version} ;;
  *ensurepip*) exit {venv} ;;
  *sysconfig*) exit {headers} ;;
  '-m venv '*)
    mkdir "$3/bin"
    cat "$0" > "$3/bin/python"
    chmod +x "$3/bin/python" ;;
  *'install --no-deps --no-compile'*)
    echo 'pip requirements' >> calls
    {pip}
    touch "$(dirname "$0")/packages" ;;
  *'-m pip'*) echo 'pip package' >> calls ;;
  *warm_up*) echo 'warm up' >> calls ;;
  *) echo "ran: $*" ;;
esac
"""


class Machine:
    """A checkout's scripts in a folder with a space, and a PATH with little on it."""

    def __init__(self, folder):
        self.checkout = folder / 'my checkout'
        self.bin = folder / 'bin'
        self.bin.mkdir()
        for name in ('scripts', 'requirements', 'overlay'):
            shutil.copytree(REPOSITORY / name, self.checkout / name)
        for name in ('package.xml', 'pyproject.toml', 'setup.py', 'setup.cfg'):
            shutil.copy(REPOSITORY / name, self.checkout)
        for name in ('core', 'skin'):
            (self.checkout / 'hand_tracker' / name).mkdir(parents=True)
            (self.checkout / 'hand_tracker' / name / '__init__.py').touch()
        for tool in (*TOOLS, 'chmod'):
            (self.bin / tool).symlink_to(shutil.which(tool))
        self.give('c++', 'exit 0')
        self.overlay('echo overlay >> calls')

    def give(self, name, body):
        """Put a program on the PATH."""
        (self.bin / name).write_text(f'#!/usr/bin/env bash\n{body}\n')
        (self.bin / name).chmod(0o755)

    def python(self, name='python3', version=0, venv=0, headers=0, pip=':'):
        """Put a fake Python on the PATH; the numbers are the exit codes of the set-up's probes."""
        text = FAKE_PYTHON.format(version=version, venv=venv, headers=headers, pip=pip)
        (self.bin / name).write_text(text)
        (self.bin / name).chmod(0o755)

    def overlay(self, body):
        """Let building the overlay do `body`."""
        (self.checkout / 'overlay' / 'build').write_text(f'#!/usr/bin/env bash\n{body}\n')

    def start(self, script='demo', *arguments, **environment):
        return subprocess.Popen(
            [self.checkout / 'scripts' / script, *arguments],
            cwd=self.checkout, env={'PATH': str(self.bin), **environment}, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        )

    def run(self, script='demo', *arguments, **environment):
        process = self.start(script, *arguments, **environment)
        out, err = process.communicate(timeout=PATIENCE)
        return subprocess.CompletedProcess(process.args, process.returncode, out, err)

    def calls(self):
        """Return the steps that really ran since the last call."""
        path = self.checkout / 'calls'
        calls = path.read_text().splitlines() if path.exists() else []
        path.unlink(missing_ok=True)
        return calls


@pytest.fixture
def machine(tmp_path):
    missing = [tool for tool in TOOLS if shutil.which(tool) is None]
    if missing:
        pytest.skip(f'the scripts need {missing}')
    return Machine(tmp_path)


def test_first_run_sets_up_and_the_second_only_starts(machine):
    machine.python()
    first = machine.run('demo', '--out', 'a b')
    assert (first.returncode, first.stdout) == (0, 'ran: -m hand_tracker demo --out a b\n')
    assert machine.calls() == ['pip requirements', 'overlay', 'pip package']
    second = machine.run()
    assert (second.returncode, second.stderr) == (0, '')
    assert machine.calls() == []


@pytest.mark.parametrize('option', ['--recording', '--hand'])
def test_a_file_that_is_not_there_is_said_before_the_set_up(machine, option):
    machine.python()
    result = machine.run('demo', '--view', option, 'absent.mcap')
    assert result.returncode == 1
    assert result.stderr == (
        f'hand_tracker demo: {option} absent.mcap: no such file or folder\n')
    assert machine.calls() == []
    (machine.checkout / 'absent.mcap').touch()
    assert machine.run('demo', option, 'absent.mcap').returncode == 0


@pytest.mark.parametrize('asks', ['-h', '--help'])
def test_help_is_printed_without_a_set_up_or_numpy(machine, asks):
    python = subprocess.run([sys.executable, '-c', 'import sys; print(sys._base_executable)'],
                            capture_output=True, text=True).stdout.strip()
    # Isolated from all packages but this one.
    machine.give('python3', f'exec {python} -S -s "$@"')
    shutil.rmtree(machine.checkout / 'hand_tracker')
    shutil.copytree(REPOSITORY / 'hand_tracker', machine.checkout / 'hand_tracker',
                    ignore=shutil.ignore_patterns('__pycache__'))
    done = machine.run('demo', '--view', asks, COLUMNS='100')
    with_numpy = subprocess.run(
        [sys.executable, '-m', 'hand_tracker', 'demo', '--help'], capture_output=True, text=True,
        env={**os.environ, 'COLUMNS': '100', 'PYTHONPATH': str(REPOSITORY)})
    assert done.returncode == 0 and done.stdout == with_numpy.stdout != ''
    assert not (machine.checkout / '.venv').exists()


def test_view_adds_its_requirements_and_gets_ready_before_it_starts(machine):
    machine.python()
    machine.run('demo')
    machine.calls()
    result = machine.run('demo', '--view', '--port', '9')
    assert result.stdout == 'ran: -m hand_tracker demo --view --port 9\n'
    assert machine.calls() == ['pip requirements', 'warm up']
    machine.run('demo', '--view')
    machine.run('demo')
    assert machine.calls() == []


def test_test_adds_its_requirements_and_passes_arguments_on(machine):
    machine.python()
    machine.run('demo')
    machine.calls()
    result = machine.run('test', '-k', 'palm or thumb')
    assert result.stdout == 'ran: -m pytest -k palm or thumb\n'
    assert machine.calls() == ['pip requirements', 'overlay']
    machine.run('demo')
    assert machine.calls() == []


@pytest.mark.parametrize(
    ('changed', 'steps'),
    [
        ('requirements/demo.txt', ['pip requirements', 'overlay', 'pip package']),
        ('overlay/tf2_msgs/msg/TFMessage.msg', ['overlay']),
        ('setup.py', ['pip package']),
    ],
)
def test_only_what_changed_is_made_anew(machine, changed, steps):
    machine.python()
    machine.run()
    machine.calls()
    with open(machine.checkout / changed, 'a') as file:
        file.write('\n')
    assert machine.run().returncode == 0
    assert machine.calls() == steps


def test_moved_checkout_is_set_up_anew(machine):
    machine.python()
    machine.run()
    machine.calls()
    machine.checkout = machine.checkout.rename(machine.checkout.with_name('moved'))
    machine.run()
    assert machine.calls() == ['pip requirements', 'overlay', 'pip package']


def test_no_python(machine):
    result = machine.run()
    assert result.returncode == 1
    assert 'no Python 3.10 to 3.14' in result.stderr
    assert 'apt install python3' in result.stderr


def test_old_python_gives_way_to_a_newer_one(machine):
    machine.python('python3', version=1)
    machine.python('python3.13')
    result = machine.run()
    assert result.returncode == 0
    assert 'python3.13' in result.stderr


def test_no_venv_module(machine):
    machine.python(venv=1)
    result = machine.run()
    assert result.returncode == 1
    assert 'no venv module' in result.stderr
    assert 'apt install python3-venv' in result.stderr
    assert not (machine.checkout / '.venv').exists()


def test_no_network(machine):
    machine.python(pip="echo 'NewConnectionError: Network is unreachable'; exit 1")
    result = machine.run()
    assert result.returncode == 1
    assert 'Is there a network?' in result.stderr
    assert 'setup.log' in result.stderr
    machine.python()
    assert machine.run().returncode == 0


def test_other_failure_of_pip_shows_its_last_words(machine):
    machine.python(pip="echo 'ERROR: no wheel for this processor'; exit 1")
    result = machine.run()
    assert result.returncode == 1
    assert 'no wheel for this processor' in result.stderr
    assert 'setup.log' in result.stderr


@pytest.mark.parametrize('lack', ['compiler', 'headers', 'build'])
def test_without_overlay_all_else_goes_on(machine, lack):
    machine.python(headers=int(lack == 'headers'))
    if lack == 'compiler':
        (machine.bin / 'c++').unlink()
    if lack == 'build':
        machine.overlay('exit 1')
    result = machine.run()
    assert result.returncode == 0
    told = [line for line in result.stderr.splitlines() if line.startswith('No /tf')]
    assert len(told) == 1
    hints = {'compiler': 'install g++', 'headers': 'install python3-dev', 'build': 'setup.log'}
    assert hints[lack] in told[0]


def test_interrupted_set_up_starts_anew(machine):
    machine.python(pip='touch "$(dirname "$0")/packages"; kill -INT $PPID; exit 1')
    assert machine.run().returncode != 0
    half = machine.checkout / '.venv' / 'half'
    half.touch()
    machine.python()
    assert machine.run().returncode == 0
    assert not half.exists()
    assert machine.calls()[-3:] == ['pip requirements', 'overlay', 'pip package']


def test_a_folder_of_the_user_is_left_alone(machine):
    machine.python()
    theirs = machine.checkout / '.venv' / 'bin' / 'python'
    theirs.parent.mkdir(parents=True)
    theirs.write_text('mine')
    result = machine.run()
    assert result.returncode == 1
    assert theirs.read_text() == 'mine'
    assert "not of this script's making" in result.stderr and 'Move it away' in result.stderr
    assert machine.calls() == []
    shutil.rmtree(machine.checkout / '.venv')
    assert machine.run().returncode == 0


def test_two_runs_at_once_set_up_once(machine):
    machine.python(pip='sleep 1')
    first = machine.start()
    deadline = time.monotonic() + PATIENCE
    while not (machine.checkout / 'calls').exists() and time.monotonic() < deadline:
        time.sleep(0.02)
    second = machine.run()
    first.communicate(timeout=PATIENCE)
    assert 'waiting' in second.stderr
    assert (first.returncode, second.returncode) == (0, 0)
    assert machine.calls() == ['pip requirements', 'overlay', 'pip package']


SOURCED_PYTHON = """
case "$*" in
  *'import rclpy'*) exit {rclpy} ;;
  *'import xdist'*) exit 1 ;;
  '- '*) echo "$@" > asked; echo '{missing}' ;;
  *warm_up*) echo 'warm up' >> calls ;;
  *) echo "ran: $* with $PYTHONPATH in $ROS_DOMAIN_ID" ;;
esac"""


def test_sourced_ros_is_used_as_it_is(machine):
    machine.give('python3', SOURCED_PYTHON.format(rclpy=0, missing=''))
    result = machine.run('test', ROS_DISTRO='jazzy', ROS_DOMAIN_ID='7', PYTHONPATH='/ros')
    assert result.stdout == f'ran: -m pytest with {machine.checkout}:/ros in 7\n'
    assert not (machine.checkout / '.venv').exists()


def test_sourced_ros_needs_only_what_is_required(machine):
    machine.give('python3', SOURCED_PYTHON.format(rclpy=0, missing=''))
    assert machine.run(ROS_DISTRO='jazzy', ROS_DOMAIN_ID='7').returncode == 0
    asked = (machine.checkout / 'asked').read_text().split()[1:]
    assert asked == ['matplotlib', 'numpy', 'PIL', 'rosbags', 'scipy', 'yaml']


def test_sourced_ros_without_a_dependency(machine):
    machine.give('python3', SOURCED_PYTHON.format(rclpy=0, missing='rosbags'))
    result = machine.run(ROS_DISTRO='jazzy')
    assert result.returncode == 1
    assert 'missing: rosbags' in result.stderr
    assert 'rosdep install' in result.stderr and 'pip install' not in result.stderr


def test_sourced_ros_gets_the_view_ready_once(machine, tmp_path):
    machine.give('python3', SOURCED_PYTHON.format(rclpy=0, missing=''))
    for calls in (['warm up'], []):
        result = machine.run('demo', '--view', ROS_DISTRO='jazzy', ROS_DOMAIN_ID='7',
                             XDG_CACHE_HOME=str(tmp_path / 'my cache'))
        assert result.stdout.startswith('ran: -m hand_tracker demo --view with ')
        assert machine.calls() == calls
    asked = (machine.checkout / 'asked').read_text().split()[1:]
    assert asked == ['matplotlib', 'numpy', 'PIL', 'rosbags', 'scipy', 'yaml',
                     'skimage', 'trimesh', 'viser']
    assert not (machine.checkout / '.venv').exists()


def test_sourced_ros_without_the_library_of_the_view(machine):
    machine.give('python3', SOURCED_PYTHON.format(rclpy=0, missing='trimesh viser'))
    result = machine.run('demo', '--view', ROS_DISTRO='jazzy')
    assert result.returncode == 1
    assert 'missing: trimesh viser' in result.stderr
    assert 'rosdep install' in result.stderr and 'pip install viser' in result.stderr
    assert machine.calls() == []


def test_sourced_ros_without_the_physics_of_the_grasp(machine):
    machine.give('python3', SOURCED_PYTHON.format(rclpy=0, missing='mujoco'))
    result = machine.run('demo', '--grasp', ROS_DISTRO='jazzy')
    assert result.returncode == 1
    assert 'missing: mujoco' in result.stderr and 'pip install mujoco' in result.stderr
    asked = (machine.checkout / 'asked').read_text().split()[1:]
    assert asked[-1] == 'mujoco'


def test_sourced_ros_of_another_python_is_left_alone(machine):
    machine.python()
    result = machine.run(ROS_DISTRO='noetic', LD_LIBRARY_PATH='/opt/ros/noetic/lib')
    assert result.returncode == 0
    assert 'using .venv instead' in result.stderr


def test_scripts_pass_shellcheck():
    if shutil.which('shellcheck') is None:
        pytest.skip('shellcheck is not installed')
    scripts = [REPOSITORY / 'scripts' / name for name in (
        'audit', 'demo', 'docs', 'environment.sh', 'lint', 'test')]
    scripts += [REPOSITORY / name for name in ('.ci/run', 'overlay/build', 'requirements/pin')]
    subprocess.run(['shellcheck', '-x', *scripts], cwd=REPOSITORY, check=True, env=os.environ)
