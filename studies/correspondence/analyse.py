"""What shows that the correspondence score and the names are right: every table and both figures.

    python studies/correspondence/analyse.py [PART…] [--runs N] [--write]

Parts are ladders, names, cut, vehicles and twin; all of them by default. Everything is simulated anew, in
some five minutes of processor time. `--runs N` takes at most N trials where there are 12 or 20, for a quick
look. With `--write`, which wants all parts, tables.md, ladders.png and names.png are written. The vehicles
need Enki (apt install libenki-dev g++).
"""

import argparse
import itertools
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pandas as pd
from matplotlib.legend import Legend
from PIL import Image

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1]))
from studies.common import markdown  # noqa: E402
from studies.correspondence.kinds import KINDS  # noqa: E402
from studies.correspondence.ladders import (  # noqa: E402
    PAPER_SCORES,
    Ladder,
    against,
    behaviours,
    climb,
    ladders_of,
    order_of_phrases,
    phrase_scores,
    setting_for,
)
from studies.correspondence.naming import (  # noqa: E402
    called,
    held_out,
    interval,
    left_out,
    miscalibration,
    reliability,
    right,
    surely_wrong,
    vehicles_named,
)
from studies.correspondence.twin import names_on_the_twin  # noqa: E402
from studies.correspondence.vehicles import SMALL, VEHICLES  # noqa: E402
from studies.correspondence.vehicles_fresh import FRESH  # noqa: E402
from studies.correspondence.vehicles_later import LATER  # noqa: E402
from studies.correspondence.wide import FAMILIES  # noqa: E402

from realitygap.correspondence.names import NONE, of_length  # noqa: E402
from realitygap.report.style import PAGE, new_figure, styled  # noqa: E402

COLOURS, MARKERS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7"), "os^D"
WHATS = {"gain": "gain of the sensors", "steering": "share of a turn made", "noise": "noise, × observed"}
SETS = (7000, 20_000, 40_000)
"""First seeds of the held-out exemplars; none is an exemplar's that names are learnt from."""
EACH, TRIALS = 12, 20
"""Held-out exemplars of a kind and level; trials of a vehicle on a robot."""
NOBODIES_OF = {task: [kind for kind in FAMILIES[task] if kind not in KINDS[task]] for task in KINDS}
VEHICLE_SETS = {"fresh": FRESH, "eighteen, known": VEHICLES, "eleven, known": LATER}
ROBOTS = {
    "Thymio II, 20 s": ("thymio2", 20.0),
    "Thymio II, 60 s": ("thymio2", 60.0),
    "Khepera": ("khepera", 20.0),
    "e-puck": ("epuck", 20.0),
}
CUTS_S = (3, 6, 10, 15, 20)


def main(words: list[str]) -> None:
    """Make the parts that are asked for, print them or keep them."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    options.add_argument("parts", nargs="*", metavar="PART", help=", ".join(Study.PARTS))
    options.add_argument("--runs", type=int, default=TRIALS, metavar="N")
    options.add_argument("--write", action="store_true")
    asked = options.parse_args(words)
    parts = asked.parts or list(Study.PARTS)
    if unknown := sorted(set(parts) - set(Study.PARTS)):
        options.error(f"expected {', '.join(Study.PARTS)}, got {', '.join(unknown)}")
    study = Study(asked.runs)
    text = HEAD + "".join(f"\n\n## {Study.PARTS[part]}\n\n{getattr(study, part)()}" for part in parts) + "\n"
    if not asked.write:
        print(text, end="")
        return
    if len(parts) < len(Study.PARTS) or asked.runs < TRIALS:
        options.error("--write wants all parts, at their full size")
    (HERE / "tables.md").write_text(text, encoding="utf-8")
    draw_ladders(study.ladders_made, HERE / "ladders.png")
    draw_reliability(study.found, HERE / "names.png")


HEAD = """# Correspondence: the tables

