"""Prints every table of the study of misfit and noise, from the archived data: python analyse.py.

`--write` writes them into tables.md, and the figure of docs/noise.md; `--out out/misfit` takes the tables of
finished arms there instead of the archived ones.
"""

from __future__ import annotations

import argparse
import sys
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy import stats

sys.path.insert(0, str(Path(__file__).resolve().parent))
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from common import archive, estimate, markdown, number, table
from trend import CONTRAST, PLAN, Trend, against, holm, interaction, over_runs, over_units

from realitygap.report.misfit import peak

HERE = Path(__file__).resolve().parent
ARMS = tomllib.loads((HERE / "arms.toml").read_text("utf-8"))
NAMES = {
    "K": "K, readings of two real Kheperas (all else simulated)",
    "E": "E, Enki's Khepera",
    "T": "T, the twin",
}
PAPER = {0.0: 6.2, 1.0: 8.0, 2.0: 6.8}
"""The paper's diagonal, obstacle avoidance."""
CONTROL, RIVAL = "table", ARMS["rival"]["simulations"]
BINS = (0.0, 0.6, 1.5, 3.0, 4.5, np.inf)
"""Of misfit, for tables and the figure."""
SCORES = ("without_jitter", "score")
KEY = ["set", "reality", "simulation", "evolved_level", "run", "individual"]


@dataclass(frozen=True, eq=False)
class Arm:
    """An arm's tables: a row of `rows` for each controller, with its place's misfit and its score at the
    robot's level; `cells` at every level of comparison."""

    name: str
    rows: pd.DataFrame = field(repr=False)
    cells: pd.DataFrame = field(repr=False)

    @classmethod
    def of(cls, name: str, controllers: pd.DataFrame, cells: pd.DataFrame, misfits: pd.DataFrame) -> Arm:
        """From the tables that run.py writes."""
        known = misfits.set_index(["reality", "simulation"])["misfit"]
        judged = cells[np.isclose(cells["comparison_level"], PLAN["robot"])].set_index(KEY)[list(SCORES)]
        own = cells[np.isclose(cells["comparison_level"], cells["evolved_level"])].set_index(KEY)
        rows = controllers.join(judged, on=KEY).join(own["without_jitter"].rename("diagonal"), on=KEY)
        both = [rows, cells]
        for some in both:
            some["misfit"] = known.loc[list(zip(some["reality"], some["simulation"], strict=True))].to_numpy()
        return cls(name, *both)

    def some(self, **values: Any) -> Arm:
        """Those rows alone whose columns have these values."""
        parts = []
        for part in (self.rows, self.cells):
            keep = np.ones(len(part), bool)
            for key, value in values.items():
                keep &= part[key].isin(value if isinstance(value, (list, tuple, set)) else [value]).to_numpy()
            parts.append(part[keep])
        return Arm(self.name, *parts)

    @cached_property
    def models(self) -> Arm:
        """Champions in fixed simulations: no rivals."""
        names = set(self.rows["simulation"]) - set(RIVAL)
        return self.some(simulation=names, individual="champion")

    def trend(self, by: str, *, below: float = np.inf) -> Trend:
        """The contrast of an outcome, a column; "failures": of the share whose score is too low."""
        rows = self.rows[self.rows["misfit"] < below]
        y = rows[SCORES[0]].to_numpy() if by == "failures" else rows[by].to_numpy()
        known = np.isfinite(y)
        rows, y = rows[known], y[known]
        y = (y < PLAN["failed"]).astype(float) if by == "failures" else y
        level, misfit, simulation = (
            rows[key].to_numpy() for key in ("evolved_level", "misfit", "simulation")
        )
        if self.name == "K":
            stratum = (rows["reality"] + ", " + rows["simulation"]).to_numpy()
            return over_runs(level, misfit, stratum, y, rows["set"].to_numpy())
        units = [(rows["reality"] == unit).to_numpy() for unit in rows["reality"].unique()]
        slopes = [interaction(level[u], misfit[u], simulation[u], y[u]) for u in units]
        return over_units(np.array(slopes), np.array([rows["set"].to_numpy()[u][0] for u in units]))

    def judging(self) -> Trend:
        """How the root of the best level of comparison rises with misfit: a slope for each reality."""
        slopes, sets = [], []
        for _, unit in self.cells.groupby("reality", sort=False):
            tops, misfits = [], []
            for _, part in unit.groupby("simulation", sort=False):
                mean = part.groupby("comparison_level")[SCORES[0]].mean()
                tops.append(np.sqrt(float(peak(mean.index.to_numpy(float), mean.to_numpy()))))
                misfits.append(part["misfit"].iloc[0])
            slopes.append(np.polyfit(against(np.array(misfits)), tops, 1)[0])
            sets.append(int(unit["set"].iloc[0]))
        per = np.array(slopes) * float(np.diff(np.log2(PLAN["between"]))[0]) / CONTRAST
        return over_units(per, np.array(sets))


