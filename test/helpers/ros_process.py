"""Nodes in processes of their own, and a node to watch them with, on a DDS domain of their own."""

import gc
import json
import os
import random
import signal
import socket
import subprocess
import sys
import time
from contextlib import ExitStack, contextmanager
from threading import Condition, Thread

from hand_tracker.entry import PLAIN_NODES


def claim_domain():
    """Return a DDS domain that nobody on this machine uses, and a socket that marks it so."""
    # Above 100, a domain's ports are among those that the system hands out.
    for domain in random.Random(os.getpid()).sample(range(1, 101), 100):
        with ExitStack() as free:
            try:
                for port in range(7400 + PORTS * domain, 7400 + PORTS * (domain + 1)):
                    taken = free.enter_context(socket.socket(type=socket.SOCK_DGRAM))
                    taken.bind(('', port))
            except OSError:
                continue
            # DDS counts from the first port on: the last one is for this mark alone.
            return domain, taken.dup()
    raise RuntimeError('every DDS domain is in use')


PORTS = 250  # of a domain
DOMAIN, _mark = claim_domain()
# Read by every context and process that starts after this, instead of the domain of the user's
# robot. The second variable is Humble's name.
os.environ['ROS_DOMAIN_ID'] = str(DOMAIN)
os.environ.update({'ROS_LOCALHOST_ONLY': '1'} if os.environ.get('ROS_DISTRO') == 'humble'
                  else {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'})

TRACKER_MODULE = 'hand_tracker.nodes.tracker_node'
# A tracker starts with half of the work so, where the speed and paths of frames do not matter.
PLAIN_PYTHON = {'HAND_TRACKER_JIT': '0'}
PATIENCE = 240.  # [s]: kernels may have to be compiled, and other work run beside


class Process:
    """A process whose output is read as it comes; end it by leaving the context.

    Parameters
    ----------
    command : sequence of str
    environment : dict of str to str, optional
        In addition to that of this process.
    **more
        For `subprocess.Popen`.
    """

    def __init__(self, command, environment=None, **more):
        self._process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
            env={**os.environ, 'PYTHONFAULTHANDLER': '1', **(environment or {})}, **more)
        self._lines = []
        self._ended = False
        self._changed = Condition()
        self._reader = Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self):
        for line in self._process.stdout:
            with self._changed:
                self._lines.append(line)
                self._changed.notify_all()
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    def __enter__(self):
        return self

    def __exit__(self, *error):
        if self._process.poll() is None:
            self._process.kill()
        self._process.wait()
        self._reader.join()
        self._process.stdout.close()

    @property
    def output(self):
        """All that it has printed so far."""
        with self._changed:
            return ''.join(self._lines)

    @property
    def ended(self):
        """Whether it has ended by itself."""
        return self._process.poll() is not None

    def wait_for_line(self, text, timeout=PATIENCE):
        """Wait until it has printed a text."""
        def printed():
            return any(text in line for line in self._lines)

        with self._changed:
            self._changed.wait_for(lambda: self._ended or printed(), timeout)
            assert printed(), f'no {text!r} in:\n{"".join(self._lines)}'

    def wait(self, timeout=PATIENCE):
        """Wait until it ends; return its exit code."""
        try:
            code = self._process.wait(timeout)
        except subprocess.TimeoutExpired:
            # Python's fault handler prints where each thread hangs.
            self._process.send_signal(signal.SIGABRT)
            self._process.wait()
            self._reader.join()
            raise AssertionError(f'it did not end within {timeout} s:\n{self.output}') from None
        self._reader.join()
        return code

    def send_signal(self, sig):
        """Send it a signal, as SIGSTOP."""
        self._process.send_signal(sig)

    @property
    def resident(self):
        """Memory that it has taken at most so far [bytes]."""
        with open(f'/proc/{self._process.pid}/status', encoding='ascii') as file:
            return 1024 * next(int(line.split()[1]) for line in file if line.startswith('VmHWM'))

    def interrupt(self, sig=signal.SIGINT, timeout=PATIENCE, times=1):
        """Interrupt it as Ctrl-C does; return its exit code, which must come in time."""
        for _ in range(times):
            self._process.send_signal(sig)
        return self.wait(timeout)


