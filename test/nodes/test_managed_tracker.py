"""The tracker as a managed node: it answers while it is active, and loads its hand anew."""

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from helpers.bench import LOSSLESS, Bench
from helpers.hands import BENT_ANGLES, hand_at
from helpers.ros_process import NodeProcess, watching_node
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from std_srvs.srv import Trigger

from hand_tracker.core.model.hand import JOINTS, Hand
from hand_tracker.core.model.marker_layout import MarkerLayout
from hand_tracker.files.hand_file import save_hand

NEEDS = 'rclpy', 'lifecycle_msgs'
MODULE = 'hand_tracker.nodes.managed_tracker_node'
PIP = JOINTS.index('index_pip_flexion')



def state(node):
    return node.call(GetState, 'hand_tracker/get_state').current_state.id


def change(node, transition):
    """Ask for a transition; return whether it was made."""
    return node.call(ChangeState, 'hand_tracker/change_state', ChangeState.Request(
        transition=Transition(id=transition))).success


def unanswered_then_answered(node, bench, count=20):
    """Send frames that must not be answered, activate, and see that only later ones are."""
    before = [bench.send(hand_at()) for _ in range(count)]
    # What is answered by the same executor afterwards comes after them.
    assert state(node) == State.PRIMARY_STATE_INACTIVE
    bench.joint_states.clear()
    assert change(node, Transition.TRANSITION_ACTIVATE)
    node.repeat(lambda: bench.send(hand_at()), lambda: bench.joint_states)
    assert not any(answer.header.stamp in before for answer in bench.joint_states)


def test_it_activates_itself_and_answers_only_while_it_is_active():
    with NodeProcess(MODULE, {**LOSSLESS, 'auto_size': False}) as process, \
            watching_node() as node:
        bench = Bench(process, node, 1000, 'hand_tracker')
        process.wait_for_line('listening')
        assert state(node) == State.PRIMARY_STATE_ACTIVE
        bench.meet(hand_at())
        for _ in range(5):
            angles = bench.angles(hand_at())
        assert angles[PIP] == pytest.approx(BENT_ANGLES[PIP], abs=1e-6)
        assert change(node, Transition.TRANSITION_DEACTIVATE)
        unanswered_then_answered(node, bench)
        assert np.allclose(bench.angles(hand_at()), angles, rtol=0, atol=1e-3)
        # What is not allowed in a state is refused, and changes nothing.
        assert not change(node, Transition.TRANSITION_CONFIGURE)
        process.wait_for_line('No transition matching')
        bench.answer(hand_at())
        assert process.interrupt() == 0, process.output
    assert 'Traceback' not in process.output
    assert 'no markers' not in process.output


def test_diagnostics_say_that_it_is_not_active():
    with NodeProcess(MODULE, {'autostart': False}) as process, watching_node() as node:
        process.wait_for_line('listening')
        told = node.collect(DiagnosticArray, '/diagnostics')
        node.repeat(lambda: None, lambda: told)
        status, = told[-1].status
        assert (status.level, status.message) == (
            DiagnosticStatus.STALE, 'not active: markers are left out')
        assert change(node, Transition.TRANSITION_CONFIGURE)
        assert change(node, Transition.TRANSITION_ACTIVATE)
        node.repeat(lambda: None, lambda: 'no markers' in told[-1].status[0].message)
        assert process.interrupt() == 0, process.output


def test_cleaned_up_it_loads_the_hand_file_as_it_is_then(tmp_path):
    path, layout = tmp_path / 'hand.yaml', MarkerLayout()
    small, large = (Hand.scaled(length=length) for length in (.17, .2))
    save_hand(path, small, layout)
    with NodeProcess(MODULE, {**LOSSLESS, 'hand_file': str(path), 'autostart': False}) as process, \
            watching_node() as node:
        bench = Bench(process, node, 1000, 'hand_tracker')
        process.wait_for_line('listening')
        assert state(node) == State.PRIMARY_STATE_UNCONFIGURED
        assert not change(node, Transition.TRANSITION_ACTIVATE)
        assert change(node, Transition.TRANSITION_CONFIGURE)
        unanswered_then_answered(node, bench)
        bench.answer(hand_at(hand=small))
        assert change(node, Transition.TRANSITION_DEACTIVATE)
        assert change(node, Transition.TRANSITION_CLEANUP)
        path.write_text('no hand')
        assert not change(node, Transition.TRANSITION_CONFIGURE)
        process.wait_for_line('not configured: ')
        save_hand(path, large, layout)
        assert change(node, Transition.TRANSITION_CONFIGURE)
        assert change(node, Transition.TRANSITION_ACTIVATE)
        frame = hand_at(hand=large)
        # Angles go over to another hand's within some frames.
        node.repeat(lambda: bench.answer(frame), lambda: abs(
            bench.joint_states[-1].position[PIP] - BENT_ANGLES[PIP]) < 1e-3)
        assert process.interrupt() == 0, process.output
    assert 'Traceback' not in process.output


def test_cleaned_up_it_searches_the_hand_among_points_anew():
    with NodeProcess(MODULE, {**LOSSLESS, 'labels.from': 'none', 'auto_size': False}) as process, \
            watching_node() as node:
        bench = Bench(process, node, 1000, 'hand_tracker')
        process.wait_for_line('listening')
        for times in (1, 2):
            node.repeat(lambda: bench.send(hand_at()), lambda times=times: process.output.count(
                'hand is found among') == times)
            for transition in (Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_CLEANUP,
                               Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE):
                assert change(node, transition)
        assert process.interrupt() == 0, process.output


def test_cleaned_up_it_calibrates_no_more(tmp_path):
    with NodeProcess(MODULE, {**LOSSLESS, 'calibration_file': str(tmp_path / 'mine.yaml')}) as (
            process), watching_node() as node:
        process.wait_for_line('listening')
        for _ in range(2):
            assert node.call(Trigger, 'hand_tracker/calibrate').success
            assert not node.call(Trigger, 'hand_tracker/calibrate').success
            for transition in (Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_CLEANUP,
                               Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE):
                assert change(node, transition)
        assert process.interrupt() == 0, process.output
    assert 'Traceback' not in process.output
