"""The tracker node with points that have no usable labels, or of the other hand, over DDS."""

from itertools import cycle

import numpy as np
from helpers.bench import lines, message, tracking
from helpers.hands import RIGHT, from_pose_to_pose, hand_at, motion
from visualization_msgs.msg import MarkerArray

from hand_tracker.core.model.hand import LEFT_HAND_MIRROR
from hand_tracker.core.model.marker_layout import MARKERS
from hand_tracker.messages.stamps import seconds

NEEDS = 'rclpy',


def shuffled(frame, random):
    """Return the markers of a frame in another order, and two ghosts among them."""
    cloud = np.concatenate((frame, frame[0] + random.uniform(.3, .4, (2, 3))))
    return cloud[random.permutation(len(cloud))]


def test_points_are_labelled_tracked_and_published_by_their_names():
    random = np.random.default_rng(1)
    with tracking({'labels': 'none', 'auto_size': False}) as bench:
        labelled = bench.node.collect(MarkerArray, 'labelled_markers')
        frames = motion(RIGHT)[:8]
        bench.meet(frames[0], heard=(labelled,))
        for frame in frames:
            stamp = bench.answer(shuffled(frame, random)).header.stamp
        bench.node.spin_until(lambda: labelled[-1].markers and (
            labelled[-1].markers[0].header.stamp == stamp))
        markers = {marker.ns: marker.pose.position for marker in labelled[-1].markers}
        assert set(markers) == {f'right_{name}' for name in MARKERS}
        places = [(at.x, at.y, at.z) for at in (markers[f'right_{name}'] for name in MARKERS)]
        assert np.array_equal(places, frame)
        bench.process.wait_for_line('the right hand is found')


def test_points_without_any_label_are_labelled_by_the_shape_of_the_hand_and_that_is_said_once():
    labels = {f'labels.{name}': f'mine/{i}' for i, name in enumerate(MARKERS)}
    with tracking({**labels, 'auto_size': False}) as bench:
        bench.meet(hand_at())
        bench.process.wait_for_line("as with labels:='none'")
        assert len(lines(bench.process, "as with labels:='none'")) == 1
        labelled = bench.node.collect(MarkerArray, 'labelled_markers')
        bench.node.repeat(lambda: bench.send(hand_at()), lambda: labelled, .05)
        # Those of the source are used again once others are set.
        assert bench.set({f'labels.{name}': str(i) for i, name in enumerate(MARKERS)}).successful
        for _ in range(3):
            bench.answer(hand_at())
        bench.process.wait_for_line('the labels of the markers are used again')
        count = len(labelled)
        for _ in range(10):
            bench.answer(hand_at())
        assert len(labelled) == count


def test_a_hand_of_the_other_side_is_left_out_until_it_is_of_this_side():
    frames = from_pose_to_pose(0, 80)
    with tracking({'side': 'left', 'auto_size': False}) as bench:
        # A marker at zero is missing.
        wrong, right = cycle(frames + 1.), cycle(frames * LEFT_HAND_MIRROR + 1.)
        bench.meet(next(wrong))
        text = 'the fingers bend away from the palm of a left hand'
        bench.node.repeat(lambda: bench.send(next(wrong)), lambda: text in bench.process.output)
        left_out = [seconds(bench.send(next(wrong))) for _ in range(20)]
        bench.node.repeat(lambda: bench.send(next(right)),
                          lambda: 'tracking again' in bench.process.output)
        bench.answer(next(right))
        answered = [seconds(state.header.stamp) for state in bench.joint_states]
        assert answered[-1] > left_out[-1] and not set(answered) & set(left_out)
        assert len(lines(bench.process, text)) == 1


def test_labels_that_change_from_marker_to_marker_give_way_to_the_shape_of_the_hand():
    random = np.random.default_rng(2)
    with tracking({'auto_size': False}) as bench:
        bench.meet(hand_at())

        def send():
            """Send the markers with others' ids, in another order: never twice alike."""
            bench.number += 1
            array = message(hand_at()[random.permutation(8)], bench.number)
            random.shuffle(array.markers)
            bench.publisher.publish(array)

        text = 'labels change from marker to marker'
        bench.node.repeat(send, lambda: text in bench.process.output)
        bench.answer(hand_at())
        assert len(lines(bench.process, text)) == 1
