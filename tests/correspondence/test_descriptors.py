"""The descriptors, on tracks made of stretches whose amounts are plain, and of batches of trials."""

from dataclasses import replace

import numpy as np
import pytest

from realitygap import Genotype, Simulation, describe
from realitygap.correspondence.descriptors import chosen, describe_all
from realitygap.correspondence.setting import fits
from realitygap.correspondence.trials import STEP_S, Trial, read_transfer
from realitygap.errors import UsageError
from realitygap.tasks.load import load_task
from realitygap.world.robot import load_profile
from tests.correspondence.tracks import mirrored


def drive(*stretches: tuple[float, float, float]) -> Trial:
    """A track of stretches (seconds, cm/s forward, deg/s leftward)."""
    pace = np.concatenate([np.tile(amounts, (round(seconds / STEP_S), 1)) for seconds, *amounts in stretches])
    heading = np.append(0.0, np.cumsum(np.radians(pace[:, 1]) * STEP_S))
    middle = (heading[1:] + heading[:-1]) / 2
    x, y = (np.append(0.0, np.cumsum(pace[:, 0] * STEP_S * f(middle))) for f in (np.cos, np.sin))
    return Trial(x=x + 25.0, y=y + 25.0, heading=heading)


def told(trial: Trial) -> dict[str, float]:
    """Its descriptors of motion alone."""
    return {name: float(values[0]) for name, values in describe_all([trial], None).items()}


def test_backward_is_a_share_of_time():
    """Three seconds of ten backward are 0.3, wherever the robot looks; one reversal there, one back."""
    made = told(drive((4, 3, 20), (3, -3, 20), (3, 3, 20)))
    assert made["backward"] == pytest.approx(0.3, abs=0.03)
    assert made["reversals"] == pytest.approx(2.0)


def test_a_robot_that_turns_on_the_spot_is_not_still():
    """Still is neither going nor turning: of ten seconds, five turned on the spot, three are still."""
    made = told(drive((2, 3, 0), (5, 0, 60), (3, 0, 0)))
    assert made["still"] == pytest.approx(0.3, abs=0.03)


def test_turns_have_a_side():
    """Three turns to the left are 1, to the right -1; one to each side are 0; a larger one tells more."""
    leftward = drive(*[(1, 3, 0), (1, 0, 60)] * 3, (1, 3, 0))
    assert told(leftward)["turns"] == pytest.approx(3 / 0.7)
    assert told(leftward)["side of turns"] == pytest.approx(1.0)
    assert told(*mirrored([leftward], 50.0))["side of turns"] == pytest.approx(-1.0)
    even = told(drive((1, 3, 0), (1, 0, 60), (1, 3, 0), (1, 0, -60), (1, 3, 0)))
    assert even["side of turns"] == pytest.approx(0.0, abs=1e-9) and even["one-sidedness"] < 1e-9
    more = told(drive((1, 3, 0), (1, 0, 60), (1, 3, 0), (2, 0, -60), (1, 3, 0)))
    assert more["side of turns"] == pytest.approx((60**2 - 120**2) / (60**2 + 120**2), abs=0.03)


def test_a_wider_body_is_nearer_to_what_stands_around_it():
    """Clearance counts from the body's own edge; a Khepera measured at 2.75 cm is told as 2.9 cm."""
    arena, paper = load_task("avoidance").arena, drive((5, 3, 40), (5, 3, -20))
    bodies = [replace(paper, radius_cm=radius) for radius in (2.9, 2.75, 4.5, 1.5)]
    made = describe_all(bodies, arena)
    clearance = made["clearance"]
    assert clearance - clearance[0] == pytest.approx([0.0, 0.0, -1.6, 1.4])
    assert all(values[0] == values[1] for values in made.values())
    assert made["near"][2] >= made["near"][0] >= made["near"][3]
    assert fits(arena, np.array([2.0]), np.array([25.0]), 2.9)
    assert not fits(arena, np.array([2.0]), np.array([25.0]), 4.5)


@pytest.mark.parametrize("folder", [None, "a/b"])
def test_a_transfers_body_is_its_studys(tmp_path, folder):
    """A transfer's trials are of the body that its study's profile has; elsewhere of a Khepera's."""
    paper = load_profile("paper")
    wide = replace(paper, body=replace(paper.body, radius_cm=4.0))
    (tmp_path / "profile.toml").write_text(wide.to_toml())
    place = tmp_path / (folder or "transfer/twin-1") / "run-1" / "start-1"
    place.mkdir(parents=True)
    (place / "transfer.toml").write_text("")
    rows = [f"{k / 10:.1f},{10 + k / 10:.6f},20.000000,0.000000" for k in range(31)]
    for name in ("simulated.csv", "situated.csv"):
        (place / name).write_text("\n".join(["t_s,x_cm,y_cm,heading_deg", *rows]) + "\n")
    if folder:
        (tmp_path / "profile.toml").unlink()
    for (trial,) in read_transfer(tmp_path):
        assert trial.radius_cm == (2.9 if folder else 4.0)


@pytest.mark.parametrize("name", ["avoidance", "light"])
def test_each_trial_of_a_batch_is_told_as_alone(name):
    """Tracks are the trajectories', descriptors those of their trials; an array [networks, trials] each."""
    simulation = Simulation(load_task(name), load_profile("paper"))
    genes = [Genotype.braitenberg(simulation.task.feeds).genes, Genotype.constant(3, 2).genes]
    networks, streams = Genotype.decode(np.stack(genes), 8), np.arange(6, dtype=np.uint64).reshape(2, 3)
    path = simulation.tracks(networks, streams)
    made = describe(path, name, "paper")
    assert {d.name for d in chosen(simulation.task.arena)} <= set(made)
    for n in range(2):
        alone, _ = simulation.trajectory(Genotype.decode(genes[n], 8), stream=int(streams[n, 1]))
        track = alone.track
        assert (path.x[n, 1] == track.x[1:]).all() and (
            path.contact[n, 1] > 0
        ).tolist() == alone.contact.tolist()
        trial = Trial(x=track.x[1:], y=track.y[1:], heading=np.unwrap(alone.track.heading)[1:])
        for key, values in describe_all([trial], simulation.task.arena).items():
            assert made[key].shape == (2, 3)
            assert made[key][n, 1] == pytest.approx(values[0], rel=1e-6, abs=1e-6, nan_ok=True), key


def test_a_path_of_another_place_is_refused():
    """Outside the task's arena nothing around the robot is what it was."""
    light = Simulation("light", "paper")
    path = light.tracks(Genotype.braitenberg("ambient").networks(), np.array([[1, 2]], np.uint64))
    with pytest.raises(UsageError, match=r"inside the arena of task 'obstacle-avoidance'.*simulation\.task"):
        describe(path, "avoidance", "paper")
