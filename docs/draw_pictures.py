"""Make the pictures of the README: `python -m docs.draw_pictures [NAME ...]`.

The hands are tracked from simulated recordings and drawn with their skin. All pictures are
reproducible but the latency, which is measured.
"""

import argparse
import shutil
import subprocess
import sys
import tarfile
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse, FancyBboxPatch
from PIL import Image
from scipy.spatial.transform import Rotation

from benchmarks.repository import PICTURE_FOLDER
from hand_tracker.core.model.hand import JOINTS, Hand, preset_limits
from hand_tracker.core.model.kinematics import Pose, forward, joint_table, tip_offsets
from hand_tracker.core.model.layout_presets import (
    LAYOUT_PRESETS,
    SKIN_LAYOUT,
    SKIN_LAYOUTS,
    preset_layout,
)
from hand_tracker.core.model.marker_layout import MARKERS, MarkerLayout, marker_positions
from hand_tracker.core.model.skeleton import (
    DIGIT_CHAINS,
    PALM_BONES,
    SKELETON_BONES,
    SKELETON_POINTS,
    skeleton_points,
)
from hand_tracker.core.model.states import MarkerState
from hand_tracker.core.tracker import HandTracker
from hand_tracker.drawing.angle_plots import digit_page, tracked_angles
from hand_tracker.drawing.images import (
    blank_figure,
    figure_image,
    place_image,
    save_gif,
    write_text,
)
from hand_tracker.drawing.palette import (
    BLUE,
    DIGIT_COLOURS,
    GREY,
    LIGHT_GREY,
    ORANGE,
    PAPER_WHITE,
    REDDISH_PURPLE,
    SKIN_TONE,
    SKY_BLUE,
    VERMILLION,
    rgb,
)
from hand_tracker.drawing.render import (
    Camera,
    Mesh,
    ball_mesh,
    bone_mesh,
    camera_axes,
    render,
    view_axes,
)
from hand_tracker.evaluation import ablation
from hand_tracker.evaluation.capture_tracking import tracked_joints
from hand_tracker.evaluation.results import hardware
from hand_tracker.evaluation.simulated import trial
from hand_tracker.files.bvh_file import CHANNELS, BvhJoint, BvhMotion, rotation_channels
from hand_tracker.files.skeleton_motion import HandAngles, skeleton_motion
from hand_tracker.files.urdf_file import urdf
from hand_tracker.package_data import packaged_recording
from hand_tracker.retargeting.command_guard import GuardState
from hand_tracker.retargeting.robot_file import load_robot
from hand_tracker.retargeting.teleoperation import Teleoperation
from hand_tracker.simulation.motions import motion_named
from hand_tracker.simulation.packaged_recordings import RECORDING_RATE, demo_recording
from hand_tracker.skin import deform, load_skin
from hand_tracker.splicing.body_glb import body_mesh, skeleton_of
from hand_tracker.splicing.body_skeleton import require_hand, skeleton_naming
from hand_tracker.splicing.clock_alignment import ClockAlignment
from hand_tracker.splicing.hand_mount import rest_mount
from hand_tracker.splicing.spliced_body import SplicedHand, splice

# Of the robot that is driven while the tracker fails [s].
DRIVEN_JOINT, DRIVEN_START, DRIVEN_SECONDS = 'index_pip_flexion', 0., 14.
ENGAGED_AT, JUMPS, KILLED = (1., 11.5), ((5., 5.03), (6.5, 6.53)), ((3.5, 4.1), (8., 10.5))
GUARD_COLOURS = {GuardState.DISENGAGED: LIGHT_GREY, GuardState.EASING: SKY_BLUE,
                 GuardState.FOLLOWING: PAPER_WHITE, GuardState.HOLDING: ORANGE}
LAYOUT_SIZE = 170, 245    # [px]
GIF_RATE, GIF_COLOURS, GIF_TOLERANCE = 20., 40, 13  # [Hz], entries, of 255
THREE_VERSION = '0.170.0'    # as docs/glb.html has it
PICTURE_SEED = 1         # that of the evaluations
SHOWN_CONDITIONS = {'occluded': 'markers hidden', 'wrong': 'labels exchanged, reflections'}
WRONG_MARKER_ERROR = .01  # [m] above which a measured marker counts as wrong
FULL_COLOUR_ERROR = .025  # [m] of skin shown wholly vermillion
MAX_ERROR_MM = 60.        # mean error of a frame, above which the hand is out of the picture
TRIP_RATE, TRIP_SECONDS = 480, 10.  # [Hz], [s] of the round trips
SHOWN_MS, TICKS_MS = (.06, 12.), (.1, .2, .5, 1, 2, 5, 10)
TRIP_NODES = {'hand_tracker': ('hand_tracker', 'tracks the whole hand', SKY_BLUE),
              'rclpy_echo': ('echo in rclpy', 'tracks nothing', ORANGE),
              'c_echo': ('echo in C', 'tracks nothing', REDDISH_PURPLE)}
