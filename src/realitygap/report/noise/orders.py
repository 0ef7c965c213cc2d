"""Agreement of measures without a camera with the camera's order of an arm's controllers."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from realitygap.errors import StudyError
from realitygap.experiments.noise.simulated import LIVED
from realitygap.report.noise.facts import Span
from realitygap.report.noise.figures import titled
from realitygap.report.noise.tables import NoiseTable, Number, Row
from realitygap.table import read_table
from realitygap.transfer.order import Order, means, order_of

__all__ = ["FILE", "order_tables", "read_orders"]

FILE = "without-camera.csv"
KEY = ("seed_set", "run", "evolved_level")
BY_CAMERA = ("correspondence", "fitness_simulated", "fitness_situated", "fitness_pseudo")


def read_orders(
    folder: Path, kind: str, cure: str, homes: Mapping[tuple[object, ...], int]
) -> tuple[Order, ...]:
    """The orders of an arm's champions in each task; () if readings and commands were not kept.

    Args:
        folder: with the tables.
        kind: of robot.
        cure: for messages about a broken table.
        homes: the calibration unit of each controller: task, seed set, run, evolved level, individual.

    Raises:
        StudyError: the table is broken.
    """
    if not (folder / FILE).is_file():
        return ()
    table = read_table(folder / FILE, StudyError, needs=("task", *KEY, "unit", *LIVED, *BY_CAMERA), cure=cure)
    tasks, unit = np.array(table.texts("task")), table.whole("unit")
    known = list(zip(table.texts("task"), *(table.numbers(key) for key in KEY), strict=True))
    unknown = np.array([(*key, "champion") not in homes for key in known])
    table.refuse(unknown, "run", "a champion of controllers.csv", [" ".join(map(str, k)) for k in known])
    who = np.stack([table.numbers(key) for key in KEY], axis=1)
    values = {name: table.numbers(name, empty=True) for name in (*LIVED, *BY_CAMERA)}
    made = []
    for task in dict.fromkeys(tasks.tolist()):
        own = tasks == task
        keys, row = np.unique(who[own], axis=0, return_inverse=True)
        units, column = np.unique(unit[own], return_inverse=True)
        grids = {name: np.full((row.max() + 1, len(units)), np.nan) for name in values}
        for name, grid in grids.items():
            grid[row, column] = values[name][own]
        columns = {name: means(grid) for name, grid in grids.items()}
        home = np.array([homes[task, *key, "champion"] for key in keys.tolist()])
        names = task, "champion", kind
        made.append(order_of(names, grids["distance"], grids["correspondence"], columns, home))
    return tuple(made)


def order_tables(name: str, orders: Sequence[Order]) -> list[NoiseTable]:
    """Agreement of an arm's measures on the order of its champions; empty if it is unknown."""
    if not orders:
        return []
    rows: list[Row] = []
    for one in orders:
        alone = (one.readings, one.commands, one.speeds, one.replay)
        rows.append((
            titled(one.task), one.controllers, Number(span=Span(one.rho, one.low, one.high), signed=True),
            one.verdict, *(Number(span=Span(value), signed=True) for value in alone),
            Number(span=Span(one.fitness, one.fitness_low, one.fitness_high), signed=True),
            *(Number(span=Span(value), signed=True) for value in (one.simulated, one.pseudo)),
        ))  # fmt: skip
    table = NoiseTable(
        name=f"{name}-order",
        title=f"Arm {name}, without a camera: Spearman's rho, with the camera's score over champions, of the "
        "Wasserstein distances of what the robot and the simulation at level 1 read and did (95 % over "
        "calibration units with their controllers), and of their parts; Pearson's r of simulated and "
        "situated fitness (Kadian et al. 2020); rho of situated fitness with simulated fitness and with that "
        "in pseudo-realities.",
        head=("task", "champions", "without a camera", "is", "readings", "commands", "speeds",
              "replayed commands", "r of fitness", "simulated", "pseudo-realities"),
        rows=tuple(rows),
    )  # fmt: skip
    return [table]