Made by `python studies/correspondence/analyse.py`, which simulates everything anew."""


class Study:
    """The parts of the validation; each returns its tables as Markdown.

    Args:
        runs: at most so many trials where there are 12 or 20.

    Attributes:
        ladders_made: all ladders, for their figure.
        found: names by what they are of, for the figure of confidence.
    """

    PARTS: ClassVar = {
        "ladders": "Scores along ladders",
        "names": "Names of exemplars that were held out",
        "cut": "Names of trials cut short",
        "vehicles": "Names on Enki's robots",
        "twin": "Names on the twin",
    }

    def __init__(self, runs: int) -> None:
        self.runs = runs
        self.each = min(EACH, runs)
        self.ladders_made: list[Ladder] = []
        self.found: dict[str, pd.DataFrame] = {}

    def ladders(self) -> str:
        """One robot against itself made worse; the phrases; other behaviours; the same robot again."""
        robots = [robot for k in range(min(3, self.runs)) for robot in behaviours(k)]
        climbing = [robot for robot in robots if robot.seed < 2]
        self.ladders_made = [climb(robot, what) for robot in climbing for what in ladders_of(robot)]
        rows = [
            (
                made.behaviour.task, made.behaviour.kind, made.behaviour.seed + 1, made.what,
                f"{made.spearman:.2f}", " ".join(f"{score:.1f}" for score in made.scores),
            )
            for made in self.ladders_made
        ]  # fmt: skip
        lowest = min(made.spearman for made in self.ladders_made)
        said = phrase_scores(rung for ladder in self.ladders_made for rung in ladder.rungs)
        phrases = [
            (phrase, f"{score:g}", f"{said[phrase][0]:.1f}", said[phrase][1])
            for phrase, score in sorted(PAPER_SCORES.items(), key=lambda item: -item[1])
            if phrase in said
        ]
        lives = {robot: robot.trials(12, again=7) for robot in robots}
        others = [
            against(a, lives[a], lives[b]).score
            for a, b in itertools.combinations(lives, 2)
            if a.task == b.task and a.kind != b.kind
        ]
        again = [against(a, of, a.trials(12, again=8)).score for a, of in lives.items()]
        return "\n\n".join(
            [
                markdown(["task", "behaviour", "robot", "ladder", "rho", "scores"], rows),
                f"{len(rows)} ladders, lowest rho {lowest:.2f}.",
                markdown(["phrase", "paper", "here", "pairs"], phrases),
                f"Spearman with the paper's order: {order_of_phrases(said):.2f}.",
                f"Another behaviour: {len(others)} pairs, highest {max(others):.2f}. The same robot again: "
                f"{len(again)} pairs, lowest {min(again):.2f}.",
            ]
        )

    def names(self) -> str:
        """Held-out exemplars by task and noise, with and without the rule on evidence; designs left out."""
        rows = []
        for task, level in itertools.product(KINDS, (0.0, 1.0, 2.0)):
            sets = [called(task, held_out(task, KINDS[task], self._seeds(k), level)) for k in SETS]
            bare = called(task, held_out(task, KINDS[task], self._seeds(SETS[0]), level, marked=False))
            rows.append((task, f"{level:g}", *(f"{right(of):.1%}" for of in (*sets, bare))))
            self._keep(f"exemplars held out,\n{task.replace('-', ' ')}", *sets)
        for task in KINDS:
            nobodies = called(task, held_out(task, NOBODIES_OF[task], self._seeds(SETS[0]), 1.0))
            self._keep(f"exemplars held out,\n{task.replace('-', ' ')}", nobodies)
        designs = []
        for task, hotter in itertools.product(KINDS, (1.0, 0.25, 3.0)):
            made = left_out(task, hotter)
            designs.append(
                (task, f"{hotter:g}", len(made), f"{right(made):.1%}", f"{miscalibration(made):.3f}")
            )
        return "\n\n".join(
            [
                markdown(["task", "noise", "set 1", "set 2", "set 3", "without evidence"], rows),
                "All of these, with exemplars of *none of these* at noise 1:",
                self._reliability("exemplars"),
                "Shipped exemplars named by those of other designs, at multiples of the fitted temperature:",
                markdown(["task", "temperature", "names", "right", "error"], designs),
            ]
        )

    def cut(self) -> str:
        """How sure and how right names of trials are that are cut short, and how sure without discount."""
        trials = {}
        for task in KINDS:
            kinds = [(KINDS[task], min(16, self.runs)), (NOBODIES_OF[task], min(8, self.runs))]
            sets = [held_out(task, which, range(k, k + n), 1.0) for k in SETS[:2] for which, n in kinds]
            trials[task] = [(task, *one) for one in itertools.chain(*sets)]
        drives, _ = vehicles_named(SMALL, VEHICLES, range(200, 200 + min(4, self.runs)))
        task, arena = "obstacle-avoidance", setting_for("obstacle-avoidance").arena
        trials["Enki's Khepera and e-puck"] = [(task, one.kind, one.trial, arena) for one in drives]
        rows = []
        for label, every in trials.items():
            for seconds in CUTS_S:
                short = [(kind, trial.cut(seconds), where) for _, kind, trial, where in every]
                made = called(every[0][0], short)
                sure = made["confidence"].mean()
                plain = sure / of_length(seconds)
                rows.append((label, seconds, len(made), f"{right(made):.1%}", f"{sure:.2f}", f"{plain:.2f}"))
        return markdown(["trials", "seconds", "named", "right", "sure", "without the discount"], rows)

    def vehicles(self) -> str:
        """All sets of hand-written controllers on each of Enki's robots."""
        seeds = range(min(TRIALS, self.runs))
        small = vehicles_named(SMALL, VEHICLES, seeds)[1]
        self.found["vehicles on Enki's\nKhepera and e-puck"] = small[small["shown"]]
        self.found["the same,\nas trials fall"] = small
        made = {
            (of, label): vehicles_named([model], vehicles, seeds, seconds)[1]
            for (of, vehicles), (label, (model, seconds)) in itertools.product(
                VEHICLE_SETS.items(), ROBOTS.items()
            )
        }
        known = [one for (of, label), one in made.items() if of != "fresh" and "Thymio" in label]
        fresh = [one for (of, _), one in made.items() if of == "fresh"]
        for label, several in (
            ("vehicles looked at,\nThymio II", known),
            ("fresh vehicles,\nall three robots", fresh),
        ):
            every = pd.concat(several)
            self.found[label] = every[every["shown"]]
            self.found[f"{label.splitlines()[0]}\nas trials fall"] = every
        return "\n\n".join(
            [
                "Eighteen known controllers on Enki's Khepera and e-puck:",
                self._shown_and_all(small),
                self._by_design(small),
                "Each set on each robot; 95 % intervals by bootstrap over controllers:",
                self._by_robot(made),
                "Fresh controllers, right of those that show their behaviour:",
                self._fresh({label: one for (of, label), one in made.items() if of == "fresh"}),
                "All:",
                self._reliability("vehicles"),
            ]
        )

    def twin(self) -> str:
        """One trial of each kind on each of two units."""
        every = {task: names_on_the_twin(task) for task in KINDS}
        return markdown(
            ["task", "trials", "right"],
            [(task, len(made), (made["kind"] == made["name"]).sum()) for task, made in every.items()],
        )

    def _seeds(self, first: int) -> range:
        return range(first, first + self.each)

    def _keep(self, label: str, *several: pd.DataFrame) -> None:
        kept = [self.found[label]] if label in self.found else []
        self.found[label] = pd.concat([*kept, *several], ignore_index=True)

    def _reliability(self, of: str) -> str:
        rows = [
            (
                " ".join(label.split()), len(made), f"{right(made):.1%}", f"{made['confidence'].mean():.3f}",
                f"{miscalibration(made):.3f}",
            )
            for label, made in self.found.items() if label.startswith("exemplars") == (of == "exemplars")
        ]  # fmt: skip
        return markdown(["names of", "names", "right", "confidence", "error"], rows)

    def _shown_and_all(self, made: pd.DataFrame) -> str:
        parts = {
            "that show their behaviour": made[made["shown"]],
            "whose commands hold it": made[made["ordered"]],
            "all": made,
        }
        rows = [(k, len(of), f"{right(of):.1%}", f"{miscalibration(of):.3f}") for k, of in parts.items()]
        return markdown(["trials", "", "right", "error"], rows)

    def _by_design(self, made: pd.DataFrame) -> str:
        rows = []
        for (kind, design), own in made.groupby(["kind", "design"], sort=False):
            wrong = Counter(own["name"][own["name"] != kind])
            others = ", ".join(f"{name} {count}" for name, count in wrong.most_common())
            shown = own[own["shown"]]
            share = f"{right(shown):.0%}" if len(shown) else "–"
            rows.append((kind, design, f"{len(shown)} of {len(own)}", share, f"{right(own):.0%}", others))
        head = ["written to be", "vehicle", "show it", "right of these", "right of all", "else called"]
        return markdown(head, rows)

    def _by_robot(self, made: dict[tuple[str, str], pd.DataFrame]) -> str:
        rows = []
        for (of, label), every in made.items():
            if of == "eighteen, known" and "Thymio" not in label:
                continue  # together above
            shown = every[every["shown"]]
            low, high = interval(shown)
            paper = shown[shown["kind"] != NONE]
            rows.append(
                (
                    of, label, f"{len(shown)} of {len(every)}",
                    f"{right(shown):.1%} ({100 * low:.0f} to {100 * high:.0f})",
                    f"{miscalibration(shown):.3f}", f"{right(every):.1%}", f"{miscalibration(every):.3f}",
                    surely_wrong(every), f"{(paper['kind'] == paper['name']).sum()} of {len(paper)}",
                )
            )  # fmt: skip
        head = ["controllers", "robot", "show it", "right of these", "error", "right of all", "error"]
        return markdown([*head, "surely wrong", "right of the paper's kinds"], rows)

    def _fresh(self, made: dict[str, pd.DataFrame]) -> str:
        def cell(every: pd.DataFrame, kind: str, design: str) -> str:
            own = every[(every["kind"] == kind) & (every["design"] == design) & every["shown"]]
            return f"{(own['name'] == kind).sum()} of {len(own)}" if len(own) else "–"

        rows = [
            (kind, design, *(cell(every, kind, design) for every in made.values()))
            for kind, designs in FRESH.items()
            for design in designs
        ]
        return markdown(["written to be", "fresh vehicle", *made], rows)


