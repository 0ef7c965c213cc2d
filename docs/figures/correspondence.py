"""Draws docs/correspondence.md's figure, prints its tables: `python -m docs.figures.correspondence`."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
from tests.correspondence.ladders import (
    Ladder,
    against,
    behaviours,
    climb,
    held_out,
    ladders_of,
    order_of_phrases,
    phrase_scores,
)

from realitygap.correspondence.exemplars.kinds import KINDS, exemplar
from realitygap.correspondence.words import PAPER_SCORES
from realitygap.report.style import PAGE, new_figure, styled

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7")
MARKERS = "os^D"
HERE = Path(__file__).parent
WHATS = {"gain": "gain of the sensors", "steering": "share of a turn made", "noise": "noise, × observed"}
PLACES: dict[str, Any] = {
    "obstacle-avoidance": {"loc": "upper center", "bbox_to_anchor": (0.5, 1.15)},
    "light-seeking": {"loc": "lower center", "bbox_to_anchor": (0.5, -0.2)},
}
SETS, EACH = (7000, 20_000, 40_000), 30
"""First seeds of the held-out exemplars, and how many of a kind and level."""


def main() -> None:
    """Climb all ladders, name held-out exemplars, compare all robots; draw and print."""
    robots = [*behaviours(0), *behaviours(1)]
    ladders = [climb(robot, what) for robot in robots for what in ladders_of(robot)]
    draw(ladders)
    print("| task | behaviour | robot | ladder | rho | scores |")
    print("|---|---|---|---|---|---|")
    for made in ladders:
        b = made.behaviour
        steps = " ".join(f"{score:.1f}" for score in made.scores)
        print(f"| {b.task} | {b.kind} | {b.seed + 1} | {made.what} | {made.spearman:.2f} | {steps} |")
    print(f"\n{len(ladders)} ladders, lowest rho {min(made.spearman for made in ladders):.2f}")
    said = phrase_scores(rung for ladder in ladders for rung in ladder.rungs)
    print("\n| phrase | paper | here | pairs |\n|---|---|---|---|")
    for phrase, score in sorted(PAPER_SCORES.items(), key=lambda item: -item[1]):
        if phrase in said:
            print(f"| {phrase} | {score:g} | {said[phrase][0]:.1f} | {said[phrase][1]} |")
    print(f"\nSpearman with the paper's order: {order_of_phrases(said):.2f}\n")
    lives = {robot: robot.trials(12, again=7) for robot in [*robots, *behaviours(2)]}
    others = [
        against(a, lives[a], lives[b]).score
        for a, b in itertools.combinations(lives, 2) if a.task == b.task and a.kind != b.kind
    ]  # fmt: skip
    again = [against(a, of, a.trials(12, again=8)).score for a, of in lives.items()]
    print(f"another behaviour: {len(others)} pairs, highest {max(others):.2f}")
    print(f"the same robot again: {len(again)} pairs, lowest {min(again):.2f}\n")
    names()


def names() -> None:
    """Held-out exemplars by task and noise level."""
    print("| task | noise | " + " | ".join(f"set {k + 1}" for k in range(len(SETS))) + " | without marks |")
    print("|---|---" + "|---" * (len(SETS) + 1) + "|")
    for task, level in itertools.product(KINDS, (0.0, 1.0, 2.0)):
        shares = [_right(task, level, first, marked=True) for first in SETS]
        shares.append(_right(task, level, SETS[0], marked=False))
        print(f"| {task} | {level:g} | " + " | ".join(f"{share:.1%}" for share in shares) + " |")


def _right(task: str, level: float, first: int, *, marked: bool) -> float:
    """Share of held-out exemplars that get their names."""
    seeds = range(first, first + EACH)
    trials = {kind: [exemplar(task, kind, i, level, marked=marked) for i in seeds] for kind in KINDS[task]}
    return float(np.mean(list(held_out(task, trials).values())))


def draw(ladders: list[Ladder]) -> None:
    """Score against gain and noise, a line a robot."""
    with styled():
        figure = new_figure(PAGE, 4.6, layout="constrained")
        panels = figure.subplots(2, 3, sharey=True)
        panels[0][1].set_axis_off()  # where the legend is
        for ladder in ladders:
            kinds = list(KINDS[ladder.behaviour.task])
            k = kinds.index(ladder.behaviour.kind)
            axes = panels[list(KINDS).index(ladder.behaviour.task)][list(WHATS).index(ladder.what)]
            second = ladder.behaviour.seed > 0
            axes.plot(
                ladder.steps, ladder.scores, color=COLOURS[k], marker=MARKERS[k], markersize=3,
                linestyle=(0, (3, 1.5)) if second else "-",
                label=None if second else ladder.behaviour.kind,
            )  # fmt: skip
        for task, row in zip(KINDS, panels, strict=True):
            for what, axes in zip(WHATS, row, strict=True):
                axes.set(xscale="log", xlabel=WHATS[what], ylim=(-0.3, 10.3), title=task.replace("-", " "))
                steps = (1, 2, 4, 8) if what == "noise" else (1, 0.5, 0.25, 0.15)
                axes.set_xticks(steps, [f"{s:g}" for s in steps])
                axes.minorticks_off()
                if what != "noise":
                    axes.invert_xaxis()
            panels[0][1].set_title("")
            row[0].set_ylabel("correspondence score")
            handles, labels = row[2].get_legend_handles_labels()
            panels[0][1].add_artist(
                panels[0][1].legend(handles, labels, title=task.replace("-", " "), **PLACES[task])
            )
        figure.savefig(HERE / "correspondence.png", dpi=160, metadata={"Software": None})


if __name__ == "__main__":
    main()
