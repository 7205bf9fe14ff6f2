"""The monitor in front of logs and diagnostics: single frames and batches of the fast path."""

from types import SimpleNamespace

import numpy as np
import pytest
from helpers.frames import RESTING, ZERO_STAMP, frame, hidden, state_of
from helpers.hands import from_pose_to_pose, hand_at

from hand_tracker.core.model.hand import LEFT_HAND_MIRROR, Hand, preset_limits
from hand_tracker.core.model.states import MarkerState, PalmState
from hand_tracker.core.tracker import HandTracker
from hand_tracker.messages.labels import LabelMap
from hand_tracker.messages.marker_array import MarkerFrame
from hand_tracker.messages.stamps import Stamp
from hand_tracker.tracking.diagnostics import STATUS_GAP, Level
from hand_tracker.tracking.exchange_check import ExchangeCheck
from hand_tracker.tracking.fit_check import OFF_HAND_DISTANCE
from hand_tracker.tracking.input_monitor import SILENT_AFTER
from hand_tracker.tracking.monitor import AlikeFrames, Monitor, TrackedFrames
from hand_tracker.tracking.rate_limit import KEYS_LOGGED
from hand_tracker.tracking.stream import TrackedFrame

LATENCY = .002


def monitor():
    return Monitor(0., '/markers', LabelMap())


def tracked_frame(now, state=None, positions=RESTING, restarted=False):
    """Return a frame of the slow path, published at `now` [s]."""
    stamp = Stamp(100 + int(now), round(now % 1. * 1e9))
    return TrackedFrame(now - LATENCY, stamp, 'mocap', 100. + now, state or state_of(),
                        frame(positions, stamp), True, True, restarted,
                        preset_limits('paper'))


def single(now, *args, **kwargs):
    """Return such a frame as the only one of its batch."""
    return TrackedFrames.of(tracked_frame(now, *args, **kwargs), now)


def batch(times, *runs, count=None):
    """Return a batch of the fast path; of each run its time and state."""
    runs = runs or ((times[0], state_of()), (times[-1], state_of()))
    return TrackedFrames(
        count or len(times), Stamp(100 + int(times[-1]), round(times[-1] % 1. * 1e9)),
        runs[-1][1], [now - LATENCY for now in times], list(times),
        [100. + now for now in times], list(runs), None, on_fast_path=True, restarted=False)


def logged(found, now):
    return [line for _, line in found.log_lines(now, lambda: 'nobody is there')]


def status(found, now):
    return found.status(now, lambda: 'nobody is there')


def test_a_single_frame_of_the_slow_path():
    state = state_of()
    tracked = TrackedFrame(3., ZERO_STAMP, 'mocap', 5., state, frame(), True, True, True,
                           preset_limits('paper'))
    frames = TrackedFrames.of(tracked, 3.5)
    assert (frames.frame_count, frames.stamp, frames.received, frames.published, frames.times) == (
        1, ZERO_STAMP, [3.], [3.5], [5.])
    assert frames.runs == [(3.5, state)] and frames.state is state
    assert frames.markers is tracked.markers
    assert frames.restarted and not frames.on_fast_path


def test_frames_of_both_paths_are_counted_and_timed():
    found = monitor()
    found.update(single(.1))
    found.update(batch([.2, .21, .22], count=48))
    found.left_out(5)
    found.set_size('learning')
    level, text, values = status(found, 1.)
    assert (level, text) == (Level.OK, 'tracking')
    assert (values['frames'], values['frames on fast path'], values['frames left out']) == (
        '49', '48', '5')
    assert values['hand size'] == 'learning'
    assert float(values['latency p50 [ms]']) == pytest.approx(1e3 * LATENCY)


def test_a_change_is_to_be_published_and_what_stays_is_not():
    found = monitor()
    assert found.update(single(.1))
    status(found, .1)
    assert not found.update(batch([.5, .6]))
    hidden_index = state_of(index=MarkerState.PREDICTED)
    assert found.update(batch([.7, .8], (.7, hidden_index), (.8, hidden_index)))
    status(found, .8)
    # Too soon, then due.
    assert not found.update(single(.8 + .5 * STATUS_GAP))
    assert found.update(single(.8 + 1.5 * STATUS_GAP))


