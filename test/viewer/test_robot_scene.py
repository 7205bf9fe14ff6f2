"""A robot in the viewer's scene: every link is where its model has it, meshes become bones."""

from types import SimpleNamespace

import numpy as np
import pytest
from helpers.robots import GRIPPER, wide_hand
from scipy.spatial.transform import Rotation

from hand_tracker.core.model.hand import Hand
from hand_tracker.core.model.kinematics import Pose, forward, joint_table
from hand_tracker.core.model.marker_layout import MarkerLayout, marker_positions
from hand_tracker.core.tracker import HandTracker
from hand_tracker.files.urdf_file import urdf
from hand_tracker.retargeting.robot_file import load_robot
from hand_tracker.retargeting.robot_urdf import InvalidRobot
from hand_tracker.viewer.robot_scene import RobotScene, add_shapes, robot_extent
from hand_tracker.viewer.scene import PERSON_EXTENT, Extent, place_camera


class Scene:
    """Takes what is added to it, by name."""

    def __init__(self):
        self.nodes = {}

    def __getattr__(self, name):
        def add(node, *_, **given):
            at = {'position': np.zeros(3), 'wxyz': (1., 0., 0., 0.)}
            self.nodes[node] = SimpleNamespace(kind=name.removeprefix('add_'), **{**at, **given})
            return self.nodes[node]
        return add

    def place(self, name):
        """Return the position of a node in the scene."""
        at = np.zeros(3)
        while name:
            node = self.nodes[name]
            at = Rotation.from_quat(np.roll(node.wxyz, -1)).apply(at) + node.position
            name = name.rpartition('/')[0]
        return at


def test_the_plain_hand_is_drawn_where_its_model_is():
    hand, scene, loaded = wide_hand(), Scene(), load_robot('plain')
    robot = RobotScene(scene, '/robot', loaded, hand)
    table = joint_table(hand)
    state = HandTracker(hand).update(marker_positions(
        MarkerLayout().mounting(hand), forward(table, hand.relaxed())))
    robot.draw(state, Pose(state.wrist_rotation, state.wrist_position), .2)
    position = robot._retargeter.update_angles(state.angles, 0.)
    spheres = [(node.position, scene.place(name)) for name, node in scene.nodes.items()
               if node.kind == 'icosphere' and node.radius == .009 and node.position[0] > 0.]
    assert len(spheres) == 4
    # The balls at the tips are those with which they touch.
    tips = loaded.hand.tip_positions(position) + (0., .2, 0.)
    for _, at in spheres:
        assert np.linalg.norm(tips - at, axis=1).min() < 1e-6


def test_a_robot_of_meshes_is_drawn_as_bones_and_of_shapes_by_them():
    bones, shapes = Scene(), Scene()
    add_shapes(bones, '/robot', load_robot('robotiq_2f', GRIPPER).hand)
    assert {node.kind for node in bones.nodes.values()} == {'cylinder', 'icosphere'}
    shaped = load_robot('plain').hand
    add_shapes(shapes, '/robot', shaped)
    kinds = [node.kind for node in shapes.nodes.values()]
    assert len(kinds) == len(shaped.model.shapes) and kinds.count('box') == 1


def test_a_robot_of_the_other_side_is_refused(tmp_path):
    path = tmp_path / 'left.urdf'
    path.write_text(urdf(wide_hand('left')))
    with pytest.raises(InvalidRobot, match="the robot's hand is a left one"):
        RobotScene(Scene(), '/robot', load_robot(str(path)), wide_hand())


def seen_share(points, hands, aspect, extent):
    """Return where points are in the picture: at its rims the largest of x and y is 1."""
    camera = SimpleNamespace()
    place_camera(camera, hands, aspect, extent)
    ahead = camera.look_at - camera.position
    ahead = ahead / np.linalg.norm(ahead)
    right = np.cross(ahead, (0., 0., 1.))
    right /= np.linalg.norm(right)
    away = points - camera.position
    depth = away @ ahead * np.tan(.5 * camera.fov)
    return np.maximum(np.abs(away @ right) / aspect, np.abs(away @ np.cross(right, ahead))) / depth


@pytest.mark.parametrize('aspect', [.8, 1., 1.8])
def test_a_large_robot_is_not_cut(aspect, tmp_path):
    large = Hand.scaled(length=.26, breadth=.115)
    path = tmp_path / 'robot.yaml'
    path.write_text('name: large\n')
    robot = load_robot(str(path), urdf(large)).hand
    # And larger than hands of persons are.
    tips, own = 1.3 * robot.tip_positions(robot.model.open_position()), robot_extent(robot)
    extent = PERSON_EXTENT.joined(Extent(*(1.3 * side for side in own)))
    assert own.far > .25 and own.aside > .08 and extent.near <= PERSON_EXTENT.near
    tips -= (0., .09, 0.)
    assert seen_share(tips, 2, aspect, extent).max() < 1.
    # A narrow picture is as wide as both hands, and has space above them.
    assert seen_share(tips, 2, aspect, PERSON_EXTENT).max() > 1. or aspect < 1.5


def test_a_small_robot_changes_no_view():
    assert PERSON_EXTENT.joined(Extent(0., .1, .05)) == PERSON_EXTENT
