"""Trials of one network in lockstep, one lane each: the bits of separate trials (trial.py), three times as
fast.

Noise, network, wheels and movement are the same operations in the same order, a vector of lanes at once.
Inputs are computed in single precision where the result is certain (lane_sensors.py). Rare cases, an input
near a rounding boundary or contact, are handled lane by lane.
"""

import numpy as np

from realitygap.kernels.contact import ground_speeds, settle
from realitygap.kernels.infrared import infrared
from realitygap.kernels.jit import kernel, step
from realitygap.kernels.lane_noise import draw_normals
from realitygap.kernels.lane_sensors import sense_lanes

from realitygap.kernels.lanes import (  # isort: skip
    CHANGE, COS, COS_MEAN, DX, DY, HEADING, LEFT, NOTED, P0, P1, P2, P3, P4, PLAY, RIGHT, SHARE, SIN,
    SIN_MEAN, SPEED, TARGET, TO_X, TO_Y, TOUCHED, TURN, WHEELS, WIDE, X, Y,
)  # fmt: skip
from realitygap.kernels.network import DELAY, LIMIT, PAST, SOURCE, WEIGHT
from realitygap.kernels.network import TARGET as ONTO
from realitygap.kernels.params import MAX_DELAY, STEP_S, UPDATES, Path
from realitygap.kernels.rng import sin_cos
from realitygap.kernels.trial import PROXIMITY, draw_noise, draw_start, read, scale_input
from realitygap.kernels.wheels import FASTEST, Arc, drive_arc
from realitygap.kernels.work import DRAWS

U = np.uint64
ROW, NOTES = U(WIDE), U(len(Path._fields) * WIDE)


@step
def wake_lanes(nets, w, streams, lanes):
    """Set all networks to silence; lanes beyond the trials repeat the last one."""
    last = streams.shape[0] - 1
    for t in range(WIDE):
        lanes.stream[t] = streams[min(t, last)]
    lanes.double[:] = 0.0
    lanes.noise[:] = 0.0
    lanes.single[:] = 0.0
    lanes.inputs[:] = 0
    lanes.outputs[:] = 0
    for i in range(nets.neurons[w]):
        lanes.base[i * WIDE : (i + 1) * WIDE] = -nets.thresholds[w, i]


@step
def stand_lanes(n, task, lanes, work):
    """Put all robots at rest at their starts."""
    d = lanes.double
    for t in range(n):
        draw_start(task, lanes.stream[t], work.start)
        d[X + t], d[Y + t], d[HEADING + t] = work.start[0], work.start[1], work.start[2]
        d[SIN + t], d[COS + t] = sin_cos(work.start[2])


@step
def sense_apart(n, k, world, lanes, work):
    """Inputs of the lanes marked `apart`, separately."""
    d, robot = lanes.double, world.robot
    for t in range(n):
        if lanes.apart[t] == 0:
            continue
        work.pose[0], work.pose[1], work.pose[2] = d[X + t], d[Y + t], d[HEADING + t]
        work.pose[3], work.pose[4] = d[COS + t], d[SIN + t]
        draw_noise(world.level, lanes.stream[t], k, work.readings.shape[0], work)
        infrared(robot, world.arena, work, work.readings)
        read(robot, PROXIMITY, world.level, 0.0, work.noise, work.readings)
        for i in range(world.task.channels.shape[0]):
            at, reading = U(i * WIDE) + t, work.readings[world.task.channels[i]]
            new = scale_input(robot.proximity_low, robot.proximity_high, reading)
            lanes.change[at] += new - lanes.inputs[at]
            lanes.inputs[at] = new


@step
def add(n, weight, source, total):
    """Add one link's contribution in each lane."""
    for t in range(n):
        total[t] += weight * source[t]


