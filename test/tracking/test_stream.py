"""A stream of messages: read, timed, tracked; sizes and kernels that come later."""

from types import SimpleNamespace

import numpy as np
import pytest
from helpers.frames import RESTING
from helpers.hands import markers_of

from hand_tracker.core.model.hand import JOINTS, Hand, preset_limits
from hand_tracker.core.model.layout_presets import preset_layout
from hand_tracker.core.model.marker_layout import MarkerLayout
from hand_tracker.core.numerics.jit import LABELLING_SET, TRACKING_SET
from hand_tracker.core.point_labelling.natural_poses import ANYBODY, SIZED
from hand_tracker.core.tracker import HandTracker
from hand_tracker.messages.marker_array import MarkerFrame
from hand_tracker.messages.points import PointFrame
from hand_tracker.messages.stamps import Stamp, stamp_of
from hand_tracker.simulation.motions import motion_named
from hand_tracker.tracking import auto_size as auto_size_module
from hand_tracker.tracking import stream as module
from hand_tracker.tracking.auto_size import AutoSize
from hand_tracker.tracking.point_labels import SEARCHED_LONG, PointLabelReader, PointLabels
from hand_tracker.tracking.stream import BLEND_TIME, UNNAMED_FRAME, FrameTime, Stream
from hand_tracker.tracking.unobserved_note import unobserved_note

UNSET = Stamp(0, 0)
STAMP = Stamp(5, 0)
RECEIPT = Stamp(70, 0)


class State(str):
    """A state with all markers seen."""

    marker_states, markers = np.zeros(8, dtype=int), RESTING


class Tracker:
    """A tracker that notes what it is given."""

    def __init__(self):
        self.hand = Hand.scaled(limits=.5 * preset_limits('wide'))
        self.layout = MarkerLayout()
        self.placed, self.restarted, self.is_compiled = True, False, False
        self.updates, self.blended = [], 0
        self.configured = []

    def update(self, *given):
        self.updates.append(given)
        return State('a state')

    def configure(self, *given):
        self.hand, *_ = given
        self.configured.append(given)

    def blend_in(self):
        self.blended += 1

    def use_loaded_kernels(self):
        self.is_compiled = True


class Reader:
    """A reader whose messages are frames in a list."""

    signature = None
    has_switched = False

    def read(self, message):
        frame, = message
        return frame

    def use_loaded_kernels(self):
        self.has_switched = True


def markers(stamp=STAMP, frame_id='mocap'):
    return MarkerFrame(stamp, frame_id, RESTING, (), (), ())


def receipt():
    return RECEIPT


def no_receipt():
    raise AssertionError('the markers have a stamp')


@pytest.fixture
def stream():
    return Stream(Tracker(), Reader())


def test_the_time_of_receipt_counts_until_a_stamp_has_come():
    time = FrameTime()
    assert time.of(UNSET, 3.) == 3.
    assert time.of(UNSET, None) is None
    assert time.of(Stamp(5, 10**8), 4.) == 5.1
    # Of another clock, perhaps.
    assert time.of(UNSET, 5.) is None
    assert time.of(Stamp(6, 0), 6.) == 6.


def test_a_frame_is_read_timed_and_tracked(stream):
    frame = stream.track([markers()], 2., no_receipt)
    (positions, time, flexion), = stream.tracker.updates
    assert positions is RESTING and time == 5. and flexion is None
    assert (frame.received, frame.stamp, frame.frame_id, frame.time, frame.state) == (
        2., STAMP, 'mocap', 5., 'a state')
    assert frame.is_valid and frame.is_regular and not frame.restarted


def test_what_was_read_before_is_not_read_again(stream):
    stream.reader = None
    assert stream.track(markers(), 2., no_receipt).time == 5.


def test_markers_without_stamp_or_frame(stream):
    frame = stream.track([markers(UNSET, '')], 2., receipt)
    assert (frame.stamp, frame.time, frame.frame_id) == (RECEIPT, 70., UNNAMED_FRAME)
    assert not frame.is_regular
    stream.track([markers()], 3., no_receipt)
    # Once there are stamps, its time is unknown.
    frame = stream.track([markers(UNSET)], 4., receipt)
    assert (frame.stamp, frame.time) == (RECEIPT, None)
    assert [time for _, time, _ in stream.tracker.updates] == [70., 5., None]


