"""One trial by the threads of a group, as a GPU has them: each senses with some of the sensors and updates
some of the neurons.

The steps are those of trial.py, taken for a robot of one sensor, so the bits are the same. What the threads
share lies in `work`; after each stage they `meet`.
"""

from collections import namedtuple
from typing import Any

import numpy as np

from realitygap.kernels.ambient import ambient
from realitygap.kernels.infrared import infrared
from realitygap.kernels.jit import step
from realitygap.kernels.network import (
    DELAY,
    LIMIT,
    PAST,
    SOURCE,
    TARGET,
    WEIGHT,
    is_still,
)
from realitygap.kernels.params import LANES, MAX_DELAY, UPDATES, F, Robot
from realitygap.kernels.rng import normal_pair
from realitygap.kernels.trial import (
    AMBIENT,
    PROXIMITY,
    act_on,
    begin,
    feed_one,
    move,
    near_fed,
    note,
    read,
    wheels_speed,
)
from realitygap.kernels.work import DRAWS, Work, noise_blocks, whole_vectors

Own = namedtuple(
    "Own", "ray_x ray_y inverse terms light far hidden end_x end_y normal_x normal_y incidence noticed listed"
)
"""Fields of Work that each thread needs for itself: room for the rays of one sensor."""


def _written(name: str, given: str, made: type, values: dict[str, str]) -> Any:
    """A compiled function that makes a tuple of so many fields: no compiled code can map over them."""
    fields = ", ".join(values[field] for field in made._fields)  # type: ignore[attr-defined]
    scope: dict[str, Any] = {made.__name__: made, "LANES": LANES}
    exec(f"def {name}({given}):\n    return {made.__name__}({fields})", scope)
    return step(scope[name])


def _robot_field(name: str, kind: Any) -> str:
    if kind is not F or not name.startswith(("proximity_", "ambient_")):
        return f"robot.{name}"
    if name in ("ambient_ray", "ambient_weight"):
        return f"robot.{name}[k * fans : (k + 1) * fans]"
    return f"robot.{name}[k : k + 1]"


def _work_field(name: str) -> str:
    lit = "work.all_fans[:, k * rays : (k + 1) * rays + LANES]"
    sliced = {"fan": "work.fan[:, k : k + 1]", "all_fans": lit}
    return f"own.{name}" if name in Own._fields else sliced.get(name, f"work.{name}")


_robot = {name: _robot_field(name, kind) for name, kind in Robot.__annotations__.items()}
part_of = _written("part_of", "robot, k, fans", Robot, _robot)
"""A robot with proximity sensor `k` and ambient sensor `k` alone, the latter of so many fans."""
mine_of = _written("mine_of", "work, own, k, rays", Work, {n: _work_field(n) for n in Work._fields})
"""The scratch arrays of sensor `k` of such a robot; an ambient one has so many rays."""


def lanes_of_rays(work: Work, robot: Robot) -> tuple[int, int]:
    """Lengths of Own.light and of the other arrays of rays, for the scratch arrays of a whole robot."""
    rays = (work.all_fans.shape[1] - LANES) // max(len(robot.ambient_place), 1)
    light = max(whole_vectors(rays), LANES) + whole_vectors(1)
    return light, light + LANES


@step
def meet(lane, group):
    """Wait until all threads of the group are here: nothing to do for a single one."""


@step
def draw_share(world, stream, k, lane, group, work):
    """This thread's share of `draw_noise`."""
    if world.level > 0.0:
        half = work.noise.shape[0] // 2
        first = DRAWS * noise_blocks(work.readings.shape[0]) * (k + 1)
        for i in range(lane, half, group):
            work.noise[i], work.noise[half + i] = normal_pair(stream, first + i)


@step
def sense_together(world, lane, group, work, own, common):
    """As `sense`."""
    sense_share(world, lane, group, work, own)


