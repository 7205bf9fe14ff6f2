"""Hand tracker's commands; `hand_tracker COMMAND --help` lists the options of each."""

import os
import signal
import sys
from importlib import import_module

from . import __version__
from .interruption import INTERRUPTED_EXIT_CODE, ended_by_interrupt

# Module of `cli`: its help.
COMMANDS = {
    'demo': 'replay a recording through the tracker and draw the hand',
    'track': 'track a recording; write a table or a recording of angles',
    'inspect': 'print what is in a recording, and the command to run next',
    'convert': 'write a recording in another format',
    'splice': 'put tracked hands on the body that another system captured',
    'plot': 'track a recording; plot the angles of each digit over time',
    'skin': 'draw the skin of a hand, its weights and blending',
    'view': 'show a recording in the browser',
    'layout': 'print or write a preset marker layout, as a file to adapt',
    'urdf': 'print or write the URDF of a hand',
    'robot': 'find palm, digits and axes of a robot hand; write its file, draw it',
    'evaluate': 'measure the tracker, each table in turn',
    'calibrate': 'fit a hand to takes of the markers on it',
    'simulate': 'record a simulated hand seen by cameras',
    'record': 'make a packaged recording again',
}

BROKEN_PIPE_EXIT_CODE = 128 + signal.SIGPIPE  # as of a process that the signal ended

# Commands that track at once, in plain Python where the kernels are not on disk yet.
START_AT_ONCE = {'convert', 'demo', 'inspect', 'plot', 'splice', 'track'}


def main(arguments: list[str] | None = None) -> int:
    """Run a command; return its exit code."""
    try:
        try:
            return _run(arguments)
        finally:
            sys.stdout.flush()
    except BrokenPipeError:
        # Nobody reads on, as behind `| head`: what is left to write goes nowhere.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return BROKEN_PIPE_EXIT_CODE


def _run(arguments: list[str] | None) -> int:
    arguments = sys.argv[1:] if arguments is None else arguments
    name = arguments[0] if arguments else '--help'
    if name in COMMANDS:
        # The viewer tracks seconds of a recording at a time, for which plain Python is too slow.
        if name in START_AT_ONCE and '--view' not in arguments:
            os.environ.setdefault('HAND_TRACKER_JIT', 'background')
        try:
            with ended_by_interrupt():
                command = import_module(f'hand_tracker.cli.{name}')
            return command.main(arguments[1:])
        except KeyboardInterrupt:
            return INTERRUPTED_EXIT_CODE
    if name == '--version':
        print(f'hand_tracker {__version__}')
        return 0
    usage = '\n'.join((
        'usage: hand_tracker COMMAND [--help] ...', '       hand_tracker --version', '',
        *(f'  {command:9s} {what}' for command, what in COMMANDS.items())))
    if name in ('-h', '--help'):
        print(f'{__doc__}\n\n{usage}')
        return 0
    print(f"hand_tracker: no command '{name}'\n{usage}", file=sys.stderr)
    return 2


if __name__ == '__main__':
    sys.exit(main())
