"""Runs an arm of the study of misfit and noise as planned (plan.md, arms.toml).

    python studies/misfit/run.py E --only 1 --out out/misfit/E-1 --hours 1.9
    python studies/misfit/run.py K --out out/misfit/K --data READINGS

Stopped, or out of its hours, it goes on with --resume. `--runs 2 --realities 2 --evaluations 60` is a small
one to try; what it makes is no data.
"""

from __future__ import annotations

import argparse
import sys
import time
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from common import told
from parts import Individual, calibrated_again, genes_of
from realities import Readings

from realitygap.calibration.judge import judge
from realitygap.calibration.load import load_recording
from realitygap.calibration.plan import BEARINGS, DISTANCES_CM
from realitygap.calibration.unit import PROFILE, Unit, calibrated_unit
from realitygap.correspondence.setting import Setting
from realitygap.errors import StudyInterruptedError
from realitygap.experiments.experiment import Recorded, open_folder, session, write_table
from realitygap.experiments.noise import (
    Controller,
    NoiseConfig,
    NoiseExperiment,
    Trials,
    calibration_folder,
    noise_experiment,
)
from realitygap.files import atomic_write
from realitygap.robots.address import Address
from realitygap.simulation.simulation import Simulation
from realitygap.streams import named_stream
from realitygap.study.folder import exists
from realitygap.study.plan import named
from realitygap.study.runner import run_study
from realitygap.transfer.rig import Rig
from realitygap.values import Pose
from realitygap.work.pool import Workers
from realitygap.world.robot import Profile, load_profile

PLAN = tomllib.loads(Path(__file__).with_name("arms.toml").read_text("utf-8"))
RIVAL = PLAN["rival"]
OWN, TABLE = "own, all", "table"
SHARES = {"own, 20 %": 0.2, "own, 5 %": 0.05}
PARTS = ("wheels", "infrared-wall", "infrared-cylinder")


