"""Every public way into compiled code refuses arrays that do not fit, before anything is compiled on."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import realitygap as rg
from realitygap.control.encoding import check_networks
from realitygap.errors import UsageError
from realitygap.kernels.types import Networks
from realitygap.simulation.body import SimulatedBody

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "follow_the_wall.py"
VARIATION = rg.Variation(start_neurons=0.4)
GENES = np.stack([VARIATION.random(np.uint64(k)) for k in range(2)])
STREAMS = np.zeros((2, 3), np.uint64)


@pytest.fixture(scope="module")
def simulation() -> rg.Simulation:
    """The paper's robot avoiding obstacles for a second."""
    from dataclasses import replace

    return rg.Simulation(replace(rg.load_task("avoidance"), seconds=1.0), "paper")


def nets(**change: object) -> Networks:
    """Two networks with another array, or one value of an array changed: name=(place, value)."""
    made = rg.Genotype.decode(GENES, 8)
    for name, new in change.items():
        if isinstance(new, tuple):
            array = getattr(made, name).copy()
            array[new[0]] = new[1]
            new = array
        made = made._replace(**{name: new})
    return made


BROKEN: dict[str, Networks] = {
    "more neurons than there are": nets(neurons=(0, 23)),
    "no motors": nets(neurons=(1, 1)),
    "a link from nowhere": nets(links=((0, 0, 1), 20000)),
    "a link from below": nets(links=((0, 0, 1), -1)),
    "a link too late": nets(links=((0, 0, 3), 5)),
    "links that end beyond": nets(link_start=((0, 1), 9999)),
    "links that end before they begin": nets(link_start=((0, 1), -1)),
    "a sensor's link to nowhere": nets(sensor_links=((0, 0, 0), 99)),
    "a sensor that is not there": nets(sensor_links=((0, 0, 1), 8)),
    "too many sensor links": nets(sensor_count=(0, 10**6)),
    "weights as floats": nets(links=np.zeros((2, 176, 4))),
    "arrays of another size": nets(thresholds=np.zeros((2, 3), np.int16)),
}


@pytest.mark.parametrize("what", BROKEN)
def test_networks_that_lead_out_of_their_arrays_are_refused(what: str) -> None:
    """A user's encoding never makes compiled code read or write beyond an array."""
    check_networks(nets(), 8)
    with pytest.raises(UsageError, match="networks"):
        check_networks(BROKEN[what], 8)


SCORES: dict[str, Callable[[rg.Simulation], object]] = {
    "more rows of streams than networks": lambda s: s.scores(nets(), np.zeros((5000, 2), np.uint64)),
    "fewer rows of streams": lambda s: s.scores(nets(), STREAMS[:1]),
    "streams of another type": lambda s: s.scores(nets(), np.zeros((2, 3))),
    "streams in a matrix": lambda s: s.scores(nets(), np.matrix(STREAMS)),
    "streams behind a mask": lambda s: s.scores(nets(), np.ma.array(STREAMS, mask=STREAMS == 0)),
    "networks of other shapes": lambda s: s.scores(BROKEN["arrays of another size"], STREAMS),
    "networks of floats": lambda s: s.scores(BROKEN["weights as floats"], STREAMS),
    "genes for networks": lambda s: s.scores(GENES, STREAMS),  # type: ignore[arg-type]
    "more inputs": lambda s: s.scores(nets(inputs=np.full(2, 12)), STREAMS),
    "other inputs than the task": lambda s: s.scores(rg.Genotype.random(1, inputs=4).networks(), STREAMS[:1]),
    "two networks for one trajectory": lambda s: s.trajectory(nets(), stream=1),
    "a stream below 0": lambda s: s.trajectory(rg.Genotype.decode(GENES[0], 8), stream=-1),
    "a stream of 65 bits": lambda s: s.start(2**64),
    "no repetition": lambda s: s.probe(rg.Pose(x=25, y=25, heading=0), repeat=0),
    "repetitions without end": lambda s: s.probe(rg.Pose(x=25, y=25, heading=0), repeat=10**12),
    "seconds without end": lambda s: s.trajectory(rg.Genotype.decode(GENES[0], 8), stream=1, seconds=1e12),
    "a command beyond the robot's": lambda s: SimulatedBody(s).act(rg.Command(left=10**12, right=0)),
    "a body on half a stream": lambda s: reset_on(s, 2.5),
    "a body on a stream below 0": lambda s: reset_on(s, -2),
    "an output between two": lambda s: s.profile.wheels.command(0.4),
    "an output beyond the ten": lambda s: s.profile.wheels.command(25),
    "an output that is no number": lambda s: s.profile.wheels.command(float("nan")),
}


def reset_on(simulation: rg.Simulation, stream: object) -> None:
    """A simulated body that is put on another stream."""
    body = SimulatedBody(simulation)
    body.stream = stream  # type: ignore[assignment]
    body.reset()


@pytest.mark.parametrize("call", SCORES.values(), ids=SCORES.keys())
def test_a_simulation_refuses_what_does_not_fit(simulation, call):
    """Each wrong array, stream, pose or length is a UsageError, not a crash and not a score."""
    with pytest.raises(rg.UsageError):
        call(simulation)


def test_what_fits_is_scored(simulation):
    """The networks that the table spoils are scored as they are; none at all have no scores."""
    assert np.isfinite(simulation.scores(nets(), STREAMS)).all()
    nobody = rg.Genotype.decode(GENES[:0], 8)
    assert simulation.scores(nobody, STREAMS[:0]).shape == (0, 3)
    assert simulation.tracks(nobody, STREAMS[:0]).x.shape[:2] == (0, 3)


def test_a_task_of_a_file_is_named_by_its_file():
    """A Task stands for the file that it came from; one that was changed in Python is refused."""
    from dataclasses import replace

    task = rg.load_task(EXAMPLE)
    assert rg.StudyConfig.single(task).conditions[0].task == str(EXAMPLE)
    for changed in (replace(task, seconds=3.0), replace(task, score=lambda path, room: 1.0)):
        with pytest.raises(rg.UsageError, match=r"no longer matches .*follow_the_wall\.py"):
            rg.StudyConfig.single(changed)
    with pytest.raises(rg.UsageError, match="loaded from a file"):
        rg.StudyConfig.single(replace(task, source=None))