def word(claim: Mapping[str, Any], found: Trend, p: float) -> str:
    """What the plan calls it."""
    if p < PLAN["alpha"] and found.agrees:
        return "found" if found.contrast * claim["direction"] > 0 else "found, reversed"
    return "null" if found.absent(claim["least"]) else "open"


def verdicts(arms: Sequence[Arm]) -> str:
    """The primary family, and the secondary claim with a correction of its own."""
    rows = []
    primary, second = PLAN["claim"][:2], PLAN["claim"][2]
    for claims in (primary, [second]):
        tests = [
            (claim, arm, arm.models.judging() if claim is second else arm.models.trend(_by(claim)))
            for claim in claims for arm in arms
        ]  # fmt: skip
        planned = len(claims) * len(ARMS["arm"])  # an arm that is missing counts as if nothing were in it
        ps = holm([one.p for _, _, one in tests] + [1.0] * (planned - len(tests)))
        for (claim, arm, found), p in zip(tests, ps, strict=False):
            places = 3 if claim["key"] == "fitness" else 2
            said = estimate(*found[:3], places, signed=True)
            sets = " ".join(number(one, places, signed=True) for one in found.sets)
            rows.append(
                [claim["key"], arm.name, said, sets, f"{found.p:.3g}", f"{p:.3g}", word(claim, found, p)]
            )
    head = ["claim", "arm", "contrast (90 %)", "sets 1, 2", "p", "Holm", "word"]
    return markdown(head, rows)


def _by(claim: Mapping[str, Any]) -> str:
    return "failures" if claim["key"] == "failures" else claim["by"]


def robust(arms: Sequence[Arm]) -> str:
    """The primary claims by other individuals, scores and ranges: shown, not tested."""
    rows = []
    for arm in arms:
        fixed = set(arm.rows["simulation"]) - set(RIVAL)
        jittery = Arm(
            arm.name, arm.models.rows.assign(without_jitter=arm.models.rows["score"]), arm.models.cells
        )
        ranks = arm.models.rows[SCORES[0]].rank(pct=True)
        ranked = Arm(arm.name, arm.models.rows.assign(ranks=ranks), arm.models.cells)
        fittest = arm.some(simulation=fixed, individual="fittest")  # of T only champions drove
        for what, some, by, below in (
            ("failures, the paper's fittest", fittest, "failures", np.inf),
            ("fitness, the paper's fittest", fittest, "fitness_situated", np.inf),
            ("failures, with jitter", jittery, "failures", np.inf),
            ("rank of the score, 0 to 1", ranked, "ranks", np.inf),
            ("failures, misfit below 6", arm.models, "failures", 6.0),
            ("fitness, misfit below 6", arm.models, "fitness_situated", 6.0),
        ):
            if len(some.rows):
                rows.append([arm.name, what, estimate(*some.trend(by, below=below)[:3], 3, signed=True)])
    return markdown(["arm", "outcome", "contrast (90 %)"], rows)