class NodeProcess(Process):
    """A node started as a user starts it.

    Parameters
    ----------
    module : str
        Python module that is run, as 'hand_tracker.nodes.replay_node'.
    parameters : dict, optional
    remaps : dict of str to str, optional
    environment : dict of str to str, optional
        In addition to that of this process.
    files : sequence of path-like, optional
        Parameter files.
    """

    def __init__(self, module, parameters=None, remaps=None, environment=None, files=()):
        name = module.rpartition('.')[2].removesuffix('_node')
        command = [sys.executable, '-m', 'hand_tracker.entry', name, '--ros-args']
        if name not in PLAIN_NODES:
            # Compiled before it listens, not beside that.
            environment = {'HAND_TRACKER_JIT': os.environ.get('HAND_TRACKER_JIT', '1'),
                           **(environment or {})}
        if module == TRACKER_MODULE:
            # What it answers is compared with the hand that it starts with.
            parameters = {'auto_size': False, **(parameters or {})}
        for file in files:
            command += ['--params-file', str(file)]
        for name, value in (parameters or {}).items():
            command += ['-p', f'{name}:={json.dumps(value)}']
        for old, new in (remaps or {}).items():
            command += ['-r', f'{old}:={new}']
        super().__init__(command, environment)


def frames_on_fast_path(diagnostics, key='name'):
    """Return the last count of each status that has one.

    Parameters
    ----------
    diagnostics : list of DiagnosticArray
    key : {'name', 'hardware_id'}, optional
        Of a status, by which it is found.
    """
    return {getattr(status, key): int(value.value) for array in diagnostics
            for status in array.status for value in status.values
            if value.key == 'frames on fast path'}


@contextmanager
def watching_node(name='test'):
    """Yield a node that collects messages, calls services and spins, in a context of its own."""
    import rclpy
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.node import Node

    context = rclpy.Context()
    rclpy.init(context=context)
    executor = SingleThreadedExecutor(context=context)

    class WatchingNode(Node):
        def collect(self, kind, topic, qos=1000):
            """Return a list that grows with each message of a topic."""
            messages = []
            self.create_subscription(kind, topic, messages.append, qos)
            return messages

        def call(self, kind, service, request=None):
            """Call a service; return its response."""
            client = self.create_client(kind, service)
            assert client.wait_for_service(PATIENCE), f'no service {service}'
            future = client.call_async(request or kind.Request())
            self.spin_until(future.done)
            self.destroy_client(client)
            return future.result()

        def spin_until(self, condition, timeout=PATIENCE):
            """Serve callbacks until a condition holds; fail when it does not in time."""
            until = time.monotonic() + timeout
            while not condition():
                assert time.monotonic() < until, f'not in {timeout:g} s'
                executor.spin_once(.05)

        def repeat(self, act, condition, every=.02):
            """Act again and again until a condition holds; fail when it does not in time."""
            until = time.monotonic() + PATIENCE
            while not condition():
                assert time.monotonic() < until, f'not in {PATIENCE:g} s'
                act()
                self.spin_for(every)

        def spin_for(self, duration):
            """Serve callbacks for so many seconds."""
            until = time.monotonic() + duration
            while (left := until - time.monotonic()) > 0:
                executor.spin_once(left)

    node = WatchingNode(name, context=context)
    executor.add_node(node)
    # To collect what a long run of tests has made takes a second, in which messages are lost.
    gc.freeze()
    try:
        yield node
    finally:
        gc.unfreeze()
        executor.shutdown()
        node.destroy_node()
        context.try_shutdown()
