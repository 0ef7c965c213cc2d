"""The tables in plain words, computed from them: nothing here expects an outcome."""

from collections.abc import Iterator, Sequence

import numpy as np

from realitygap.report.scores import SCORES, ScoreClass, ScoreTable
from realitygap.report.statistics import Mean, difference, mean_of
from realitygap.report.tables import TaskPart, counted
from realitygap.report.transfers import Group
from realitygap.robots.address import ROBOT

__all__ = ["read_scores", "read_table", "read_transfers"]


def read_table(table: TaskPart) -> list[str]:
    """A few sentences on a table; fewer if an unfinished study leaves it empty."""
    sentences = [_overrating(table), _order(table), _champions(table), *_robustness(table)]
    return [sentence for sentence in sentences if sentence]


def _pairs(table: TaskPart, who: str) -> list[tuple[float, float]]:
    """(stored fitness, mean on fresh trials at its own noise) of every tested run."""
    tested = ((row.stored, row.mean(who, one.level)) for one in table.conditions for row in one.rows)
    return [(stored, fresh.value) for stored, fresh in tested if stored is not None and fresh is not None]


def _overrating(table: TaskPart) -> str:
    """Difference of the fittest's stored fitness from its score on fresh trials."""
    pairs = np.array(_pairs(table, "fittest"))
    if not len(pairs):
        return ""
    stored, fresh = pairs.mean(axis=0)
    gap = stored - fresh
    share = f" ({abs(gap) / stored:.0%})" if stored > 0 else ""
    if gap > 0:
        verdict = (
            f"{table.text(gap)} less{share}: the highest of many noisy fitnesses is partly luck, "
            "which is why the tables show fresh trials."
        )
    else:
        verdict = f"{table.text(-gap)} more{share}."
    return (
        f"The fittest individuals’ stored fitness is {table.text(stored)} on average over "
        f"{counted(len(pairs), 'run')}; "
        f"on fresh trials at the noise they evolved under they score {table.text(fresh)}, {verdict}"
    )


def _order(table: TaskPart) -> str:
    """Which noise class does best at the robot's own noise, and whether the runs can show it."""
    level = 1.0 if 1.0 in table.levels else next(iter(table.levels), None)
    if level is None:
        return ""
    ranked = [(one, one.means("fittest", level)) for one in table.conditions]
    ranked = sorted(((one, m) for one, m in ranked if m.size), key=lambda pair: -pair[1].mean())
    if len(ranked) < 2:
        return ""
    listed = ", ".join(f"{one.name} noise {table.text(float(m.mean()))}" for one, m in ranked)
    tested = table.levels[level]
    text = f"Tested at {tested} noise, the fittest individuals by the noise they evolved under: {listed}."
    gap = difference(ranked[0][1], ranked[-1][1])
    if gap is None:
        return text + " One run each does not tell them apart."
    return f"{text} First and last differ by {' '.join(table.show(gap))} (95 % interval): " + (
        f"more than the spread among {counted(len(ranked[0][1]), 'run')} explains, though they were picked "
        "as the extremes."
        if _sure(gap)
        else f"with {counted(len(ranked[0][1]), 'run')} each this does not tell them apart."
    )


def _sure(gap: Mean | None) -> bool:
    """Whether the 95 % interval of a difference is above zero."""
    return gap is not None and gap.value - gap.half > 0


def _champions(table: TaskPart) -> str:
    """Whether the retest finds better individuals than the stored fitness does."""
    fittest, champion = [
        np.array([fresh for _, fresh in _pairs(table, who)]) for who in ("fittest", "champion")
    ]
    if not len(fittest) or len(fittest) != len(champion):
        return ""
    gain = mean_of(champion - fittest)
    assert gain is not None
    ahead = int((champion > fittest).sum())
    word = "more" if gain.value >= 0 else "less"
    return (
        f"The retested champion scores higher than the fittest in {ahead} of {counted(len(fittest), 'run')}, "
        "on average "
        f"{table.text(abs(gain.value))} {word} at the noise both evolved under."
    )