@step
def update_lanes(n, nets, w, row, lanes):
    """As network.update_neurons, into row `row`."""
    neurons, y = nets.neurons[w], lanes.outputs
    for i in range(neurons):
        at = (row * neurons + i) * WIDE
        here, base = y[at:], lanes.base[i * WIDE :]
        for t in range(n):
            here[t] = base[t]
        for e in range(nets.link_start[w, i], nets.link_start[w, i + 1]):
            back = (nets.links[w, e, DELAY] + 1) * neurons + i - nets.links[w, e, SOURCE]
            add(n, np.int32(nets.links[w, e, WEIGHT]), y[at - back * WIDE :], here)
        for t in range(n):
            here[t] = min(max(here[t], np.int32(-LIMIT)), np.int32(LIMIT))


@step
def think_lanes(n, nets, w, lanes):
    """As network.think, for all lanes whether or not they have settled."""
    link, y = 0, lanes.outputs
    for update in range(UPDATES):
        while link < nets.sensor_count[w] and nets.sensor_links[w, link, DELAY] == update:
            source = lanes.change[nets.sensor_links[w, link, SOURCE] * WIDE :]
            total = lanes.base[nets.sensor_links[w, link, ONTO] * WIDE :]
            add(n, np.int32(nets.sensor_links[w, link, WEIGHT]), source, total)
            link += 1
        update_lanes(n, nets, w, PAST + update, lanes)
    kept = nets.neurons[w] * WIDE
    for i in range(PAST * kept):
        y[i] = y[UPDATES * kept + i]


@step
def turn_lanes(n, robot, level, side, lanes, asks):
    """As trial.act for one wheel: `asks` are that neuron's outputs."""
    d, u = lanes.double, WHEELS[side]
    friction, slips = lanes.noise[side * WIDE :], lanes.noise[(2 + side) * WIDE :]
    fastest, half = FASTEST * robot.top_command * robot.speed_per_unit[side], robot.half_play
    for t in range(n):
        target = asks[t] * (robot.top_command / LIMIT) * robot.speed_per_unit[side]
        drag, slip = 1.0 + level * robot.noise_friction * friction[t], level * robot.noise_wheel * slips[t]
        speed, before = d[u + SPEED + t], d[u + TARGET + t]
        p0 = (target + robot.lag * (before - target) - speed) / STEP_S
        p1, p2, p3, p4 = d[u + P0 + t], d[u + P1 + t], d[u + P2 + t], d[u + P3 + t]
        integral = p0 + p1 + p2 + p3 + p4
        d[u + P0 + t], d[u + P1 + t], d[u + P2 + t], d[u + P3 + t], d[u + P4 + t] = p0, p1, p2, p3, p4
        d[u + TARGET + t] = target
        rests = (abs(speed) < robot.rest_speed) & (abs(integral) <= robot.friction * drag)
        change = (robot.kp * p0 + robot.ki * integral + robot.kd * d[u + CHANGE + t]) / robot.divisor
        sign = 1.0 if target > 0.0 else -1.0
        owed, room = half - sign * d[u + PLAY + t], abs(target) * (1.0 - robot.lag)
        plays = (half > 0.0) & (target != 0.0) & (owed > 0.0) & (not rests)
        lost = owed * (room / (room + owed)) if plays else 0.0
        d[u + PLAY + t] += sign * lost
        speed = speed + change - sign * lost
        speed = 0.0 if rests else speed + slip * speed
        d[u + SPEED + t] = min(max(speed, -fastest), fastest)
        d[u + CHANGE + t] = min(max(0.0 if rests else change, -2.0 * fastest), 2.0 * fastest)


