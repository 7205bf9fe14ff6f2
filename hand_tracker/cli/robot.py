"""`hand_tracker robot`: find palm, digits, side and axes of a robot, write its file, show it."""

import shlex
import sys
from pathlib import Path

from ..core.model.hand import SIDES
from ..output_files import PICTURE_SUFFIXES, YAML_SUFFIXES, require_writable, write_whole_text
from ..package_data import packaged_recording
from . import view
from .recording_options import one_side, require_inputs
from .reporting import CommandParser, reporting


@reporting
def main(args: list[str] | None = None) -> int:
    """Run the command.

    Parameters
    ----------
    args : list of str, optional
        Those of the command line when left out.

    Returns
    -------
    int
        Exit code: 0, or 1 if the robot or a file is invalid.
    """
    parser = CommandParser(prog='hand_tracker robot',
                           description='Add a robot hand to retarget to.')
    commands = parser.add_subparsers(dest='command', required=True, metavar='COMMAND')
    inspect = commands.add_parser(
        'inspect', help='find palm, digits, side and axes of a URDF; write a robot file, draw it')
    inspect.add_argument('robot', help='URDF, robot file, dex-retargeting file, or preset')
    inspect.add_argument('--robot-description', '--urdf', dest='urdf', default='', metavar='URDF',
                         help="the URDF's path, for a preset or a file")
    inspect.add_argument('--side', type=one_side, choices=SIDES,
                         help="instead of the geometry's")
    inspect.add_argument('--hand', metavar='FILE', help='hand file of the person to draw beside')
    inspect.add_argument('-o', '--output', type=Path, metavar='FILE',
                         help='robot file (YAML) to write')
    inspect.add_argument('--picture', type=Path, metavar='FILE',
                         help='PNG to draw: five poses of both hands')
    show = commands.add_parser(
        'view', help='show the robot in the browser, following the packaged recording')
    show.add_argument('robot', help='as for inspect')
    show.add_argument('--robot-description', '--urdf', dest='urdf', default='', metavar='URDF',
                      help='as for inspect')
    show.add_argument('--side', type=one_side, choices=SIDES, default=SIDES[0],
                      help="the person's")
    options = parser.parse_args(args)
    require_inputs(options)
    if options.command == 'view':
        return view.main([str(packaged_recording(options.side)), '--side', options.side, '--robot',
                          options.robot, '--robot-description', options.urdf])
    for path, suffixes in ((options.output, YAML_SUFFIXES),
                           (options.picture, PICTURE_SUFFIXES)):
        if path:
            require_writable(path, suffixes)
    # Here, so that a wrong option is reported at once.
    from ..retargeting.robot_file import load_robot
    from ..retargeting.robot_inspection import findings, robot_file_text

    loaded = load_robot(options.robot, options.urdf, options.side)
    for line in findings(loaded):
        print(line)
    for line in loaded.notes:
        print(f'unsure: {line}')
    if options.output:
        text = robot_file_text(loaded, loaded.urdf)
        write_whole_text(options.output, text)
        print(f'{options.output}: the robot file written')
    if options.picture:
        from .robot_poses import draw_robot

        draw_robot(options.picture, loaded, options.hand)
        print(f'{options.picture}: the robot beside a human hand, in five poses')
    if options.output:
        side = loaded.hand.side
        is_usual = side == SIDES[0]
        shown = shlex.join(['hand_tracker', 'robot', 'view', str(options.output),
                            *([] if is_usual else ['--side', side])])
        launched = shlex.join(['ros2', 'launch', 'hand_tracker', 'track.launch.py',
                               'source:=markers', f'robot:={options.output.absolute()}',
                               *([] if is_usual else [f'side:={side}'])])
        print(f'next: {shown}, in the browser; or {launched}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
