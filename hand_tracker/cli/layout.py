"""`hand_tracker layout`: print or write a preset marker layout, to adapt."""

import shlex
import sys
from functools import partial
from pathlib import Path

from ..core.model.layout_presets import LAYOUT_NAMES, preset_layout
from ..output_files import YAML_SUFFIXES, require_suffix, write_keeping_replaced
from .reporting import CommandParser, reporting


@reporting
def main(args: list[str] | None = None) -> int:
    """Print or write a preset marker layout: a file to adapt, which `--layout` takes."""
    parser = CommandParser(prog='hand_tracker layout', description=main.__doc__)
    parser.add_argument('name', choices=LAYOUT_NAMES, metavar='NAME',
                        help=f'one of {", ".join(LAYOUT_NAMES)}')
    parser.add_argument('-o', '--output', type=Path, metavar='FILE.yaml',
                        help='standard output when left out')
    options = parser.parse_args(args)
    if options.output:
        require_suffix(options.output, YAML_SUFFIXES)
    # Here, so that a wrong option is reported at once.
    from ..files.layout_file import layout_text, save_layout

    layout = preset_layout(options.name)
    if options.output:
        kept = write_keeping_replaced(options.output, partial(save_layout, layout=layout))
        print(f'{options.output}: {len(layout.names)} markers to adapt; then --layout '
              f'{shlex.quote(str(options.output))} in place of {options.name}'
              + (f'; the former file is {kept}' if kept else ''))
    else:
        sys.stdout.write(layout_text(layout))
    return 0


if __name__ == '__main__':
    sys.exit(main())