@dataclass(frozen=True, kw_only=True)
class Design(NoiseConfig):
    """An arm. A place is one of its realities with one of its simulations, numbered from 1: what is a unit
    elsewhere. `levels` are those of comparison; `runs` of each place and level, one number a reality. `only`
    one seed set, or 0: an arm may be carried out in two parts. `nominal` is a profile, or a unit's number."""

    COMMAND = "python studies/misfit/run.py"

    arm: str = ""
    seeds: tuple[int, ...] = ()
    evolved: tuple[float, ...] = ()
    realities: tuple[str, ...] = ()
    simulations: tuple[str, ...] = ()
    rivals: tuple[str, ...] = ()
    rivals_evolved: tuple[float, ...] = ()
    nominal: str = ""
    only: int = 0
    runs: tuple[int, ...] = ()  # type: ignore[assignment]
    data: str = ""

    def _check_runs(self) -> None:
        """As planned."""

    @property
    def every_unit(self) -> Sequence[int]:  # type: ignore[override]
        """Numbers of the places."""
        every = range(1, 1 + len(self.realities) * len(self.known))
        return [n for n in every if self.only in (0, *self.sets(self.place(n)))]

    @property
    def known(self) -> tuple[str, ...]:
        """All simulations of a reality."""
        return (*self.simulations, *self.rivals)

    @property
    def command(self) -> str:
        """The command that makes it."""
        return f"{self.COMMAND} {self.arm}"

    def place(self, number: int) -> Place:
        """A place by its number."""
        reality, simulation = divmod(number - 1, len(self.known))
        return Place(number, reality, self.realities[reality], self.known[simulation])

    def address(self, unit: int) -> str:
        """The robot of a place; of arm K's, its reality's name."""
        return f"{'table' if self.arm == 'K' else self.robot or 'twin'}:{self.place(unit).reality}"

    def sets(self, place: Place) -> tuple[int, ...]:
        """The seed sets that a reality belongs to: the first half of the units to one, the second to two; of
        arm K every other day; its first Khepera to both."""
        if self.arm == "K":
            return (1, 2) if place.index == 0 else (2 - place.index % 2,)
        return (1 + 2 * place.index // len(self.realities),)

    def neighbour(self, place: Place) -> str:
        """The next unit of its set, cyclically."""
        ours = [self.place(n) for n in self.every_unit]
        names = list(dict.fromkeys(one.reality for one in ours if self.sets(one) == self.sets(place)))
        return names[(names.index(place.reality) + 1) % len(names)]


class Place(NamedTuple):
    """A reality, by its place among them and its name, and what the simulation knows of it."""

    number: int
    index: int
    reality: str
    simulation: str


def design(arm: str, *, data: str = "", realities: int | None = None, runs: int | None = None,
           seed: int | None = None, **changes: Any) -> Design:  # fmt: skip
    """An arm as planned, but for changes that make it small enough to try."""
    asked = {**PLAN["design"], **PLAN["arm"][arm]}
    if "first_unit" in asked:
        first, count = asked.pop("first_unit"), asked.pop("units")
        asked["realities"] = [str(first + k) for k in range(count)]
        asked["runs"] = [asked["runs"]] * count
    if arm == "E":
        asked |= {"rivals": RIVAL["simulations"], "rivals_evolved": RIVAL["evolved"]}
    asked.pop("individuals", None)
    some = len(asked["realities"]) if realities is None else realities
    asked["realities"] = asked["realities"][:some]
    asked["runs"] = [asked["runs"][k] if runs is None else runs for k in range(some)]
    if asked.get("robot") == "twin":
        del asked["robot"]
    asked = {key: tuple(value) if isinstance(value, list) else value for key, value in asked.items()}
    if seed is not None:
        asked["seeds"] = (seed, seed + 1)
    known = {key: value for key, value in changes.items() if value is not None}
    return Design(arm=arm, units=some, seed=asked["seeds"][0], data=data, **{**asked, **known})


class Drawn(Simulation):
    """The nominal robot with constants drawn about it: each trial is in one of some robots."""

    def __init__(self, spread: float, *made_of: Any) -> None:
        super().__init__(*made_of)
        draw, profile = np.random.default_rng(PLAN["design"]["seeds"][0]), self.profile
        self.robots = [drawn(profile, spread, draw).to_kernel() for _ in range(RIVAL["robots"])]

    def world_of(self, stream: int) -> Any:
        """All that the trial on a stream happens in."""
        return self.world._replace(robot=self.robots[int(stream) % len(self.robots)])

    def worlds(self, streams: Any) -> list[tuple[Any, slice]]:
        """A world for each trial."""
        return [(world, slice(t, t + 1)) for t, world in enumerate(map(self.world_of, streams))]


class Engine(str):
    """The engine of a rival, by its name "nominal, spread × 2"."""

    def __call__(self, *made_of: Any) -> Drawn:
        return Drawn(float(self.rpartition(" ")[2]), *made_of)


def drawn(profile: Profile, spread: float, draw: np.random.Generator) -> Profile:
    """A robot about the nominal one: gains and noise by log-normal factors, the rest normal."""

    def factor(deviation: float) -> float:
        return float(np.exp(spread * deviation * draw.standard_normal()))

    loud = factor(RIVAL["noise"])
    sensors, off = [], np.array([RIVAL["place_cm"], RIVAL["place_cm"], RIVAL["direction_deg"]])
    for one in profile.infrared.sensors:
        gain = factor(RIVAL["gain"])
        x, y, turn = [one.x_cm, one.y_cm, one.direction_deg] + spread * off * draw.standard_normal(3)
        inside = min(1.0, 0.99 * profile.body.radius_cm / np.hypot(x, y))  # no sensor is outside the body
        place = {"x_cm": float(inside * x), "y_cm": float(inside * y), "direction_deg": float(turn)}
        louder = tuple(loud * one for one in one.noise)
        sensors.append(replace(one, a=one.a * gain, b=one.b * gain, noise=louder, **place))
    noise, wheels = profile.noise, profile.wheels
    return replace(
        profile,
        infrared=replace(profile.infrared, sensors=tuple(sensors)),
        noise=replace(noise, proximity=noise.proximity * loud, proximity_dark=noise.proximity_dark * loud),
        wheels=replace(
            wheels, track_cm=wheels.track_cm * factor(RIVAL["track"]),
            speed_per_unit_cm_s=tuple(v * factor(RIVAL["wheels"]) for v in wheels.speed_per_unit_cm_s),
        ),
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Placed(Individual):
    """An individual of a place: `home` is its number."""

    @property
    def key(self) -> tuple[object, ...]:
        """The names of the streams of its trials."""
        names = super().key
        return (*names[:4], self.home, *names[4:])

    @property
    def name(self) -> str:
        """Its name in files and messages."""
        return f"place-{self.home}-{super().name}"


class Study(NoiseExperiment):
    """Its design: each controller drives the reality of its place; two individuals a run."""

    config: Design

    def controllers(self) -> Sequence[Controller]:
        """All individuals, place by place."""
        made = []
        individuals = PLAN["arm"][self.config.arm].get("individuals", ("champion", "fittest"))
        for place in map(self.config.place, self.config.every_unit):
            sets = self.config.sets(place)
            rival = place.simulation in self.config.rivals
            for number in (one for one in sets if self.config.only in (0, one)):
                for level in self.config.rivals_evolved if rival else self.config.evolved:
                    for index in range(1, self.config.runs[place.index] // len(sets) + 1):
                        made += [
                            Placed(
                                task=self.config.tasks[0], level=level, run=index, home=place.number,
                                seed_set=number, individual=who, study=f"place-{place.number}-set-{number}",
                                run_name=f"{self.config.tasks[0]}/{named(level)}/{index}",
                            )
                            for who in individuals
                        ]  # fmt: skip
        return made

    def driven(self, one: Controller) -> tuple[int, ...]:
        """Its own place."""
        return (one.home,)

    def seed(self, seed_set: int) -> int:
        """Of a set."""
        return self.config.seeds[seed_set - 1]

    def start_poses(self, task: str, seed_set: int, unit: int) -> tuple[Pose, ...]:
        """A reality's starts in a set, whatever the simulation."""
        return self.drawn(task, self._own(unit), task, seed_set, self.config.place(unit).reality)

    def genes(self, one: Controller) -> Any:
        """Of its run's champion, or its fittest."""
        return super().genes(one) if one in self.known else genes_of(one, self.study(one.study))

    def _own(self, number: int) -> int:
        """The place of the same reality whose simulation knows all."""
        return number - self.config.known.index(self.config.place(number).simulation)

    def ruler(self, unit: int) -> Profile:
        """Tracks are scored as those of the reality's own robot, whatever the simulation knows."""
        return self.profile(self._own(unit))

    def rig(self, one: Controller, unit: int) -> Rig:
        """Without a camera; a table's robot is its own profile."""
        made = super().rig(one, unit)
        made.filmed = False
        if made.robot.kind == "table":
            made.robot = Address(kind="table", rest=str(self.profile_file(self._own(unit))))
        return made

    # Calibrations

    @cached_property
    def readings(self) -> Readings:
        """Arm K's."""
        return Readings(Path(self.config.data))

    def recorded(self, reality: str) -> Path:
        """The folder of a unit's recordings and whole calibration."""
        return self.folder / "recorded" / f"unit-{reality}"

    def calibrate(self, unit: int, workers: Workers, report: Recorded) -> None:
        """Make a place's profile."""
        config, place = self.config, self.config.place(unit)
        folder, simulation = calibration_folder(self.folder, unit), place.simulation
        folder.mkdir(parents=True, exist_ok=True)
        if config.arm == "K":
            text = (
                self.readings.fitted(place.reality, simulation)
                .named(f"{place.reality}, {simulation}", date="")
                .profile.to_toml()
            )
        elif simulation.startswith("nominal") and not config.nominal.isdecimal():
            text = load_profile(config.nominal).to_toml()
        else:
            reality = place.reality
            if simulation == "another unit":
                reality = config.neighbour(place)
            elif simulation.startswith("nominal"):
                reality = config.nominal
            whole = self._whole(reality, workers, report)
            made = folder / "again"
            if simulation in SHARES:
                whole = calibrated_again(made, of=whole.parent, share=SHARES[simulation], workers=workers)
            elif simulation == "look-up table":
                whole = calibrated_again(made, of=whole.parent, form="lookup", workers=workers)
            text = whole.read_text("utf-8")
        atomic_write(folder / PROFILE, text)

    def _whole(self, reality: str, workers: Workers, report: Recorded) -> Path:
        """A unit's calibration by all of its recordings, which are made first."""
        number = int(reality)
        return calibrated_unit(
            self.recorded(reality), noise=1.0,
            unit=number if self.config.robot is None else f"{self.config.robot}:{number}",
            seed=named_stream(self.config.seed, "calibration", number) >> 1, workers=workers,
            parts=PARTS, bearings=BEARINGS, distances_cm=DISTANCES_CM, on_progress=report,
        )  # fmt: skip

    def misfit(self, place: Place) -> float:
        """Model error over noise, lit: held out where the simulation was fitted to all of the reality's
        readings, else on all of these; 0 where it is the reality."""
        profile = self.profile(place.number)
        fit = next((fit for fit in profile.provenance.fits if fit.channel == "infrared"), None)
        if place.simulation == TABLE:
            return 0.0
        if fit is not None and (place.simulation in (OWN, "look-up table") or place.reality == "khepera-1"):
            return float(fit.ratio)
        if self.config.arm == "K":
            return judge(self.readings.recording(place.reality), profile).ratio
        unit = Unit(self.recorded(place.reality))
        found = [judge(load_recording(unit.recordings / part), profile).ratio for part in PARTS[1:]]
        return float(np.sqrt(np.mean(np.square(found))))

    # Comparisons and tables

    def cell(
        self, one: Controller, simulated: Trials, situated: Trials, setting: Setting
    ) -> dict[str, float]:
        """The usual figures, and the score without jitter."""
        here, there = [*simulated.values()], [*situated.values()]
        found = self.figures(here, there, setting, 1)
        calm = self.figures(here, there, replace(setting, jitter=False), 1)
        return {**found, "without_jitter": calm["score"]}

    def who(self, one: Controller) -> dict[str, object]:
        """The first columns of each row."""
        place = self.config.place(one.home)
        return {
            "set": one.seed_set, "reality": place.reality, "simulation": place.simulation,
            "evolved_level": one.level, "run": one.run, "individual": one.individual,
        }  # fmt: skip

    def controller_row(self, one: Controller, made: Mapping[str, Any]) -> dict[str, object]:
        """Without the mean of its only unit."""
        row = super().controller_row(one, made)
        return {key: value for key, value in row.items() if "_unit" not in key}

    def write_results(self) -> Path:
        """The usual tables, and misfits.csv."""
        folder = super().write_results()
        places = [self.config.place(number) for number in self.config.every_unit]
        rows = [
            {"set": "+".join(map(str, self.config.sets(p))), "reality": p.reality, "simulation": p.simulation,
             "misfit": self.misfit(p)}
            for p in places
        ]  # fmt: skip
        write_table(folder / "misfits.csv", rows)
        return folder


def evolve_rivals(made: Study, recorders: Workers) -> None:
    """The rivals' evolution, with robots drawn about the nominal one, which needs no unit."""
    for study, runs in made.studies.items():
        place = made.config.place(runs[0].home)
        if place.simulation in made.config.rivals:
            if not made.profile_file(place.number).is_file():
                made.calibrate(place.number, recorders, lambda *said: None)
            folder = made.evolved_folder(study)
            print(f"evolving: {place.simulation}, unit {place.reality}", flush=True)
            run_study(folder, made.evolution(study), workers=1, engine=Engine(place.simulation),
                      resume=exists(folder))  # fmt: skip


def main(words: Sequence[str] | None = None) -> None:
    """Carry an arm out, and say where its tables are."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("arm", choices=list(PLAN["arm"]))
    parser.add_argument("--out", type=Path, help="the arm's folder [out/misfit/ARM, or ARM-SET]")
    parser.add_argument("--data", default="", help="of arm K: the folder of the real readings")
    parser.add_argument("--hours", type=float, help="after which it stops, to be resumed")
    parser.add_argument("--only", type=int, choices=(1, 2), help="one seed set; the other in another folder")
    for key in ("runs", "realities", "evaluations", "starts", "seed"):
        parser.add_argument(f"--{key}", type=int, help="to try it out: what it makes is no data")
    parser.add_argument("--seconds", type=float, help="length of a trial, to try it out")
    parser.add_argument("--workers", type=int, help="processes [one a core]")
    parser.add_argument("--resume", action="store_true", help="go on with the arm in the folder")
    asked = vars(parser.parse_args(words))
    arm, out, hours, workers, resume = (
        asked.pop(key) for key in ("arm", "out", "hours", "workers", "resume")
    )
    out = out or Path("out/misfit") / (f"{arm}-{asked['only']}" if asked["only"] else arm)
    until = time.monotonic() + 3600 * (hours or 1e6)

    def on_progress(event: Any) -> None:
        if time.monotonic() > until:
            raise KeyboardInterrupt
        told(event)

    config = Design.from_folder(out) if resume else design(arm, **asked)
    try:
        if config.rivals:
            with session(out, 1):
                open_folder(out, Design, config, resume=resume)
                evolve_rivals(Study(out.resolve(), config), 1)
            resume = True
        where = noise_experiment(
            out, config, kind=Study, settings=Design, workers=workers, resume=resume, on_progress=on_progress
        )
    except StudyInterruptedError as stopped:
        raise SystemExit(f"{stopped}\n{config.command} --out {out} --resume") from None
    print(f"results {where}")


if __name__ == "__main__":
    main()