def test_batches_without_markers_of_their_own_are_not_silence():
    found = monitor()
    found.update(single(.1))
    found.update(batch([.2, 5.]))
    assert status(found, 5.1).level is Level.OK
    silent = status(found, 5.1 + SILENT_AFTER)
    assert silent.level is Level.STALE and 'nobody is there' in silent.text


def test_every_run_of_a_batch_is_looked_at():
    found = monitor()
    found.update(single(.1))
    assert logged(found, .1) == ['tracking']
    # The last frame is as the first was; between, a marker was where it cannot be.
    rejected = state_of(index=MarkerState.REJECTED)
    found.update(batch([.2, .3, .4], (.2, state_of()), (.3, rejected), (.4, state_of())))
    line, = logged(found, .5)
    assert 'not used' in line and '(index)' in line
    lost = state_of(PalmState.LOST)
    found.update(batch([.6, .7], (.6, lost), (.7, lost)))
    line, = logged(found, .7)
    assert line.startswith('the palm is lost')


def test_a_jump_back_is_logged_once():
    found = monitor()
    for now in (.1, .2):
        found.update(single(now, restarted=True))
    assert sum('jumped back' in line for line in logged(found, .2)) == 1
    found.update(single(.3, restarted=True))
    assert not any('jumped back' in line for line in logged(found, .3))


def test_messages_without_markers_of_the_hand():
    found = monitor()
    others = frame(hidden(*range(8)), stamp=False, unknown=(('leds', 40),))
    for now in range(5):
        found.judge(float(now), others)
    unlabelled = status(found, 4.1)
    assert unlabelled.level is Level.ERROR
    assert 'held no marker of the hand' in unlabelled.text and "'leds/40'" in unlabelled.text
    assert "'leds/40'" in found.why_never_tracked()


def test_other_labels_are_expected_from_the_next_message_on():
    found = monitor()
    found.update(single(.1, state_of(thumb=MarkerState.ABSENT)))
    assert status(found, .2).values['thumb marker'].startswith('absent')
    found.set_labels(LabelMap([*'0123456', '']))
    assert status(found, .3).values['thumb marker'] == 'not worn'


def test_warnings_are_logged_once_and_their_number_is_bounded():
    found = monitor()
    for _ in range(3):
        found.warn_once('stamp', 'no stamp')
    assert found.log_lines(0., str) == [(True, 'no stamp')]
    for key in range(2 * KEYS_LOGGED):
        found.warn_once(key, f'cause {key}')
    assert len(logged(found, 0.)) == KEYS_LOGGED - 1


def test_the_end_names_what_was_never_seen():
    found = monitor()
    found.update(single(.1, state_of(ring=MarkerState.ABSENT)))
    assert logged(found, .1) == ['tracking']
    found.ended()
    line, = logged(found, .1)
    assert line.startswith('never seen so far') and '(ring)' in line


@pytest.mark.parametrize('every', [1, 20])
def test_a_hand_of_the_other_side_is_said_once_with_the_cure(every):
    hand, found = Hand.scaled(side='left'), monitor()
    tracker = HandTracker(hand)
    found.check_side(hand, tracker.layout)
    lines = []
    for number, positions in enumerate(from_pose_to_pose(0, 80)):
        now = .01 * number
        state = tracker.update(positions, now)
        if number % every == 0:
            found.update(batch([now], (now, state)))
            lines += [line for line in logged(found, now) if 'side:=right' in line]
    line, = lines
    assert line.startswith('the fingers bend away from the palm of a left hand')


