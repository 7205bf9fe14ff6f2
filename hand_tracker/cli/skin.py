"""`hand_tracker skin`: draw the skin of a hand, its weights and blending; measure its quality."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.model.hand import Hand
from .recording_options import add_hand_options, require_inputs
from .reporting import CommandParser, reporting

# What makes the skin is imported where it is used, so that a wrong option is reported at once.
if TYPE_CHECKING:
    from ..skin.skinning import Skin

SKIN_PICTURES = 'poses.png', 'weights.png', 'blending.png'


@reporting
def main(arguments: list[str] | None = None) -> int:
    """Run the command; return its exit code.

    Parameters
    ----------
    arguments : list of str, optional
        Those of the command line when left out.
    """
    parser = CommandParser(prog='hand_tracker skin', description=__doc__)
    add_hand_options(parser)
    parser.add_argument('--mesh', metavar='FILE', help='closed mesh of the hand with straight '
                        'joints (OBJ, PLY, STL); default: made from the hand')
    parser.add_argument('-o', '--output', metavar='FOLDER', type=Path, default=Path('skin_output'),
                        help=f"for {', '.join(SKIN_PICTURES)}; default: %(default)s")
    options = parser.parse_args(arguments)
    require_inputs(options)
    from ..files.hand_file import choose_hand
    from ..skin import pictures
    from ..skin.load import load_skin
    from ..skin.measure import volume

    hand, _ = choose_hand(options.hand, options.side, options.limits, options.coupling)
    print('Making the skin and drawing it ...', flush=True)
    skin = load_skin(hand, options.mesh)
    options.output.mkdir(parents=True, exist_ok=True)
    for name in SKIN_PICTURES:
        getattr(pictures, f'save_{Path(name).stem}')(options.output / name, hand, skin)
    print(f'{len(skin.vertices)} vertices, {len(skin.faces)} triangles, '
          f'{1e6 * volume(skin.vertices, skin.faces):.0f} ml; pictures in {options.output}')
    print('\n'.join(report(hand, skin)))
    return 0


def report(hand: Hand, skin: Skin) -> Iterator[str]:
    """Yield a table: change of volume and self-intersection of the skin in each pose."""
    import numpy as np

    from ..core.model.kinematics import forward, joint_table
    from ..simulation.poses import pose_angles
    from ..skin.measure import self_intersection_share, volume
    from ..skin.pictures import PICTURED_POSES
    from ..skin.skinning import deform

    yield f"{'':10s}{'linear blending':>26s}{'dual quaternions':>26s}"
    yield f"{'pose':10s}" + 2 * f"{'volume':>13s}{'buried skin':>13s}"
    rest = volume(skin.vertices, skin.faces)
    for name in PICTURED_POSES:
        pose = forward(joint_table(hand), np.asarray(pose_angles(name, hand)))
        cells = ''
        for dual_quaternions in (False, True):
            vertices = deform(skin, pose, dual_quaternions)
            change = volume(vertices, skin.faces) / rest - 1.
            buried = self_intersection_share(vertices, skin.faces)
            cells += f'{100. * change:+12.1f}%{100. * buried:12.1f}%'
        yield f'{name:10s}{cells}'


if __name__ == '__main__':
    sys.exit(main())
