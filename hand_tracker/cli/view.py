"""Show a recording in the browser: `hand_tracker view RECORDING`."""

import argparse
import signal
import sys

from ..core.errors import HandTrackerError
from ..files.hand_file import choose_hand
from ..package_data import packaged_recording
from ..tracking.recording import add_recording_options, label_map
from ..viewer.page import LOCALHOST, PORT, Viewer
from ..viewer.recording_source import Recording

NEEDED = 'pip install ".[fast,view]"'


def add_page_options(parser):
    """Add the options of the page, which the node has too."""
    parser.add_argument('--host', default=LOCALHOST, metavar='ADDRESS',
                        help='where to listen: 0.0.0.0 for the whole network, which anybody in it '
                        'can then see and steer (default: this machine alone)')
    parser.add_argument('--port', type=int, default=PORT,
                        help=f'first port that is tried (default: {PORT})')


def view(source, options):
    """Serve a page that shows a source, until interrupted.

    Parameters
    ----------
    source : Recording or Live
    options : argparse.Namespace
        Those of `add_page_options`.

    Raises
    ------
    HandTrackerError
        If it cannot listen there, or viser is not installed.
    """
    interrupts = []

    def interrupt(number, frame):
        # Extension code may swallow an exception raised in it: the list remembers.
        interrupts.append(number)
        raise KeyboardInterrupt

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, interrupt)
    try:
        viewer = Viewer(options.host, options.port)
    except ModuleNotFoundError as error:
        raise HandTrackerError(f'{error}; in the checkout: {NEEDED}') from None
    try:
        print(f'The hand is at {" and ".join(viewer.addresses)} (Ctrl-C ends it)', flush=True)
        source.prepare(viewer.say)
        viewer.show(source, skin_of(source.hand), lambda: not interrupts)
    except KeyboardInterrupt:
        print()
    finally:
        viewer.stop()


def warm_up():
    """Compile the kernels and make the mean hand's skin, both of which are kept."""
    hand, layout = choose_hand()
    Recording(packaged_recording(), hand, layout).prepare(print)
    skin_of(hand)


def skin_of(hand):
    """Return the hand's skin; None, and say why, where its libraries are missing."""
    try:
        from ..skin import load_skin

        return load_skin(hand)
    except ImportError as error:
        print(f'No skin, the skeleton alone: {error}', file=sys.stderr)
        return None


def _parse(args):
    parser = argparse.ArgumentParser(prog='hand_tracker view', description=main.__doc__)
    add_recording_options(parser)
    add_page_options(parser)
    return parser.parse_args(args)


def main(args=None):
    """Track a recording and show the hand in the browser, with controls to play it."""
    options = _parse(args)
    try:
        hand, layout = choose_hand(options.hand, options.side, options.limits, options.coupling)
        view(Recording(options.recording, hand, layout, options.topic,
                       labels=label_map(options.label), frame_id=options.frame,
                       scale=options.unit_scale, zero_is_missing=not options.keep_zeros), options)
    except (HandTrackerError, OSError) as error:
        print(f'hand_tracker view: {error}', file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    return 0
