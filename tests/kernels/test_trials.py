"""Whole trials: judged by the slow reference, mirrored, and functions of their streams alone."""

from __future__ import annotations

import inspect
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from realitygap.control.encoding import Variation
from realitygap.control.genotype import Genotype
from realitygap.control.slots import FIRST_LINK, decode
from realitygap.kernels.rng import substream
from realitygap.kernels.trial import live_step, run_trial
from realitygap.simulation.simulation import Simulation
from realitygap.tasks import load_task
from realitygap.values import Pose, fed
from realitygap.world.arena import Arena, Cylinder, Lamp
from tests.kernels.reference import trial as reference
from tests.kernels.scenes import PAPER, random_profile

TASKS = {name: load_task(name) for name in ("obstacle-avoidance", "light-seeking")}
CROWDED = Arena(
    name="crowded", size_cm=(60, 45), walls=((0, 20, 15, 20), (40, 45, 40, 30)),
    cylinders=(Cylinder(x_cm=30, y_cm=35, radius_cm=3), Cylinder(x_cm=45, y_cm=10, radius_cm=5)),
    lamps=(Lamp(x_cm=60, y_cm=22), Lamp(x_cm=5, y_cm=40, line_deg=0, spacing_cm=1, brightness=0.5)),
)  # fmt: skip


def networks(count: int, seed: int = 25, inputs: int = 8) -> np.ndarray:
    """Random genotypes with hidden neurons."""
    variation = Variation(inputs=inputs, start_neurons=0.3)
    return np.stack([variation.random(substream(np.uint64(seed), i)) for i in range(count)])


def streams(count: int, trials: int, seed: int = 26) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 2**64, (count, trials), np.uint64)


@pytest.mark.parametrize("level", [0.0, 1.0, 2.0])
@pytest.mark.parametrize("name", TASKS)
def test_agrees_with_the_reference(name, level):
    """A trial goes, step by step, as the slow reference goes: readings, inputs, commands, path."""
    task = replace(TASKS[name], seconds=20.0 if name == "obstacle-avoidance" else 6.0)
    genes = [Genotype.braitenberg(task.feeds).genes, *networks(3)]
    for stream, gene in enumerate(genes):
        judge(task, PAPER, gene, level, stream)


def test_agrees_by_curves_of_command_to_speed():
    """The same where each wheel settles by a curve of its own, with a dead zone and an end."""
    left = ((-9.0, -6.0), (-4.0, -4.0), (-2.5, 0.0), (0.0, 0.0), (1.5, 0.0), (3.0, 2.0), (8.0, 7.0))
    right = ((-10.0, -7.0), (-1.0, 0.0), (2.0, 0.0), (7.5, 6.0))
    curved = replace(PAPER, wheels=replace(PAPER.wheels, curve_left=left, curve_right=right))
    task = replace(TASKS["obstacle-avoidance"], seconds=10.0)
    for stream, gene in enumerate([Genotype.braitenberg(task.feeds).genes, *networks(3)]):
        judge(task, curved, gene, 1.0, stream)


@pytest.mark.parametrize("feeds", ["proximity", "ambient", "proximity+ambient"])
def test_agrees_in_other_rooms_with_other_robots(feeds):
    """The same in a room with inner walls and lamps, for robots with sensors of their own."""
    random = np.random.default_rng(28)
    contacts = 0
    for k in range(5):
        profile = random_profile(random)
        count = len(profile.bands(feeds))
        sensors = tuple(int(s) for s in random.integers(0, count, random.integers(1, 17)))
        task = replace(
            TASKS["obstacle-avoidance"], arena=CROWDED, feeds=feeds, sensors=sensors, seconds=4.0,
            start=replace(TASKS["obstacle-avoidance"].start, x_cm=20, y_cm=30, heading_deg=(-90, 30)),
        )  # fmt: skip
        contacts += judge(
            task, profile, networks(1, seed=k, inputs=len(sensors))[0], 1.0, 100 + k, len(sensors)
        )
    assert contacts > 0


@pytest.mark.parametrize("feeds", ["ambient", "proximity+ambient"])
def test_noise_of_the_light_by_its_reading_agrees_with_the_reference(feeds):
    """Each light sensor's noise is its own table's at what it reads, and rises with the wheels' speed; the
    noise level multiplies all of it."""
    law = PAPER.ambient
    tables = np.random.default_rng(29).uniform(0.0, 30.0, (len(law.sensors), 9)).tolist()
    sensors = tuple(
        replace(s, noise=tuple(table), noise_rise=0.1) for s, table in zip(law.sensors, tables, strict=True)
    )
    noisy = replace(PAPER, ambient=replace(law, sensors=sensors))
    light = tuple(range(len(noisy.bands(feeds)) - 8, len(noisy.bands(feeds))))
    task = replace(TASKS["light-seeking"], feeds=feeds, sensors=light, seconds=3.0)
    for level in (1.0, 2.0):
        judge(task, noisy, networks(1)[0], level, 3)


def judge(task, profile, genes, level: float, stream: int, inputs: int = 8) -> int:
    """Compare one trial with the reference's; how many steps were in contact."""
    simulation = Simulation(task, profile, level)
    expected = reference.run(task, profile, genes, level=level, stream=stream)
    got, score = simulation.trajectory(decode(genes, inputs), stream=stream)
    assert fed(got, task.feeds).tolist() == expected.readings
    assert got.inputs.tolist() == expected.inputs
    assert [tuple(row) for row in got.commands.tolist()] == expected.commands
    after = np.column_stack([got.x, got.y, got.heading])[1:]
    np.testing.assert_allclose(after, expected.poses[:-1], rtol=1e-9, atol=1e-9)
    end = got.end.x, got.end.y, got.end.heading
    assert end == pytest.approx(expected.poses[-1], rel=1e-9, abs=1e-9)
    assert got.contact.tolist() == expected.contact
    assert score == pytest.approx(score_of(task, expected), rel=1e-9, abs=1e-12)
    return sum(expected.contact)