def test_a_hand_of_the_other_side_is_wrong_until_it_is_of_this_side():
    hand, found = Hand.scaled(side='left'), monitor()
    tracker = HandTracker(hand)
    found.check_side(hand, tracker.layout)
    frames = from_pose_to_pose(0, 80)
    lines = []
    for number, positions in enumerate((*frames, *frames * LEFT_HAND_MIRROR)):
        now = .01 * number
        found.update(batch([now], (now, tracker.update(positions, now))))
        lines += logged(found, now)
        if number == len(frames) - 1:
            assert found.is_wrong and found.side_fault() in lines
    assert not found.is_wrong and found.side_fault() is None
    assert lines[0] == 'tracking' and 'tracking again' in lines


def test_exchanged_labels_are_said_once_with_the_cure_until_others_are_set():
    hand = Hand.scaled()
    found, tracker = monitor(), HandTracker(hand)
    found.check_exchange(ExchangeCheck(hand, tracker.layout))
    lines, states = [], []
    for number in range(400):
        frame = hand_at(hand.relaxed() * (1. + .5 * np.sin(number)))
        frame[[3, 4]] = frame[[4, 3]]
        states.append(tracker.update(frame, .1 * number))

    def look(begin):
        for now, state in zip(begin + .1 * np.arange(400), states):
            found.update(batch([now], (now, state)))
            lines.extend(line for line in logged(found, now) if 'exchanged' in line)
        return status(found, now)[:2]

    level, text = look(0.)
    line, = lines
    assert line == ("labels look exchanged: '4' (middle) stays where index should be, '3' (index) "
                    'stays where middle should be; check labels.*')
    assert level is Level.WARN and text == f'tracking; {line.removesuffix("; check labels.*")}'
    fine = Level.OK, 'tracking'
    found.update(single(40., states[-1], restarted=True))
    assert status(found, 40.)[:2] == fine and look(41.)[0] is Level.WARN
    found.set_labels(LabelMap(['0', '1', '2', '4', '3', '5', '6', '7']))
    assert status(found, 81.)[:2] == fine and look(82.)[0] is Level.WARN
    found.check_exchange(None)
    assert status(found, 122.)[:2] == fine == look(122.)


def test_both_hands_that_do_not_fit_may_be_exchanged():
    right, left = monitor(), monitor()
    right.pair_with(left)
    far = state_of()._replace(residuals=np.full(8, .05))
    said = {True: [], False: []}
    for number in range(120):
        now = .05 * number
        # The left hand fits again after three seconds.
        for one, state in ((right, far), (left, far if now < 3. else state_of())):
            one.update(batch([now], (now, state)))
            said[one is right] += [line for line in logged(one, now) if 'left out' in line]
            if one is right:
                # Sooner than one alone, and no longer than it does not fit.
                assert one.is_wrong is (number > 10)
    assert not left.is_wrong
    assert all('left and right exchanged, as neither hand fits, or wrong side' in line
               for line, in said.values())
    assert 'exchanged' not in status(right, now)[1] and 'left out' in status(right, now)[1]


def test_a_hand_that_fits_again_is_not_left_out_for_the_other_s_sake():
    right, left = monitor(), monitor()
    right.pair_with(left)
    far, near = (state_of()._replace(residuals=np.full(8, miss)) for miss in (.05, .008))
    for number in range(120):
        now = .05 * number
        right.update(batch([now], (now, far if now < 1. else near)))
        left.update(batch([now], (now, far)))
    assert left.is_wrong and not right.is_wrong


def test_spells_far_off_the_hand_are_a_misfit_though_frames_between_them_fit():
    found = monitor()
    far, near = (state_of()._replace(residuals=np.full(8, miss)) for miss in (.04, .004))
    for number in range(400):
        now = .05 * number
        found.update(batch([now], (now, near if number % 20 < 2 else far)))
        logged(found, now)
    assert found.is_wrong


def test_a_hand_that_was_far_off_for_a_while_needs_no_hand_file():
    found, lines = monitor(), []
    far, near = (state_of()._replace(residuals=np.full(8, miss)) for miss in (.05, .001))
    for number in range(400):
        now = .05 * number
        found.update(batch([now], (now, far if 40 <= number < 75 else near)))
        lines += logged(found, now)
    assert not any('hand file' in line for line in lines)


