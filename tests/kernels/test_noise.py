"""Noise of level L has L times the observed deviation on every channel, and is normal."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from realitygap.control.genotype import Genotype
from realitygap.errors import ConfigError
from realitygap.simulation.simulation import Simulation
from realitygap.streams import BETWEEN
from realitygap.tasks import load_task
from realitygap.values import Pose
from tests.kernels.reference.draws import normals, substream
from tests.kernels.reference.motion import Wheel
from tests.kernels.scenes import PAPER, readings

ALARM = 1e-4
"""A level is doubted below this p-value."""
REPEAT = 20_000
LEVELS = (0.5, 1.0, 2.0)
AT_WALL = Pose(x=50 - 2.45 - 3.8, y=25, heading=0.0)
AVOIDANCE, SEEKING = load_task("avoidance"), load_task("light")


def consistent(noise: np.ndarray, deviation: float) -> bool:
    """Numbers that are normal with mean 0 and this deviation, as far as their number can tell."""
    spread = np.sum((noise / deviation) ** 2)
    tail = stats.chi2.sf(spread, noise.size)
    return min(tail, 1 - tail) > ALARM / 2 and stats.kstest(noise / deviation, "norm").pvalue > ALARM


def spread_out(counts: np.ndarray) -> np.ndarray:
    """Whole counts with the rounding undone by chance, so that they can be compared with a smooth law."""
    return counts + np.random.default_rng(17).uniform(-0.5, 0.5, counts.shape)


def with_rounding(deviation: float) -> float:
    """The deviation after rounding and `spread_out`: each adds a twelfth to the variance."""
    return float(np.sqrt(deviation**2 + 1 / 6))


def lit_proximity(level: float) -> np.ndarray:
    """Noise of one sensor in the middle of its range, against a wall."""
    free, _ = readings(PAPER, AVOIDANCE.arena, (AT_WALL.x, AT_WALL.y, AT_WALL.heading))
    assert 300 < free[2] < 700
    counts, _ = Simulation(AVOIDANCE, PAPER, level).probe(AT_WALL, stream=18, repeat=REPEAT)
    return spread_out(counts[:, 2]) - free[2]


def ambient(level: float) -> np.ndarray:
    """Noise of one ambient sensor."""
    pose = Pose(x=60, y=35, heading=0.0)
    _, free = readings(PAPER, SEEKING.arena, (pose.x, pose.y, pose.heading))
    _, counts = Simulation(SEEKING, PAPER, level).probe(pose, stream=19, repeat=REPEAT)
    return spread_out(counts[:, 2]) - free[2]


def turning(level: float) -> np.ndarray:
    """Relative errors of the speeds that the wheels achieved, over one long trial."""
    simulation = Simulation(AVOIDANCE, PAPER, level)
    nets = Genotype.constant(6, -9).networks()
    trajectory, _ = simulation.trajectory(nets, stream=20, seconds=REPEAT / 10)
    errors = []
    for w, command in enumerate((6, -9)):
        law, achieved = Wheel(PAPER), trajectory.wheels[:, w] * 0.8
        for speed in achieved:
            free = law.turn(command * 0.8, drag=0.0)
            errors.append(speed / free - 1)
            law.speed = float(speed)
    return np.array(errors)


CHANNELS = [(lit_proximity, 21.0, True), (ambient, 4.5, True), (turning, 0.058, False)]


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize(("measured", "observed", "whole"), CHANNELS)
def test_deviation_and_law(measured, observed, whole, level):
    """Proximity 21 counts, ambient 4.5 counts, wheel speed 5.8 %, each times the level, each normal."""
    noise, deviation = measured(level), level * observed
    assert consistent(noise, with_rounding(deviation) if whole else deviation)
    # And another level is found out, if it is only 8 % off.
    wrong = 1.08 * deviation
    assert not consistent(noise, with_rounding(wrong) if whole else wrong)


def test_a_wrong_law_is_found_out():
    """Noise of the right deviation that is not normal does not pass."""
    random = np.random.default_rng(21)
    uniform = random.uniform(-1, 1, REPEAT) * np.sqrt(3) * 21
    assert uniform.std() == pytest.approx(21, rel=0.01) and not consistent(uniform, 21.0)
    assert consistent(random.normal(0, 21, REPEAT), 21.0)


@pytest.mark.parametrize("level", LEVELS)
def test_dark_proximity(level):
    """Where the noise-free reading is 0, counts are the upper half of a deviation of 3.3."""
    pose = Pose(x=25, y=25, heading=0.0)
    free, _ = readings(PAPER, AVOIDANCE.arena, (25, 25, 0.0))
    assert (free == 0).all()
    counts, _ = Simulation(AVOIDANCE, PAPER, level).probe(pose, stream=22, repeat=REPEAT // 4)

    def doubt(deviation: float) -> float:
        borders = np.array([0.5, *np.arange(1, 12) + 0.5]) * level
        below = stats.norm.cdf(np.floor(borders) + 0.5, 0, deviation)
        law = np.diff([0, *np.unique(below), 1])
        edges = np.unique(np.floor(borders) + 0.5)
        seen = np.bincount(np.searchsorted(edges, counts.ravel()), minlength=law.size)
        return stats.chisquare(seen, law * counts.size).pvalue

    assert doubt(3.3 * level) > ALARM > doubt(3.3 * level * 1.05)


def starts_at_once(level: float, command: float, count: int = 20_000) -> int:
    """Of how many resting wheels moves the left one in the first step, at this speed (cm/s)?"""
    wheels = replace(PAPER.wheels, speed_per_unit_cm_s=(command, command))
    task = replace(AVOIDANCE, seconds=0.1, score=first_speed)
    simulation = Simulation(task, replace(PAPER, wheels=wheels), level)
    nets = Genotype.constant(1, 1).networks()
    streams = np.random.default_rng(23).integers(0, 2**63, (1, count)).astype(np.uint64)
    return int(np.count_nonzero(simulation.scores(nets, streams)))


def first_speed(path, room):
    return path.left[0]


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("command", [0.7, 0.9, 1.5, 1.8])
def test_friction(command, level):
    """A wheel starts where |I| passes 12·(1 + 0.3·level·z): at each command as often as that says."""
    moved = starts_at_once(level, command)

    def doubt(actual: float) -> float:
        share = stats.norm.cdf((10 * command / 12 - 1) / (0.3 * actual))
        return stats.binomtest(moved, 20_000, share).pvalue

    assert doubt(level) > ALARM > doubt(level * 1.5)


def test_zero_noise_is_none():
    """At level 0 nothing is drawn: all streams give the same readings and the same trial."""
    pose = Pose(x=10, y=25, heading=1.0)
    simulation = Simulation(AVOIDANCE, PAPER, 0)
    proximity, light = simulation.probe(pose, repeat=5)
    assert (proximity == proximity[0]).all() and (light == light[0]).all()
    nets = Genotype.constant(4, 5).networks()
    paths = [simulation.trajectory(nets, stream=s, pose=pose)[0].x for s in (1, 2)]
    assert (paths[0] == paths[1]).all()


def test_channels_are_independent():
    """Noise of one sensor says nothing about another's, nor about that of the next trial."""
    counts, _ = Simulation(AVOIDANCE, PAPER, 1).probe(AT_WALL, stream=24, repeat=REPEAT)
    lit = [k for k in range(8) if 100 < counts[:, k].mean() < 900]
    assert len(lit) >= 2
    _, light = Simulation(SEEKING, PAPER, 1).probe(Pose(x=60, y=35, heading=0.2), stream=24, repeat=REPEAT)
    for table in (counts[:, lit], light):
        correlations = np.corrcoef(table.T) - np.eye(table.shape[1])
        assert np.abs(correlations).max() < 5 / np.sqrt(REPEAT)
        serial = [np.corrcoef(table[1:, k], table[:-1, k])[0, 1] for k in range(table.shape[1])]
        assert np.abs(serial).max() < 5 / np.sqrt(REPEAT)


