"""The site's live pages: robots that a reader drives. Each is one file that opens from disk."""

from __future__ import annotations

import re
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

import realitygap
from realitygap import Genotype, Simulation
from realitygap.report.drive import Driven, drive_json, driven_runs
from realitygap.report.evolution import Paths, parts_of
from realitygap.report.page import rendered
from realitygap.report.player import player_data, player_json, replay_data
from realitygap.simulation.simulation import batch_streams
from realitygap.study.config import StudyConfig
from realitygap.study.load import load_study
from realitygap.study.runner import run_study

HERE = Path(__file__).parent
DRIVE = (
    "Six networks that evolved under three levels of noise, in the simulation in which they did, calibrated "
    "to a real Khepera. Drag the robot, change the noise, and see how far apart its futures come."
)
BY_HAND = (
    "Two neurons, one a wheel, and five infrared eyes: twelve numbers decide how this robot drives. Can you "
    "find twelve that drive fast and straight, and avoid obstacles? Evolution has."
)


def write_live(folder: Path, evaluations: int) -> None:
    """Evolve what drives, and write both pages into a folder."""
    with tempfile.TemporaryDirectory() as there:
        few = ["profile=khepera", "retest_trials=4", "fresh_trials=3"]
        config = StudyConfig.reproduction(runs=1, evaluations=evaluations).with_settings(few)
        run_study(Path(there, "study"), config)
        write_drive(folder / "drive-it.html", Path(there, "study"))
    write_by_hand(folder / "evolve-by-hand.html", evaluations)


def write_drive(page: Path, there: Path) -> None:
    """The page of a study's robots."""
    study = load_study(there)
    parts = parts_of(study)
    data = player_data(study, parts, {part.task.name: [] for part in parts}, Paths(study))
    assert data is not None
    for noises in (task["noises"] for task in data["tasks"]):
        noises.insert(0, noises.pop(1))  # observed noise first
        for run in (run for noise in noises for run in noise["runs"]):
            run["network"]["links"] = [link for link in run["network"]["links"] if link["works"]]
            for one in run["trials"]:  # what is recorded is for browsers without WebAssembly
                one["simulated"] |= dict.fromkeys(("readings", "commands", "outputs"))
    _write(page, "Drive it yourself", DRIVE, data, driven_runs(parts, study.profile))


def write_by_hand(page: Path, evaluations: int) -> None:
    """The page of a network whose numbers a reader sets, beside one that evolved."""
    task = replace(realitygap.load_task("obstacle-avoidance"), name="by-hand", title="Obstacle avoidance")
    simulation = Simulation(task, HERE.parent / "examples" / "five_eyes.toml", 1.0)
    evolved = _evolved(simulation, evaluations)
    numbers = {"yours": np.zeros(12, np.int8), "evolved": evolved}
    genes = _genes(np.stack([*numbers.values()]))
    runs = {name: Genotype(one, 5) for name, one in zip(numbers, genes, strict=True)}
    pages = [
        replay_data(simulation, one, simulation.trajectory(one.networks(), stream=1), name)
        for name, one in runs.items()
    ]
    data: Any = pages[0]
    data["tasks"][0]["noises"][0]["runs"] += pages[1]["tasks"][0]["noises"][0]["runs"]
    driven = Driven(task=simulation.task, profile=simulation.profile, runs=runs, scored=True)
    more, script = ((HERE / f"by-hand.{kind}").read_text("utf-8") for kind in ("html", "js"))
    _write(page, "Evolve by hand", BY_HAND, data, [driven], more=Markup(more), script=Markup(script))


def _genes(numbers: np.ndarray) -> np.ndarray:
    """Genotypes of [N, 12] numbers: of each wheel the threshold, and the weight of each eye."""
    genes = np.zeros((len(numbers), 7, 2 + 4 * 5), np.int8)
    genes[:, :, 0] = 1
    wheels = numbers.reshape(-1, 2, 6)
    genes[:, 5:, 1] = wheels[:, :, 0]
    genes[:, 5:, 2::4], genes[:, 5:, 3::4], genes[:, 5:, 4::4] = 1, np.arange(5), wheels[:, :, 1:]
    return genes


def _evolved(simulation: Simulation, evaluations: int) -> np.ndarray:
    """Twelve numbers: of each generation's forty the best lives on, and its offspring differ in a few."""
    chance, most = np.random.default_rng(1995), np.tile([10, 4, 4, 4, 4, 4], 2)
    best = np.zeros(12, np.int8)
    for generation in range(1 + evaluations // 40):
        young = np.where(chance.random((40, 12)) < 0.2, chance.integers(-most, most + 1, (40, 12)), best)
        young[0] = best
        networks = Genotype.decode(_genes(young), 5, prune=False)
        scores = simulation.scores(networks, np.tile(batch_streams(generation, 8), (40, 1)))
        best = young[scores.mean(axis=1).argmax()]
    return best.astype(np.int8)


def _write(page: Path, title: str, lead: str, data: Any, driven: list[Driven], **more: Markup) -> None:
    facts = {"player": Markup(player_json(data)), "drive": drive_json(driven), "drive_first": True}
    text = rendered("notebook.html.j2", {**facts, "title": title, "lead": lead, **more})
    spaces_and_comments = r"(?m)^[ \t]+(//.*\n)?|^//.*\n"
    page.write_text(re.sub(spaces_and_comments, "", text), "utf-8")