CARD, CARD_INK, CARD_MUTED = '#151C26', '#F2F4F7', '#9AA7B5'
DRAWN_MARKER_RGB, PALM_BONE_RGB = (.95, .95, .95), (.72, .75, .79)
DRAWN_BALL_RADIUS = .0040   # [m]


@cache
def demo():
    """Return the hand and its tracked states in the demo motion, with markers on the skin.

    The states are of the second of two rounds, so that the animation loops without a jump.
    """
    hand = Hand.scaled()
    layout = resting_layout(hand)
    recording = demo_recording(hand, layout)
    stamps, step = recording.stamps, recording.stamps[1] - recording.stamps[0]
    twice = recording._replace(
        stamps=np.append(stamps, stamps + stamps[-1] - stamps[0] + step),
        markers=np.tile(recording.markers, (2, 1, 1)))
    return hand, [state for _, state in tracked_from(twice, hand, layout)][len(stamps):]


def tracked_from(recording, hand, layout):
    """Track a recording; yield time [s] and `HandState` of each frame."""
    tracker = HandTracker(hand, layout)
    for stamp, markers in zip(recording.stamps - recording.stamps[0], recording.markers):
        yield 1e-9 * stamp, tracker.update(markers, 1e-9 * stamp)


def resting_layout(hand):
    """Return the paper's marker layout, offset so that the balls rest on the skin."""
    rest = forward(joint_table(hand), np.zeros(len(JOINTS)))
    vertices = deform(load_skin(hand), rest)
    bare = MarkerLayout().mounting(hand)
    offsets = np.zeros((len(MARKERS), 3))
    for marker, offset, link, centre in zip(MARKERS, offsets, bare.link, bare.position):
        # Link -1 is the wrist, the root frame.
        turned = np.eye(3) if link < 0 else rest.rotation[link]
        above = (vertices - (0. if link < 0 else rest.position[link])) @ turned - centre
        axis = 0 if marker == 'thumb' else 2
        near = np.linalg.norm(np.delete(above, axis, axis=1), axis=1) < .7 * DRAWN_BALL_RADIUS
        offset[axis] = above[near, axis].max() + .8 * DRAWN_BALL_RADIUS
    return MarkerLayout(offsets=offsets)


def local(state):
    """Return the markers, shape (8, 3) [m], and the pose of a state in its wrist frame."""
    markers = (state.markers - state.wrist_position) @ state.wrist_rotation
    return markers, Pose(state.wrist_rotation.T @ state.pose.rotation,
                         (state.pose.position - state.wrist_position) @ state.wrist_rotation)


def skin_mesh(hand, pose):
    """Return the mesh of the skin in a pose."""
    skin = load_skin(hand)
    return Mesh(deform(skin, pose), skin.faces, rgb(SKIN_TONE))


def balls(markers, states=None):
    """Return a ball for each marker; those not seen are orange."""
    states = np.zeros(len(markers)) if states is None else states
    # Larger where not seen: a predicted marker may lie within the skin.
    return [ball_mesh(centre, DRAWN_BALL_RADIUS, DRAWN_MARKER_RGB) if state == MarkerState.SEEN
            else ball_mesh(centre, 1.4 * DRAWN_BALL_RADIUS, rgb(ORANGE))
            for centre, state in zip(markers, states)]


def bones(hand, pose):
    """Return meshes of the skeleton, each digit in its colour."""
    points = skeleton_points(tip_offsets(hand), pose, np.zeros(3))
    ends = [chain[-1] for chain in DIGIT_CHAINS]
    last = points[ends] - points[[chain[-2] for chain in DIGIT_CHAINS]]
    # Shortened, so that their round ends stay within the skin.
    points[ends] -= .005 * last / np.linalg.norm(last, axis=1)[:, None]
    found = [bone_mesh(points[a], points[b], .0028, .0028, PALM_BONE_RGB) for a, b in PALM_BONES]
    found += [ball_mesh(points[SKELETON_POINTS.index('wrist')], .005, PALM_BONE_RGB)]
    for chain, colour in zip(DIGIT_CHAINS, DIGIT_COLOURS):
        for a, b in zip(chain, chain[1:]):
            found += [bone_mesh(points[a], points[b], .0034, .0026, rgb(colour)),
                      ball_mesh(points[a], .0052, rgb(colour))]
        found.append(ball_mesh(points[chain[-1]], .0026, rgb(colour)))
    return found


