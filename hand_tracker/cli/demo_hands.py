"""The demo's hands and recording, with its options checked before anything starts."""

from __future__ import annotations

import argparse
import errno
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from ..core.errors import HandTrackerError
from ..files.bags import Bag, BagError, write_bag
from ..files.hand_file import choose_hand
from ..interruption import ended_by_interrupt
from ..messages.labels import USUAL_TOPIC
from ..package_data import packaged_recording
from ..simulation.ball_grasp import grasp_recording
from ..simulation.packaged_recordings import recording_messages
from ..tracking.label_check import label_fault
from ..tracking.opened_recording import open_recording
from ..tracking.point_bag import PointBag
from ..tracking.recording import MarkerReading, marker_topic, sampled_messages
from ..tracking.side_check import GREATEST_STEP, recorded_side_fault
from ..viewer.page_options import PLAIN_ROBOT, chosen_robot
from .demo_anonymous import ANONYMOUS_RECORDING, PointOwners, take_labels_off
from .recording_options import (
    WornHand,
    label_map,
    recorded_hands,
    recorded_notes,
    recorded_reading,
)


def _hands(options: argparse.Namespace) -> tuple[list[WornHand], Path | PointBag]:
    """Return the hand that the options ask for, or both, and the recording.

    Where the options name no recording, the packaged one is noted there.
    """
    if options.grasp:
        return [_grasping_hand(options)], options.recording
    if options.recording is None:
        side = options.side or choose_hand(options.hand)[0].side
        options.recording = packaged_recording(side)
    hands, recording = recorded_hands(options)
    if options.markers and not isinstance(recording, PointBag):
        raise HandTrackerError('--markers: the tracker of the demo knows MarkerArrays by their '
                               'default ids; expected a file of points, or hand_tracker track')
    return hands, recording


def _grasping_hand(options: argparse.Namespace) -> WornHand:
    """Write the recording of a hand that grasps, and return the hand."""
    for name, allowed in (('recording', (None,)), ('side', (None, 'right')), ('hand', (None,)),
                          ('robot', ('', PLAIN_ROBOT)), ('rate', (1.,)), ('view', (False,))):
        if getattr(options, name) not in allowed:
            raise HandTrackerError(f'--grasp: leave out --{name}; it has the mean right hand and '
                                   'the plain robot hand')
    hand, layout = choose_hand(None, 'right', options.limits, options.coupling)
    options.robot = PLAIN_ROBOT
    options.output.mkdir(parents=True, exist_ok=True)
    options.recording = options.output / 'grasp.mcap'
    write_bag(options.recording, recording_messages(grasp_recording(hand), hand.side))
    return WornHand(hand, layout, label_map((), layout.names))


def _require_sides(bag: Bag, topic: str, hands: Sequence[WornHand],
                   readings: Sequence[MarkerReading]) -> None:
    """Refuse a recording of hands of other sides, as `hand_tracker track` does at its end."""
    for hand, reading in zip(hands, readings):
        if not reading.has_labels:
            continue
        reader = reading.marker_reader()
        # As far apart as `SideCheck` counts them.
        frames = ((1e-9 * message.time, reader.read(message.data).positions)
                  for message in sampled_messages(bag, topic, GREATEST_STEP))
        fault = recorded_side_fault(frames, hand.hand.side, hand.layout.principal)
        if fault is not None:
            whose = f'{hand.hand.side} hand: ' if len(hands) > 1 else ''
            raise BagError(f'{bag.path}: {whose}{fault}')


def _view(options: argparse.Namespace, hands: Sequence[WornHand],
          recording: Path | PointBag, readings: Sequence[MarkerReading]) -> None:
    """Show the recording in the browser."""
    from ..viewer.recording_source import viewed_hands
    from ..viewer.serve import view

    source = viewed_hands(recording, [
        (one.hand, one.layout, reading) for one, reading in zip(hands, readings)])
    view(source, options, source.hand)


def demonstrate(options: argparse.Namespace) -> None:
    """Run the demo; all that may be wrong with the options is said before anything starts.

    Parameters
    ----------
    options : argparse.Namespace
        Of the command line.

    Raises
    ------
    HandTrackerError
    """
    if options.anonymous and (options.view or options.grasp):
        raise HandTrackerError('--anonymous: leave out --view and --grasp; a recording of points '
                               'without labels is taken by --labels none')
    hands, recording = _hands(options)
    for note in recorded_notes(recording):
        print(f'{options.recording}: {note}', flush=True)
    if options.robot and len(hands) > 1 and not options.view:
        raise HandTrackerError('--side both: a robot follows one hand; choose a side')
    loaded = None if options.view else chosen_robot(options, hands[0].hand)
    readings = [recorded_reading(options, recording, one.labels) for one in hands]
    for one, reading in zip(hands, readings):
        if (fault := label_fault(recording, USUAL_TOPIC, reading, one.layout)) is not None:
            print(fault, file=sys.stderr)
    with open_recording(recording, partial=options.partial) as bag:
        topic = marker_topic(bag, USUAL_TOPIC)
        _require_sides(bag, topic, hands, readings)
        frame_count = bag.counts[topic]
    if options.view:
        _view(options, hands, recording, readings)
        return
    options.output.mkdir(parents=True, exist_ok=True)
    if not os.access(options.output, os.W_OK):
        raise PermissionError(errno.EACCES, 'no permission to write there', options.output)
    owners: PointOwners = {}
    has_labels = readings[0].has_labels
    if has_labels and options.anonymous or not has_labels and isinstance(recording, PointBag):
        options.recording = options.output / ANONYMOUS_RECORDING
        with open_recording(recording, partial=options.partial) as bag:
            if has_labels:
                owners = take_labels_off(bag, topic, hands, options.recording)
            else:
                write_bag(options.recording, bag.messages([topic]))
        # The replay reads what is written here, in metres.
        options.markers, options.units, options.up, options.handed = [], None, None, None
        options.frame_rate = options.subject = None
    # What draws and listens is imported once all is right.
    with ended_by_interrupt():
        from .demo_run import run_demo

    run_demo(options, hands, recording, frame_count, loaded,
             None if has_labels and not options.anonymous else owners)
