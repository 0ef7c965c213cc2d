"""What lets a page drive robots itself: the compiled simulation, and what it finds in its memory."""

import base64
import gzip
import warnings
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np
from markupsafe import Markup

from realitygap.control.genotype import Genotype
from realitygap.errors import RealityGapWarning
from realitygap.kernels.trial import new_scratch
from realitygap.kernels.types import Path
from realitygap.report.evolution import TaskPart, individual
from realitygap.report.player import MOST_RUNS, Json, player_json
from realitygap.simulation.simulation import Simulation
from realitygap.simulation.wasm import BASE, Arguments, Memory, WasmError, entries, module
from realitygap.tasks.task import Task
from realitygap.world.robot import Profile

__all__ = ["Driven", "drive_json", "driven_runs"]

READ = (
    "world.level", "nets.neurons", "nets.thresholds", "nets.sensor_links", "n", "path.x", "path.y",
    "path.contact", "scratch.start", "scratch.state.pose", "scratch.state.inputs", "scratch.state.outputs",
    "scratch.readings",
)  # fmt: skip
"""What the page reads and writes in the memory."""


class Driven(NamedTuple):
    """A task's runs on a page, by name, each with the genotype that drives. If it is `scored`, the page takes
    the task's score, too, which must need neither library nor constants."""

    task: Task
    profile: Profile
    runs: Mapping[str, Genotype]
    scored: bool = False


def driven_runs(parts: Iterable[TaskPart], profile: Profile) -> list[Driven]:
    """The runs of a study's player, but for tasks whose trials draw a robot's constants anew."""
    found = []
    for part in parts:
        rows = [row for one in part.conditions if one.begun for row in one.shown(MOST_RUNS)]
        if rows and not part.task.spread:
            found.append(Driven(part.task, profile, {row.run.name: individual(row.run) for row in rows}))
    return found


def drive_json(driven: Iterable[Driven]) -> Markup | None:
    """A page's own simulation of tasks as text for a script element, empty without any; None, with a warning,
    where it cannot be compiled."""
    memory, kernels = Memory(), dict[bytes, int]()
    try:
        tasks = {one.task.name: _laid(one, memory, kernels) for one in driven}
    except WasmError as error:
        warnings.warn(f"{error}. The page shows recorded drives only.", RealityGapWarning, stacklevel=2)
        return None
    packed = [_packed(kernel) for kernel in kernels]
    data: Json = {"base": BASE, "memory": _packed(bytes(memory.data)), "kernels": packed, "tasks": tasks}
    return Markup(player_json(data) if tasks else "")


def _laid(one: Driven, memory: Memory, kernels: dict[bytes, int]) -> Json:
    """Lay a task down; what a page must know to call its kernel."""
    simulation = Simulation(one.task, one.profile, 1.0)
    inputs, steps = len(simulation.trial.channels), simulation.trial.steps
    nets = Genotype.decode(_stacked([run.genes for run in one.runs.values()]), inputs, prune=False)
    path, scratch = Path(*np.zeros((6, steps))), new_scratch(simulation.robot, simulation.trial, nets)
    given = Arguments(simulation.world, nets, 0, np.uint64(0), 0, 0, path, scratch)
    at, where = memory.lay(given)
    made, scored = [module(entries(given))], None
    if one.scored:
        made.append(module({"score": (simulation.score.plain, (path, simulation.room))}))
        scored, _ = memory.lay((path, simulation.room))
    return {
        "kernels": [kernels.setdefault(one, len(kernels)) for one in made], "at": at, "scored": scored,
        "where": {name: where[name] for name in READ},
        "steps": steps, "sensors": len(scratch.readings), "inputs": inputs, "runs": list(one.runs),
        "neurons": nets.thresholds.shape[1], "links": nets.links.shape[1],
    }  # fmt: skip


def _stacked(genes: list[np.ndarray]) -> np.ndarray:
    """Genotypes of perhaps different sizes as one array; what is added expresses nothing."""
    slots, columns = (max(sizes) for sizes in zip(*(one.shape for one in genes), strict=True))
    return np.stack([np.pad(one, ((0, slots - one.shape[0]), (0, columns - one.shape[1]))) for one in genes])


def _packed(data: bytes) -> str:
    return base64.b64encode(gzip.compress(data, 9, mtime=0)).decode()