def card(width, height):
    """Return a figure [px] with a dark card of round corners as its background."""
    figure = blank_figure(width, height, facecolor='none')
    figure.add_artist(FancyBboxPatch(
        (0., 0.), 1., 1., boxstyle='round,pad=0,rounding_size=.02',
        mutation_aspect=width / height, facecolor=CARD, linewidth=0, zorder=-1))
    return figure


def save(figure, name):
    """Write a figure as PNG with a reduced palette, which makes it small."""
    PICTURE_FOLDER.mkdir(exist_ok=True)
    image = figure_image(figure)
    image.save(PICTURE_FOLDER / name, optimize=True)
    print(f'{PICTURE_FOLDER / name}: {image.width} x {image.height}, '
          f'{(PICTURE_FOLDER / name).stat().st_size / 1e3:.0f} kB', flush=True)


def hero(seconds=16.8):
    """Draw what goes in and what comes out: markers, joints, skin."""
    hand, states = demo()
    state = states[round(seconds * RECORDING_RATE)]
    markers, pose = local(state)
    figure = card(1600, 680)
    size = 500, 570
    camera = Camera(view_axes('aslant', 'right'), (.081, .014, -.012), .212)
    whole = skin_mesh(hand, pose)
    ghost = render([whole], camera, size)
    ghost[..., :3] = 255
    ghost[..., 3] = ghost[..., 3] * .08
    stages = (([ghost, render(balls(markers), camera, size, shadows=False)], '8 markers'),
              ([ghost, render(bones(hand, pose), camera, size)], '25 joint angles'),
              ([render([whole, *balls(markers)], camera, size)], 'one whole hand'))
    for column, (images, what) in enumerate(stages):
        left = 25 + 525 * column
        for image in images:
            place_image(figure, image, left, 22)
        write_text(figure, left + .5 * size[0], 630, what, 40, CARD_INK, weight='bold')
        if column:
            write_text(figure, left - 12, 320, '→', 64, CARD_MUTED)
    save(figure, 'hero.png')


def motion():
    """Draw the demo motion: the measured markers beside the hand tracked from them."""
    hand, states = demo()
    width, height, size = 640, 336, (310, 280)
    camera = Camera(view_axes('aslant', 'right'), (.08, .006, -.012), .222)
    turned = states[0].wrist_rotation.T
    back = card(width, height)
    for x, what in ((165, 'markers measured'), (475, 'hand tracked from them')):
        write_text(back, x, 314, what, 17, CARD_INK)
    for x, colour, text in ((24, DRAWN_MARKER_RGB, 'seen'), (92, ORANGE, 'hidden, predicted')):
        back.add_artist(Ellipse((x / width, 1. - 22 / height), 13 / width, 13 / height,
                                color=colour))
        write_text(back, x + 14, 22, text, 15, CARD_MUTED, ha='left')
    base = Image.new('RGBA', (width, height), CARD)
    base.alpha_composite(figure_image(back))
    images = []
    for frame in range(0, len(states), round(RECORDING_RATE / GIF_RATE)):
        markers, pose = local(states[frame])
        # Keep the wrist's rotation relative to the first frame, but not its translation.
        sway = turned @ states[frame].wrist_rotation
        markers, pose = markers @ sway.T, Pose(sway @ pose.rotation, pose.position @ sway.T)
        kinds = states[frame].marker_states
        image = base.copy()
        seen = balls(markers[kinds == MarkerState.SEEN])
        for left, meshes, shadows in ((10, seen, False),
                                      (320, [skin_mesh(hand, pose), *balls(markers, kinds)], True)):
            image.alpha_composite(Image.fromarray(
                render(meshes, camera, size, 2, shadows)), (left, 18))
        images.append(image.convert('RGB'))
    PICTURE_FOLDER.mkdir(exist_ok=True)
    path = PICTURE_FOLDER / 'motion.gif'
    save_gif(path, images, GIF_RATE, GIF_COLOURS, (ORANGE,), GIF_TOLERANCE)
    print(f'{path}: {len(images)} frames, {path.stat().st_size / 1e6:.2f} MB', flush=True)


