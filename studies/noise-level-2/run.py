"""Runs an arm of the second study of noise as planned (plan.md, arms.toml).

    python studies/noise-level-2/run.py E --out out/noise-level-2/E

The tables reported here were made by the versions that README.md names; today's twin and calibrations come
to other digits. Stopped, it goes on with --resume. `--runs 1 --units 2` is a small one to try.
"""

import argparse
import math
import sys
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from common import told
from parts import Individual, genes_of

from realitygap.correspondence.setting import Setting
from realitygap.experiments.experiment import write_table
from realitygap.experiments.noise import (
    Controller,
    NoiseConfig,
    NoiseExperiment,
    Trials,
    noise_experiment,
)
from realitygap.kernels.rng import substream
from realitygap.robots.drive import Recording
from realitygap.simulation.simulation import batch_streams
from realitygap.streams import named_stream
from realitygap.study.plan import named
from realitygap.track import Track
from realitygap.transfer.scores import DISTANCES, distances
from realitygap.values import Pose, fed

PLAN = tomllib.loads(Path(__file__).with_name("arms.toml").read_text("utf-8"))
AS_MEASURED = 1.0
"""The level of the simulations that are compared without a camera."""
PSEUDO, PSEUDO_REALITIES, PSEUDO_SPREAD = 8, 200, 0.1
"""Trials of each champion, each with a robot whose constants are drawn within ±10 % of the profile's."""


@dataclass(frozen=True, kw_only=True)
class Design(NoiseConfig):
    """An arm; `runs` are those of each level, over both sets of seeds; `foreign` units follow the own one."""

    COMMAND = "python studies/noise-level-2/run.py"

    arm: str = ""
    runs: tuple[int, ...] = ()  # type: ignore[assignment]
    seeds: tuple[int, ...] = ()
    first_unit: int = 101
    foreign: int = 3
    fittest: bool = True
    starts_by_unit: bool = True

    def _check_runs(self) -> None:
        """As planned."""

    @property
    def every_unit(self) -> range:
        """Numbers of the units."""
        return range(self.first_unit, self.first_unit + self.units)

    @property
    def command(self) -> str:
        """The command that makes it."""
        return f"{self.COMMAND} {self.arm}"


def design(arm: str, **changes: Any) -> Design:
    """An arm as planned, but for changes that make it small enough to try."""
    made = Design(arm=arm, seed=PLAN["design"]["seeds"][0], **{**PLAN["design"], **PLAN["arm"][arm]})
    runs = changes.pop("runs", None)
    if runs is not None:
        made = replace(made, runs=(runs * len(made.seeds),) * len(made.levels))
    known = {key: value for key, value in changes.items() if value is not None}
    made = replace(made, **known)
    return replace(made, foreign=min(made.foreign, made.units - 1))


