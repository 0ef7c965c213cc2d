"""Digests of what the system computes: they stay the same while the code is rebuilt.

    python tests/digests.py          # compares with tests/digests.txt; exit code 1 if one differs
    python tests/digests.py --write  # accepts today's, when a change of results is meant

Scores of both tasks in three profiles (the paper's, one calibrated to a real robot's readings, a polygon) at
noise 0, 1 and 2; one evolution; one recording, fit and transfer on the twin. Public names only. A fit, and
what follows from it, differs between kinds of processors in its last bits: write today's before you begin.
"""

import hashlib
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

import realitygap as rg

KEPT = Path(__file__).with_suffix(".txt")
TASKS = ("obstacle-avoidance", "light-seeking")
HEXAGON = tuple((3.1 * np.cos(k * np.pi / 3), 3.1 * np.sin(k * np.pi / 3)) for k in range(6))


def digest(*values: object) -> str:
    """Of arrays, files and numbers, to the bit."""
    made = hashlib.sha256()
    for value in values:
        made.update(value.read_bytes() if isinstance(value, Path) else np.ascontiguousarray(value).tobytes())
    return made.hexdigest()[:16]


def scores() -> Iterator[tuple[str, str]]:
    """Of 20 random networks, 4 trials each, at each noise level."""
    khepera = rg.load_profile("khepera")
    polygon = replace(khepera, name="polygon", body=replace(khepera.body, radius_cm=0.0, outline_cm=HEXAGON))
    for profile in (rg.load_profile("paper"), khepera, polygon):
        for task in TASKS:
            for noise in (0.0, 1.0, 2.0):
                simulation = rg.Simulation(task, profile, noise)
                genes = [rg.Genotype.random(k).genes for k in range(20)]
                streams = np.arange(80, dtype=np.uint64).reshape(20, 4)
                found = simulation.scores(rg.Genotype.decode(np.array(genes), 8), streams)
                yield f"scores {profile.name} {task} {noise:g}", digest(found)


def studies(home: Path) -> Iterator[tuple[str, str]]:
    """An evolution; a unit's recordings and fit; and a transfer of the one to the other."""
    unit = rg.calibrated_unit(
        home / "unit", unit=7, noise=1.0, seed=1, workers=2, parts=("wheels", "infrared-wall"),
        bearings=8, distances_cm=(1.0, 2.0, 4.0),
    )  # fmt: skip
    for file in sorted((home / "unit" / "recordings").rglob("*.csv")):
        yield f"recording {file.relative_to(home / 'unit' / 'recordings')}", digest(file)
    kept = [line for line in unit.read_text("utf-8").splitlines() if not line.startswith("date")]
    yield "fit", digest(np.frombuffer("\n".join(kept).encode(), np.uint8))
    asked = [{"task": TASKS[0], "noise": 1.0}]
    config = rg.StudyConfig.from_dict({"seed": 7, "runs": 2, "evaluations": 300, "conditions": asked})
    config = replace(config, profile=str(unit))
    study = rg.run_study(home / "study", config.with_settings(["task.seconds=4"]), workers=2)
    for run in study.runs:
        yield f"evolution {run.name}", digest(run.champion, run.best_fitness, run.champion_fitness)
    for trial in rg.run_transfer(study, rg.Transfer(starts=2, robots=("twin:7",), seed=3), workers=2):
        paths = [getattr(side, axis) for side in (trial.simulated, trial.situated) for axis in "xy"]
        fitness = (trial.fitness_simulated, trial.fitness_situated)
        yield f"transfer {trial.name} start {trial.start}", digest(*paths, fitness)


def main() -> int:
    """Compare, or write; returns the exit code."""
    with tempfile.TemporaryDirectory() as home:
        found = "".join(f"{value}  {name}\n" for value, name in _lines(Path(home)))
    if "--write" in sys.argv[1:]:
        KEPT.write_text(found, "utf-8")
        return 0
    known, now = KEPT.read_text("utf-8").splitlines(), found.splitlines()
    for old, new in zip(known, now, strict=True):
        if old != new:
            print(f"expected {old}\n     got {new}")
    return int(known != now)


def _lines(home: Path) -> Iterator[tuple[str, str]]:
    for name, value in (*scores(), *studies(home)):
        yield value, name


if __name__ == "__main__":
    sys.exit(main())
