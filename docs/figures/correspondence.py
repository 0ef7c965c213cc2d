"""Draws docs/correspondence.md's figure, prints its tables: `python docs/figures/correspondence.py`."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np

from realitygap.correspondence.exemplars import KINDS, exemplar
from realitygap.correspondence.ladders import behaviours
from realitygap.correspondence.validation import (
    Ladder,
    against,
    climb,
    held_out,
    order_of_phrases,
    phrase_scores,
)
from realitygap.correspondence.words import PAPER_SCORES
from realitygap.report.style import PAGE, new_figure, styled

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7")
MARKERS = "os^D"
HERE = Path(__file__).parent


def main() -> None:
    """Climb all ladders, name held-out exemplars, compare all robots; draw and print."""
    robots = [*behaviours(0), *behaviours(1)]
    ladders = [climb(robot, what) for robot in robots for what in ("gain", "noise")]
    draw(ladders)
    print("| task | behaviour | robot | gain: rho | scores | noise: rho | scores |")
    print("|---|---|---|---|---|---|---|")
    for gain, noise in _twos(ladders):
        b = gain.behaviour
        print(f"| {b.task} | {b.kind} | {b.seed + 1} | {_row(gain)} | {_row(noise)} |")
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
    print("| task | noise | right | trials |\n|---|---|---|---|")
    for task, level in itertools.product(KINDS, (0.0, 1.0, 2.0)):
        trials = {kind: [exemplar(task, kind, 7000 + i, level) for i in range(30)] for kind in KINDS[task]}
        print(f"| {task} | {level:g} | {np.mean(list(held_out(task, trials).values())):.1%} | {30 * 4} |")


def draw(ladders: list[Ladder]) -> None:
    """Score against gain and noise, a line a robot."""
    with styled():
        figure = new_figure(PAGE, 4.6, layout="constrained")
        panels = figure.subplots(2, 2, sharey=True)
        for ladder in ladders:
            kinds = list(KINDS[ladder.behaviour.task])
            k = kinds.index(ladder.behaviour.kind)
            axes = panels[list(KINDS).index(ladder.behaviour.task)][int(ladder.what == "noise")]
            second = ladder.behaviour.seed > 0
            axes.plot(
                ladder.steps, ladder.scores, color=COLOURS[k], marker=MARKERS[k], markersize=3,
                linestyle=(0, (3, 1.5)) if second else "-",
                label=None if second else ladder.behaviour.kind,
            )  # fmt: skip
        whats = ("gain of the sensors that are fed", "noise, × observed")
        for task, row in zip(KINDS, panels, strict=True):
            for what, axes in zip(whats, row, strict=True):
                axes.set(xscale="log", xlabel=what, ylim=(-0.3, 10.3), title=task.replace("-", " "))
                steps = (1, 0.5, 0.25, 0.15) if what[0] == "g" else (1, 2, 4, 8)
                axes.set_xticks(steps, [f"{s:g}" for s in steps])
                axes.minorticks_off()
                if what[0] == "g":
                    axes.invert_xaxis()
            row[0].set_ylabel("correspondence score")
            row[0].legend(loc="lower left")
        figure.savefig(HERE / "correspondence.png", dpi=160, metadata={"Software": None})


def _row(ladder: Ladder) -> str:
    rho = "flat" if np.isnan(ladder.spearman) else f"{ladder.spearman:.2f}"
    return f"{rho} | {' '.join(f'{score:.1f}' for score in ladder.scores)}"


def _twos(ladders: list[Ladder]) -> list[tuple[Ladder, Ladder]]:
    return list(zip(ladders[::2], ladders[1::2], strict=True))


if __name__ == "__main__":
    main()
