"""Measure the tracker: each table and figure of the results from one command."""

from __future__ import annotations

import argparse
import csv
import io
import json
import math
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ..core.errors import HandTrackerError
from ..evaluation import EVALUATIONS
from ..evaluation.evaluation_options import Options
from ..output_files import write_whole_text
from .recording_options import add_frame_rate_option, require_inputs
from .reporting import CommandParser, reporting

# Readers and tracker are imported where they are used, so that a wrong option is reported at once.
if TYPE_CHECKING:
    from ..calibration.takes import MarkerTake
    from ..core.model.marker_layout import MarkerLayout
    from ..evaluation.captures import Capture
    from ..evaluation.rows import Row

SEEDS = 2**31 - 1  # at most: each motion has a seed of its own above it


def plain(value: Any) -> Any:
    """Return a value of a row as JSON has it: no numpy types, null for what is not finite."""
    value = value.item() if hasattr(value, 'item') else value
    return None if isinstance(value, float) and not math.isfinite(value) else value


def run_evaluation(name: str, options: Options) -> list[Row]:
    """Return the rows of an evaluation.

    Parameters
    ----------
    name : str
        One of `EVALUATIONS`.
    options : Options

    Returns
    -------
    list of dict
    """
    start = time.monotonic()
    options.say(f'{name}: {EVALUATIONS[name].summary}')
    found = [{key: plain(value) for key, value in row.items()}
             for row in EVALUATIONS[name].load().evaluate(options)]
    options.say(f'{name}: {len(found)} rows in {time.monotonic() - start:.0f} s')
    return found


def _write_csv(path: Path, rows: list[Row]) -> None:
    """Write rows as a table whose columns are all their keys, in the order of appearance."""
    columns = list(dict.fromkeys(key for row in rows for key in row))
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator='\n')
    writer.writeheader()
    writer.writerows(rows)
    write_whole_text(path, text.getvalue())


def _write_json(path: Path, rows: list[Row]) -> None:
    """Write rows as a JSON list, one row on a line."""
    lines = ',\n'.join(json.dumps(row, allow_nan=False) for row in rows)
    write_whole_text(path, f'[\n{lines}\n]\n')


def _whole(lowest: int, highest: int) -> Callable[[str], int]:
    def whole(text: str) -> int:
        value = int(text)
        if not lowest <= value <= highest:
            raise argparse.ArgumentTypeError(f'{value}; allowed is {lowest} to {highest}')
        return value
    return whole


def _file(text: str) -> Path:
    path = Path(text)
    if path.is_dir():
        raise argparse.ArgumentTypeError(f'{path} is a folder; expected a file')
    return path


def _parse(arguments: list[str] | None) -> tuple[CommandParser, argparse.Namespace]:
    parser = CommandParser(
        prog='hand_tracker evaluate', description=__doc__.split('\n')[0],
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog='\n'.join(f'{name:10s} {one.summary}' for name, one in EVALUATIONS.items()))
    parser.add_argument('name', choices=(*EVALUATIONS, 'all'), metavar='NAME',
                        help=', '.join((*EVALUATIONS, 'all')))
    parser.add_argument('files', nargs='*', type=Path, metavar='FILE',
                        help='captures: npz with positions (T, 21, 3) [m], joints, side, rate_hz, '
                        'or markers, marker_names; BVH, C3D, TRC, TSV, CSV with names')
    parser.add_argument('--fit', nargs='+', type=Path, default=[], metavar='FILE.npz',
                        help='markers, layouts, labelling: fit the hand to these, judge the '
                        'others; default: leave each one out in turn')
    parser.add_argument('--layout', metavar='NAME|FILE',
                        help='layouts: the layout whose names the markers of the files have; '
                        'default: a preset with just these names')
    add_frame_rate_option(parser)
    parser.add_argument('--seed', type=_whole(0, SEEDS), default=1,
                        help='of all that is drawn (default: 1)')
    parser.add_argument('--json', type=_file, metavar='OUT', help='file for the rows')
    parser.add_argument('--output', type=Path, metavar='FOLDER', help='folder for CSV and PNG')
    parser.add_argument('--results', type=_file, metavar='FILE.md',
                        help='document to write; its pictures go into the folder of its name')
    parser.add_argument('--jobs', type=_whole(1, 64), default=1, help='processes (default: 1)')
    parser.add_argument('--quiet', action='store_true', help='print no progress')
    # Intermixed: files may also follow an option.
    return parser, parser.parse_intermixed_args(arguments)


def _names(parser: CommandParser, chosen: str, files: list[Path]) -> list[str]:
    """Return the evaluations to run."""
    if chosen != 'all':
        one = EVALUATIONS[chosen]
        if one.judges and not files:
            parser.error(f'{chosen} judges captures: name at least one npz file')
        return [chosen]
    names = [name for name, one in EVALUATIONS.items()
             if files or not one.judges]
    if not files:
        print('no captures given: ' + ' and '.join(sorted(set(EVALUATIONS) - set(names)))
              + ' are left out', file=sys.stderr)
    return names


