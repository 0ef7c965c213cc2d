"""Draws docs/correspondence.md's figures, prints its tables: `python -m docs.figures.correspondence`.

With `names`, what concerns names alone; with `short`, names of trials cut short.
"""

from __future__ import annotations

import itertools
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tests.correspondence.ladders import (
    PAPER_SCORES,
    Ladder,
    Named,
    against,
    behaviours,
    called,
    climb,
    held_out,
    ladders_of,
    miscalibration,
    order_of_phrases,
    phrase_scores,
    reliability,
    right,
    setting_for,
)
from tests.correspondence.vehicles import SMALL, VEHICLES, Driven, Vehicles, called_by_name, everybody
from tests.correspondence.vehicles_fresh import FRESH
from tests.correspondence.vehicles_later import LATER
from tests.exemplars.wide import FAMILIES

from realitygap.correspondence.names import KINDS, of_length
from realitygap.report.style import PAGE, new_figure, styled

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7")
MARKERS = "os^D"
HERE = Path(__file__).parent
WHATS = {"gain": "gain of the sensors", "steering": "share of a turn made", "noise": "noise, × observed"}
PLACES: dict[str, Any] = {
    "obstacle-avoidance": {"loc": "upper center", "bbox_to_anchor": (0.5, 1.15)},
    "light-seeking": {"loc": "lower center", "bbox_to_anchor": (0.5, -0.2)},
}
SETS, EACH, SEEDS = (7000, 20_000, 40_000), 12, 20
"""First seeds of the held-out exemplars, how many of a kind and level; trials of a vehicle on each robot."""
NOBODIES_OF = {task: [kind for kind in FAMILIES[task] if kind not in KINDS[task]] for task in KINDS}
ROBOTS = ((("khepera",), 20.0), (("epuck",), 20.0), (("thymio2",), 20.0), (("thymio2",), 60.0))
"""Which of Enki's robots are watched for how long."""


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
    """Held-out exemplars by task and noise level; vehicles on Enki's robots; how sure, how often right."""
    print(
        "| task | noise | " + " | ".join(f"set {k + 1}" for k in range(len(SETS))) + " | without evidence |"
    )
    print("|---|---" + "|---" * (len(SETS) + 1) + "|")
    found: dict[str, list[Named]] = {}
    for task, level in itertools.product(KINDS, (0.0, 1.0, 2.0)):
        sets = [called(task, held_out(task, KINDS[task], range(k, k + EACH), level)) for k in SETS]
        bare = called(task, held_out(task, KINDS[task], range(SETS[0], SETS[0] + EACH), level, marked=False))
        print(f"| {task} | {level:g} | " + " | ".join(f"{right(of):.1%}" for of in (*sets, bare)) + " |")
        label = f"exemplars held out,\n{task.replace('-', ' ')}"
        found.setdefault(label, []).extend(itertools.chain(*sets))
    for task, label in zip(KINDS, list(found), strict=True):
        found[label] += called(task, held_out(task, NOBODIES_OF[task], range(SETS[0], SETS[0] + EACH), 1.0))
    names_on_enki(found)
    names_by_length()
    reliability_figure(found)


def names_by_length() -> None:
    """How sure and how right names of trials are that are cut short, and how sure without their discount."""
    print("| trials | seconds | trials named | right | sure | without the discount |")
    print("|---|---|---|---|---|---|")
    for task in (*KINDS, "Enki"):
        if task == "Enki":
            arena = setting_for("obstacle-avoidance").arena
            every = [(d.kind, d.trial, arena) for d in everybody(range(200, 204))]
        else:
            of = [(KINDS[task], 16), (NOBODIES_OF[task], 8)]
            sets = [held_out(task, kinds, range(k, k + n), 1.0) for k in SETS[:2] for kinds, n in of]
            every = [*itertools.chain(*sets)]
        for seconds in (3, 6, 10, 15, 20):
            cut = [(kind, trial.cut(seconds), arena) for kind, trial, arena in every]
            made = called("obstacle-avoidance" if task == "Enki" else task, cut)
            sure = np.mean([one.confidence for one in made])
            print(f"| {task} | {seconds} | {len(made)} | {right(made):.1%} | {sure:.2f} | "
                  f"{sure / of_length(seconds):.2f} |")  # fmt: skip


