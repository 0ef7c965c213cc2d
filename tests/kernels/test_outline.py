"""A body of a convex outline: nothing enters anything, and it moves as the slow reference says."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from realitygap.kernels.motion import body_clear
from realitygap.world.arena import Arena, Cylinder
from realitygap.world.robot import Body
from tests.kernels.calls import slide_outline
from tests.kernels.reference import outline as slow
from tests.kernels.scenes import EMPTY, PAPER, random_arena
from tests.kernels.test_contact import LEFT_BEHIND, WEDGES

REAR, SIDE, ARC = -3.0, 5.5, 8.0
"""A Thymio II, cm: an arc about the axle's middle ahead, a rectangle behind."""


def thymio() -> tuple[tuple[float, float], ...]:
    half = math.asin(SIDE / ARC)
    ahead = [half * (k / 5 - 1) for k in range(11)]
    return ((REAR, -SIDE), *((ARC * math.cos(a), ARC * math.sin(a)) for a in ahead), (REAR, SIDE))


THYMIO = thymio()
OUTLINES = (
    THYMIO,
    ((-1.0, -1.5), (4.0, 0.0), (-1.0, 1.5)),
    ((-2.0, -2.0), (1.0, -2.0), (1.0, 2.5), (-2.0, 2.5)),
)


@cache
def robot(outline: tuple[tuple[float, float], ...]):
    """The paper's robot with this outline, as the kernels have it."""
    body = Body(outline_cm=outline)
    return PAPER.to_kernel()._replace(radius=body.radius_cm, outline=body.edges())


in_kernels = cache(Arena.to_kernel)


def go(arena, outline, pose, dx, dy, turn):
    return slide_outline(in_kernels(arena), robot(outline), np.array([*pose, 0.0, 0.0]), dx, dy, turn)


def free_pose(random, arena, outline):
    """A pose at which the body overlaps nothing, mostly near something; None where there is none."""
    for _ in range(100):
        pose = (*(random.uniform(0, size) for size in arena.size_cm), random.uniform(-7, 7))
        if 0 <= slow.clearance(arena, outline, pose) < random.choice([1, 2, 50]):
            return pose
    return None


def test_agrees_with_the_reference():
    """A body ends, turns and touches as the slow reference says, in any room, whatever the friction."""
    random, touched = np.random.default_rng(11), 0
    for k in range(45):
        outline = OUTLINES[k % len(OUTLINES)]
        arena = random_arena(random, lamps=0, sliding=random.choice([0.0, 0.3, 1.0, 100.0]))
        pose = free_pose(random, arena, outline)
        step = (*random.uniform(-1.2, 1.2, 2), random.uniform(-0.4, 0.4))
        for _ in range(4 if pose else 0):
            expected = slow.settle(arena, outline, pose, *step)
            got = go(arena, outline, pose, *step)
            assert got == pytest.approx(expected, rel=1e-8, abs=1e-8)
            touched += got[3]
            pose = (got[0], got[1], pose[2] + got[2])
    assert touched > 15, "hardly anything was touched"


@settings(max_examples=100)
@given(
    st.sampled_from((*WEDGES, Arena(name="tight", size_cm=(11.4, 12)))), st.sampled_from(OUTLINES),
    st.sampled_from([0.0, 1.0, 100.0]), st.integers(0, 2**32 - 1),
)  # fmt: skip
def test_nothing_enters_anything(arena, outline, sliding, seed):
    """However a body drives and turns, its outline overlaps no wall, cylinder or inner wall."""
    random = np.random.default_rng(seed)
    pose, arena = free_pose(random, arena, outline), replace(arena, sliding=sliding)
    if pose is None:
        return
    assert body_clear(robot(outline), arena.to_kernel(), *pose)
    for k in range(30):
        if k % 10 == 0:
            way, turn = random.uniform(-2, 2), random.uniform(-0.6, 0.6)
        step = way * math.cos(pose[2]), way * math.sin(pose[2])
        x, y, turned, _ = go(arena, outline, pose, *step, turn)
        assert math.hypot(x - pose[0], y - pose[1]) < 2 * 2.6 * (1 + abs(turn) * 4)
        pose = (x, y, pose[2] + turned)
        assert slow.clearance(arena, outline, pose) >= -LEFT_BEHIND * (1 + 1e-3)


@settings(max_examples=50)
@given(st.sampled_from(OUTLINES), st.integers(0, 2**32 - 1))
def test_mirrored_bodies_move_as_mirror_images(outline, seed):
    """At one cylinder, wall or inner wall, what is mirrored ends mirrored."""
    random = np.random.default_rng(seed)
    kind = random.integers(3)
    post = (Cylinder(x_cm=50, y_cm=44, radius_cm=random.uniform(1, 8)),) if kind == 0 else ()
    a, b = random.uniform(35, 65, 2), random.uniform(35, 65, 2)
    walls = ((*map(float, a), *map(float, b)),) if kind == 1 else ()
    arena = replace(EMPTY, cylinders=post, walls=walls)
    flipped = replace(
        EMPTY, cylinders=tuple(replace(c, y_cm=100 - c.y_cm) for c in post),
        walls=tuple((x0, 100 - y0, x1, 100 - y1) for x0, y0, x1, y1 in walls),
    )  # fmt: skip
    image = tuple((x, -y) for x, y in outline[::-1])
    pose = free_pose(random, arena, outline)
    if pose is None:
        return
    dx, dy, turn = *random.uniform(-1, 1, 2), random.uniform(-0.3, 0.3)
    for _ in range(5):
        x, y, turned, touched = go(arena, outline, pose, dx, dy, turn)
        there = (pose[0], 100 - pose[1], -pose[2])
        assert go(flipped, image, there, dx, -dy, -turn) == pytest.approx(
            (x, 100 - y, -turned, touched), abs=1e-7
        )
        pose = (x, y, pose[2] + turned)


def test_a_grown_body_is_farther_out_everywhere():
    """Grown by a millimetre, a body is a millimetre deeper at each place within: disc or polygon."""
    for body in (Body(outline_cm=THYMIO), Body(radius_cm=3.0)):
        for place in ((0, 0), (1, 2), (-2.9, 0)):
            assert body.grown(0.1).depth_cm(*place) == pytest.approx(body.depth_cm(*place) + 0.1)