def constraints():
    """Draw the true hand beside those tracked with and without constraints."""
    size, left, step, head, row = (480, 400), 60, 500, 110, 530
    figure = card(1600, head + 2 * row + 70)
    for column, title in enumerate(('the truth', 'tracked with constraints', 'without')):
        write_text(figure, left + step * column + .5 * size[0], 62, title, 36, CARD_INK,
                   weight='bold')
    for number, (condition, what) in enumerate(SHOWN_CONDITIONS.items()):
        one, markers, frame, poses, errors = _helped_most(condition)
        top = head + row * number
        figure.add_artist(Line2D((left / figure.bbox.width, 1. - left / figure.bbox.width),
                                 (1. - top / figure.bbox.height,) * 2, color=CARD_MUTED, alpha=.4))
        write_text(figure, left, top + 30, what, 26, CARD_MUTED, ha='left')
        back = one.rotation[frame].T
        skins = [deform(load_skin(one.hand), forward(
            joint_table(one.hand), angles, back @ turn, back @ (at - one.position[frame])))
            for angles, turn, at in poses]
        camera = Camera(view_axes('aslant', 'right'), (.078, 0., -.012), .2)
        measured, true = ((places - one.position[frame]) @ back.T
                          for places in (markers, one.observed.truth[frame]))
        for column, vertices in enumerate(skins):
            off = np.linalg.norm(vertices - skins[0], axis=1)
            share = np.clip(off / FULL_COLOUR_ERROR, 0., 1.)[:, None]
            whole = Mesh(vertices, load_skin(one.hand).faces,
                         (1. - share) * rgb(SKIN_TONE) + share * rgb(VERMILLION))
            x, y = left + step * column, top + 42
            balls_shown = _judged(measured, None if column else true)
            place_image(figure, render([whole, *balls_shown], camera, size), x, y)
            middle, below = x + .5 * size[0], y + size[1]
            if column:
                here, mean = errors[column - 1]
                write_text(figure, middle, below + 22, f'{here:.1f} mm off', 32, CARD_INK)
                write_text(figure, middle, below + 58, f'all frames: {mean:.1f} mm', 22, CARD_MUTED)
            else:
                write_text(figure, middle, below + 40, 'the frame in which\nconstraints help most',
                           22, CARD_MUTED, linespacing=1.4)
    _constraints_legend(figure)
    save(figure, 'constraints.png')


def _judged(measured, true):
    """Return a ball for each measured marker; given the truth, mark wrong and add hidden ones."""
    found = [(at, DRAWN_MARKER_RGB) for at in measured]
    if true is not None:
        off = np.linalg.norm(measured - true, axis=1)
        found = [(at, rgb(SKY_BLUE) if miss > WRONG_MARKER_ERROR else DRAWN_MARKER_RGB)
                 for at, miss in zip(measured, off)]
        found += [(at, rgb(ORANGE)) for at, miss in zip(true, off) if np.isnan(miss)]
    return [ball_mesh(at, DRAWN_BALL_RADIUS, colour)
            for at, colour in found if np.isfinite(at).all()]


def _constraints_legend(figure):
    """Draw the legend along the lower edge."""
    width, height = figure.bbox.size
    y = height - 40
    for x, colour, text in ((72, DRAWN_MARKER_RGB, 'marker measured'), (312, ORANGE, 'hidden'),
                            (442, SKY_BLUE, 'measured with a wrong label, or a reflection')):
        figure.add_artist(Ellipse((x / width, 1. - y / height), 18 / width, 18 / height,
                                  color=colour))
        write_text(figure, x + 20, y, text, 22, CARD_MUTED, ha='left')
    shades = np.linspace(rgb(SKIN_TONE), rgb(VERMILLION), 160)
    place_image(figure, np.tile(np.round(255. * shades).astype(np.uint8), (18, 1, 1)), 1130, y - 9)
    write_text(figure, 1120, y, 'skin off by 0', 22, CARD_MUTED, ha='right')
    write_text(figure, 1300, y, f'to {1e3 * FULL_COLOUR_ERROR:.0f} mm and more', 22, CARD_MUTED,
               ha='left')