def names_on_enki(found: dict[str, list[Named]]) -> None:
    """All sets of vehicles by what they are written to do, on each robot."""
    every = vehicles_named(SMALL, VEHICLES)
    found["vehicles on Enki's\nKhepera and e-puck"] = [name for one, name in every if one.shown]
    found["the same,\nas trials fall"] = [name for _, name in every]
    by_set = {
        of: [vehicles_named(models, vehicles, seconds) for models, seconds in ROBOTS]
        for of, vehicles in (("", VEHICLES), ("later", LATER), ("fresh", FRESH))
    }
    large = [pair for of in ("", "later") for made in by_set[of][2:] for pair in made]
    fresh = [pair for made in by_set["fresh"] for pair in made]
    for label, pairs in (
        ("vehicles looked at,\nThymio II", large),
        ("fresh vehicles,\nall three robots", fresh),
    ):
        found[label] = [name for one, name in pairs if one.shown]
        found[f"{label.splitlines()[0]}\nas trials fall"] = [name for _, name in pairs]


def vehicles_named(models: Sequence[str], of: Vehicles, seconds: float = 20.0) -> list[tuple[Driven, Named]]:
    """All vehicles of a set on these robots, and what they are called; prints a table."""
    made = [*everybody(range(SEEDS), models, seconds=seconds, of=of)]
    said = called_by_name(made)
    every = [(one, Named(one.kind, name.name, name.confidence)) for one, name in zip(made, said, strict=True)]
    print(f"\nOn Enki's {', '.join(models)}, {seconds:g} s:")
    print(
        "\n| written to be | vehicle | show it | right of these | right of all | else called |\n"
        + "|---" * 6
        + "|"
    )
    for kind, family in dict.fromkeys((one.kind, one.family) for one in made):
        own = [(one.shown, name) for one, name in every if (one.kind, one.family) == (kind, family)]
        shown, wrong = [n for yes, n in own if yes], Counter(n.name for _, n in own if n.name != kind)
        others = ", ".join(f"{name} {count}" for name, count in wrong.most_common())
        share = f"{right(shown):.0%}" if shown else "–"
        alls = f"{right([n for _, n in own]):.0%}"
        print(f"| {kind} | {family} | {len(shown)} of {len(own)} | {share} | {alls} | {others} |")
    for what, part in {
        "show it": [pair for pair in every if pair[0].shown],
        "do so by their commands": [pair for pair in every if pair[0].ordered],
        "all": every,
    }.items():
        names, (low, high) = [name for _, name in part], between(part)
        sure = sum(name.confidence > 0.8 and name.kind != name.name for name in names)
        print(
            f"{what}: {len(names)}, {right(names):.1%} right ({low:.0%} to {high:.0%}), "
            f"off by {miscalibration(names):.3f}, {sure} surely wrong"
        )
    return every


def between(every: Sequence[tuple[Driven, Named]]) -> NDArray[np.float64]:
    """95 % interval of the share of right names, by bootstrap over controllers: one's trials go together."""
    own: dict[tuple[str, str], list[bool]] = {}
    for one, name in every:
        own.setdefault((one.kind, one.family), []).append(name.kind == name.name)
    tally = np.array([(sum(each), len(each)) for each in own.values()])
    picked = tally[np.random.default_rng(0).integers(len(tally), size=(10_000, len(tally)))].sum(axis=1)
    return np.quantile(picked[:, 0] / picked[:, 1], (0.025, 0.975))


def reliability_figure(found: dict[str, list[Named]]) -> None:
    """Share of right names against confidence, a panel a set of robots."""
    with styled():
        figure = new_figure(PAGE, 4.2, layout="constrained")
        panels = figure.subplots(2, 4, sharex=True, sharey=True)
        for axes, (label, made) in zip(panels.flat, found.items(), strict=True):
            rows = reliability(made)
            count, sure, true = np.array(rows).T
            error = np.sqrt(true * (1 - true) / count)
            axes.plot([0, 1], [0, 1], color="0.6", linewidth=0.8)
            axes.errorbar(sure, true, yerr=error, color=COLOURS[0], marker="o", markersize=3, linewidth=1)
            for n, x, y in rows:
                axes.annotate(str(n), (x, y), (4, -8), textcoords="offset points", fontsize=6)
            axes.set(title=label, xlim=(0.3, 1.03), ylim=(0, 1.05))
            axes.title.set_fontsize(7)
            mean = np.mean([one.confidence for one in made])
            print(f"\n{label!r}: {len(made)} names, {right(made):.1%} right, confidence {mean:.3f}")
            print(f"off by {miscalibration(made):.3f}: {[tuple(np.round(row, 2)) for row in rows]}")
        figure.supxlabel("confidence", size="medium")
        figure.supylabel("share of right names", size="medium")
        figure.savefig(HERE / "names.png", dpi=160, metadata={"Software": None})


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
    {("names",): names, ("short",): names_by_length}.get(tuple(sys.argv[1:]), main)()
