"""table:PROFILE: recorded readings in the place of a robot."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from realitygap.calibration.plan import Plan, tasks_of
from realitygap.control.genotype import Genotype
from realitygap.errors import UsageError
from realitygap.kernels.rng import substream
from realitygap.robots.address import Address, StandIn
from realitygap.simulation.simulation import Simulation
from realitygap.simulation.table import TableBody
from realitygap.streams import TWIN_NOISE
from realitygap.tasks import load_task
from realitygap.testing import BodyContract
from realitygap.transfer.rig import Rig
from realitygap.values import Command, Pose
from realitygap.world.robot import Profile, load_profile
from realitygap.world.sensors import LookUp

PAPER, TASK = load_profile("paper"), load_task("avoidance")


def profile(*, cylinder: float = 0.5) -> Profile:
    """A robot whose sensors see what is less than 4 cm ahead of each, a cylinder as a share of a wall."""
    ahead = [[900.0 if k == b else 100.0 for b in range(8)] + [10.0] * 8 for k in range(8)]
    table = LookUp(
        nothing=(10.0,) * 8, wall_cm=(0.5, 4.0), wall=tuple(map(tuple, ahead)), cylinder_cm=(0.5, 4.0),
        cylinder=tuple(tuple(max(10.0, cylinder * v) for v in row) for row in ahead),
    )  # fmt: skip
    return replace(PAPER, name="k", infrared=replace(PAPER.infrared, table=table))


@pytest.fixture
def file(tmp_path: Path) -> Path:
    (tmp_path / "k.toml").write_text(profile().to_toml(), encoding="utf-8")
    return tmp_path / "k.toml"


class TestContract(BodyContract):
    """It does what every body must do."""

    @contextmanager
    def opened(self) -> Iterator[tuple[TableBody, object]]:
        with closing(TableBody(profile(), base="paper")) as body:
            body.enter({"size_cm": [50.0, 50.0]}, 1, None)
            yield body, body.clock


def test_a_drive_is_a_trial_in_the_tables_own_simulation(file: Path) -> None:
    """To the bit: nothing but the readings' source is new. The next trial does not know of it."""
    genes, pose = Genotype.braitenberg(TASK.feeds), Pose(x=25.0, y=8.0, heading=0.5)
    with Rig(TASK, load_profile(file), robot=f"table:{file}") as rig:
        driven = [rig.drive(genes.controller(), stream, pose)[0] for stream in (7, 8, 7)]
    own, _ = Simulation(TASK, load_profile(file)).trajectory(
        genes.networks(), stream=int(substream(np.uint64(7), np.uint64(TWIN_NOISE))), pose=pose
    )
    for k in (0, 2):
        np.testing.assert_array_equal(driven[k].x[:-1], own.x)
        np.testing.assert_allclose(driven[k].heading[:-1], own.heading, atol=1e-12)
    assert (driven[0].x != driven[1].x).any() and driven[0].seen_by == "robot"


def test_it_obeys_the_units_of_its_profile() -> None:
    """Of a robot whose top command is 100, 50 is half of its speed."""
    made = profile()
    wheels = replace(made.wheels, top_command=100.0, speed_per_unit_cm_s=(0.08, 0.08))
    with closing(TableBody(replace(made, wheels=wheels), noise=0.0, base="paper")) as body:
        begun = body.pose
        body.act(Command(left=50, right=50))
        body.clock.sleep_until(2.0)
        assert body.pose.x - begun.x == pytest.approx(2.0 * 50 * 0.08, rel=0.1)


def test_what_was_not_recorded_is_not_recorded_of_it() -> None:
    """One that reads cylinders as it does walls has no cylinder's readings; neither knows its wheels."""
    for share, objects in ((0.5, ("wall", "cylinder")), (1.0, ("wall",))):
        body = TableBody(profile(cylinder=share), base="paper")
        tasks = tasks_of(Plan(kind="infrared", base=PAPER), body)
        assert body.infrared_objects == objects and len(tasks) == len(objects)
        assert not body.counts_turns and body.odometry.counters is None


def test_what_it_cannot_be_is_refused(tmp_path: Path, file: Path) -> None:
    """A profile without a table; surfaces that were not recorded. It is not called a robot."""
    (tmp_path / "law.toml").write_text(PAPER.to_toml(), encoding="utf-8")
    with pytest.raises(UsageError, match="--form lookup"):
        Address.parse(f"table:{tmp_path / 'law.toml'}").open()
    with closing(Address.parse(f"table:{file}").open()) as body, pytest.raises(UsageError, match="surfaces"):
        body.enter({"size_cm": [50.0, 50.0], "reflectance": [1.0]}, 0, None)
    address = Address.parse(f"table:{file}")
    stood = StandIn.of_folder(address.folder())
    assert address.port is None and stood is not None
    assert (stood.words, stood.kind) == ("recorded readings k", "recorded readings")
