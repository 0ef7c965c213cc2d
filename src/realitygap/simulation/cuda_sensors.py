"""What the threads of a warp do together for its trials: draw noise, and follow the sensors' rays.

A warp carries out 32 trials, one a thread, or fewer where there are not enough to keep a GPU busy: then
several threads have the same one. The steps are those of the processor and of kernels/raywise.py, so the bits
are the same, however many trials a warp has. All its threads are here at a time.
"""

# mypy: allow-untyped-defs, no-check-untyped-defs
from collections.abc import Callable
from typing import Any

import numba
import numpy as np
from numba import cuda

from realitygap.kernels import ambient, geometry, infrared, light, near, raywise, rng
from realitygap.kernels.params import RAYS

__all__ = ["EACH", "MOST", "WARP", "shared_ambient", "shared_infrared", "shared_noise"]

WARP = 32
ALL = 0xFFFFFFFF
"""Threads that meet: a bit for each of a warp's."""
EACH = 1
"""Place in work.settled where the number of a warp's trials lies."""
MOST = 63
"""Proximity sensors at most: a bit for each."""
Device = Callable[[Any], Any]
"""Makes a step one of the GPU's."""
_ONE, _NONE = np.int64(1), np.int64(0)


def shared_noise(device: Device, drawn: int, warps: int) -> Callable[..., None]:
    """As `trial.draw_noise`; threads of the same trial share the work, and each has the numbers, since it
    scales them in place where noise follows a table.

    Args:
        device: as of `Device`.
        drawn: normal numbers of a step.
        warps: of a block.
    """
    pair, half = device(rng.normal_pair), drawn // 2

    def draw(level, stream, k, _sensors, work):
        if level > 0.0:
            lane, warp, each = cuda.threadIdx.x % WARP, cuda.threadIdx.x // WARP, work.settled[EACH]
            shared = cuda.shared.array((warps, drawn, WARP), numba.float64)[warp, :, lane % each]
            cuda.syncwarp()
            i = lane // each
            while i < half:
                shared[i], shared[half + i] = pair(stream, half * (k + 1) + i)
                i += WARP // each
            cuda.syncwarp()
            for n in range(drawn):
                work.noise[n] = shared[n]

    return draw


def shared_infrared(device: Device, sensors: int, warps: int) -> Callable[..., None]:
    """As `infrared.infrared`, for surfaces of the usual reflectance.

    Most sensors notice nothing. Those that do are listed, whosever they are, and each thread follows the rays
    of one at a time.

    Args:
        device: as of `Device`.
        sensors: of a robot.
        warps: of a block.
    """
    notice, look_along, answer = _noticing(device), device(raywise.look_along), device(raywise.answer_near)
    pairs = sensors * WARP

    def see(robot, arena, work, out):
        lane, warp, each = cuda.threadIdx.x % WARP, cuda.threadIdx.x // WARP, work.settled[EACH]
        which = lane % each
        poses = cuda.shared.array((warps, 4, WARP), numba.float64)[warp]
        listed = cuda.shared.array((warps, pairs), numba.int16)[warp]
        returned = cuda.shared.array((warps, pairs), numba.float64)[warp]
        noticed = notice(robot, arena, work, lane // each, WARP // each)
        cuda.syncwarp()  # all have read what they saw a step ago
        poses[0, which], poses[1, which] = work.pose[0], work.pose[1]
        poses[2, which], poses[3, which] = work.pose[3], work.pose[4]
        count, before = 0, (1 << lane) - 1
        for k in range(sensors):
            mine = (noticed >> k) & _ONE != 0
            those = cuda.ballot_sync(ALL, mine)
            returned[k * WARP + which] = 0.0
            if mine:
                listed[count + cuda.popc(those & before)] = k * WARP + which
            count += cuda.popc(those)
        cuda.syncwarp()
        for n in range(lane, count, WARP):
            pair = listed[n]
            t = pair % WARP
            pose = poses[0, t], poses[1, t], poses[2, t], poses[3, t]
            returned[pair] = look_along(robot, arena, pair // WARP, pose, work.inverse, work.incidence)
        cuda.syncwarp()
        for k in range(sensors):
            out[k] = answer(robot, k, returned[k * WARP + which])

    return see


def _noticing(device: Device) -> Any:
    """As infrared.notice, of a thread's share of its trial's sensors: a bit for each that notices anything.

    What no trial of the warp has near is passed over by all.
    """
    faces_walls, faces_cylinder = device(infrared.faces_walls), device(infrared.faces_cylinder)
    faces_segment, inner_wall = device(infrared.faces_segment), device(infrared.inner_wall)
    cell_at, is_beyond = device(near.cell_at), device(near.is_beyond)

    def notice(robot, arena, work, first, step):
        x, y, c, s = work.pose[0], work.pose[1], work.pose[3], work.pose[4]
        fan, span, sensors, found = work.fan, work.span[0], robot.proximity_place.shape[0], _NONE
        cell, k = cell_at(arena, x, y), first
        while k < sensors:
            found |= _ONE << k if faces_walls(robot, arena, fan, k, x, y, c, s) else _NONE
            k += step
        for n in range(arena.cylinders.shape[0]):
            close = arena.cylinder_gap[cell, n] <= span
            if not cuda.any_sync(ALL, close):
                break
            j = arena.near_cylinders[cell, n]
            qx, qy, radius = arena.cylinders[j, 0] - x, arena.cylinders[j, 1] - y, arena.cylinders[j, 2]
            close = close & (qx * qx + qy * qy <= (span + radius) * (span + radius))
            if cuda.any_sync(ALL, close):
                forward, leftward, k = c * qx + s * qy, c * qy - s * qx, first
                while k < sensors:
                    faced = close & faces_cylinder(robot, fan, k, forward, leftward, radius)
                    found |= _ONE << k if faced else _NONE
                    k += step
        for n in range(arena.segments.shape[0]):
            close = arena.segment_gap[cell, n] <= span
            if not cuda.any_sync(ALL, close):
                break
            j = arena.near_segments[cell, n]
            close = close & (not is_beyond(arena, j, x, y, span))
            if cuda.any_sync(ALL, close):
                wall, k = inner_wall(arena, j, x, y, c, s), first
                while k < sensors:
                    found |= _ONE << k if close & faces_segment(robot, fan, k, wall) else _NONE
                    k += step
        return found

    return cuda.jit(device=True)(notice)


def shared_ambient(device: Device, warps: int) -> Callable[..., None]:
    """As `ambient.ambient`, by the printed law: threads of the same trial share a sensor's rays.

    Args:
        device: as of `Device`.
        warps: of a block.
    """
    look, light_by, added = device(light.look), device(raywise.light_by), device(geometry.added)
    walls_round, answer = device(geometry.walls_round), device(ambient.answer)
    shape = warps, RAYS + 1, WARP

    def see(robot, arena, work, out):
        lane, warp, each = cuda.threadIdx.x % WARP, cuda.threadIdx.x // WARP, work.settled[EACH]
        terms = cuda.shared.array(shape, numba.float64)[warp, :, lane % each]
        for k in range(robot.ambient_place.shape[0]):
            view = look(robot, k, work)
            walls, total = walls_round(arena, view), 0.0
            for lamp in range(arena.lamp_points.shape[0]):
                cuda.syncwarp()
                i = lane // each
                while i <= RAYS:
                    terms[i] = light_by(robot, arena, lamp, k, i, view, walls, work)
                    i += WARP // each
                cuda.syncwarp()
                total += terms[RAYS] + added(terms)
            out[k] = total
        answer(robot, out)

    return see
