"""The switch: kernels give the same numbers compiled and as plain Python."""

import ast
import os
import re
import subprocess
import sys
import time
from copy import deepcopy

import numpy as np
import pytest
from helpers.allocations import counted_allocations

from benchmarks.repository import REPOSITORY
from hand_tracker.core.numerics.jit import CACHE_NAME, COMPILED, kernel_sources
from hand_tracker.core.numerics.packs import empty_like_pack, empty_packs, overwrite, packed, parts
from hand_tracker.core.pose.report import blank_report
from hand_tracker.core.records import blank_state

SCRIPT = """
import sys
import numpy as np
from hand_tracker.core.numerics import jit
from hand_tracker.core.model.hand import Hand
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.marker_layout import MarkerLayout, marker_positions
from hand_tracker.core.tracker import HandTracker, TrackerOptions

assert jit.COMPILED == (sys.argv[1] == '1'), jit.COMPILED
rng = np.random.default_rng(1)
hand = Hand.scaled(side='left')
mounting = MarkerLayout().mounting(hand)
rows = []
for options in (TrackerOptions(), TrackerOptions('spheres', 'fabrik'),
                TrackerOptions(friction=.5)):
    tracker = HandTracker(hand, options=options)
    lower, upper = hand.limits.T
    phase = rng.uniform(0., 6., 25)
    for frame in range(90):
        angles = lower + (upper - lower) * (.5 + .3 * np.sin(phase + .1 * frame))
        markers = marker_positions(mounting, forward(joint_table(hand), angles))
        markers += rng.normal(scale=.0005, size=(8, 3))
        if 20 <= frame < 50:
            markers[[0, 4, 6][:frame // 10 - 1]] = np.nan
        if frame in (15, 35):
            markers[[3, 5]] = markers[[5, 3]]
        if frame == 55:
            markers[7] += .1
        if 60 <= frame < 75:
            markers[[0, 1, 2, 3, 7][:frame // 3 - 19]] = np.nan
        if 70 <= frame < 80:
            markers[[1, 2]] = markers[[2, 1]]
        measured = np.full(5, .3) if frame >= 80 else None
        state = tracker.update(markers, distal_flexion=measured)
        rows.append(np.concatenate((state.angles, state.deviation, state.marker_states,
                                    state.wrist_position, state.pose.position.ravel())))
np.save(sys.argv[2], rows)
"""

# Prints by how many the allocations of tracked frames are more than the arrays handed over.
ALLOCATIONS = """
import numpy as np
from numba.core.runtime import rtsys
from hand_tracker.core.model.hand import Hand
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.layout_presets import preset_layout
from hand_tracker.core.model.marker_layout import marker_positions
from hand_tracker.core.tracker import HandTracker

hand, rng = Hand.scaled(), np.random.default_rng(1)
for name in ('paper8', 'sig18_19'):
    tracker, mounting = HandTracker(hand, preset_layout(name)), preset_layout(name).mounting(hand)
    frames = np.array([marker_positions(mounting, forward(
        joint_table(hand), hand.relaxed() + .3 * np.sin(.1 * frame))) for frame in range(220)])
    frames += rng.normal(scale=.0005, size=frames.shape)
    frames[rng.random(frames.shape[:2]) < .1] = np.nan
    for markers in frames[:20]:
        tracker.update(markers)
    before = rtsys.get_allocation_stats().alloc
    for markers in frames[20:]:
        tracker.update(markers)
    made = rtsys.get_allocation_stats().alloc - before
    # Besides those of `kernel_arguments` the markers.
    print(made - 200 * (len(tracker.kernel_arguments()) + 1))
"""


@pytest.mark.skipif(not COMPILED, reason='plain Python allocates')
def test_kernels_allocate_nothing_while_they_track():
    assert counted_allocations(ALLOCATIONS) == ['0', '0']


def rows(tmp_path, switch):
    out = tmp_path / f'{switch}.npy'
    environment = {**os.environ, 'HAND_TRACKER_JIT': switch, 'PYTHONPATH': os.pathsep.join(
        [str(REPOSITORY), os.environ.get('PYTHONPATH', '')])}
    subprocess.run([sys.executable, '-c', SCRIPT, switch, str(out)], check=True, env=environment)
    return np.load(out)


def test_compiled_and_plain_kernels_agree(tmp_path):
    pytest.importorskip('numba', reason='numba is not installed: there is only plain Python')
    compiled, plain = rows(tmp_path, '1'), rows(tmp_path, '0')
    # What feeds back, FABRIK and separating, makes rounding grow, and a straight finger does.
    np.testing.assert_allclose(compiled, plain, atol=1e-6)


def test_the_switch_turns_numba_off(tmp_path):
    assert np.isfinite(rows(tmp_path, '0')).all()