def _helped_most(condition):
    """Return the frame with the largest ratio of errors without to with constraints.

    Returns
    -------
    trial, markers, frame, poses, errors
        The simulated trial, its markers (T, 8, 3) [m], the frame's index, its true pose and both
        tracked ones, and (error in the frame, mean error) of both [mm].
    """
    found, means, layout = [], [], resting_layout(Hand.scaled())
    for number, name in enumerate(ablation.ABLATION_MOTIONS):
        one = trial(name, PICTURE_SEED + number, ablation.ABLATION_RATE,
                    ablation.ABLATION_DURATION, layout)
        markers = ablation.markers_of(one, condition, PICTURE_SEED + number)
        tracked, off = [], []
        for change in (ablation.ABLATION_VARIANTS[ablation.ALL_CONSTRAINTS],
                       ablation.without_any()):
            hand, each = ablation.tracked_with(one, change, markers)
            tracked.append(each)
            off.append(1e3 * np.linalg.norm(
                tracked_joints(hand, each) - one.joints, axis=2).mean(axis=1))
        means.append([each.mean() for each in off])
        frame = int(np.argmax(np.where(off[1] < MAX_ERROR_MM, off[1] / off[0], 0.)))
        poses = [(one.angles[frame], one.rotation[frame], one.position[frame])] + [
            (each.angles[frame], each.wrist_rotation[frame], each.wrist_position[frame])
            for each in tracked]
        found.append((one, markers[frame], frame, poses, [each[frame] for each in off]))
    *best, errors = max(found, key=lambda each: each[-1][1] / each[-1][0])
    return *best, list(zip(errors, np.mean(means, axis=0)))


def angles():
    """Plot a finger's angles in the packaged recording, tracked and true."""
    hand, recording = Hand.scaled(), demo_recording()
    tracked = tracked_angles(tracked_from(recording, hand, MarkerLayout()))
    figure = digit_page(tracked, hand, 'index', 'demo.mcap, right hand', truth=recording.angles)
    PICTURE_FOLDER.mkdir(exist_ok=True)
    figure.savefig(PICTURE_FOLDER / 'angles.png')


def latency(samples=None):
    """Plot the latency from markers to joint states, beside nodes that only echo."""
    with TemporaryDirectory() as folder:
        if samples is None:
            samples = Path(folder, 'samples.npz')
            subprocess.run([
                sys.executable, '-m', 'benchmarks.round_trip', '--rates', f'{TRIP_RATE}',
                '--seconds', f'{TRIP_SECONDS}', '--samples', samples], check=True)
        with np.load(samples) as found:
            trips = {node: 1e-3 * found[key] for node in TRIP_NODES
                     if (key := f'{node}_{TRIP_RATE}_1') in found}
    row, left, top, right = 128, 420, 190, 1540
    figure = card(1600, top + row * len(trips) + 120)
    width, height = figure.bbox.size
    bottom = top + row * len(trips)
    write_text(figure, 60, 56, f'Round trip at {TRIP_RATE} Hz', 40, CARD_INK, weight='bold',
               ha='left')
    write_text(figure, 60, 104,
               'from markers published to joint states received, between processes',
               25, CARD_MUTED, ha='left')
    edges = np.geomspace(*SHOWN_MS, 121)
    shares = {node: np.histogram(each, edges)[0] / len(each) for node, each in trips.items()}
    highest = max(share.max() for share in shares.values())
    for number, (node, share) in enumerate(shares.items()):
        axes = figure.add_axes((left / width, 1. - (top + row * (number + 1)) / height,
                                (right - left) / width, .88 * row / height))
        _log_axis(axes, number + 1 == len(trips))
        axes.set_ylim(0., 1.05 * highest)
        what, note, colour = TRIP_NODES[node]
        axes.stairs(share, edges, fill=True, color=colour, alpha=.35)
        axes.stairs(share, edges, color=colour, linewidth=2.5)
        lost = np.isnan(trips[node]).mean()
        median, p99 = np.nanpercentile(trips[node], (50, 99))
        write_text(figure, 60, top + row * number + 26, what, 28, colour, weight='bold', ha='left')
        loss = f', lost {lost:.2%}' if lost else ''
        write_text(figure, 60, top + row * number + 58, note + loss, 20, CARD_MUTED, ha='left')
        write_text(figure, 60, top + row * number + 92, f'median {median:.2f} ms, p99 {p99:.2f} ms',
                   20, CARD_INK, ha='left')
        print(f'{node}: median {1e3 * median:.0f}, p99 {1e3 * p99:.0f} µs, lost {lost:.2%}')
    for rate in (120, TRIP_RATE):
        x = left + (right - left) * np.log(1e3 / rate / SHOWN_MS[0]) / np.log(
            SHOWN_MS[1] / SHOWN_MS[0])
        figure.add_artist(Line2D((x / width,) * 2, (1. - top / height, 1. - bottom / height),
                                 color=CARD_INK, linestyle=(0, (4, 4)), linewidth=1.5))
        write_text(figure, x, top - 34, f'{1e3 / rate:.1f} ms:\na frame at {rate} Hz', 20, CARD_INK,
                   linespacing=1.3)
    frames = len(next(iter(trips.values())))
    write_text(figure, 60, bottom + 84, f'{frames} frames each, one hand, all constraints on; '
               f'{hardware()}', 20, CARD_MUTED, ha='left')
    save(figure, 'latency.png')


