"""`hand_tracker view`: show a recording in the browser."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

from ..package_data import packaged_recording
from ..viewer.page_options import add_page_options
from .recording_options import (
    add_recording_options,
    hand_notes,
    recorded_hands,
    recorded_notes,
    recorded_reading,
    require_inputs,
)
from .reporting import CommandParser, reporting

# The viewer is imported where it is used, so that a wrong option is reported at once.
if TYPE_CHECKING:
    from ..viewer.recording_source import ViewerRecording


def warm_up() -> None:
    """Compile the kernels and make the mean hand's skin, both of which are kept."""
    from ..files.hand_file import choose_hand
    from ..tracking.recording import USUAL_READING
    from ..viewer.recording_source import viewed_hands
    from ..viewer.serve import skin_of

    hand, layout = choose_hand()
    viewed_hands(packaged_recording(), [(hand, layout, USUAL_READING)]).prepare(print)
    print('Making the skin', flush=True)
    skin_of(hand)


def _parse(args: list[str] | None) -> argparse.Namespace:
    parser = CommandParser(prog='hand_tracker view', description=main.__doc__)
    add_recording_options(parser, both=True)
    add_page_options(parser)
    return parser.parse_args(args)


def _source(options: argparse.Namespace) -> ViewerRecording:
    """Return the hand that the command line asks for, or both."""
    from ..tracking.label_check import label_fault
    from ..viewer.recording_source import viewed_hands

    hands, recording = recorded_hands(options)
    for note in (*recorded_notes(recording), *hand_notes(options, hands)):
        print(f'{options.recording}: {note}', file=sys.stderr)
    viewed = [(hand, layout, recorded_reading(options, recording, labels))
              for hand, layout, labels in hands]
    (_, layout, reading), *others = viewed
    if not others and (fault := label_fault(
            recording, options.topic, reading, layout)) is not None:
        print(fault, file=sys.stderr)
    return viewed_hands(recording, viewed, options.topic)


@reporting
def main(args: list[str] | None = None) -> int:
    """Track a recording and show the hand in the browser, with controls to play it."""
    options = _parse(args)
    require_inputs(options)
    source = _source(options)
    from ..viewer.serve import view

    view(source, options, source.hand)
    return 0