def draw_ladders(made: Sequence[Ladder], path: Path) -> None:
    """Score against gain, steering and noise, a line a robot."""
    with styled():
        figure = new_figure(PAGE, 4.6, layout="constrained")
        panels = figure.subplots(2, 3, sharey=True)
        panels[0][1].set_axis_off()  # where the legends are
        for ladder in made:
            task, kind, second = ladder.behaviour.task, ladder.behaviour.kind, ladder.behaviour.seed > 0
            k = list(KINDS[task]).index(kind)
            panels[list(KINDS).index(task)][list(WHATS).index(ladder.what)].plot(
                ladder.steps, ladder.scores, color=COLOURS[k], marker=MARKERS[k], markersize=3,
                linestyle=(0, (3, 1.5)) if second else "-", label=None if second else kind,
            )  # fmt: skip
        places: tuple[dict[str, Any], ...] = (
            {"loc": "upper center", "bbox_to_anchor": (0.5, 1.15)},
            {"loc": "lower center", "bbox_to_anchor": (0.5, -0.2)},
        )
        for task, row, place in zip(KINDS, panels, places, strict=True):
            for what, axes in zip(WHATS, row, strict=True):
                axes.set(xscale="log", xlabel=WHATS[what], ylim=(-0.3, 10.3), title=task.replace("-", " "))
                steps = (1, 2, 4, 8) if what == "noise" else (1, 0.5, 0.25, 0.15)
                axes.set_xticks(steps, [f"{s:g}" for s in steps])
                axes.minorticks_off()
                if what != "noise":
                    axes.invert_xaxis()
            row[0].set_ylabel("correspondence score")
            handles, labels = row[2].get_legend_handles_labels()
            figure.add_artist(Legend(panels[0][1], handles, labels, title=task.replace("-", " "), **place))
        panels[0][1].set_title("")
        save(figure, path)