def teleoperation():
    """Plot a robot's command over time while the tracker fails in several ways."""
    hand = Hand.scaled(limits=preset_limits('wide'))
    motion, step = motion_named('demo', hand), 1. / RECORDING_RATE
    with TemporaryDirectory() as folder:
        Path(folder, 'robot.urdf').write_text(urdf(hand))
        robot = load_robot(str(Path(folder, 'robot.urdf')))
    driver = Teleoperation(robot, hand, 'right_')
    names, row = [f'right_{joint}' for joint in JOINTS], robot.order.index(DRIVEN_JOINT)
    position = robot.hand.rest.copy()
    times = np.arange(0., DRIVEN_SECONDS, step)
    angles, _, _ = motion.sample(DRIVEN_START + times)
    wanted, sent, states = [], [], []
    for now, frame in zip(times, angles):
        seen = frame.copy()
        if any(start <= now < end for start, end in JUMPS):
            seen[:] = hand.limits[:, 1]
        driver.observe_robot(robot.order, position, now)
        if not any(start <= now < end for start, end in KILLED):
            driver.observe_hand(names, seen, now)
        if any(abs(now - engaged) < .5 * step for engaged in ENGAGED_AT):
            driver.guard.engage(now)
        command = driver.command(now)
        position = position if command is None else command.position.copy()
        wanted.append(np.nan if any(start <= now < end for start, end in KILLED)
                      else seen[JOINTS.index(DRIVEN_JOINT)])
        sent.append(np.nan if command is None else command.position[row])
        states.append(driver.guard.state)
    figure = blank_figure(1100, 420, layout='constrained')
    axes = figure.subplots()
    for state, colour in GUARD_COLOURS.items():
        axes.fill_between(times, 0, 1, where=[one is state for one in states], color=colour,
                          alpha=.35, linewidth=0, transform=axes.get_xaxis_transform(),
                          label=state.value)
    axes.plot(times, np.degrees(wanted), color=GREY, linewidth=1., label='hand')
    axes.plot(times, np.degrees(sent), color=BLUE, linewidth=2., label='command sent')
    axes.set_xlabel('time [s]')
    axes.set_ylabel(f'{DRIVEN_JOINT} [degrees]')
    axes.set_xlim(0., DRIVEN_SECONDS)
    figure.legend(loc='outside upper center', ncols=6, frameon=False)
    PICTURE_FOLDER.mkdir(exist_ok=True)
    figure.savefig(PICTURE_FOLDER / 'teleoperation.png', metadata={'Software': None})


def _log_axis(axes, is_lowest):
    """Style axes as a line of logarithmic time [ms], labelled in the lowest row."""
    axes.set_facecolor('none')
    axes.set_xscale('log')
    axes.set_xlim(SHOWN_MS)
    axes.set_xticks(TICKS_MS, [f'{tick:g} ms' for tick in TICKS_MS] if is_lowest else [])
    axes.set_xticks([], minor=True)
    axes.set_yticks([])
    axes.tick_params(colors=CARD_MUTED, labelsize=16, length=0, pad=10)
    for name, spine in axes.spines.items():
        spine.set(visible=name == 'bottom', color=CARD_MUTED)