def score_of(task, record) -> float:
    """Equations 2 and 3 in NumPy."""
    if task.score is TASKS["light-seeking"].score:
        lamp = task.arena.lamps[0]
        return 1 / sum((x - lamp.x_cm) ** 2 + (y - lamp.y_cm) ** 2 for x, y, _ in record.poses)
    left, right = np.array(record.ground).T
    v = max(0.0, float(np.mean((left + right) / 2))) / 8
    return v * (1 - math.sqrt(min(1.0, abs(float(np.mean(left - right))) / 16)))


def mirrored(genes: np.ndarray) -> np.ndarray:
    """The network with its wheels swapped, and each sensor swapped with its mirror image."""
    order = np.array([5, 4, 3, 2, 1, 0, 7, 6, 9, 8, *range(10, 30)])
    other = genes[order].copy()
    links = other[:, FIRST_LINK:].reshape(30, -1, 4)
    # `order` is its own inverse: a source s is found in slot order[s].
    links[:, :, 1] = np.where(links[:, :, 0] == 1, order[links[:, :, 1]], links[:, :, 1])
    return other


def mirrored_arena(arena: Arena) -> Arena:
    """The room upside down."""
    depth = arena.size_cm[1]
    return replace(
        arena,
        walls=tuple((x0, depth - y0, x1, depth - y1) for x0, y0, x1, y1 in arena.walls),
        cylinders=tuple(replace(c, y_cm=depth - c.y_cm) for c in arena.cylinders),
        lamps=tuple(replace(lamp, y_cm=depth - lamp.y_cm, line_deg=-lamp.line_deg) for lamp in arena.lamps),
    )


@pytest.mark.parametrize("feeds", ["proximity", "ambient"])
def test_mirror_symmetry(feeds):
    """In a mirrored room, the mirrored robot with the mirrored network drives the mirrored path."""
    task = replace(
        TASKS["obstacle-avoidance"], arena=CROWDED, feeds=feeds,
        start=replace(TASKS["obstacle-avoidance"].start, x_cm=22, y_cm=24),
    )  # fmt: skip
    other = replace(task, arena=mirrored_arena(CROWDED), start=replace(task.start, y_cm=45 - 24))
    random = np.random.default_rng(28)
    contacts = 0
    for genes in networks(25):
        x, y, heading = 22.0, 24.0, random.uniform(-3, 3)
        one, score = Simulation(task, PAPER, 0).trajectory(
            decode(genes, 8), stream=0, pose=Pose(x=x, y=y, heading=heading)
        )
        two, mirror_score = Simulation(other, PAPER, 0).trajectory(
            decode(mirrored(genes), 8), stream=0, pose=Pose(x=x, y=45 - y, heading=-heading)
        )
        assert one.commands.tolist() == two.commands[:, ::-1].tolist()
        np.testing.assert_allclose(one.x, two.x, atol=1e-9)
        np.testing.assert_allclose(one.y, 45 - two.y, atol=1e-9)
        np.testing.assert_allclose(one.heading, -two.heading, atol=1e-9)
        assert one.contact.tolist() == two.contact.tolist()
        assert score == pytest.approx(mirror_score, rel=1e-9, abs=1e-12)
        contacts += one.contact.sum()
    assert contacts > 50


def test_each_trial_is_a_function_of_its_stream():
    """Order, number and company of trials never change a bit of a trial's score."""
    for task in TASKS.values():
        simulation = Simulation(replace(task, seconds=3.0), PAPER, "observed")
        genes, draws = networks(40), streams(40, 4)
        together = simulation.scores(decode(genes, 8), draws)
        assert np.unique(together).size > 30
        turned = simulation.scores(decode(genes[::-1], 8), draws[::-1])[::-1]
        swapped = simulation.scores(decode(genes, 8), draws[:, ::-1])[:, ::-1]
        fresh = Simulation(replace(task, seconds=3.0), PAPER, "observed")
        assert (turned == together).all() and (swapped == together).all()
        for i in range(9):
            for t in range(4):
                alone = fresh.scores(decode(genes[i], 8), draws[i : i + 1, t : t + 1])
                assert alone[0, 0] == together[i, t]


def test_starts_fill_their_disc():
    """Starts are uniform in the disc (not crowded in its middle) and in heading."""
    from scipy import stats

    task = TASKS["obstacle-avoidance"]
    simulation = Simulation(task, PAPER, 1)
    starts = [simulation.start(int(s)) for s in streams(3000, 1)[:, 0]]
    place = np.array([(p.x - 25, p.y - 25) for p in starts])
    r2 = (place**2).sum(1) / 9
    assert r2.max() <= 1 + 1e-12
    assert stats.kstest(r2, "uniform").pvalue > 1e-4
    assert stats.kstest(np.sqrt(r2), "uniform").pvalue < 1e-4
    angle = np.mod(np.arctan2(place[:, 1], place[:, 0]) / (2 * math.pi), 1)
    heading = np.array([p.heading for p in starts]) / (2 * math.pi)
    assert stats.kstest(angle, "uniform").pvalue > 1e-4
    assert stats.kstest(heading, "uniform").pvalue > 1e-4


def test_the_documents_show_the_loop_of_the_code():
    """docs/architecture.md has `live_step` and `run_trial` as they stand."""
    page = (Path(__file__).parents[2] / "docs" / "architecture.md").read_text("utf-8")
    for part in (live_step, run_trial):
        assert inspect.getsource(getattr(part, "py_func", part)).partition("\n")[2] in page