@step
def carry_lanes(n, robot, arena, lanes):
    """Ends of the wheels' arcs; lanes whose bodies then touch something are marked `apart`."""
    d, apart, clear = lanes.double, lanes.apart, robot.radius - 1e-9
    width, depth, most = arena.size[0], arena.size[1], 0.25 * robot.radius * robot.radius
    for t in range(n):
        left, right = d[WHEELS[0] + t], d[WHEELS[1] + t]
        arc = drive_arc(robot.track, left, right, d[COS + t], d[SIN + t], robot.period)
        d[DX + t], d[DY + t], d[TURN + t], d[SHARE + t] = arc.dx, arc.dy, arc.turn, arc.share
        d[COS_MEAN + t], d[SIN_MEAN + t] = arc.cos_mean, arc.sin_mean
        d[LEFT + t], d[RIGHT + t], d[TOUCHED + t] = left, right, 0.0
    for t in range(n):
        x, y = d[X + t] + d[DX + t], d[Y + t] + d[DY + t]
        outside = (x < clear) | (y < clear) | (width - x < clear) | (depth - y < clear)
        apart[t] = U(outside | (d[DX + t] * d[DX + t] + d[DY + t] * d[DY + t] > most))
        d[TO_X + t], d[TO_Y + t] = x, y
    for j in range(arena.cylinders.shape[0]):
        x, y, reach = arena.cylinders[j, 0], arena.cylinders[j, 1], clear + arena.cylinders[j, 2]
        for t in range(n):
            dx, dy = d[TO_X + t] - x, d[TO_Y + t] - y
            apart[t] |= U(dx * dx + dy * dy < reach * reach)


@step
def settle_apart(n, robot, arena, lanes):
    """Contact of the lanes marked `apart`, separately (trial.move)."""
    d, listed, count = lanes.double, lanes.listed, U(0)
    for t in range(n):
        listed[count] = t
        count += lanes.apart[t]
    for i in range(count):
        t = listed[i]
        x, y, touched = settle(arena, robot.radius, d[X + t], d[Y + t], d[DX + t], d[DY + t])
        d[TO_X + t], d[TO_Y + t] = x, y
        if touched:
            arc = Arc(d[DX + t], d[DY + t], d[TURN + t], d[SHARE + t], d[COS_MEAN + t], d[SIN_MEAN + t])
            left, right = ground_speeds(x - d[X + t], y - d[Y + t], arc, robot.track, robot.period)
            d[LEFT + t], d[RIGHT + t], d[TOUCHED + t] = left, right, 1.0


@step
def move_lanes(k, n, lanes):
    """Carry out the movement, and note what the scores will see of it."""
    d, notes = lanes.double, lanes.notes[U(k % NOTED) * NOTES :]
    for t in range(n):
        d[X + t], d[Y + t] = d[TO_X + t], d[TO_Y + t]
        d[HEADING + t] += d[TURN + t]
        d[SIN + t], d[COS + t] = sin_cos(d[HEADING + t])
        notes[t], notes[ROW + t], notes[U(2) * ROW + t] = d[X + t], d[Y + t], d[HEADING + t]
        notes[U(3) * ROW + t], notes[U(4) * ROW + t] = d[LEFT + t], d[RIGHT + t]
        notes[U(5) * ROW + t] = d[TOUCHED + t]


@step
def write_down(k, lanes, paths):
    """Copy the notes of the last steps up to `k`: each path's lie together, for the processor's cache."""
    many = k % NOTED + 1
    for i in range(paths.shape[0]):
        for c in range(paths.shape[1]):
            at = U(c) * ROW + U(i)
            for j in range(many):
                paths[i, c, k + 1 - many + j] = lanes.notes[U(j) * NOTES + at]


@kernel
def run_lockstep(world, nets, w, streams, paths, lanes):
    """Trials of network `w` on up to WIDE streams, into `paths`: the bits of batch.run_trials."""
    robot, arena, work = world.robot, world.arena, lanes.work
    n = U((streams.shape[0] + 7) & -8)  # whole vectors
    wake_lanes(nets, w, streams, lanes)
    stand_lanes(n, world.task, lanes, work)
    for k in range(world.task.steps):
        if world.level > 0.0:
            draw_normals(n, DRAWS * (k + 1), lanes)
        sense_lanes(n, world, lanes)
        sense_apart(n, k, world, lanes, work)
        think_lanes(n, nets, w, lanes)
        for side in range(2):
            last = (MAX_DELAY * nets.neurons[w] + side) * WIDE
            turn_lanes(n, robot, world.level, side, lanes, lanes.outputs[last:])
        carry_lanes(n, robot, arena, lanes)
        settle_apart(n, robot, arena, lanes)
        move_lanes(k, n, lanes)
        if k % NOTED == NOTED - 1 or k == world.task.steps - 1:
            write_down(k, lanes, paths)
