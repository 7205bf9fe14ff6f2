"""Serve the viewer for a source of frames: a recording or a running tracker."""

import argparse
import sys

from ..core.errors import HandTrackerError
from ..core.model.hand import Hand
from ..parallel import raise_on_interruption
from ..skin.skinning import Skin
from .page import FIRST_PORT, LOCALHOST, Viewer
from .source import FrameSource

INSTALL_HINT = 'pip install ".[fast,view]"'


def add_page_options(parser: argparse.ArgumentParser) -> None:
    """Add the options `--host` and `--port` to a command line."""
    parser.add_argument('--host', default=LOCALHOST, metavar='ADDRESS',
                        help='where to listen: 0.0.0.0 for the whole network, which anybody in it '
                        'can then see and steer (default: this machine alone)')
    parser.add_argument('--port', type=int, default=FIRST_PORT,
                        help=f'first port that is tried (default: {FIRST_PORT})')


def view(source: FrameSource, options: argparse.Namespace) -> None:
    """Serve a page that shows a source, until SIGINT or SIGTERM.

    Parameters
    ----------
    source : FrameSource
    options : argparse.Namespace
        With those of `add_page_options`.

    Raises
    ------
    HandTrackerError
        If it cannot listen there, or viser is not installed.
    """
    interruptions = raise_on_interruption()
    try:
        viewer = Viewer(options.host, options.port)
    except ModuleNotFoundError as error:
        raise HandTrackerError(f'{error}; in the checkout: {INSTALL_HINT}') from None
    try:
        print(f'The hand is at {" and ".join(viewer.addresses)} (Ctrl-C ends it)', flush=True)
        source.prepare(viewer.say)
        viewer.show(source, skin_of(source.hand), lambda: not interruptions)
    except KeyboardInterrupt:
        print()
    finally:
        viewer.stop()


def skin_of(hand: Hand) -> Skin | None:
    """Return the hand's skin; None, with a message, if its libraries are not installed."""
    try:
        from ..skin import load_skin

        return load_skin(hand)
    except ImportError as error:
        print(f'No skin, the skeleton alone: {error}', file=sys.stderr)
        return None
