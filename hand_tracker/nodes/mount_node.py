"""Mount node: hang the tracked hand on a body that another system captures, by its TF frames.

The wrist rests in `body_frame` at an offset, which ~/calibrate finds while both captures run. The
tracker beside it has `on_body` set. See docs/ros.md.
"""

from __future__ import annotations

import math
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from std_srvs.srv import Trigger

from ..core.errors import HandTrackerError
from ..files.parameter_file import save_parameters
from ..messages.pose_fields import pose_numbers
from ..messages.stamps import seconds
from ..output_files import OutputError, require_writable
from .executors import steady_clock
from .parameters import Parameter
from .replies import TF_DEPTH
from .runner import declare, log_line, names_of, run
from .serialization import TFMessage
from .static_transforms import StaticTransforms
from .tracker_parameters import START, InvalidParameter, starting_hand, with_defaults

if TYPE_CHECKING:
    from ..splicing.frame_tree import FrameTree
    from ..splicing.wrist_offset import PoseTrack

NAMING = 'hand_file', 'side', 'prefix', 'wrist_frame'  # parameters of the tracker, too
MOUNT_NUMBERS = 'x', 'y', 'z', 'qx', 'qy', 'qz', 'qw'
FARTHEST = 2.           # [m] of the wrist from the body's frame
MISSED_AFTER = 2.       # [s] of a calibration after which a frame without poses is said
END_CHECK_PERIOD = .1   # [s] between two checks whether a calibration is over
STATIC_DEPTH = 100      # messages of /tf_static, one of each publisher
MOUNT_PARAMETERS = tuple(row._replace(read_only=True) for row in (
    *(row for row in START if row.name in NAMING),
    Parameter('body_frame', '', "Frame of the body's hand on TF, in which the wrist rests"),
    *(Parameter(name, 0., f"The wrist's place along {name} of the body's frame [m]",
                range=(-FARTHEST, FARTHEST)) for name in MOUNT_NUMBERS[:3]),
    *(Parameter(name, float(name == 'qw'), f"{name[1]} of the wrist's rotation in the body's "
                'frame, a quaternion', range=(-1., 1.)) for name in MOUNT_NUMBERS[3:]),
    Parameter('duration', 20., 'How long ~/calibrate records both captures [s]',
              range=(1., 600.)),
    Parameter('mount_file', 'my_mount.yaml', 'Parameter file that ~/calibrate writes, from the '
              'folder in which the node was started'),
))


