"""Serve the page of the viewer for a source: a recording or a running tracker."""

import signal
import sys

from ..core.errors import HandTrackerError
from .page import LOCALHOST, PORT, Viewer

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


def skin_of(hand):
    """Return the hand's skin; None, and say why, where its libraries are missing."""
    try:
        from ..skin import load_skin

        return load_skin(hand)
    except ImportError as error:
        print(f'No skin, the skeleton alone: {error}', file=sys.stderr)
        return None
