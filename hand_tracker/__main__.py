"""The commands that need no ROS node: `hand_tracker COMMAND --help` tells of each."""

import sys
from importlib import import_module

COMMANDS = {
    'demo': ('hand_tracker.demo', 'replay a recording through the tracker and draw the hand'),
    'track': ('hand_tracker.offline', 'track a recording; write a table or a recording of angles'),
    'urdf': ('hand_tracker.urdf', 'print or write the URDF of a hand'),
    'evaluate': ('hand_tracker.evaluation.command', 'measure the tracker, each table in turn'),
    'simulate': ('hand_tracker.simulation.simulate', 'record a simulated hand seen by cameras'),
    'record': ('hand_tracker.simulation.recording', 'make the packaged recording again'),
}


def main(arguments=None):
    """Run a command; return its exit code."""
    arguments = sys.argv[1:] if arguments is None else arguments
    name = arguments[0] if arguments else '--help'
    if name in COMMANDS:
        return import_module(COMMANDS[name][0]).main(arguments[1:])
    usage = 'usage: hand_tracker COMMAND [--help] ...\n\n' + '\n'.join(
        f'  {command:8s} {what}' for command, (_, what) in COMMANDS.items())
    if name in ('-h', '--help'):
        print(f'{__doc__}\n\n{usage}')
        return 0
    print(f"hand_tracker: no command '{name}'\n{usage}", file=sys.stderr)
    return 2


if __name__ == '__main__':
    sys.exit(main())