@pytest.mark.parametrize("level", [1.0, 2.0])
def test_noise_between_recordings_is_drawn_once_a_trial(level):
    """Each sensor's reading is shifted by one normal number, times a deviation by the reading, all along; by
    nothing if the profile is not told to draw it. Reference: NumPy and the streams' published draws."""
    table = (4.0, 20.0, 60.0)
    law = replace(PAPER.infrared, between=table)
    plain = replace(PAPER.noise, proximity=0.0, proximity_dark=0.0)
    profile = replace(PAPER, infrared=law, noise=plain)
    free, _ = readings(PAPER, AVOIDANCE.arena, (AT_WALL.x, AT_WALL.y, AT_WALL.heading))
    nets = Genotype.constant(0, 0).networks()
    z = np.array(normals(substream(7, BETWEEN), 0, 16)[:8])
    size = np.interp(free, np.linspace(0.0, law.top, 3), table)
    expected = np.floor(np.clip(free + level * size * z, 0.0, law.top) + 0.5)
    seen, _ = Simulation(AVOIDANCE, profile.with_between(), level).trajectory(nets, stream=7, pose=AT_WALL)
    assert (seen.proximity == expected).all() and not np.array_equal(expected, np.floor(free + 0.5))
    still, _ = Simulation(AVOIDANCE, profile, level).trajectory(nets, stream=7, pose=AT_WALL)
    assert (still.proximity == np.floor(free + 0.5)).all()
    counts, _ = Simulation(AVOIDANCE, profile.with_between(), level).probe(AT_WALL, stream=18, repeat=REPEAT)
    assert consistent(spread_out(counts[:, 2]) - free[2], with_rounding(level * size[2]))
    with pytest.raises(ConfigError, match="noise between recordings: profile 'paper': expected"):
        PAPER.with_between()