def _robustness(table: TaskPart) -> list[str]:
    """Scores of each class from the least to the most noise it was tested at."""
    if len(table.levels) < 2:
        return []
    low, high = min(table.levels), max(table.levels)
    ends = [(one.name, one.mean("fittest", low), one.mean("fittest", high)) for one in table.conditions]
    parts = "; ".join(
        f"evolved at {name} noise, from {table.text(before.value)} to {table.text(after.value)}"
        for name, before, after in ends
        if before and after
    )
    begins = f"From {table.levels[low]} to {table.levels[high]} noise the fittest individuals go"
    return [f"{begins}: {parts}."] if parts else []


def read_scores(table: ScoreTable) -> list[str]:
    """Change of both scores with the noise level; empty if there are none."""
    where = f" on the {table.kind}" if table.kind else ""
    whose = "The fittest individuals’" if table.individual == "fittest" else "The"
    told = [
        *_told_scores(table, "behaviour", f"{whose} behaviour score averages"),
        *_told_scores(table, "correspondence", f"{whose} correspondence score{where} averages"),
    ]
    return [" ".join(told)] if told else []


def _told_scores(table: ScoreTable, of: str, begins: str) -> Iterator[str]:
    known = [(mean.value, one) for one in table.classes if (mean := one.mean(of)) is not None]
    if not known:
        return
    said = ", ".join(f"{value:.1f} at {one.name} noise" for value, one in known)
    place = SCORES.index(of)
    printed = [f"{one.paper_average[place]:g}" for _, one in known if one.paper_average]
    beside = f" (the paper’s judges: {', '.join(printed)})" if len(printed) == len(known) else ""
    yield f"{begins} {said}{beside}{_best(known, of)}."


def _best(known: list[tuple[float, ScoreClass]], of: str) -> str:
    """Whether the runs distinguish the highest from each of the others."""
    if len(known) < 2:
        return ""
    ranked = sorted(known, key=lambda pair: -pair[0])
    best = ranked[0][1]
    gaps = [difference(best.values(of), other.values(of)) for _, other in ranked[1:]]
    if None in gaps:
        return ""
    if all(map(_sure, gaps)):
        return (
            f"; {best.name} noise has the highest by more than the spread among the runs explains, "
            "though it was picked as the highest"
        )
    return f"; the runs do not tell {best.name} noise, the highest, from every other"


def read_transfers(table: TaskPart, groups: Sequence[Group], kind: str) -> str:
    """Comparison of simulated and situated scores on one kind of robot, by noise level."""
    return " ".join(_told_transfers(table, [group for group in groups if group.kind == kind], kind))


def _told_transfers(table: TaskPart, groups: Sequence[Group], kind: str) -> Iterator[str]:
    where = "On robots" if kind == ROBOT else f"On the {kind} (pseudo-reality)"
    parts, drops = [], []
    for group in groups:
        simulated, situated, drop = (group.mean(of) for of in ("simulated", "situated", "drop"))
        if simulated and situated and drop:
            parts.append(
                f"{group.name} noise {table.text(simulated.value)} simulated, "
                f"{table.text(situated.value)} situated"
            )
            drops.append((drop.value, group))
    if not parts:
        yield f"{where} no transfer has scores yet."
        return
    yield f"{where}, by the noise they evolved under: {'; '.join(parts)}."
    if len(drops) > 1:
        ranked = sorted(drops, key=lambda pair: pair[0])
        (least, first), (most, last) = ranked[0], ranked[-1]
        gap = difference(last.values("drop"), first.values("drop"))
        yield (
            f"The drop is least at {first.name} noise ({table.text(least)}) "
            f"and largest at {last.name} noise ({table.text(most)}): "
            + (
                "more than the spread among the runs explains, though these two were picked as the extremes."
                if _sure(gap)
                else "these runs do not tell them apart."
            )
        )
