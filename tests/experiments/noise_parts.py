"""A small study of noise whose units are quick: no recordings, and a simulation in the twin's place."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from realitygap.experiments.noise import NoiseConfig
from realitygap.simulation.simulation import Simulation
from realitygap.world.robot import FittedChannel, Profile, Provenance, load_profile

TABLES = ("controllers.csv", "cells.csv", "calibration.csv")


def tiny(**changes: Any) -> NoiseConfig:
    """Two tasks, two levels, two units, two runs each: short trials, little evolution."""
    usual = {"levels": (0.0, 1.0), "runs": 2, "units": 2, "starts": 3}
    return NoiseConfig(**{**usual, "evaluations": 40, "seconds": 3.0, **changes})


def tables(results: Path) -> dict[str, str]:
    """What came out."""
    return {name: (results / name).read_text() for name in TABLES}


class SimulatedRig:
    """A unit of the twin as its own simulation has it, at the twin's noise scale; `profile` has ranges."""

    def __init__(self, task: Any, profile: Any, *, robot: str, twin_noise: float, **_: Any) -> None:
        self.simulation = Simulation(
            task, wearing(unit_profile(int(robot.rpartition(":")[2])), profile), twin_noise
        )
        self.open = True

    def drive(self, driver: Any, stream: int, pose: Any, seconds: float | None = None) -> tuple[Any, Any]:
        """A trial's track and recording; who drives a unit that was let go is told."""
        assert self.open
        networks = driver.genotype.networks()
        one, _ = self.simulation.trajectory(networks, stream=stream, pose=pose, seconds=seconds)
        lived = {name: getattr(one, name) for name in ("proximity", "ambient", "commands")}
        return one.track, SimpleNamespace(**lived, speeds=one.wheels)

    def close(self) -> None:
        """Let it go."""
        self.open = False


def wearing(robot: Profile, own: Profile) -> Profile:
    """A robot whose readings become inputs as `own` makes them."""
    return replace(
        robot,
        infrared=replace(robot.infrared, bands=own.infrared.bands),
        ambient=replace(robot.ambient, bands=own.ambient.bands),
    )


def unit_profile(unit: int) -> Profile:
    """The paper's robot, with other sensors, wheels and bands for each unit."""
    paper, more = load_profile("paper"), 1 + 0.15 * (unit % 100)
    near, light = paper.infrared, paper.ambient
    return replace(
        paper,
        name=f"unit {unit}",
        infrared=replace(
            near,
            bands=(near.bands[0], near.bands[1] - 20.0 * (unit % 100)),
            sensors=tuple(replace(one, a=one.a * more) for one in near.sensors),
        ),
        ambient=replace(light, sensors=tuple(replace(one, gain=one.gain * more) for one in light.sensors)),
        wheels=replace(
            paper.wheels,
            speed_per_unit_cm_s=tuple(0.9 * more * speed for speed in paper.wheels.speed_per_unit_cm_s),
        ),
    )


def unit_by_hand(folder: Path, *, unit: int | str, **_: Any) -> Path:
    """A unit's profile without its recordings."""
    fit = FittedChannel(
        channel="infrared",
        form="extended",
        rmse=20.0,
        model_error=9.0,
        noise=20.0,
        ratio=0.45,
        ratio_over_all=0.3,
    )
    number = int(str(unit).rpartition(":")[2])
    made = replace(unit_profile(number), provenance=Provenance(base="paper", fits=(fit,)))
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "robot.toml").write_text(made.to_toml())
    return folder / "robot.toml"


@contextmanager
def quick_units(*, rig: bool = True) -> Iterator[pytest.MonkeyPatch]:
    """Units that need no recordings, and (`rig`) no twin."""
    import realitygap.calibration.unit
    import realitygap.experiments.noise

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(realitygap.calibration.unit, "calibrated_unit", unit_by_hand)
        if rig:
            patch.setattr(realitygap.experiments.noise, "Rig", SimulatedRig)
        yield patch
