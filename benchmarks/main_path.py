"""Count the files and functions that one frame of markers visits in the tracker node.

    python -m benchmarks.main_path [--frames 240] [--list] [--json OUT]

Two counts, for the structure of the program and not for its speed. Static: imports that run
upwards in `import_order.ORDER`. Traced, where rclpy is installed: the Python calls of one message
of eight markers, with the kernels as plain Python, from message to published answer and back to
rest: the subscription's callback, the slow path, and then one `MarkerInput.drain`, which monitors
the frame (the node itself drains several frames at a time). Counted twice: up to the return of the
last answer (`answer_files`, ...), and with monitoring. `files` and `functions` are those of the
package outside `core/numerics` and `depth` its deepest nesting of calls. `upward_calls` are calls
from a folder into a higher one; `climbs` counts how often the node calls into a higher folder than
with its call before, and `calls_after` its calls into other folders once the last answer to the
frame (joint states, transforms, deviations) is published. The traced frames are of the demo motion;
the frame of the median number of functions is taken, as now and then one is reported on
/diagnostics or in the log; `all_files` and `all_functions` count those of any frame.
"""

import argparse
import os
import sys
from collections import Counter
from pathlib import Path
from typing import NamedTuple

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
# Compiled kernels show none of their calls.
os.environ['HAND_TRACKER_JIT'] = '0'

from benchmarks.common import RATE, add_json_option, put_stamps, write_rows
from benchmarks.import_order import ORDER, PACKAGE_FOLDER, is_upward, upward_imports
from benchmarks.round_trip import isolate, messages

UNCOUNTED = 'core/numerics'
ANSWERS = '/joint_states', '/tf', '/joint_confidence'
UNTRACED_FRAMES = 60     # frames that are not traced: the filters settle


class Call(NamedTuple):
    """A call of a function of the package.

    Attributes
    ----------
    caller : str or None
        File of the calling function, relative to the package; None for the middleware.
    file : str
        File of the called function.
    function : str
        Its qualified name.
    depth : int
        Calls of the package that it is nested in, itself included.
    answered : bool
        Whether the last answer to the frame was published before.
    """

    caller: str | None
    file: str
    function: str
    depth: int
    answered: bool


class Tracer:
    """Record the package's calls while a function runs."""

    def __init__(self):
        self.calls = []
        self._stack = []     # files of the package's functions that run, and None for others
        self._answers = 0    # calls recorded when the last answer was published

    def run(self, function, *arguments):
        """Return the calls that `function(*arguments)` makes.

        Returns
        -------
        list of Call
        """
        self.calls, self._stack, self._answers = [], [], 0
        sys.setprofile(self._event)
        try:
            function(*arguments)
        finally:
            sys.setprofile(None)
        return [call._replace(answered=i >= self._answers) for i, call in enumerate(self.calls)]

    def _event(self, frame, event, _):
        if event == 'call':
            self._stack.append(self._entered(frame))
        elif event == 'return' and self._stack:
            self._stack.pop()
            if (frame.f_code.co_name == 'publish' and 'rclpy' in frame.f_code.co_filename
                    and frame.f_locals['self'].topic_name in ANSWERS):
                self._answers = len(self.calls)

    def _entered(self, frame):
        """Record the call of a function; return its file if it is one of the package."""
        path = Path(frame.f_code.co_filename)
        if not path.is_relative_to(PACKAGE_FOLDER):
            return None
        file = str(path.relative_to(PACKAGE_FOLDER))
        # Comprehensions and lambdas are part of the function they stand in.
        if not frame.f_code.co_name.startswith('<') and not file.startswith(UNCOUNTED):
            outer = [name for name in self._stack if name is not None]
            self.calls.append(Call(outer[-1] if outer else None, file, frame.f_code.co_qualname
                                   if hasattr(frame.f_code, 'co_qualname')
                                   else frame.f_code.co_name, len(outer) + 1, False))
        return file


