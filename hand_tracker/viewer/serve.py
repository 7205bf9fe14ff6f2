"""Serve the viewer for a source of frames: a recording or a running tracker."""

import argparse
import sys

from ..core.errors import HandTrackerError
from ..core.model.hand import Hand
from ..parallel import raise_on_interruption
from ..skin.skinning import Skin
from .page import Viewer
from .page_options import chosen_robot
from .source import FrameSource

INSTALL_HINT = 'pip install -e ".[fast,view]"'


def view(source: FrameSource, options: argparse.Namespace, hand: Hand | None = None) -> None:
    """Serve a page that shows a source, and a robot if one is asked for, until interrupted.

    Parameters
    ----------
    source : FrameSource
    options : argparse.Namespace
        With those of `add_page_options`.
    hand : Hand, optional
        Of the source, where it is known before that is prepared: a robot that does not fit it is
        refused before the page is there.

    Raises
    ------
    HandTrackerError
        If it cannot listen there, viser is not installed, or the robot cannot be loaded or does
        not fit the hand.
    """
    robot = None if hand is None else chosen_robot(options, hand)
    interruptions = raise_on_interruption()
    try:
        viewer = Viewer(options.host, options.port)
    except ModuleNotFoundError as error:
        raise HandTrackerError(f'{error}; in the checkout: {INSTALL_HINT}') from None
    try:
        print(f'The hand is at {" and ".join(viewer.addresses)} (Ctrl-C ends it)', flush=True)
        source.prepare(viewer.say)
        if hand is None:
            robot = chosen_robot(options, source.hand)
        viewer.show(source, skin_of, lambda: not interruptions, robot)
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