def layouts():
    """Draw each layout preset on the hand at rest, seen from the back of a right hand."""
    hand = Hand.scaled()
    rest = forward(joint_table(hand), hand.relaxed() * .3)
    points = skeleton_points(tip_offsets(hand), rest, np.zeros(3))
    # `SKIN_LAYOUT` looks like the paper's eight from above.
    for name in (*LAYOUT_PRESETS, *set(SKIN_LAYOUTS) - {SKIN_LAYOUT}):
        layout = preset_layout(name)
        markers = marker_positions(layout.mounting(hand), rest)
        figure = blank_figure(*LAYOUT_SIZE, facecolor='white')
        axes = figure.add_axes((0., 0., 1., 1.))
        # Fingers up, the thumb to the left.
        for bone in SKELETON_BONES:
            axes.plot(-points[bone, 1], points[bone, 0], color=LIGHT_GREY, linewidth=5,
                      solid_capstyle='round', zorder=1)
        is_principal = np.isin(np.arange(len(markers)), layout.principal)
        for chosen, colour in ((is_principal, VERMILLION), (~is_principal, SKY_BLUE)):
            axes.scatter(-markers[chosen, 1], markers[chosen, 0], s=22, color=colour,
                         edgecolor='black', linewidth=.4, zorder=2)
        axes.set_aspect('equal')
        axes.set_xlim(-.085, .075)
        axes.set_ylim(-.035, .2)
        axes.axis('off')
        save(figure, f'layout_{name}.png')


def glb(time=2.):
    """Photograph a GLB of the packaged recording in docs/glb.html, in Chromium.

    Needs npm, for three.js, and Playwright with a Chromium.
    """
    # Here, as only this picture needs it.
    from playwright.sync_api import sync_playwright

    with TemporaryDirectory() as folder:
        done = subprocess.run(['npm', 'pack', f'three@{THREE_VERSION}'], cwd=folder, check=True,
                              capture_output=True, text=True)
        with tarfile.open(Path(folder, done.stdout.split()[-1])) as archive:
            archive.extractall(folder, filter='data')
        hand = Path(folder, 'hand.glb')
        subprocess.run([sys.executable, '-m', 'hand_tracker', 'track', packaged_recording(), '-o',
                        hand], check=True)

        def answer(route):
            path = route.request.url.partition('?')[0]
            library = path.partition(f'three@{THREE_VERSION}/')[2]
            route.fulfill(path=Path(folder, 'package', library) if library else
                          hand if path.endswith('.glb') else PICTURE_FOLDER.parent / 'glb.html')

        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(
                executable_path=shutil.which('chromium'),
                args=['--no-sandbox', '--use-gl=angle', '--use-angle=swiftshader',
                      '--enable-unsafe-swiftshader'])
            page = browser.new_page(viewport={'width': 1200, 'height': 380})
            page.route('**/*', answer)
            page.goto(f'http://page/glb.html?file=hand.glb&time={time}&frames=4')
            page.wait_for_function("document.title == 'drawn'", timeout=120_000)
            page.screenshot(path=PICTURE_FOLDER / 'glb.png')
            browser.close()


def body_at_rest():
    """Return a body with its forearms in front of it, as a full-body system captures it."""
    turns = {'Arm': (0., 0., 65.), 'ForeArm': (0., 80., 15.), 'Hand': (0., 0., 0.)}
    limbs = {'UpLeg': (-9., -8., 0.), 'Leg': (0., -42., 0.), 'Foot': (0., -42., 0.),
             'Shoulder': (-4., 44., 0.), 'Arm': (-14., 0., 0.), 'ForeArm': (-28., 0., 0.),
             'Hand': (-25., 0., 0.)}
    joints = [BvhJoint('Hips', -1, (0., 95., 0.), CHANNELS[:3] + rotation_channels('ZXY')),
              BvhJoint('Neck', 0, (0., 50., 0.), rotation_channels('ZXY')),
              BvhJoint('', 1, (0., 20., 0.), ())]
    values = [0., 95., 0., 0., 0., 0., 0., 0., 0.]
    for side, sign in (('Right', 1.), ('Left', -1.)):
        parent = 0
        for name, (x, y, z) in limbs.items():
            parent = 0 if name in ('UpLeg', 'Shoulder') else parent
            joints.append(BvhJoint(side + name, parent, (sign * x, y, z),
                                   rotation_channels('ZXY')))
            parent = len(joints) - 1
            about_x, about_y, about_z = turns.get(name, (0., 0., 0.))
            values += [sign * about_z, about_x, sign * about_y]
    count = len(demo()[1])
    return BvhMotion(tuple(joints), np.tile(values, (count, 1)), 1. / RECORDING_RATE)