def traced_frames(count):
    """Return the calls of frames that a tracker node takes from its subscription.

    Parameters
    ----------
    count : int
        Frames, after `UNTRACED_FRAMES`.

    Returns
    -------
    list of list of Call
    """
    import rclpy

    from hand_tracker.nodes.tracker_node import TrackerNode
    from hand_tracker.simulation.packaged_recordings import RECORDING_START_NS
    from hand_tracker.tracking.stream import Stream
    # Frames wait for each other only while kernels are compiled.
    Stream.is_compiled = True
    rclpy.init(args=['--ros-args', '-p', 'auto_size:=false'])
    try:
        node, tracer, found = TrackerNode(), Tracer(), []
        callback = next(one.callback for one in node.subscriptions
                        if one.topic_name == '/markers')
        markers, = node.inputs

        def process(message):
            callback(message)
            markers.drain()

        lap = messages(['right'], RATE)
        for i in range(UNTRACED_FRAMES + count):
            data, places = lap[i % len(lap)]
            put_stamps(data, places, RECORDING_START_NS + round(i * 1e9 / RATE))
            if i < UNTRACED_FRAMES:
                process(bytes(data))
            else:
                found.append(tracer.run(process, bytes(data)))
        node.destroy_node()
    finally:
        rclpy.shutdown()
    return found


def functions(calls):
    """Return the (file, function) that are called, in the order of their first call."""
    return list(dict.fromkeys((call.file, call.function) for call in calls))


def upward_calls(calls):
    """Return the calls from a folder into a higher one."""
    return [call for call in calls if call.caller and is_upward(call.caller, call.file)]


def calls_of_node(calls):
    """Return the calls from `nodes/` into other folders."""
    return [call for call in calls if call.caller and call.caller.startswith('nodes/')
            and not call.file.startswith('nodes/')]


def climbs(calls):
    """Return the node's calls into a higher folder than its call before went into."""
    visits = calls_of_node(calls)
    return [later for call, later in zip(visits, visits[1:]) if is_upward(call.file, later.file)]


def calls_after(calls):
    """Return the node's calls into other folders after the last answer."""
    return [call for call in calls_of_node(calls) if call.answered]


def summary(calls):
    """Return the row of a frame, or of its part up to the last answer."""
    return {'files': len({call.file for call in calls}), 'functions': len(functions(calls)),
            'depth': max(call.depth for call in calls), 'calls': len(calls),
            'upward_calls': len(upward_calls(calls)), 'climbs': len(climbs(calls))}


def print_calls(calls):
    """Print the functions of a frame by file, its climbs and the calls after its answer."""
    by_file = {}
    for file, function in functions(calls):
        by_file.setdefault(file, []).append(function)
    for file, names in by_file.items():
        print(f'{file}: {", ".join(names)}')
    for what, some in (('upward', upward_calls(calls)), ('climb', climbs(calls)),
                       ('after the answer', calls_after(calls))):
        for (caller, file, function), times in Counter(
                (call.caller, call.file, call.function) for call in some).items():
            print(f'{what}: {caller} -> {file} {function} ({times} x)')


def main():
    """Count and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--frames', type=int, default=240, help='traced')
    parser.add_argument('--list', action='store_true', help='print every file and function')
    add_json_option(parser)
    options = parser.parse_args()
    upward = upward_imports()
    print(f'{len(upward)} imports run upwards between folders ({", ".join(ORDER)})')
    for source, target in upward:
        print(f'  {source} -> {target}')
    row = {'upward_imports': len(upward)}
    isolate()
    try:
        frames = traced_frames(options.frames)
    except ImportError as error:
        print(f'main path: left out, it needs ROS 2 ({error})')
    else:
        usual = sorted(frames, key=lambda calls: len(functions(calls)))[len(frames) // 2]
        every = [call for calls in frames for call in calls]
        answer = summary([call for call in usual if not call.answered])
        row.update(summary(usual), calls_after=len(calls_after(usual)),
                   all_files=len({call.file for call in every}),
                   all_functions=len(functions(every)),
                   **{f'answer_{name}': value for name, value in answer.items()})
        print(f'a frame outside {UNCOUNTED}:')
        for part, counts in (('up to the last answer', answer), ('with monitoring', row)):
            print('  {}: {files} files, {functions} functions, depth {depth}, {calls} calls, '
                  '{upward_calls} upward, {climbs} climbs'.format(part, **counts))
        print('  {calls_after} calls of the node after the answer; any frame: {all_files} files, '
              '{all_functions} functions'.format(**row))
        if options.list:
            print_calls(usual)
    write_rows(options.json, [row])
    return 0


if __name__ == '__main__':
    sys.exit(main())