@pytest.mark.skipif(not COMPILED, reason='nothing is kept without numba')
def test_kernels_of_other_sources_go_when_unused_for_a_month(tmp_path):
    caches = tmp_path / 'hand_tracker'
    environment = {**os.environ, 'XDG_CACHE_HOME': str(tmp_path), 'PYTHONPATH': str(REPOSITORY)}
    environment.pop('NUMBA_CACHE_DIR', None)

    def old(name, days):
        folder = caches / name
        (folder / 'core').mkdir(parents=True, exist_ok=True)
        (folder / 'core' / 'kernel.nbi').touch()
        os.utime(folder, (time.time() - 86400. * days,) * 2)
        return folder

    def start():
        subprocess.run([sys.executable, '-c', 'import hand_tracker.core.numerics.jit'], check=True,
                       env=environment)
        return {path.name for path in caches.iterdir()}

    old('kernels-unused', 31.)
    old('kernels-used', 29.)
    old('skin', 31.)
    own, = start() - {'kernels-used', 'skin'}
    # Its own are used, and nothing is looked for while they are there.
    old(own, 31.)
    old('kernels-unused', 31.)
    assert start() == {own, 'kernels-unused', 'kernels-used', 'skin'}
    assert time.time() - (caches / own).stat().st_mtime < 3600.


@pytest.mark.skipif(not COMPILED, reason='nothing is kept without numba')
def test_kernels_of_other_sources_are_kept_apart_in_a_given_folder_too(tmp_path):
    def folder(given):
        done = subprocess.run(
            [sys.executable, '-c', 'from hand_tracker.core.numerics.jit import CACHE_FOLDER; '
             'print(CACHE_FOLDER)'], check=True, stdout=subprocess.PIPE, text=True, env={
                **os.environ, 'NUMBA_CACHE_DIR': str(given), 'PYTHONPATH': str(REPOSITORY)})
        return done.stdout.strip()

    own = tmp_path / 'caches' / CACHE_NAME
    assert folder(tmp_path / 'caches') == str(own) and own.is_dir()
    # As a process that this one starts is given it.
    assert folder(own) == str(own)


def test_a_change_of_any_kernel_or_of_its_constants_makes_new_ones():
    package, sources = REPOSITORY / 'hand_tracker', kernel_sources()
    for path in package.rglob('*.py'):
        text = path.read_text(encoding='utf-8')
        if not re.search(r'^ *@(partial\()?jit', text, re.M):
            continue
        assert path in sources
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.ImportFrom) and node.level:
                folder = path.parents[node.level - 1]
                module = folder.joinpath(*(node.module or '').split('.')).with_suffix('.py')
                assert module in sources or not any(
                    name.name.isupper() for name in node.names), (path, module)


def test_packed_values_are_those_given():
    state = blank_state(np.eye(3), np.ones((5, 3)), np.ones(25), 1e-4)
    state.wrist.placed[0] = True
    pack, values = packed(state)
    assert type(values) is type(state) and type(values.palm) is type(state.palm)
    np.testing.assert_array_equal(values.digits.mean, state.digits.mean)
    assert values.wrist.placed.dtype == bool and values.wrist.placed[0]
    # The arrays are those of the pack, whichever side writes.
    values.angles[1] = 7.
    assert pack[0]['angles' if COMPILED else state._fields.index('angles')][1] == 7.


def test_another_pack_is_apart():
    pack, values = packed(blank_report())
    values.angles[3] = 7.
    other = empty_like_pack(pack)
    overwrite(other, pack)
    angles = parts(other)[values._fields.index('angles')]
    assert angles[3] == 7.
    angles[:] = 1.
    assert values.angles[3] == 7. and values.angles.sum() == 7.
    assert [part.shape for part in parts(other)] == [part.shape for part in values]


def test_packs_made_at_once_share_nothing():
    pack, values = packed(blank_report())
    at = values._fields.index('angles')
    first, second = empty_packs(pack, 2)
    overwrite(first, pack)
    overwrite(second, pack)
    parts(first)[at][:] = 7.
    assert (parts(second)[at] == values.angles).all() and (values.angles != 7.).all()


def test_a_pack_is_overwritten_with_all_that_another_holds():
    blank = blank_state(np.eye(3), np.ones((5, 3)), np.ones(25), 1e-4)
    pack, values = packed(deepcopy(blank))
    other, _ = packed(blank)
    values.digits.mean[:], values.wrist.placed[0] = 3., True
    values.association.doubted_for[0] = 2.
    overwrite(pack, other)
    assert (values.digits.mean == blank.digits.mean).all()
    assert not values.wrist.placed[0] and values.association.doubted_for[0] == 0.
    values.digits.mean[:] = 4.
    assert (blank.digits.mean != 4.).all()