def by_simulation(arm: Arm) -> str:
    """Failures and fitness by evolved level, for each simulation; both seed sets apart."""
    levels = ARMS["design"]["evolved"]
    rows = []
    for name, part in arm.some(individual="champion").rows.groupby("simulation", sort=False):
        for which in (1, 2):
            ours = part[part["set"] == which]
            if ours.empty:
                continue
            shares, means = [], []
            for level in levels:
                here = ours[np.isclose(ours["evolved_level"], level)]
                fails = (here[SCORES[0]] < PLAN["failed"]).sum()
                shares.append(f"{fails} of {here[SCORES[0]].notna().sum()}" if len(here) else "–")
                means.append(number(here["fitness_situated"].mean(), 3))
            misfit = ours.groupby("reality")["misfit"].first().median()
            rows.append([name, which, number(misfit), *shares, *means])
    head = ["simulation", "set", "misfit", *(f"failures, {v:g}" for v in levels),
            *(f"fitness, {v:g}" for v in levels)]  # fmt: skip
    return markdown(head, rows)


def diagonals(arms: Sequence[Arm]) -> str:
    """The paper's two diagonals beside ours, by misfit: each in its own simulation, and all at level 1."""
    levels = ARMS["design"]["evolved"]
    paper = [number(PAPER.get(level, np.nan), 1) for level in levels]
    rows = [["the paper (judged by eye)", "", "", *paper, *["–"] * len(levels)]]
    for arm in arms:
        for which, part in _binned(arm.models.rows):
            for name in (1, 2):
                ours = part[part["set"] == name]
                if len(ours):
                    mean = ours.groupby("evolved_level")
                    cells = [mean[key].mean().reindex(levels) for key in ("diagonal", SCORES[0])]
                    rows.append([arm.name, which, name, *(number(v, 1) for one in cells for v in one)])
    head = ["arm", "misfit", "set", *(f"own, {v:g}" for v in levels), *(f"at 1, {v:g}" for v in levels)]
    return markdown(head, rows)


def _binned(rows: pd.DataFrame) -> Iterator[tuple[str, pd.DataFrame]]:
    """Controllers by misfit, and the bin in words."""
    for low, high in pairwise(BINS):
        part = rows[(rows["misfit"] >= low) & (rows["misfit"] < high)]
        if len(part):
            yield f"{low:g} to {high:g}" if np.isfinite(high) else f"{low:g} or more", part


def in_short(arm: Arm) -> str:
    """An arm by the level of evolution, and by that of comparison; both sets together. Of K simulations by
    whether they are the table, and the two robots apart; of the others by misfit."""
    levels, rows, likeness = ARMS["design"]["evolved"], [], []
    cells = dict(_groups(arm, arm.models.cells))
    for what, part in _groups(arm, arm.models.rows):
        by = part.groupby("evolved_level")
        fails = by[SCORES[0]].agg(lambda one: (one < PLAN["failed"]).sum()).reindex(levels)
        size, drop = by.size().reindex(levels), (part["fitness_simulated"] - part["fitness_situated"])
        columns = {
            f"failures of {size.iloc[0]}": [f"{v:g}" for v in fails],
            "fitness": [number(v, 3) for v in by["fitness_situated"].mean()],
            "fall from simulation": [number(v, 3) for v in drop.groupby(part["evolved_level"]).mean()],
            "judged in its own": [number(v, 1) for v in by["diagonal"].mean()],
            "judged at 1": [number(v, 1) for v in by[SCORES[0]].mean()],
        }
        rows += [[what, key, *values] for key, values in columns.items()]
        one, none = (fails[v] / size[v] for v in (1.0, 0.0))
        half = stats.norm.isf(0.05) * np.sqrt(one * (1 - one) / size[1.0] + none * (1 - none) / size[0.0])
        told = estimate(one - none, one - none - half, one - none + half, 3, signed=True)
        means = cells[what].groupby("comparison_level")[SCORES[0]].mean()
        likeness.append([what, *(number(v) for v in means), told])
    compared = [f"judged at {v:g}" for v in ARMS["design"]["levels"]]
    first = "simulation" if arm.name == "K" else "misfit"
    return "\n\n".join([
        markdown([first, "evolved at", *(f"{v:g}" for v in levels)], rows),
        markdown([first, *compared, "failures, 1 less 0 (90 %)"], likeness),
    ])  # fmt: skip


