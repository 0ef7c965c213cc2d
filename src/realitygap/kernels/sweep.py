"""Entry points for calibration: noise-free readings at many places, wheels under many commands.

One kernel each, so that a fit compiles only what it needs.
"""

from realitygap.compiled import kernel
from realitygap.kernels.infrared import infrared, receive
from realitygap.kernels.light import illuminate
from realitygap.kernels.trial import set_pose
from realitygap.kernels.wheels import turn_wheel


@kernel
def sweep_infrared(robot, arena, poses, scratch, out):
    """Proximity readings at poses [n, 3] into out [n, P], unrounded."""
    pose = scratch.state.pose
    for i in range(poses.shape[0]):
        set_pose(poses[i], pose)
        infrared(robot, arena, pose, scratch.eyes, out[i])


@kernel
def sweep_received(robot, arena, poses, scratch, out):
    """Light for measured sensors at poses [n, 3] into out [n, P], before their curves."""
    pose = scratch.state.pose
    for i in range(poses.shape[0]):
        set_pose(poses[i], pose)
        receive(robot, arena, pose, scratch.eyes, out[i])


@kernel
def sweep_light(robot, arena, poses, scratch, out):
    """Illumination of the ambient sensors at poses [n, 3] into out [n, A], before their gains."""
    pose = scratch.state.pose
    for i in range(poses.shape[0]):
        set_pose(poses[i], pose)
        illuminate(robot, arena, True, pose, scratch.eyes, out[i])


@kernel
def sweep_direct(robot, arena, poses, scratch, out):
    """As sweep_light, direct light only: where nothing near could reflect any."""
    pose = scratch.state.pose
    for i in range(poses.shape[0]):
        set_pose(poses[i], pose)
        illuminate(robot, arena, False, pose, scratch.eyes, out[i])


@kernel
def sweep_wheels(robot, commands, first, scratch, speeds):
    """Speeds [n, 2] (cm/s) of both wheels after each step of commands [n, 2] (Khepera units).

    Wheels stand still before each row that `first` marks with 1.
    """
    wheel = scratch.state.wheel
    for i in range(commands.shape[0]):
        for w in range(2):
            if first[i] != 0:
                for j in range(wheel.shape[1]):
                    wheel[w, j] = 0.0
            target = commands[i, w] * robot.wheels.speed_per_unit[w]
            speeds[i, w] = turn_wheel(robot, wheel[w], target, 1.0, 0.0)