def test_a_message_without_markers_of_the_hand_is_not_tracked(stream):
    others = markers(None)
    assert stream.track([others], 2., no_receipt) is others
    assert not stream.tracker.updates


def test_measured_flexion_reaches_the_tracker_and_is_not_regular(stream):
    flexion = np.full(5, .4)
    frame = stream.track([markers()], 2., no_receipt, flexion)
    assert stream.tracker.updates[0][2] is flexion
    assert not frame.is_regular


def test_a_tracker_that_begins_anew_without_a_palm(stream):
    stream.tracker.placed, stream.tracker.restarted = False, True
    frame = stream.track([markers()], 2., no_receipt)
    assert frame.restarted and not frame.is_valid


def test_a_learned_size_keeps_limits_and_coupling():
    sizes = [None, Hand.scaled(.2), None, Hand.scaled(.21)]
    given = []
    auto_size = SimpleNamespace(is_learning=True, is_refused=False)

    def add(positions, time, cloud):
        assert cloud is None  # as the markers have labels
        given.append((positions, time))
        auto_size.is_learning = len(given) < len(sizes)
        return sizes[len(given) - 1]

    auto_size.add = add
    stream = Stream(Tracker(), Reader(), auto_size)
    limits = stream.tracker.hand.limits
    assert stream.size == 'learning'
    learned = []
    for second in range(1, 7):
        stream.track([markers(Stamp(second, 0))], 2., no_receipt)
        learned.append(len(stream.tracker.configured))
    assert learned == [0, 1, 1, 2, 2, 2] and stream.size == 'learned'
    assert [time for _, time in given] == [1., 2., 3., 4.]
    hand = stream.tracker.hand
    assert np.array_equal(hand.finger_bones, Hand.scaled(.21).finger_bones)
    assert np.array_equal(hand.limits, limits)
    (is_warning, line), = stream.pop_log_lines()
    assert not is_warning and line.startswith('the size of the hand is learned: ')
    assert stream.pop_log_lines() == []


def test_no_angle_jumps_where_the_size_is_learned():
    hand, period = Hand.scaled(.205, .095), 1. / 120.
    angles, *wrist = motion_named('demo', hand, 7).sample(np.arange(0., 7., period))
    positions = markers_of(hand, angles, None, *wrist)
    mean = Hand.scaled()
    stream = Stream(HandTracker(mean), Reader(), AutoSize(mean, MarkerLayout()))
    found = np.array([stream.track([markers(stamp_of(round(1e9 * (1. + number * period))))
                                    ._replace(positions=frame)], 2., no_receipt).state.angles
                      for number, frame in enumerate(positions)])
    assert stream.size == 'learned'
    pip = JOINTS.index('index_pip_flexion')
    fastest = np.abs(np.diff(angles[:, pip])).max()
    # At most the re-entry rate faster than the motion, once the first frames have placed the hand.
    assert np.abs(np.diff(found[10:, pip])).max() < 5. * period + fastest


def test_the_size_is_learned_by_labels_that_were_put_right():
    hand, period = Hand.scaled(.205, .095), .01
    angles, *wrist = motion_named('demo', hand, 7).sample(np.arange(0., 7., period))
    positions = markers_of(hand, angles, None, *wrist)
    learned = []
    for order in ([0, 1, 2], [0, 2, 1]):
        exchanged = positions.copy()
        exchanged[:, :3] = positions[:, order]
        mean = Hand.scaled()
        stream = Stream(HandTracker(mean), Reader(), AutoSize(mean, MarkerLayout()))
        for number, frame in enumerate(exchanged):
            stream.track([markers(stamp_of(round(1e9 * (1. + number * period))))
                          ._replace(positions=frame)], 2., no_receipt)
        assert stream.size == 'learned'
        learned.append(stream.tracker.hand.finger_bones)
    assert np.abs(learned[1] - learned[0]).max() < 1e-3