class MountNode(Node):
    """Node that keeps the wrist of one hand in a frame of a body."""

    def __init__(self) -> None:
        super().__init__('mount')
        values = declare(self, MOUNT_PARAMETERS)
        self._body_frame = values['body_frame']
        if not self._body_frame or self._body_frame.startswith('/'):
            raise InvalidParameter(f"body_frame: '{self._body_frame}'; expected a frame of TF, "
                                   'without a slash before it')
        if TFMessage is None:
            raise InvalidParameter('body_frame: tf2_msgs is not installed; expected it')
        offset = [values[name] for name in MOUNT_NUMBERS]
        if not math.hypot(*offset[3:]) > 0.:
            raise InvalidParameter('qx, qy, qz, qw: all 0; expected a rotation')
        hand, _ = starting_hand(with_defaults(values))
        self._names = names_of(hand, values['prefix'], values['wrist_frame'], on_body=True)
        self._duration = values['duration']
        self._output = Path(values['mount_file']).expanduser().absolute()
        self._resting = StaticTransforms(self)
        self._heard: list[Subscription] = []
        self._tree: FrameTree
        self._body: PoseTrack
        self._wrist: PoseTrack
        self._ends = math.inf   # time at which the calibration is over [s]
        self._missed = math.inf     # time at which frames without poses are said [s]
        self.create_service(Trigger, '~/calibrate', self._on_calibrate)
        self.create_timer(END_CHECK_PERIOD, self._check_end, clock=steady_clock())
        self._show(offset)
        is_given = offset != [row.default for row in MOUNT_PARAMETERS if row.name in MOUNT_NUMBERS]
        self.get_logger().info(
            f'{self._names.wrist} rests in {self._body_frame}, '
            + ('at the offset given' if is_given else
               'with its origin and axes, as no offset is given: ~/calibrate finds it'))

    def _show(self, offset: Any) -> None:
        """Broadcast the wrist in the body's frame."""
        x, y, z, *turn = (float(number) for number in offset)
        length = math.hypot(*turn)
        message = TransformStamped(
            child_frame_id=self._names.wrist, transform=Transform(
                translation=Vector3(x=x, y=y, z=z),
                rotation=Quaternion(**dict(zip('xyzw', (one / length for one in turn))))))
        message.header.frame_id = self._body_frame
        message.header.stamp = self.get_clock().now().to_msg()
        self._resting.send([message])

    def _on_calibrate(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        # Here, as it takes long to import, and only a calibration needs it.
        from ..splicing.frame_tree import FrameTree
        from ..splicing.wrist_offset import PoseTrack

        if self._heard:
            response.message = 'a calibration is under way'
            return response
        try:
            require_writable(self._output)
        except OutputError as error:
            response.message = str(error)
            return response
        self._tree, self._body, self._wrist = FrameTree(), PoseTrack(), PoseTrack()
        moving = QoSProfile(depth=TF_DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)
        resting = QoSProfile(depth=STATIC_DEPTH, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._heard = [
            self.create_subscription(TFMessage, '/tf', self._on_transforms, moving),
            self.create_subscription(TFMessage, '/tf_static', self._on_resting, resting)]
        self._ends = time.monotonic() + self._duration
        self._missed = time.monotonic() + MISSED_AFTER
        response.success = True
        response.message = (
            f'for {self._duration:g} s move the arm to all sides and turn the wrist about all '
            f'axes; the offset will be written to {self._output}')
        self.get_logger().info(f'calibration: {response.message}')
        return response

    def _on_resting(self, message: Any) -> None:
        for one in message.transforms:
            self._tree.update(one.header.frame_id, one.child_frame_id, math.nan,
                              *pose_numbers(one.transform))

    def _on_transforms(self, message: Any) -> None:
        moved = set()
        for one in message.transforms:
            stamp = seconds(one.header.stamp)
            if stamp is None or not self._tree.update(
                    one.header.frame_id, one.child_frame_id, stamp, *pose_numbers(one.transform)):
                continue
            moved.add(one.child_frame_id)
        for frame, track in self._tracks:
            if moved.intersection(self._tree.chain(frame)):
                pose = self._tree.pose(frame)
                assert pose is not None
                track.append(pose)

    @property
    def _tracks(self) -> tuple[tuple[str, PoseTrack], ...]:
        """Frames of both captures, and their poses of this calibration."""
        return (self._body_frame, self._body), (self._names.tracked, self._wrist)

    def _say_missed(self) -> None:
        """Say during a calibration which frame nobody broadcasts, so that nobody moves in vain."""
        if time.monotonic() < self._missed:
            return
        self._missed = math.inf
        for frame, track in self._tracks:
            if not len(track):
                sender = "the body's driver" if frame == self._body_frame else 'the tracker'
                log_line(self, True, f"calibration: no pose of the frame '{frame}' on /tf yet; "
                         f'expected it from {sender}')

    def _check_end(self) -> None:
        self._say_missed()
        if time.monotonic() < self._ends:
            return
        self._ends = self._missed = math.inf
        for subscription in self._heard:
            self.destroy_subscription(subscription)
        self._heard = []
        try:
            self._calibrate()
        except HandTrackerError as error:
            log_line(self, True, f'calibration: {error}; the offset stays')

    def _calibrate(self) -> None:
        """Fit the wrist offset to both captures, broadcast it and write `mount_file`."""
        from ..splicing.wrist_offset import fit_wrist_offset

        found = fit_wrist_offset(self._body, self._wrist)
        offset = dict(zip(MOUNT_NUMBERS, [*found.position.tolist(), *found.rotation.tolist()]))
        save_parameters(
            self._output, f'Where {self._names.wrist} rests in a frame of a body, in metres.',
            {'body_frame': self._body_frame, **offset})
        self._show(offset.values())
        log_line(self, False, f'calibration: both captures differ by '
                 f'{math.degrees(found.spread):.1f} degrees and {1e3 * found.distance:.1f} mm, the '
                 f"body's stamps are {1e3 * found.delay:+.1f} ms later; written to {self._output}")


def main(args: list[str] | None = None) -> int:
    """Run the mount node until it is interrupted; return its exit code."""
    return run(MountNode, args=args, name='mount')


if __name__ == '__main__':
    sys.exit(main())