def test_labels_that_are_exchanged_again_are_said_again():
    found = monitor()
    verdicts = iter([{3: 4, 4: 3}, None, {3: 4, 4: 3}, {}, None, {3: 4, 4: 3}])
    found.check_exchange(SimpleNamespace(add=lambda *_: next(verdicts), begin=lambda: None))
    said = []
    for now, expected in enumerate([False, False, False, True, True, False]):
        found.update(single(float(now)))
        said += [line for line in logged(found, float(now)) if 'exchanged' in line]
        assert found.labels_are_right is expected
    assert len(said) == 2


def test_what_is_wrong_with_the_palm_is_forgotten_where_another_recording_begins():
    found = monitor()
    found.update(single(.1, state_of(PalmState.TRACKED)))
    found.update(single(.2, state_of(PalmState.LOST)))
    found.log_lines(.2, str)
    found.update(single(20., state_of(PalmState.WAITING), restarted=True))
    assert any(line.startswith('waiting for the palm') for line in logged(found, 20.))


def test_frames_of_a_recording_are_told_of_as_one_by_one():
    together, one_by_one, random = monitor(), monitor(), np.random.default_rng(2)
    swapped = {'index': MarkerState.SWAPPED, 'ring': MarkerState.SWAPPED}
    kinds = [state_of(), state_of(thumb=MarkerState.STALE), state_of(**swapped),
             state_of(PalmState.LOST), state_of(little=MarkerState.ABSENT)]
    kinds += [state_of()._replace(residuals=np.full(8, miss)) for miss in (.001, .02)]
    now = 0.
    for _ in range(60):
        kind = kinds[random.integers(len(kinds))]
        for _ in range(random.integers(1, 300)):
            now += 1. / 120.
            restarted = random.random() < .002
            together.add(tracked_frame(now, kind, restarted=restarted), now)
            one_by_one.update(single(now, kind, restarted=restarted))
            assert together.is_wrong == one_by_one.is_wrong
        assert logged(together, now) == logged(one_by_one, now)
    together.ended()
    one_by_one.ended()
    assert logged(together, now) == logged(one_by_one, now)
    assert status(together, now)[:2] == status(one_by_one, now)[:2]
    assert status(together, now).values['frames'] == status(one_by_one, now).values['frames']


def test_a_frame_like_the_one_before_is_noted_with_the_next_that_differs():
    found = AlikeFrames()
    first, *others = (tracked_frame(.01 * number) for number in range(1, 4))
    assert not found.add(first, .01) and found.pop() is None
    assert found.add(others[0], .02) and found.add(others[1], .03)
    assert not found.add(tracked_frame(.04, state_of(thumb=MarkerState.STALE)), .04)
    frames = found.pop()
    assert (frames.frame_count, frames.stamp, frames.published) == (
        2, others[1].stamp, [.02, .03])
    assert not found.add(tracked_frame(.05), .05)   # like the first ones, not like the last
    far = state_of()._replace(residuals=np.full(8, 2. * OFF_HAND_DISTANCE))
    assert not found.add(tracked_frame(.06, far), .06)


def test_labels_that_change_are_a_fault_of_the_labels():
    found, random = monitor(), np.random.default_rng(1)
    for number in range(30):
        assert found.label_fault is None or number > 10
        found.update(single(.01 * number, positions=hand_at()[random.permutation(8)]))
    assert found.label_fault == 'labels change from marker to marker'


def test_markers_without_any_label_are_a_fault_of_the_labels():
    found = monitor()
    nobody = MarkerFrame(None, 'mocap', np.full((8, 3), np.nan), tuple('abcdefgh'), (), ())
    for number in range(30):
        found.judge(.1 * number, nobody)
    assert found.label_fault == 'no marker has a label of labels.*'


def test_a_marker_that_is_not_worn_is_told_of_by_its_name_alone():
    labels = LabelMap(['', '1', '2', '3', '4', '5', '6', '7'])
    said = Monitor(0., '/markers', labels).why_never_tracked()
    assert "wrist, '1' (index_mcp), '2' (little_mcp)" in said
