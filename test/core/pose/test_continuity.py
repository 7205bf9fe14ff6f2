"""A pose that never jumps."""

import numpy as np
import pytest

from hand_tracker.core.model.hand import ABDUCTION_JOINTS, DIGIT_OF_JOINT, FLEXION_JOINTS
from hand_tracker.core.pose.continuity import blend, no_pace

LOWER, UPPER = np.full(25, -1.), np.full(25, 2.)
STEP, RATE = .01, 15.
NO_DIGIT = np.zeros(5, dtype=bool)
INDEX = np.array((True, False, False, False, False))
OF_INDEX = np.array((ABDUCTION_JOINTS[0], *FLEXION_JOINTS[0]))


def blended_path(solved, changes, step=STEP, rate=RATE, predicted=NO_DIGIT):
    """Return the blended angles of frames (n, 25), with what `changes` has in some of them."""
    blended, offset = solved[0].copy(), np.zeros(25)
    path = []
    for frame, angles in enumerate(solved):
        blend(angles, blended, offset, changes.get(frame, NO_DIGIT), predicted, step, rate,
             LOWER, UPPER)
        path.append(blended.copy())
    return np.array(path)


def jump(by, frames=30, at=5):
    """Return angles of which those of the index finger change at once."""
    solved = np.zeros((frames, 25))
    solved[at:, OF_INDEX] = by
    return solved


def test_without_a_change_nothing_is_eased():
    solved = jump(1.)
    np.testing.assert_array_equal(blended_path(solved, {}), solved)


@pytest.mark.parametrize('by', [1., -.7])
def test_a_change_fades_in_at_the_rate_and_then_is_gone(by):
    path = blended_path(jump(by), {5: INDEX})
    steps = np.diff(path[:, OF_INDEX], axis=0)
    assert abs(steps).max() <= RATE * STEP + 1e-12
    frames = int(np.ceil(abs(by) / (RATE * STEP)))
    assert (abs(steps[4:4 + frames - 1]) > .99 * RATE * STEP).all()
    np.testing.assert_array_equal(path[5 + frames:], jump(by)[5 + frames:])


def test_the_true_motion_is_neither_delayed_nor_slowed():
    solved = jump(1.)
    # Flexing at first, up to twice as fast as what corrects
    motion = .6 * np.sin(.5 * np.arange(-5, 25))
    path = blended_path(solved + motion[:, None], {5: INDEX})[5:, OF_INDEX]
    true = np.diff(motion[5:])[:, None]
    added = np.diff(path, axis=0) - true
    assert (added > -1e-12).all() and (added < RATE * STEP + 1e-12).all()
    # It goes no faster than the one or the other, and in the end there is the motion alone.
    fastest = np.maximum(abs(true), RATE * STEP)
    assert (abs(np.diff(path, axis=0)) <= fastest + 1e-12).all()
    assert (added.sum(axis=0) > .8).all()
    np.testing.assert_allclose(added[20:], 0., atol=1e-12)


def test_a_predicted_digit_turns_at_the_rate_at_most_and_a_seen_one_as_it_is_seen():
    solved = jump(1.)
    solved[15:] = -.5
    others = DIGIT_OF_JOINT != 0
    path = blended_path(solved, {}, predicted=INDEX)
    assert abs(np.diff(path[:, OF_INDEX], axis=0)).max() <= RATE * STEP + 1e-12
    np.testing.assert_array_equal(path[[14, -1]], solved[[14, -1]])
    np.testing.assert_array_equal(path[:, others], solved[:, others])


def test_other_digits_are_left_alone():
    solved = np.ones((30, 25)) * np.linspace(0., 1., 30)[:, None] ** 2
    others = np.setdiff1d(np.arange(25), OF_INDEX)
    np.testing.assert_array_equal(blended_path(solved, {5: INDEX})[:, others], solved[:, others])


def test_a_change_while_one_fades_goes_on_from_where_it_is():
    solved = jump(1.)
    solved[8:, OF_INDEX] = -.5
    steps = np.diff(blended_path(solved, {5: INDEX, 8: INDEX})[:, OF_INDEX], axis=0)
    assert abs(steps).max() <= RATE * STEP + 1e-12


def test_nothing_fades_while_no_time_passes():
    path = blended_path(jump(1.), {5: INDEX}, step=0.)
    assert (path == 0.).all()


def test_limits_hold_while_it_fades():
    solved = np.zeros((30, 25))
    solved[0:5, OF_INDEX] = 2.
    solved[5:, OF_INDEX] = 1.
    solved[6:, OF_INDEX] = 1.9
    path = blended_path(solved, {5: INDEX})
    assert (path <= UPPER).all() and (path >= LOWER).all()
    assert path[6, OF_INDEX] == pytest.approx(2.)
    np.testing.assert_array_equal(path[-1], solved[-1])


def paced(solved, missing, step=STEP, rate=5.):
    """Return the angles of frames (n, 25) that go on where the index finger's marker is missing."""
    blended, offset, pace = solved[0].copy(), np.zeros(25), no_pace()
    path, was_missing = [], False
    for frame, angles in enumerate(solved):
        is_missing = frame in missing
        changed = INDEX if is_missing != was_missing else NO_DIGIT
        blend(angles, blended, offset, changed, INDEX if is_missing else NO_DIGIT, step, rate,
              LOWER, UPPER, pace)
        path.append(blended.copy())
        was_missing = is_missing
    return np.array(path)


def test_a_marker_that_is_missing_for_a_frame_does_not_slow_a_fast_finger():
    true = np.zeros((40, 25))
    true[:, OF_INDEX] = np.clip(-.8 + .1 * np.arange(40), None, 1.9)[:, None]   # 10 rad/s
    solved = true.copy()
    solved[[8, 15]] = solved[[7, 14]]       # where the prediction holds it
    late = (true - paced(solved, {8, 15}))[:, OF_INDEX]
    # Where it is missing less than its way in a frame, as it comes back next to nothing.
    assert abs(late).max() < .07 and abs(late[[9, 16]]).max() < .03
    assert abs(np.delete(late, (8, 9, 15, 16), axis=0)).max() < 1e-12
    without = blended_path(solved, {8: INDEX, 9: INDEX, 15: INDEX, 16: INDEX}, rate=5.)
    assert (true - without)[16:25, OF_INDEX].min() > .15


def test_a_finger_that_comes_back_elsewhere_after_a_while_goes_there_at_the_rate():
    solved = np.zeros((40, 25))
    solved[10:, OF_INDEX] = 1.
    steps = np.diff(paced(solved, set(range(5, 10)))[:, OF_INDEX], axis=0)
    assert abs(steps).max() == pytest.approx(5. * STEP)


def test_a_carried_angle_stops_where_its_motion_does():
    solved = np.zeros((60, 25))
    solved[:11, OF_INDEX] = .08 * np.arange(-10, 1)[:, None]
    path = paced(solved, set(range(10, 40)))[:, OF_INDEX]
    assert path.max() < .15 and abs(path[-1]).max() < 1e-9
