"""Runs the first study of noise again: the noise experiment, in two sets of runs with seeds of their own.

    python studies/noise-level/run.py --out out/noise-level
    python studies/noise-level/run.py --evaluations 5000 --out out/noise-level-5000
    python studies/noise-level/run.py --twin-noise 2 --out out/noise-level-2x

The studies reported here were made by earlier versions of the twin and of its calibration; today's come to
other digits (README.md has the commits). Stopped, it goes on with --resume.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from common import told

from realitygap.experiments.noise import Controller, NoiseConfig, NoiseExperiment, noise_experiment
from realitygap.study.plan import named


@dataclass(frozen=True, kw_only=True)
class Design(NoiseConfig):
    """The noise experiment with sets of runs; `runs` are those of each task and level over all sets."""

    COMMAND = "python studies/noise-level/run.py"

    seed_sets: int = 2


@dataclass(frozen=True, kw_only=True)
class InSet(Controller):
    """A controller whose set is part of its name."""

    @property
    def name(self) -> str:
        """Its name in files and messages."""
        return f"{self.task}-set-{self.seed_set}-level-{self.level!r}-run-{self.run}"


class FirstStudy(NoiseExperiment):
    """The study's design: runs are numbered within a set, and the units take turns."""

    config: Design

    def controllers(self) -> Sequence[Controller]:
        """All controllers, by task and calibration unit."""
        config = self.config
        last = config.runs // config.seed_sets
        return [
            InSet(
                task=task, level=level, run=run, home=home, study=f"set-{number}-unit-{home}",
                run_name=f"{task}/{named(level)}/{index}", seed_set=number,
            )
            for task in config.tasks
            for home in config.every_unit
            for number in range(1, config.seed_sets + 1)
            for level in config.levels
            for index, run in enumerate(range(home, last + 1, config.units), start=1)
        ]  # fmt: skip

    def who(self, one: Controller) -> dict[str, object]:
        """The first columns of each row."""
        return {"task": one.task, "seed_set": one.seed_set, "run": one.run, "evolved_level": one.level}


def main(words: Sequence[str] | None = None) -> None:
    """Carry it out, and say where its tables are."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("out/noise-level"), help="the study's folder")
    parser.add_argument("--runs", type=int, default=40, help="of each task and level [%(default)s]")
    parser.add_argument("--units", type=int, default=3, help="of the twin [%(default)s]")
    parser.add_argument("--evaluations", type=int, default=1000, help="of each run [%(default)s]")
    parser.add_argument("--twin-noise", type=float, default=1.0, help="the twin's noise scale [%(default)s]")
    parser.add_argument("--seconds", type=float, help="length of a trial, to try it out")
    parser.add_argument("--workers", type=int, help="processes [one a core]")
    parser.add_argument("--resume", action="store_true", help="go on with the study in the folder")
    asked = vars(parser.parse_args(words))
    out, workers, resume = (asked.pop(key) for key in ("out", "workers", "resume"))
    results = noise_experiment(
        out, None if resume else Design(**asked), kind=FirstStudy, settings=Design, workers=workers,
        resume=resume, on_progress=told,
    )  # fmt: skip
    print(f"results {results}")


if __name__ == "__main__":
    main()