def draw_reliability(found: dict[str, pd.DataFrame], path: Path) -> None:
    """Share of right names against confidence, a panel a set of robots."""
    with styled():
        figure = new_figure(PAGE, 4.2, layout="constrained")
        panels = figure.subplots(2, 4, sharex=True, sharey=True)
        for axes, (label, made) in zip(panels.flat, found.items(), strict=True):
            rows = reliability(made)
            error = np.sqrt(rows["right"] * (1 - rows["right"]) / rows["count"])
            axes.plot([0, 1], [0, 1], color="0.6", linewidth=0.8)
            axes.errorbar(
                rows["sure"],
                rows["right"],
                yerr=error,
                color=COLOURS[0],
                marker="o",
                markersize=3,
                linewidth=1,
            )
            for one in rows.itertuples():
                axes.annotate(
                    str(one.count), (one.sure, one.right), (4, -8), textcoords="offset points", fontsize=6
                )
            axes.set(xlim=(0.3, 1.03), ylim=(0, 1.05))
            axes.set_title(label, fontsize=7)
        figure.supxlabel("confidence", size="medium")
        figure.supylabel("share of right names", size="medium")
        save(figure, path)


def save(figure: Any, path: Path) -> None:
    """A PNG of few colours: these figures need no more, and stay below 100 kB."""
    figure.savefig(path, dpi=150, metadata={"Software": None})
    with Image.open(path) as image:
        image.convert("RGB").quantize(64, dither=Image.Dither.NONE).save(path, optimize=True)


if __name__ == "__main__":
    main(sys.argv[1:])