def test_no_size_is_learned_by_labels_that_look_exchanged():
    hand, period = Hand.scaled(.205, .095), .01
    angles, *wrist = motion_named('demo', hand, 14).sample(np.arange(0., 14., period))
    positions = markers_of(hand, angles, None, *wrist)
    mean, sizes = Hand.scaled(), []
    stream = Stream(HandTracker(mean), Reader(), AutoSize(mean, MarkerLayout()))
    for number, frame in enumerate(positions):
        now = number * period
        stream.judge_labels(None if now < 2. else now >= 4.)
        stream.track([markers(stamp_of(round(1e9 * (1. + now))))
                      ._replace(positions=frame)], 2., no_receipt)
        sizes.append((stream.size, np.array_equal(
            stream.tracker.hand.finger_bones, mean.finger_bones)))
    # What was learned before is forgotten, as it may be of those labels; then all begins anew.
    assert sizes[190] == ('learning', False) and set(sizes[201:400]) == {('learning', True)}
    assert sizes[-1] == ('learned', False)
    stream.judge_labels(False)  # of labels that were right before
    assert stream.size == 'learned'


@pytest.mark.parametrize('are_right', [True, False])
def test_points_are_labelled_by_the_size_that_was_learned_from_right_labels(
        are_right, monkeypatch):
    hand, period = Hand.scaled(.205, .095), .01
    angles, *wrist = motion_named('demo', hand, 7).sample(np.arange(0., 7., period))
    positions = markers_of(hand, angles, None, *wrist)
    mean = Hand.scaled()
    labels = PointLabels()
    reader = PointLabelReader(mean, MarkerLayout(), SimpleNamespace(read=lambda frame: frame),
                              labels)
    stream = Stream(Tracker(), reader, AutoSize(mean, MarkerLayout()))
    if not are_right:
        monkeypatch.setattr(auto_size_module, 'are_confirmed', lambda *_: False)
    for number, points in enumerate(positions):
        frame = stream.track(PointFrame(stamp_of(round(1e9 * (1. + number * period))), 'mocap',
                                        points[::-1], np.full(8, -1), ()), 2., no_receipt)
        assert np.array_equal(frame.markers.positions, points), number
    tolerances = SIZED if are_right else ANYBODY
    assert tuple(labels._labeller.prototypes[0].statistics.sizes) == tolerances.sizes
    assert len(stream.tracker.configured) == (3 if are_right else 0)
    (is_warning, line), _ = stream.pop_log_lines()
    assert (is_warning, ('is learned' if are_right else 'is not learned') in line) == (
        not are_right, True)


def test_a_size_that_was_given(stream):
    stream.track([markers()], 2., no_receipt)
    assert (stream.size, stream.tracker.configured, stream.pop_log_lines()) == ('given', [], [])
    assert not stream.needs_each_frame


def test_another_hand_is_blended_in(stream):
    hand, layout = Hand.scaled(.2), MarkerLayout()
    stream.replace_hand(hand, layout)
    assert stream.tracker.configured == [(hand, layout, None)]
    for nanosec in (0, 10**8, 2 * 10**8):
        stream.track([markers(Stamp(5, nanosec))], 2., no_receipt)
        assert stream.needs_each_frame
    stream.track([markers(Stamp(5, round(1e9 * BLEND_TIME) + 1))], 2., no_receipt)
    assert stream.tracker.blended == 3 and not stream.needs_each_frame


def test_a_take_collects_each_frame(stream):
    taken = []
    stream.take = SimpleNamespace(add=lambda positions, time: taken.append((positions, time)))
    assert stream.needs_each_frame
    stream.track([markers()], 2., no_receipt)
    assert taken == [(RESTING, 5.)]


@pytest.fixture
def compilation(monkeypatch):
    """Return a compilation that the test ends, and what it was asked for."""
    found = SimpleNamespace(loaded=[], error=None, unkept=None)

    def begin(loaders, program):
        found.loaders, found.program = loaders, program
        return found

    monkeypatch.setattr(module, 'Compilation', begin)
    return found


