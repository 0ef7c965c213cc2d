"""A network that infrared and light feed: the same in kernels, on bodies, on the twin, in pictures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from realitygap.control.genotype import Genotype
from realitygap.errors import TaskError
from realitygap.robots.drive import drive
from realitygap.simulation.body import SimulatedBody, network_inputs
from realitygap.simulation.simulation import Simulation
from realitygap.tasks import Task, load_task
from realitygap.transfer.rig import Rig
from realitygap.values import fed
from realitygap.world.robot import load_profile

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "seek_in_two_rooms.py"
PAPER = load_profile("paper")


@pytest.fixture(scope="module")
def task() -> Task:
    return load_task(EXAMPLE)


def genotype_for(task: Task) -> Genotype:
    return Genotype.random(5, inputs=len(task.sensors))


def test_kinds_are_kept_in_one_order(task):
    """However they are written, proximity comes before ambient, and one kind stays a word."""
    for feeds in (("ambient", "proximity"), ["proximity", "ambient"], "proximity+ambient"):
        assert replace(task, feeds=feeds).feeds == "proximity+ambient"
    assert replace(task, feeds=("ambient",)).kinds == ("ambient",)
    assert replace(task, sensors=()).of(PAPER).sensors == tuple(range(16))


def test_a_robot_must_have_both_kinds(task):
    """A robot without light sensors is refused by the kind that it lacks; so is a seventeenth input."""
    dark = replace(PAPER, ambient=replace(PAPER.ambient, sensors=()))
    with pytest.raises(TaskError, match=r"feeds: profile 'paper' has no ambient sensors"):
        task.to_kernel(dark)
    with pytest.raises(TaskError, match="has 16, got number 16"):
        replace(task, sensors=(16,)).to_kernel(PAPER)


def test_a_body_lives_the_simulations_trial(task):
    """The loop that drives robots records the kernels' readings, inputs and commands, bit for bit."""
    genotype = genotype_for(task)
    simulation = Simulation(task, PAPER, "observed")
    wanted, _ = simulation.trajectory(genotype.networks(), stream=33, seconds=5)
    body = SimulatedBody(simulation, stream=33)
    controller = genotype.controller()
    made = drive(body, controller, seconds=5, clock=body.clock, inputs=network_inputs(simulation))
    assert (fed(made, task.feeds) == fed(wanted, task.feeds)).all() and fed(made, task.feeds).shape[1] == 16
    assert (made.inputs == wanted.inputs).all() and (made.commands == wanted.commands).all()
    assert len(np.unique(wanted.inputs[:, 6:])) > 3  # the light does feed it


def test_the_twin_feeds_both(task):
    """On the twin, inputs are made of the readings of both kinds by the profile's ranges."""
    genotype = genotype_for(task)
    with Rig(task, PAPER, robot="twin:1") as rig:
        start = Simulation(task, PAPER).start(3)
        made = rig.trial(genotype.controller(), 3, start, 1.0).recording
    rows = fed(made, task.feeds)
    assert rows.shape[1] == 16 and made.ambient.any()
    assert made.inputs.tolist() == [PAPER.inputs(row.tolist(), task.feeds, task.sensors) for row in rows]
