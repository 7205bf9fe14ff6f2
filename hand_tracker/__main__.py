"""The commands that need no ROS node: `hand_tracker COMMAND --help` tells of each."""

import os
import signal
import sys
from importlib import import_module

COMMANDS = {
    'demo': ('hand_tracker.cli.demo', 'replay a recording through the tracker and draw the hand'),
    'track': ('hand_tracker.tracking.recording', 'track a recording; write a table or a recording of angles'),
    'plot': ('hand_tracker.drawing.angle_plots', 'track a recording; plot the angles of each digit over time'),
    'skin': ('hand_tracker.cli.skin', 'draw the skin of a hand, its weights and blending'),
    'view': ('hand_tracker.cli.view', 'show a recording in the browser'),
    'urdf': ('hand_tracker.files.urdf_file', 'print or write the URDF of a hand'),
    'evaluate': ('hand_tracker.cli.evaluate', 'measure the tracker, each table in turn'),
    'simulate': ('hand_tracker.simulation.simulator', 'record a simulated hand seen by cameras'),
    'record': ('hand_tracker.simulation.packaged_recordings', 'make a packaged recording again'),
}

INTERRUPTED = 130


def main(arguments=None):
    """Run a command; return its exit code."""
    arguments = sys.argv[1:] if arguments is None else arguments
    name = arguments[0] if arguments else '--help'
    if name in COMMANDS:
        return _imported(COMMANDS[name][0]).main(arguments[1:])
    usage = 'usage: hand_tracker COMMAND [--help] ...\n\n' + '\n'.join(
        f'  {command:8s} {what}' for command, (_, what) in COMMANDS.items())
    if name in ('-h', '--help'):
        print(f'{__doc__}\n\n{usage}')
        return 0
    print(f"hand_tracker: no command '{name}'\n{usage}", file=sys.stderr)
    return 2


def _imported(module):
    """Import a module; Ctrl-C ends that quietly, with the exit code of an interrupted command."""
    before = signal.signal(signal.SIGINT, lambda *_: os._exit(INTERRUPTED))
    try:
        return import_module(module)
    finally:
        signal.signal(signal.SIGINT, before)


if __name__ == '__main__':
    sys.exit(main())