def test_compiled_kernels_take_over_between_two_frames(stream, compilation, monkeypatch):
    monkeypatch.setattr(module, 'DEFERRED', True)
    stream.compile_in_background('a program', more=print)
    assert list(compilation.loaders) == [TRACKING_SET, 'more', LABELLING_SET]
    assert compilation.program == 'a program'
    (is_warning, line), = stream.pop_log_lines()
    assert not is_warning and line.startswith('first start')
    stream.track([markers()], 2., no_receipt)
    assert not stream.is_compiled and stream.pop_log_lines() == []
    compilation.loaded.append(TRACKING_SET)
    assert not stream.is_compiled
    for _ in range(2):
        stream.track([markers()], 2., no_receipt)
    assert stream.is_compiled and stream.reader.has_switched
    assert stream.pop_log_lines() == [(False, 'compiled kernels have taken over')]


def test_why_no_hand_is_found_is_told_once_compiled_kernels_label_points(
        compilation, monkeypatch):
    monkeypatch.setattr(module, 'DEFERRED', True)
    monkeypatch.setattr(module, 'LABELLING_IS_DEFERRED', True)
    stream = Stream(Tracker(), PointLabelReader(
        Hand.scaled(), MarkerLayout(), SimpleNamespace(read=lambda frame: frame)))

    def pass_on(start):
        for seconds in (start, start + 2. * SEARCHED_LONG):
            stream.track(PointFrame(stamp_of(round(1e9 * seconds)), 'mocap', RESTING[:4],
                                    np.full(4, -1), ()), 2., no_receipt)
        return stream.pop_log_lines()

    stream.compile_in_background()
    (is_warning, line), = stream.pop_log_lines()
    assert not is_warning and line.endswith('most frames are left out')
    assert stream.awaits_labelling and pass_on(1.) == []
    compilation.loaded.append(LABELLING_SET)
    assert pass_on(10.) == [(False, 'compiled kernels label points now')]
    assert not stream.awaits_labelling
    (is_warning, line), = pass_on(20.)
    assert is_warning and line.startswith('only 4 points')


def test_points_are_no_longer_awaited_where_their_kernels_cannot_be_compiled_or_are_not_needed(
        compilation, monkeypatch):
    monkeypatch.setattr(module, 'LABELLING_IS_DEFERRED', True)
    points = SimpleNamespace(read=lambda frame: frame)
    reader = PointLabelReader(Hand.scaled(), MarkerLayout(), points)
    stream = Stream(Tracker(), reader)
    stream.compile_in_background()
    assert stream.awaits_labelling
    stream.reader = Reader()    # of labels
    assert not stream.awaits_labelling
    stream.reader = reader
    compilation.error = 'no compiler'
    (_, first), (is_warning, second) = stream.pop_log_lines()
    assert 'most frames are left out' in first and is_warning and 'no compiler' in second
    assert not stream.awaits_labelling


def test_an_error_of_the_compilation_is_reported_once(stream, compilation, monkeypatch):
    monkeypatch.setattr(module, 'DEFERRED', True)
    stream.compile_in_background()
    stream.pop_log_lines()
    compilation.error = 'no compiler'
    (is_warning, line), = stream.pop_log_lines()
    assert is_warning and line.endswith('no compiler')
    assert stream.pop_log_lines() == []


def test_kernels_of_this_process_alone_are_told_of_once_and_what_fails_later(
        stream, compilation, monkeypatch):
    monkeypatch.setattr(module, 'DEFERRED', True)
    stream.compile_in_background()
    stream.pop_log_lines()
    compilation.unkept = 'no room'
    assert stream.pop_log_lines() == [(True, 'no room')]
    compilation.error = 'no compiler'
    (is_warning, line), = stream.pop_log_lines()
    assert is_warning and line.endswith('no compiler')
    assert stream.pop_log_lines() == []


def test_nothing_is_compiled_where_nothing_is_missing(stream, compilation, monkeypatch):
    monkeypatch.setattr(module, 'DEFERRED', False)
    stream.compile_in_background()
    assert stream.compilation is None and stream.pop_log_lines() == []


def test_joints_that_a_layout_does_not_show_are_named():
    assert unobserved_note(HandTracker()) == ''
    assert unobserved_note(HandTracker(layout=preset_layout('kyutech23'))) == ''
    note = unobserved_note(HandTracker(layout=preset_layout('tips5_palm3')))
    assert note.startswith('joints that these markers do not show') and 'index_dip_flexion' in note