def posed(skeleton, mesh, frame):
    """Return the vertices of a mesh bound to a skeleton in a frame."""
    origins, places, turns = [], [], []
    for joint, parent in enumerate(skeleton.parents):
        turn = Rotation.from_quat(skeleton.rotation[frame, joint])
        if parent < 0:
            origins.append(np.zeros(3))
            places.append(skeleton.root_position[frame])
        else:
            origins.append(origins[parent] + skeleton.offsets[joint])
            places.append(places[parent] + turns[parent].apply(skeleton.offsets[joint]))
            turn = turns[parent] * turn
        turns.append(turn)
    matrices = np.array([turn.as_matrix() for turn in turns])[mesh.joints]     # (V, 4, 3, 3)
    local = mesh.vertices[:, None] - np.array(origins)[mesh.joints]            # (V, 4, 3)
    moved = np.einsum('vkij,vkj->vki', matrices, local) + np.array(places)[mesh.joints]
    return np.einsum('vk,vki->vi', mesh.weights, moved)


def spliced(seconds=(9., 13.4, 16.8)):
    """Draw tracked hands spliced onto a body: all of it, and the right one at three times."""
    body = body_at_rest()
    naming, hands, tracked = skeleton_naming(body.joints), [], []
    for side in ('right', 'left'):
        states = demo()[1]
        angles = np.array([state.angles for state in states])
        if side == 'left':
            angles = np.roll(angles, len(angles) // 2, axis=0)
        count = len(angles)
        one = HandAngles(Hand.scaled(side=side), angles, np.zeros((count, 3)),
                         np.tile(np.eye(3), (count, 1, 1)), np.arange(count) / RECORDING_RATE)
        place = require_hand(body.joints, side, 'body')
        hands.append(SplicedHand(place, skeleton_motion(one), ClockAlignment(0.), rest_mount(
            side, np.array(body.joints[place.wrist].offset))))
        tracked.append(one)
    skeleton = skeleton_of(splice(body, hands, .01), .01)
    mesh = body_mesh(skeleton, [(hand, one.hand) for hand, one in zip(hands, tracked)], naming)
    of_hands = [number for number, name in enumerate(skeleton.names) if 'Hand' in name]
    colours = np.where(np.isin(mesh.joints[:, :1], of_hands), rgb(SKIN_TONE), rgb(SKY_BLUE))
    is_right = np.isin(mesh.joints[:, 0], [number for number in of_hands
                                           if skeleton.names[number].startswith('Right')])
    figure = blank_figure(1500, 480)
    wide, close = (camera_axes(eye, (0., 1., 0.)) for eye in ((.55, .25, 1.), (-.5, .8, 1.)))
    for column, (time, axes, height, distance, size) in enumerate((
            (seconds[0], wide, 1.85, 6., (300, 470)),
            *((time, close, .25, 1.5, (390, 470)) for time in seconds))):
        vertices = posed(skeleton, mesh, round(time * RECORDING_RATE))
        hand = vertices[is_right]
        centre = .5 * (hand.min(axis=0) + hand.max(axis=0)) if column else (0., .82, .1)
        # What is far away would take the shadows' sharpness.
        is_near = np.linalg.norm(vertices - centre, axis=1) < (.3 if column else np.inf)
        shown = Mesh(vertices, mesh.faces[is_near[mesh.faces].all(axis=1)], colours)
        image = render([shown], Camera(axes, np.array(centre), height, distance), size)
        place_image(figure, image, 5 + (300 + 400 * (column - 1) if column else 0), 5)
    save(figure, 'spliced.png')


PICTURE_MAKERS = {'hero': hero, 'motion': motion, 'constraints': constraints, 'angles': angles,
                  'latency': latency, 'layouts': layouts, 'teleoperation': teleoperation,
                  'glb': glb, 'spliced': spliced}


def main():
    """Make all pictures, or the named ones."""
    parser = argparse.ArgumentParser(prog='python -m docs.draw_pictures',
                                     description=__doc__.split('\n', maxsplit=1)[0])
    parser.add_argument('names', nargs='*', choices=(*PICTURE_MAKERS, []), metavar='NAME',
                        help=', '.join(PICTURE_MAKERS))
    parser.add_argument('--samples', metavar='FILE.npz', help='of benchmarks.round_trip, for '
                        'latency; measured when left out')
    chosen = parser.parse_args()
    for name in chosen.names or PICTURE_MAKERS:
        PICTURE_MAKERS[name](*([chosen.samples] if name == 'latency' else ()))


if __name__ == '__main__':
    main()