class EvaluationInput(NamedTuple):
    """Captures and takes that evaluations judge.

    Attributes
    ----------
    captures : tuple of Capture
    takes, fit_takes : tuple of MarkerTake
        To judge, and to fit hands to.
    layout_takes, fit_layout_takes : tuple of MarkerTake
        The same, their markers named by the layout presets that have them.
    """

    captures: tuple[Capture, ...]
    takes: tuple[MarkerTake, ...]
    fit_takes: tuple[MarkerTake, ...]
    layout_takes: tuple[MarkerTake, ...]
    fit_layout_takes: tuple[MarkerTake, ...]

    def kinds(self) -> list[str]:
        """Return the kinds of files that are here, as in `Evaluation.judges`."""
        return [kind for kind, found in (('captures', self.captures), ('takes', self.takes),
                                         ('layouts', self.layout_takes)) if found]


def _takes(files: list[Path], frame_rate: float | None, by_layout: bool = False,
           layout: MarkerLayout | None = None
           ) -> tuple[dict[Path, MarkerTake], dict[Path, HandTrackerError]]:
    """Return the takes of files, and the faults of the others, by file."""
    from ..calibration.take_files import load_take

    takes: dict[Path, MarkerTake] = {}
    faults: dict[Path, HandTrackerError] = {}
    for path in files:
        try:
            takes[path] = load_take(path, by_layout=by_layout, layout=layout,
                                    frame_rate=frame_rate)
        except HandTrackerError as fault:
            faults[path] = fault
    return takes, faults


def _evaluation_input(names: list[str], files: list[Path], fit: list[Path],
                      layout: MarkerLayout | None, rate: float | None
                      ) -> tuple[EvaluationInput, list[HandTrackerError]]:
    """Return the loaded captures and takes, and the faults of files that are neither."""
    from ..evaluation.captures import load_captures

    wants_takes = any('takes' in EVALUATIONS[name].judges for name in names)
    wants_layouts = any('layouts' in EVALUATIONS[name].judges for name in names)
    wants_captures = any('captures' in EVALUATIONS[name].judges for name in names)
    captures, faults = load_captures(files, rate) if wants_captures else ([], {})
    takes, take_faults = _takes(files, rate) if wants_takes else ({}, {})
    fit_takes, fit_faults = _takes(fit, rate) if wants_takes else ({}, {})
    layout_takes, layout_faults = _takes(files, rate, True, layout) if wants_layouts else ({}, {})
    fit_layout_takes, fit_layout_faults = (_takes(fit, rate, True, layout) if wants_layouts
                                           else ({}, {}))
    if wants_takes and wants_captures:
        # A file of markers alone is no capture, one of joints alone no take.
        takes = {path: take for path, take in takes.items() if take.is_optical}
        faults = {path: fault for path, fault in faults.items() if path not in takes}
    else:
        faults.update(take_faults)
    if not (wants_takes or wants_captures):
        faults, fit_faults = layout_faults, fit_layout_faults
    all_faults = [*faults.values(), *fit_faults.values()]
    if (wants_takes or wants_captures or wants_layouts) and not (
            captures or takes or layout_takes):
        raise HandTrackerError('; '.join(map(str, all_faults)))
    found = EvaluationInput(tuple(captures), tuple(takes.values()), tuple(fit_takes.values()),
                            tuple(layout_takes.values()), tuple(fit_layout_takes.values()))
    for note in dict.fromkeys(note for files_of in found for one in files_of for note in one.notes):
        print(note, file=sys.stderr)
    return found, all_faults


@reporting
def main(arguments: list[str] | None = None) -> int:
    """Run the command; return its exit code."""
    parser, chosen = _parse(arguments)
    names = _names(parser, chosen.name, chosen.files)
    require_inputs(chosen)
    from ..files.layout_file import choose_layout
    from ..tracking.compile_kernels import prepare_kernels

    for folder in (chosen.output, *(file.parent for file in (chosen.json, chosen.results)
                                    if file)):
        if folder:
            folder.mkdir(parents=True, exist_ok=True)
    given, faults = _evaluation_input(
        names, chosen.files, chosen.fit,
        choose_layout(chosen.layout) if chosen.layout else None, chosen.frame_rate)
    names = [name for name in names if EVALUATIONS[name].can_judge(given.kinds())]
    options = Options(given.captures, chosen.seed, chosen.jobs, chosen.output, chosen.quiet,
                      takes=given.takes, fit_takes=given.fit_takes,
                      layout_takes=given.layout_takes,
                      fit_layout_takes=given.fit_layout_takes)
    for fault in faults:
        options.leave_out(str(fault))
    prepare_kernels(options.say, is_quiet=options.quiet)
    return _evaluate(parser, names, chosen, options)


def _evaluate(parser: CommandParser, names: list[str], chosen: argparse.Namespace,
              options: Options) -> int:
    """Run evaluations, write what was asked for after each; return the exit code."""
    rows, done = [], []
    for name in names:
        try:
            found = run_evaluation(name, options)
        except HandTrackerError as error:
            print(f'{parser.prog}: {name}: {error}', file=sys.stderr)
            continue
        done.append(name)
        module = EVALUATIONS[name].load()
        rows += found
        # After each: what was found is not lost to what comes.
        if chosen.json:
            _write_json(chosen.json, rows)
        print(f'\n{EVALUATIONS[name].title}\n')
        for table in module.tables(found):
            print(table.text() + '\n')
        if options.output:
            _write_csv(options.output / f'{name}.csv', found)
            module.pictures(found, options.output)
    if chosen.results and done:
        from ..evaluation.results import command_line, write_results

        write_results(chosen.results, rows, done, options,
                      command_line(chosen.name, chosen.files, options, chosen.results,
                                   chosen.fit))
    return 0 if len(done) == len(names) else 1