def _groups(arm: Arm, rows: pd.DataFrame) -> Iterator[tuple[str, pd.DataFrame]]:
    """An arm's controllers or cells in the groups of `in_short`, and their names."""
    if arm.name != "K":
        yield from _binned(rows)
        return
    for what, part in (
        ("its own table", rows[rows["simulation"] == CONTROL]),
        ("fitted simulations", rows[rows["simulation"] != CONTROL]),
    ):
        yield what, part
        for name in ("khepera-1", "khepera-2"):
            here = part[part["reality"].str.startswith(name)]
            if len(here):
                yield f"{what}, {name}", here


def rival(arm: Arm) -> str:
    """What knowing more gained over the nominal robot randomised: on fitness, then on correspondence."""
    rows, some = [], arm.some(individual="champion", evolved_level=ARMS["rival"]["evolved"]).rows
    mean = some.groupby(["reality", "simulation"], sort=False)[["fitness_situated", SCORES[0]]].mean()
    base, tested = RIVAL[0], ARMS["rival"]["against"]

    def gain(known: str, column: str) -> tuple[str, float]:
        less = (mean[column].xs(known, level=1) - mean[column].xs(base, level=1)).to_numpy()
        half = stats.sem(less) * stats.t.isf(0.05, len(less) - 1)
        p = float(stats.ttest_1samp(less, 0.0).pvalue)
        return estimate(less.mean(), less.mean() - half, less.mean() + half, 3, signed=True), p

    ps = holm([gain(known, "fitness_situated")[1] for known in tested])
    for known in [*tested, "nominal", *RIVAL[1:]]:
        fit, p = gain(known, "fitness_situated")
        like, likely = gain(known, SCORES[0])
        corrected = ps[tested.index(known)] if known in tested else np.nan
        second = f"{like}, p {likely:.2g}" if corrected < PLAN["alpha"] else like
        rows.append(
            [known, fit, *((f"{p:.2g}", f"{corrected:.2g}") if known in tested else ("–", "–")), second]
        )
    head = [f"less {base}", "fitness (90 %)", "p", "Holm", "score without jitter (90 %)"]
    return markdown(head, rows)


MARKS, DASHES = {"K": "o", "E": "s", "T": "D"}, {"K": "-", "E": "-", "T": ":"}
DRAWN = 100
"""Controllers, at least, of a range of misfits in the figure."""
SHADES = dict(zip(ARMS["design"]["evolved"], ("#f0a202", "#d95d39", "#a4243b", "#4a1942"), strict=True))


