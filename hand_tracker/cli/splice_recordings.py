"""Work of the command `hand_tracker splice`: hands tracked, aligned, and put on a body."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from copy import copy
from pathlib import Path
from typing import Any

import numpy as np

from ..core.errors import HandTrackerError
from ..core.model.hand import BOTH, SIDES
from ..files.bvh_file import read_bvh_motion, write_bvh, write_bvh_motion
from ..files.glb_file import write_glb
from ..files.point_recording import UNIT_SPELLINGS
from ..files.recordings import (
    BVH,
    ReadingOptions,
    is_bag,
    read_recording,
    recognised_format,
    write_recording,
)
from ..files.skeleton_motion import HandAngles, skeleton_motion
from ..files.written_kinds import (
    NAMINGS,
    POINT_KINDS,
    SKELETON_KIND,
    SKELETON_KINDS,
    SKINNED_KIND,
)
from ..output_files import require_folder, require_suffix, write_whole
from ..parallel import Interruptions
from ..progress import Progress
from ..skin.surface import require_surface_library
from ..splicing.body_glb import body_mesh, skeleton_of
from ..splicing.body_skeleton import body_unit, require_hand, skeleton_naming
from ..splicing.clock_alignment import AlignmentError, ClockAlignment, Trajectory, align_clocks
from ..splicing.marker_skeleton import marker_mesh, marker_skeleton
from ..splicing.spliced_body import (
    SplicedHand,
    body_times,
    mount_hand,
    overlapping,
    splice,
    wrist_motion,
)
from ..splicing.spliced_points import hand_world, marker_wrist, splice_points
from ..tracking.compile_kernels import prepare_kernels
from ..tracking.save_motion import collect_hands
from .track_recordings import refuse_to_replace
from .tracking_job import tracking_job


def splice_recordings(options: argparse.Namespace, interrupted: Interruptions,
            progress: Callable[..., Any] = Progress) -> str:
    """Splice the hands of a command line onto its body; return the closing line."""
    output = options.output
    is_skeleton = not is_bag(options.body) and recognised_format(options.body) is BVH
    expected = SKELETON_KINDS if is_skeleton else (*POINT_KINDS, *SKELETON_KINDS)
    require_suffix(output, expected, f'{", ".join(expected)}, as {options.body} has '
                   f'{"a skeleton" if is_skeleton else "points and no skeleton"}')
    require_folder(output)
    if options.side == BOTH:
        raise HandTrackerError('--side both: a recording is of one hand; expected that of the '
                               'right one, then that of the left one, which may be the same file')
    if len(options.recordings) > len(SIDES):
        raise HandTrackerError(f'{len(options.recordings)} recordings of hands; expected that of '
                               'the right one, then that of the left one')
    if len(options.recordings) > 1 and options.side:
        raise HandTrackerError(f'--side {options.side}: two recordings are of the right and of '
                               'the left hand; expected no --side')
    for recording in (options.body, *options.recordings):
        refuse_to_replace(recording, output)
    if output.suffix.lower() == SKINNED_KIND:
        require_surface_library()
    prepare_kernels(lambda line: print(line, file=sys.stderr))
    if not is_skeleton:
        return _splice_points(options, _tracked(options, interrupted, progress))
    body = read_bvh_motion(options.body, options.partial)
    tracked = _tracked(options, interrupted, progress)
    hands, unit = _placed(options, body, tracked)
    naming = skeleton_naming(body.joints)
    spliced = splice(body, hands, unit, options.wrist)
    if output.suffix.lower() == SKELETON_KIND:
        write_whole(output, lambda path: write_bvh_motion(path, spliced))
    else:
        skeleton = skeleton_of(spliced, unit)
        mesh = body_mesh(skeleton, [(hand, one.hand) for hand, one in zip(hands, tracked)],
                         naming)
        write_whole(output, lambda path: write_glb(path, skeleton, mesh))
    return (f'{output}: {len(spliced.values)} frames, {len(spliced.joints)} joints and ends, '
            f'names of {naming}')


def _tracked(options: argparse.Namespace, interrupted: Interruptions,
             progress: Callable[..., Any]) -> list[HandAngles]:
    """Return the tracked hands of the recordings."""
    tracked = []
    for side, recording in zip(SIDES if len(options.recordings) > 1 else (options.side,),
                               options.recordings):
        one = copy(options)
        one.recording, one.side = recording, side
        with tracking_job(one, interrupted, progress) as job, interrupted.only_noted():
            tracked.append(collect_hands(job.frames(), job.hands).hands[0])
    return tracked


def _splice_points(options: argparse.Namespace, tracked: list[HandAngles]) -> str:
    """Write the body's markers and the hands' joints, as points or as a skeleton."""
    body = read_recording(options.body, ReadingOptions(partial=options.partial))
    for note in body.notes:
        print(f'{options.body}: {note}', file=sys.stderr)
    hands = []
    for one in tracked:
        side = one.hand.side
        wrist = marker_wrist(body, side)
        alignment = _alignment(options.offset, wrist, Trajectory(
            one.times - one.times[0], one.wrist_position), side)
        _frames_covered(options.body, side, one.times - one.times[0], alignment, wrist.times)
        world = hand_world(wrist, one, alignment)
        print(f'{side} hand: ' + ('in the same world as the body' if world.is_same else
                                  "its world turned to the body's by the wrist's path")
              + f'; the wrists {1e3 * world.distance:.0f} mm apart', file=sys.stderr)
        hands.append((one, alignment, world))
    if options.output.suffix.lower() in POINT_KINDS:
        spliced = splice_points(body, hands)
        write_recording(options.output, spliced)
        return f'{options.output}: {len(spliced.points)} frames of {len(spliced.labels)} points'
    skeleton = marker_skeleton(body, hands, NAMINGS[0])
    if options.output.suffix.lower() == SKELETON_KIND:
        write_whole(options.output, lambda path: write_bvh(path, skeleton))
    else:
        mesh = marker_mesh(skeleton, tracked)
        write_whole(options.output, lambda path: write_glb(path, skeleton, mesh))
    return f'{options.output}: {len(skeleton.times)} frames of {len(skeleton.names)} joints'


def _frames_covered(body: Path, side: str, hand_times: np.ndarray, alignment: ClockAlignment,
                    times: np.ndarray) -> str:
    """Return in words which of the body's frames a hand's recording covers.

    Raises
    ------
    HandTrackerError
        If it covers none.
    """
    inside = overlapping(hand_times, alignment.hand_times(times))
    if not inside.any():
        raise HandTrackerError(f'{side} hand: at an offset of {alignment.offset:g} s no frame of '
                               f'{body} is in its recording')
    if inside.all():
        return f'all {len(inside)} frames'
    return f'{inside.sum()} of {len(inside)} frames, as first and last seen on the others'


def _placed(options: argparse.Namespace, body: Any,
            tracked: list[HandAngles]) -> tuple[list[SplicedHand], float]:
    """Return the hands, each aligned and placed on the body, and the body's unit [m]."""
    places = [require_hand(body.joints, one.hand.side, str(options.body)) for one in tracked]
    motions = [skeleton_motion(one) for one in tracked]
    alignments = [_alignment(options.offset, wrist_motion(body, place.wrist)[0], Trajectory(
        motion.times, motion.root_position), place.side) for place, motion in zip(places, motions)]
    gains = [one.gain for one in alignments if one.is_sure and one.gain > 0.]
    measured = 1. / float(np.median(gains)) if gains else None
    unit, how = body_unit(body.joints, measured)
    if options.body_units:
        unit, how = UNIT_SPELLINGS[options.body_units][0], f'in {options.body_units}, as given'
    print(f'{options.body}: {how}', file=sys.stderr)
    hands = []
    for place, motion, alignment in zip(places, motions, alignments):
        mount = mount_hand(body, place, motion, alignment, unit)
        covered = _frames_covered(options.body, place.side, motion.times, alignment,
                                  body_times(body))
        how = (f'the wrists turn alike within {np.degrees(mount.spread):.1f} degrees'
               if mount.is_fitted else 'wrist straight with the forearm at rest, as its turn '
               'cannot be told from the recordings')
        print(f'{place.side} hand: {how}; on {covered}', file=sys.stderr)
        hands.append(SplicedHand(place, motion, alignment, mount))
    return hands, unit