class SecondStudy(NoiseExperiment):
    """Its design: sixteen units, two sets of seeds, starts of each unit's own, two individuals a run."""

    config: Design

    def controllers(self) -> Sequence[Controller]:
        """All individuals, by task and calibration unit; levels with other numbers of runs evolve apart."""
        config, sets = self.config, len(self.config.seeds)
        last = {level: runs // sets for level, runs in zip(config.levels, config.runs, strict=True)}
        return [
            Individual(
                task=task, level=level, run=run, home=home, seed_set=number, individual=who,
                study=f"set-{number}-unit-{home}-runs-{last[level]}",
                run_name=f"{task}/{named(level)}/{index}",
            )
            for task in config.tasks
            for home in config.every_unit
            for number in range(1, sets + 1)
            for level in config.levels
            for index, run in enumerate(self._runs(home, last[level]), start=1)
            for who in ("champion", "fittest")
        ]  # fmt: skip

    def _runs(self, home: int, last: int) -> range:
        """Numbers of a set's runs that are calibrated to a unit: the units take turns."""
        return range(home - self.config.first_unit + 1, last + 1, self.config.units)

    def driven(self, one: Controller) -> tuple[int, ...]:
        """A champion's own unit and the next ones, cyclically; a fittest individual's own unit."""
        units, more = self.config.every_unit, self.config.foreign if one.individual == "champion" else 0
        return tuple(units[(units.index(one.home) + k) % len(units)] for k in range(more + 1))

    def seed(self, seed_set: int) -> int:
        """Of a set of runs."""
        return self.config.seeds[seed_set - 1]

    def start_poses(self, task: str, seed_set: int, unit: int) -> tuple[Pose, ...]:
        """Starts of the trials on a unit: its own, for both sets."""
        return self.drawn(task, unit, task, "unit", unit)

    def start_label(self, pair: Any) -> str:
        """A start's name: units share none."""
        return f"{pair.unit}.{pair.start}"

    def genes(self, one: Controller) -> Any:
        """Of its run's champion, or its fittest."""
        return super().genes(one) if one in self.known else genes_of(one, self.study(one.study))

    def keep(self, track: Track, made: Recording, task: Any) -> dict[str, Any]:
        """Paths, and in single precision what the robot read and did."""
        read = {"readings": fed(made, task.feeds), "commands": made.commands, "speeds": made.speeds}
        return {**super().keep(track, made, task), **{k: np.asarray(v, np.float32) for k, v in read.items()}}

    def cell(
        self, one: Controller, simulated: Trials, situated: Trials, setting: Setting
    ) -> dict[str, float]:
        """The usual figures, and without the score's jitter; both also on the calibration unit."""
        found = super().cell(one, simulated, situated, setting)
        calm, units = replace(setting, jitter=False), self.driven(one)
        for where, some in (("", units), ("_home", (one.home,))):
            pairs = [pair for pair in situated if pair.unit in some]
            here, there = ([side[pair] for pair in pairs] for side in (simulated, situated))
            found[f"without_jitter{where}"] = self.figures(here, there, calm, len(some))["score"]
            if where:
                found["layout_home"] = self.figures(here, there, setting, 1)["layout"]
        return found

    def compare(self, one: Controller, tell: Callable[[float], None]) -> dict[str, Any]:
        """The usual comparisons; of a champion also by what robots read and did, without a camera."""
        found = super().compare(one, tell)
        return found | (self._without_camera(one) if one.individual == "champion" else {})

    def _without_camera(self, one: Controller) -> dict[str, Any]:
        """Distances on each unit from simulations as noisy as the robots; and fitness in pseudo-realities."""
        driven, task = self.read_driven(one), self.task(one.task)
        pairs = list(self.seen(one, driven)[0])
        networks = self.networks(one)
        units: dict[int, list[dict[str, float]]] = {unit: [] for unit in driven.units}
        for pair in pairs:
            levels = (AS_MEASURED, 0.0)
            noisy, quiet = (self.simulation(one.task, pair.unit, one.home, level) for level in levels)
            pose = self.starts(one.task, one.seed_set, pair.unit)[pair.start - 1]
            stream = named_stream(self.seed(one.seed_set), "simulated", *one.key, *pair)
            trajectory, _ = noisy.trajectory(networks, stream=stream, pose=pose)
            recording = self._recording(one, driven, pair)
            row = distances(trajectory, recording, driven.track(*pair), pose, quiet)
            parts = [row[key] for key in DISTANCES[:3] if math.isfinite(row[key])]
            units[pair.unit].append({**row, "distance": float(np.mean(parts))})
        stream = named_stream(self.config.seed, "pseudo", one.task, one.home)
        home = self.simulation(one.task, one.home, one.home, 0.0)
        pseudo = type(home)(task.under(PSEUDO_SPREAD, PSEUDO_SPREAD), home.profile, 1.0)
        streams = batch_streams(int(substream(np.uint64(stream), np.uint64(PSEUDO))), PSEUDO_REALITIES)[None]
        return {
            "without_camera": {
                str(unit): {key: _mean([row[key] for row in rows]) for key in (*DISTANCES, "distance")}
                for unit, rows in units.items()
            },
            "fitness_pseudo": float(pseudo.scores(networks, streams).mean()),
        }

    def _recording(self, one: Controller, driven: Any, pair: Any) -> Recording:
        """A trial's recording, as far as it was kept."""
        place = driven.units.index(pair.unit), pair.start - 1
        readings, commands, speeds = (
            driven.more[key][place].astype(np.float64) for key in ("readings", "commands", "speeds")
        )
        steps, kinds = len(readings), self.task(one.task).kinds
        ends = np.cumsum([len(self.profile(pair.unit).channel(kind).sensors) for kind in kinds])[:-1]
        columns = dict.fromkeys(("proximity", "ambient"), np.empty((steps, 0)))
        columns.update(zip(kinds, np.split(readings, ends, axis=1), strict=True))
        unknown = np.full((steps, 2), np.nan)
        return Recording(
            t=np.arange(steps, dtype=np.float64) * driven.period_s, late=np.zeros(steps),
            inputs=np.empty((steps, 0), np.int64), commands=commands.astype(np.int64), counters=unknown,
            speeds=speeds, read=unknown[:, 0], ended="finished", **columns,
        )  # fmt: skip

    # Tables

    def who(self, one: Controller) -> dict[str, object]:
        """The first columns of each row."""
        key = {"task": one.task, "seed_set": one.seed_set, "run": one.run}
        return {**key, "evolved_level": one.level, "individual": one.individual}

    def controller_row(self, one: Controller, made: Mapping[str, Any]) -> dict[str, object]:
        """With fitness on the calibration unit, and its mean over foreign ones."""
        row = {k: v for k, v in super().controller_row(one, made).items() if "_unit_" not in k}
        home, foreign = self._apart(one, made, "fitness_situated")
        trials = row.pop("trials")
        return {**row, "fitness_situated_home": home, "fitness_situated_foreign": foreign, "trials": trials}

    def cell_row(self, one: Controller, cell: Mapping[str, Any]) -> dict[str, object]:
        """With the score on the calibration unit, and its mean over foreign ones."""
        home, foreign = self._apart(one, cell, "score")
        kept = {k: v for k, v in cell.items() if "_unit_" not in k}
        return {**self.who(one), **kept, "score_home": home, "score_foreign": foreign}

    def _apart(self, one: Controller, made: Mapping[str, Any], key: str) -> tuple[float, float]:
        units = {unit: made[f"{key}_unit_{unit}"] for unit in self.driven(one)}
        home = units.pop(one.home)
        return home, _mean(list(units.values()))

    def write_results(self) -> Path:
        """The usual tables, without-camera.csv, and every unit's profile."""
        folder = super().write_results()
        rows: list[dict[str, object]] = []
        for one in self.controllers():
            if one.individual == "champion":
                made = self.read_compared(one)
                cell = next(cell for cell in made["cells"] if cell["comparison_level"] == AS_MEASURED)
                for unit in self.driven(one):
                    rows.append({
                        **self.who(one), "unit": unit, **made["without_camera"][str(unit)],
                        "correspondence": cell[f"score_unit_{unit}"],
                        "fitness_simulated": cell["fitness_simulated"],
                        "fitness_situated": made[f"fitness_situated_unit_{unit}"],
                        "fitness_pseudo": made["fitness_pseudo"],
                    })  # fmt: skip
        write_table(folder / "without-camera.csv", rows)
        (folder / "profiles").mkdir(exist_ok=True)
        for unit in self.config.every_unit:
            (folder / "profiles" / f"unit-{unit}.toml").write_bytes(self.profile_file(unit).read_bytes())
        return folder


def _mean(values: Sequence[float]) -> float:
    known = [value for value in values if math.isfinite(value)]
    return math.fsum(known) / len(known) if known else math.nan


def main(words: Sequence[str] | None = None) -> None:
    """Carry an arm out, and say where its tables are."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("arm", choices=list(PLAN["arm"]))
    parser.add_argument("--out", type=Path, help="the arm's folder [out/noise-level-2/ARM]")
    parser.add_argument("--runs", type=int, help="of each level in each set, to try it out [as planned]")
    parser.add_argument("--units", type=int, help="likewise")
    parser.add_argument("--evaluations", type=int, help="likewise")
    parser.add_argument("--seconds", type=float, help="likewise: length of a trial")
    parser.add_argument("--workers", type=int, help="processes [one a core]")
    parser.add_argument("--resume", action="store_true", help="go on with the arm in the folder")
    asked = vars(parser.parse_args(words))
    arm, out, workers, resume = (asked.pop(key) for key in ("arm", "out", "workers", "resume"))
    results = noise_experiment(
        out or Path("out/noise-level-2") / arm, None if resume else design(arm, **asked), kind=SecondStudy,
        settings=Design, workers=workers, resume=resume, on_progress=told,
    )  # fmt: skip
    print(f"results {results}")


if __name__ == "__main__":
    main()