@step
def sense_share(world, lane, group, work, own):
    """This thread's share of `sense`: of every `group` sensors one."""
    robot, arena, level = world.robot, world.arena, world.level
    near, speed = near_fed(robot, world.task.feed), wheels_speed(work)
    sensors = max(robot.ambient_place.shape[0], 1)
    fans, rays = robot.ambient_ray.shape[0] // sensors, (work.all_fans.shape[1] - LANES) // sensors
    for s in range(lane, work.readings.shape[0], group):
        k = s if s < near else s - near
        part, mine = part_of(robot, k, fans), mine_of(work, own, k, rays)
        out, noise = work.readings[s : s + 1], work.noise[s:]
        if s < near:
            infrared(part, arena, mine, out)
            read(part, PROXIMITY, level, speed, noise, out)
        else:
            ambient(part, arena, mine, out)
            read(part, AMBIENT, level, speed, noise, out)


@step
def feed_share(world, lane, group, work):
    """This thread's share of `feed_network`."""
    near = near_fed(world.robot, world.task.feed)
    for i in range(lane, world.task.channels.shape[0], group):
        feed_one(world.robot, world.task, near, i, work)


@step
def arrive_share(update, link, lane, group, work):
    """As `arrive`, for the neurons of this thread."""
    links = work.sensor_link
    while links[DELAY, link] == update:
        target = links[TARGET, link]
        if target % group == lane:
            work.base[target] += links[WEIGHT, link] * work.change[links[SOURCE, link]]
        link += 1
    return link


@step
def update_share(neurons, place, lane, group, work):
    """As `update_neurons`, for the neurons of this thread."""
    for i in range(lane, neurons, group):
        total, here = work.base[i], place + i
        first = work.link_end[i - 1] if i > 0 else np.uint64(0)
        for e in range(first, work.link_end[i]):
            total += work.link_weight[e] * work.outputs[np.uint64(here) - work.link_back[e]]
        work.outputs[here] = min(max(total, -LIMIT), LIMIT)


@step
def keep_share(neurons, lane, group, work):
    """As `keep_past`, for some of the outputs, once work.settled[0] is 1."""
    shift = UPDATES * neurons
    for i in range(lane, PAST * neurons, group):
        value = work.outputs[shift + i]
        if value != work.outputs[shift + i - neurons]:
            work.settled[0] = 0
        work.outputs[i] = value


@step
def think_together(nets, n, lane, group, work):
    """As `think`; all threads meet as often, for other groups may wait with them."""
    neurons, still = nets.neurons[n], is_still(work)
    link = 0
    for update in range(UPDATES):
        if not still:
            if update <= MAX_DELAY:
                link = arrive_share(update, link, lane, group, work)
            update_share(neurons, (PAST + update) * neurons, lane, group, work)
            if lane == 0 and update == UPDATES - 1:
                work.settled[0] = 1
        meet(lane, group)
    if not still:
        keep_share(neurons, lane, group, work)
    meet(lane, group)


@step
def act_share(world, nets, n, lane, group, work):
    """This thread's share of `act`: a wheel, or both, or none."""
    for w in range(lane, 2, group):
        act_on(world.robot, nets, n, world.level, w, work)


@step
def run_together(world, nets, n, stream, lane, group, work, own, common, path):
    """As `run_trial`, by thread `lane` of a group of so many."""
    if lane == 0:
        begin(nets, n, work.start, work)
    meet(lane, group)
    for k in range(world.task.steps):
        draw_share(world, stream, k, lane, group, work)
        meet(lane, group)
        sense_together(world, lane, group, work, own, common)
        meet(lane, group)
        feed_share(world, lane, group, work)
        meet(lane, group)
        think_together(nets, n, lane, group, work)
        act_share(world, nets, n, lane, group, work)
        meet(lane, group)
        if lane == 0:
            move(world.robot, world.arena, work)
            note(path, k, work)
        meet(lane, group)
