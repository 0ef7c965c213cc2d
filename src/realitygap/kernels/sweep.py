"""Entry points for calibration: noise-free readings at many places, wheels under many commands.

One kernel each, so that a fit compiles only what it needs.
"""

from realitygap.compiled import kernel
from realitygap.kernels.infrared import infrared, receive
from realitygap.kernels.light import illuminate
from realitygap.kernels.trial import set_pose
from realitygap.kernels.wheels import turn_wheel


@kernel
def sweep_infrared(robot, arena, poses, work, out):
    """Proximity readings at poses [n, 3] into out [n, P], unrounded."""
    for i in range(poses.shape[0]):
        set_pose(poses[i], work)
        infrared(robot, arena, work, out[i])


@kernel
def sweep_received(robot, arena, poses, work, out):
    """Light for measured sensors at poses [n, 3] into out [n, P], before their curves."""
    for i in range(poses.shape[0]):
        set_pose(poses[i], work)
        receive(robot, arena, work, out[i])


@kernel
def sweep_light(robot, arena, poses, work, out):
    """Illumination of the ambient sensors at poses [n, 3] into out [n, A], before their gains."""
    for i in range(poses.shape[0]):
        set_pose(poses[i], work)
        illuminate(robot, arena, True, work, out[i])


@kernel
def sweep_direct(robot, arena, poses, work, out):
    """As sweep_light, direct light only: where nothing near could reflect any."""
    for i in range(poses.shape[0]):
        set_pose(poses[i], work)
        illuminate(robot, arena, False, work, out[i])


@kernel
def sweep_wheels(robot, commands, first, work, speeds):
    """Speeds [n, 2] (cm/s) of both wheels after each step of commands [n, 2] (Khepera units).

    Wheels stand still before each row that `first` marks with 1.
    """
    for i in range(commands.shape[0]):
        for w in range(2):
            if first[i] != 0:
                for j in range(work.wheel.shape[1]):
                    work.wheel[w, j] = 0.0
            target = commands[i, w] * robot.speed_per_unit[w]
            speeds[i, w] = turn_wheel(robot, work.wheel[w], target, 1.0, 0.0)
