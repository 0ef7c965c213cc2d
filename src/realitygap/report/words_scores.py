"""What tables 1 and 2 say in plain words, beside what the paper's say."""

from __future__ import annotations

from collections.abc import Iterator

from realitygap.report.scores import ScoreClass, ScoreTable
from realitygap.report.statistics import difference

__all__ = ["read_scores"]


def read_scores(table: ScoreTable) -> list[str]:
    """How both scores go with the noise level; nothing where there are none."""
    where = f" on the {table.kind}" if table.kind else ""
    told = [
        *_told(table, "behaviour", "The behaviour score averages"),
        *_told(table, "correspondence", f"The correspondence score{where} averages"),
    ]
    return [" ".join(told)] if told else []


def _told(table: ScoreTable, of: str, begins: str) -> Iterator[str]:
    known = [(mean.value, one) for one in table.classes if (mean := one.mean(of)) is not None]
    if not known:
        return
    said = ", ".join(f"{value:.1f} at {one.name} noise" for value, one in known)
    place = ("behaviour", "correspondence").index(of)
    printed = [f"{one.paper_average[place]:g}" for _, one in known if one.paper_average]
    beside = f" (the paper’s judges: {', '.join(printed)})" if len(printed) == len(known) else ""
    yield f"{begins} {said}{beside}{_order(known, of)}."


def _order(known: list[tuple[float, ScoreClass]], of: str) -> str:
    """Whether the runs tell the highest from the others, one by one."""
    if len(known) < 2:
        return ""
    ranked = sorted(known, key=lambda pair: -pair[0])
    best = ranked[0][1]
    gaps = [difference(best.values(of), other.values(of)) for _, other in ranked[1:]]
    if any(gap is None for gap in gaps):
        return ""
    sure = [gap is not None and gap.value - gap.half > 0 for gap in gaps]
    if all(sure):
        return (
            f"; {best.name} noise has the highest by more than the spread among the runs explains, "
            "though it was picked as the highest"
        )
    return f"; the runs do not tell {best.name} noise, the highest, from every other"
