"""Contact: nothing enters anything, friction holds back sliding, and a robot can always leave."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from realitygap.kernels.motion import Arc, drive_arc, ground_speeds, settle
from realitygap.world.arena import Arena, Cylinder
from tests.kernels.calls import slide
from tests.kernels.reference.motion import settle as slow_settle
from tests.kernels.reference.rays import overlap
from tests.kernels.reference.trial import move as slow_move
from tests.kernels.scenes import EMPTY, PAPER, RADIUS, full_room, random_arena, random_pose

LEFT_BEHIND = 1e-9
"""An overlap that counts as none, cm."""


def go(arena: Arena, x: float, y: float, dx: float, dy: float) -> tuple[float, float, bool]:
    return settle(arena.to_kernel(), RADIUS, x, y, dx, dy)


def test_agrees_with_the_reference():
    """A disc ends where the slow reference puts it, in any room, whatever the friction."""
    random = np.random.default_rng(7)
    touched = 0
    for k in range(400):
        arena = full_room(random) if k % 10 == 0 else random_arena(random, lamps=0)
        arena = replace(arena, sliding=random.choice([0.0, 0.3, 1.0, 100.0]))
        pose = random_pose(random, arena)
        if pose is None:
            continue
        x, y, _ = pose
        steps, ends = random.uniform(-1.2, 1.2, (10, 2)), np.zeros((10, 3))
        slide(arena.to_kernel(), RADIUS, x, y, steps, ends)
        for step, got in zip(steps, ends, strict=True):
            expected = slow_settle(arena, RADIUS, x, y, *step)
            assert (*got[:2], bool(got[2])) == pytest.approx(expected, rel=1e-9, abs=1e-9)
            touched += got[2]
            x, y = got[:2]
    assert touched > 300, "hardly anything was touched"


WEDGES = (
    EMPTY,
    Arena(name="corridor", size_cm=(60, 6.5)),
    Arena(name="box", size_cm=(6, 6)),
    Arena(name="corner", size_cm=(30, 30), walls=((0, 12, 12, 0), (18, 30, 30, 18))),
    Arena(name="wedge", size_cm=(40, 40), walls=((0, 0, 40, 12), (0, 0, 12, 40), (20, 40, 40, 20))),
    Arena(
        name="bays", size_cm=(30, 30),
        cylinders=(
            Cylinder(x_cm=4, y_cm=15, radius_cm=4), Cylinder(x_cm=15, y_cm=4, radius_cm=4),
            Cylinder(x_cm=20, y_cm=20, radius_cm=0.5), Cylinder(x_cm=25, y_cm=22, radius_cm=1),
        ),
        walls=((10, 20, 20, 10.5), (15, 30, 15, 25)),
    ),
)  # fmt: skip
"""Corners, wedges, narrow passages, free ends of walls."""


@settings(max_examples=300)
@given(
    st.sampled_from(WEDGES), st.sampled_from([0.0, 0.5, 1.0, 100.0]), st.integers(0, 2**32 - 1),
    st.sampled_from(["wander", "push"]),
)  # fmt: skip
def test_nothing_enters_anything(arena, sliding, seed, how):
    """However a robot drives, it never overlaps a wall, a cylinder or an inner wall, nor gets beyond one."""
    random = np.random.default_rng(seed)
    pose = random_pose(random, arena)
    if pose is None:
        return
    kernel = replace(arena, sliding=sliding).to_kernel()
    x, y, _ = pose
    headings, ends = random.uniform(-math.pi, math.pi, 60), np.zeros((60, 3))
    headings = headings if how == "wander" else np.repeat(headings[:3], 20)
    steps = 0.95 * np.column_stack([np.cos(headings), np.sin(headings)])
    slide(kernel, RADIUS, x, y, steps, ends)
    for end in ends:
        before, (x, y) = (x, y), end[:2]
        assert overlap(arena, x, y, RADIUS) <= LEFT_BEHIND * (1 + 1e-3)
        # So short a step cannot have jumped over anything: the body is as wide as six of them.
        assert math.hypot(x - before[0], y - before[1]) < RADIUS


@settings(max_examples=200)
@given(st.sampled_from(WEDGES), st.sampled_from([0.0, 1.0, 100.0]), st.integers(0, 2**32 - 1))
def test_a_robot_in_contact_can_leave(arena, sliding, seed):
    """Whatever it has driven against, a robot that drives back the way it came gets away freely."""
    random = np.random.default_rng(seed)
    pose = random_pose(random, arena)
    if pose is None:
        return
    kernel = replace(arena, sliding=sliding).to_kernel()
    x, y, heading = pose
    dx, dy = 0.8 * math.cos(heading), 0.8 * math.sin(heading)
    trail = [(x, y)]
    for _ in range(100):
        x, y, touched = settle(kernel, RADIUS, x, y, dx, dy)
        if touched:
            break
        trail.append((x, y))
    else:
        return
    # Straight back to where it last stood free, by a step that is no longer than any other.
    back_x, back_y = trail[-1][0] - x, trail[-1][1] - y
    got = settle(kernel, RADIUS, x, y, back_x, back_y)
    assert got == pytest.approx((*trail[-1], False), abs=1e-9)


def test_flat_wall_head_on():
    """Against a wall head on a robot stops at its radius; its wheels' ground speeds become 0."""
    x, y, touched = go(EMPTY, 100 - RADIUS - 0.3, 50, 0.8, 0.0)
    assert (x, y, touched) == (pytest.approx(100 - RADIUS, abs=1e-12), 50, True)
    x, y, touched = go(EMPTY, 100 - RADIUS, 50, 0.8, 0.0)
    left, right = ground_speeds(x - (100 - RADIUS), 0.0, Arc(0.8, 0.0, 0.0, 1.0, 1.0, 0.0), 5.3)
    assert touched and abs(left) < 1e-9 and abs(right) < 1e-9


@pytest.mark.parametrize("angle", [10, 30, 44.9, 45.1, 60, 80])
@pytest.mark.parametrize("sliding", [0.0, 0.5, 1.0, 100.0])
def test_coulomb_friction(angle, sliding):
    """At angle φ off the normal the body slides by sin φ − µ·cos φ of its way, or not at all."""
    step, phi = 0.8, math.radians(angle)
    along = step * max(math.sin(phi) - sliding * math.cos(phi), 0.0)
    arena = replace(EMPTY, sliding=sliding)
    x, y, _ = go(arena, 100 - RADIUS, 50, step * math.cos(phi), step * math.sin(phi))
    assert x == pytest.approx(100 - RADIUS, abs=1e-12)
    assert y == pytest.approx(50 + along, abs=1e-12)


def test_ground_speeds_agree_with_the_reference():
    """Along a wall, ground speeds are what the body's movement and turn say."""
    random = np.random.default_rng(9)

    class AtWall:
        arena = EMPTY

    for _ in range(300):
        left, right = random.uniform(-8, 10, 2)
        pose = (100 - RADIUS - random.uniform(0, 0.5), 50.0, random.uniform(-1.5, 1.5))
        x, y, heading = pose
        driven = drive_arc(5.3, left, right, math.cos(heading), math.sin(heading))
        to_x, to_y, touched = go(EMPTY, x, y, driven.dx, driven.dy)
        _, expected, slow_touched = slow_move(AtWall, PAPER, pose, left, right)
        got = ground_speeds(to_x - x, to_y - y, driven, 5.3) if touched else (left, right)
        assert touched == slow_touched
        assert got == pytest.approx(expected, rel=1e-9, abs=1e-9)