def _alignment(offset: float | None, path: Trajectory, hand_path: Trajectory,
               side: str) -> ClockAlignment:
    """Return the clock of a hand in the body's: as given, else by the path of the wrist."""
    if offset is not None:
        try:
            found = align_clocks(path, hand_path)
        except AlignmentError:
            return ClockAlignment(offset, gain=np.nan)
        return ClockAlignment(offset, gain=found.gain if found.is_sure else np.nan)
    try:
        found = align_clocks(path, hand_path)
    except AlignmentError as error:
        raise AlignmentError(f'{side} hand: {error}') from None
    print(alignment_words(found, side), file=sys.stderr)
    return found


def alignment_words(found: ClockAlignment, side: str) -> str:
    """Return in words where a hand's recording begins, and how sure that is.

    Parameters
    ----------
    found : ClockAlignment
    side : {'right', 'left'}
    """
    begins = f'{side} hand: begins at {found.offset:.4f} s of the body'
    rest = (f'its clock {1e6 * found.drift:+.1f} ppm; motions correlate by '
            f'{found.correlation:.3f}, confidence {found.confidence:.2f}')
    unsure = f'{side} hand: that is unsure, as the wrist moves little, or otherwise in the two'
    advice = 'compare the result, or give --offset SECONDS'
    if not found.is_one_peak:
        # The deviation is that about one offset, and says nothing of another one.
        other = '' if np.isnan(found.next_best) else (
            f'; it would fit nearly as well if it began at {found.next_best:.2f} s')
        return f'{begins}, or elsewhere; {rest}\n{unsure}{other}; {advice}'
    stated = f'{begins}, with a standard deviation of {1e3 * found.deviation:.1f} ms; {rest}'
    return stated if found.is_sure else f'{stated}\n{unsure}; {advice}'
