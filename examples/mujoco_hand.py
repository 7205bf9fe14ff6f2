"""Let the plain robot hand follow the packaged recording in MuJoCo."""

import numpy as np

from hand_tracker import HandTracker
from hand_tracker.files.bags import open_bag
from hand_tracker.package_data import packaged_recording
from hand_tracker.retargeting.retargeter import Retargeter
from hand_tracker.retargeting.robot_file import load_robot
from hand_tracker.tracking.recording import marker_topic, track

try:
    import mujoco
except ModuleNotFoundError:
    raise SystemExit('This example needs MuJoCo: pip install mujoco') from None

JOINT_STIFFNESS, JOINT_DAMPING, JOINT_ARMATURE = 3., .02, 1e-4  # [N m/rad, N m s/rad, kg m²]
robot, tracker = load_robot('plain'), HandTracker()
spec = mujoco.MjSpec.from_file(robot.urdf)
spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
spec.option.gravity = 0., 0., 0.
for joint in spec.joints:
    joint.armature = JOINT_ARMATURE
for name in robot.order:
    actuator = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    actuator.set_to_position(JOINT_STIFFNESS, JOINT_DAMPING)
model = spec.compile()
data, retargeter = mujoco.MjData(model), Retargeter(robot.hand, tracker.hand)
joints = [model.joint(name).qposadr[0] for name in robot.order]
with open_bag(packaged_recording()) as bag:
    frames = track(bag.messages([marker_topic(bag)]), tracker)
    start, misses = next(frames).time, []
    for frame in frames:
        now = 1e-9 * (frame.time - start)
        data.ctrl[:] = retargeter.update_angles(frame.state.angles, now - data.time)
        while data.time < now:
            mujoco.mj_step(model, data)
        misses.append(np.abs(data.qpos[joints] - data.ctrl).max())
print(f'{len(misses)} frames, worst {np.degrees(np.median(misses)):.1f} degrees off in the median')