def figure(arms: Sequence[Arm], file: Path) -> None:
    """Against misfit: failures for each level of evolution, and the best levels to evolve under and to judge
    by, with 95 % intervals over controllers; real readings are filled.
    Ranges with few controllers are left out."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import NullLocator

    drawing = Figure(figsize=(9.6, 3.6), layout="constrained")
    left, middle, right = drawing.subplots(1, 3, sharex=True)
    draw = np.random.default_rng(PLAN["seed"])
    for arm in arms:
        style = {"marker": MARKS[arm.name], "linewidth": 1, "markersize": 6}
        face = {} if arm.name == "K" else {"markerfacecolor": "white"}
        bins = [part for _, part in _binned(arm.models.rows) if len(part) >= DRAWN]
        at = [max(part["misfit"].median(), PLAN["floor"]) for part in bins]
        for level, shade in SHADES.items():
            shares = []
            for part in bins:
                here = part.loc[np.isclose(part["evolved_level"], level), SCORES[0]].dropna()
                shares.append(100 * (here < PLAN["failed"]).mean())
            left.plot(at, shares, color=shade, linestyle=DASHES[arm.name], **style, **face)
        for axis, rows, by, value in (
            (middle, arm.models.rows, "evolved_level", "fitness_situated"),
            (right, arm.models.cells, "comparison_level", SCORES[0]),
        ):
            for _, part in _binned(rows):
                if len(part) < DRAWN * len(rows) / len(arm.models.rows):
                    continue
                groups = [one[value].dropna().to_numpy() for _, one in part.groupby(by)]
                levels = np.sort(part[by].unique())
                top = float(peak(levels, np.array([one.mean() for one in groups])))
                means = [draw.choice(one, (1000, len(one))).mean(axis=1) for one in groups]
                low, high = np.percentile(peak(levels, np.stack(means, 1)), [2.5, 97.5])
                x = max(part["misfit"].median(), PLAN["floor"])
                axis.plot([x, x], np.sqrt([low, high]), color="#456", linewidth=1, zorder=1)
                axis.plot(x, np.sqrt(top), color="#456", **style, **face)
    left.set(title="unlike their simulation (failures), of 100", ylim=(0, 1.6 * left.get_ylim()[1]))
    left.legend(
        handles=[left.plot([], [], color=c, label=f"evolved at noise {v:g}")[0] for v, c in SHADES.items()],
        fontsize=8, frameon=False, loc="upper left",
    )  # fmt: skip
    for axis, title in ((middle, "best noise to evolve under (fitness)"), (right, "best noise to judge by")):
        ticks = np.array([0.0, 0.5, 1.0, 2.0, 4.0])
        axis.set(title=title, yticks=np.sqrt(ticks), ylim=(-0.1, 2.1))
        axis.set_yticklabels([f"{tick:g}" for tick in ticks])
    for axis in (left, middle, right):
        axis.set(xscale="log", xlabel="model error / noise", xticks=[0.25, 0.5, 1, 2, 4, 8, 16])
        axis.set_xticklabels(["≤ ¼", "½", "1", "2", "4", "8", "16"])
        axis.xaxis.set_minor_locator(NullLocator())
        axis.set_xlim(0.2, max(6.0, 1.2 * max(arm.models.rows["misfit"].max() for arm in arms)))
        axis.title.set_fontsize(10)
    names = [
        right.plot([], [], color="#456", linestyle="", marker=MARKS[arm.name], label=NAMES[arm.name],
                   **({} if arm.name == "K" else {"markerfacecolor": "white"}))[0]
        for arm in arms
    ]  # fmt: skip
    drawing.legend(handles=names, loc="outside lower center", ncols=3, fontsize=8, frameon=False)
    drawing.savefig(file, dpi=150)


def page(arms: Sequence[Arm]) -> str:
    """Every table."""
    parts = ["# Misfit and noise: every table", "`python studies/misfit/analyse.py --write` makes this page."]
    parts += ["## Verdicts", verdicts(arms), "## Not tested", robust(arms), "## Diagonals", diagonals(arms)]
    for arm in arms:
        parts += [f"## Arm {NAMES[arm.name]}", by_simulation(arm), in_short(arm)]
        if set(RIVAL) & set(arm.rows["simulation"]):
            parts += ["## The fair rival, on arm E's units", rival(arm)]
    return "\n\n".join(parts) + "\n"


def read(out: Path | None) -> list[Arm]:
    """All arms that there are whole, in the order of the plan: the archive's, or a folder's."""
    made = []
    for name in ARMS["arm"]:
        for parts in ([name], [f"{name}-1", f"{name}-2"]):
            if all(_there(out, part) for part in parts):
                files = [
                    [_table(out, part, key) for part in parts] for key in ("controllers", "cells", "misfits")
                ]
                made.append(Arm.of(name, *(pd.concat(each, ignore_index=True) for each in files)))
                break
    return made


def _there(out: Path | None, part: str) -> bool:
    return f"misfit/{part}/cells.csv" in archive() if out is None else (out / part / "results").is_dir()


def _table(out: Path | None, part: str, key: str) -> pd.DataFrame:
    return (
        table(f"misfit/{part}/{key}.csv")
        if out is None
        else pd.read_csv(out / part / "results" / f"{key}.csv")
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, help="folder of finished arms")
    parser.add_argument("--write", action="store_true", help="write tables.md and the figure")
    asked = parser.parse_args()
    arms = read(asked.out)
    if not arms:
        raise SystemExit(
            "expected an arm's tables, got none: the study has not been carried out yet (run.py)"
        )
    print(page(arms))
    if asked.write:
        (HERE / "tables.md").write_text(page(arms), encoding="utf-8")
        figure(arms, HERE.parents[1] / "docs" / "figures" / "noise-misfit.png")
