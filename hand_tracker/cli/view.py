"""`hand_tracker view`: show a recording in the browser."""

import argparse
import sys

from ..core.errors import HandTrackerError
from ..files.hand_file import choose_hand
from ..package_data import packaged_recording
from ..viewer.recording_source import ViewerRecording
from ..viewer.serve import add_page_options, skin_of, view
from .recording_options import add_recording_options, label_map


def warm_up() -> None:
    """Compile the kernels and make the mean hand's skin, both of which are kept."""
    hand, layout = choose_hand()
    ViewerRecording(packaged_recording(), hand, layout).prepare(print)
    skin_of(hand)


def _parse(args: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog='hand_tracker view', description=main.__doc__)
    add_recording_options(parser)
    add_page_options(parser)
    return parser.parse_args(args)


def main(args: list[str] | None = None) -> int:
    """Track a recording and show the hand in the browser, with controls to play it."""
    options = _parse(args)
    try:
        hand, layout = choose_hand(options.hand, options.side, options.limits, options.coupling)
        view(ViewerRecording(options.recording, hand, layout, options.topic,
                             labels=label_map(options.label), frame_id=options.frame,
                             scale=options.unit_scale, zero_is_missing=not options.keep_zeros),
             options)
    except (HandTrackerError, OSError) as error:
        print(f'hand_tracker view: {error}', file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    return 0
