"""What stands under the situated half's figures, and what its table says in plain words.

"Real" and "reality" are kept for hardware; the twin is a stand-in, pseudo-reality.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from realitygap.report.gather import TaskPart
from realitygap.report.page import Words
from realitygap.report.statistics import difference
from realitygap.report.tables import Table, number
from realitygap.report.transfers import ROBOT, Group, Pair

__all__ = ["about", "pair_words", "read_transfers", "sheet_words"]


SOURCES = {
    "film": "tracked in a film from above",
    "camera": "tracked by the camera above, ten times a second",
    "counters": "reckoned from the wheels’ counters, which do not see a wheel slip",
    "robot": "as the robot itself knows it",
}
"""Where a situated path comes from."""


def about(pairs: Sequence[Pair]) -> str:
    """What "situated" means on this page."""
    twin, robot = any(pair.twin for pair in pairs), not all(pair.twin for pair in pairs)
    stand_in = (
        "a physics twin of the robot, with sensors, wheels and noise of its own: a stand-in, "
        "called pseudo-reality, in other code than the simulation’s, though sizes of noise, arenas "
        "and starts have common sources. It is not a robot"
    )
    if twin and robot:
        return f"Situated means: on a Khepera, or on {stand_in}; each row says which."
    return f"Situated means: on {stand_in}." if twin else "Situated means: on a Khepera."


def pair_words(part: TaskPart, shown: Sequence[Pair]) -> Words:
    """Of figure 3 or 5."""
    return Words(f"Paths. {_seen(part, shown)}.", _caption(part, shown))


def sheet_words(many: int, where: str, *, counted: bool) -> Words:
    """Of the sheet with every transferred run's paths; `counted`: some are from the wheels' counters."""
    alt = f"Simulated and situated paths of {many} runs, each from its first start."
    caption = f"{alt} Simulated above, {where} below; the number is the path’s score."
    if counted:
        caption += " A path that leaves the room is reckoned from counters of wheels that slipped at a wall."
    return Words(alt, caption)


def _caption(part: TaskPart, shown: Sequence[Pair]) -> str:
    """What stands under figure 3 or 5."""
    where, unit = shown[0].where, part.task.fitness_unit
    what = f"{where}, a physics stand-in for the robot (pseudo-reality)" if shown[0].twin else f"the {where}"
    sources = {pair.source for pair in shown}
    source = ", or ".join(words for name, words in SOURCES.items() if name in sources)
    who = {"champion": "retested champion", "fittest": "fittest individual"}
    names = {who.get(pair.individual, pair.individual) for pair in shown}
    name = names.pop() if len(names) == 1 else "individual"
    many = any(len(c.rows) > 1 for c in part.conditions)
    return (
        f"Above: simulated (thin whole strokes, empty body), at the noise that each {name} evolved under. "
        f"Below: situated (broad broken strokes, filled body), on {what}; the path is {source}. "
        + ("For each noise level the median run on fresh trials, where it was transferred. " if many else "")
        + "Both from the same start (ring). After the colon: the path’s score"
        + (f" in {unit}. " if unit else ". ")
        + "Each stroke of the tail joins the robot’s centre to its leading edge, every 0.1 s; none is erased."
    )


def _seen(part: TaskPart, shown: Sequence[Pair]) -> str:
    """The paths' ends, for those who cannot see them."""
    return "; ".join(
        f"{part.names[p.level]}: from ({p.simulated.x[0]:.0f}, {p.simulated.y[0]:.0f}) simulated to "
        f"({p.simulated.x[-1]:.0f}, {p.simulated.y[-1]:.0f}), on {p.where} to "
        f"({p.situated.x[-1]:.0f}, {p.situated.y[-1]:.0f}) cm"
        for p in shown
    )


def read_transfers(table: Table, groups: Sequence[Group], kind: str) -> str:
    """How simulated and situated scores compare on one kind of robot, by noise level."""
    return " ".join(_told(table, [group for group in groups if group.kind == kind], kind))


def _told(table: Table, groups: Sequence[Group], kind: str) -> Iterator[str]:
    where = "On Kheperas" if kind == ROBOT else f"On the {kind} (pseudo-reality)"
    parts, drops = [], []
    for group in groups:
        simulated, situated, drop = (group.mean(of) for of in ("simulated", "situated", "drop"))
        if simulated and situated and drop:
            parts.append(
                f"{group.name} noise {number(simulated.value / table.scale, table.places)} simulated, "
                f"{number(situated.value / table.scale, table.places)} situated"
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
        told = gap is not None and gap.value - gap.half > 0
        yield (
            f"The drop is least at {first.name} noise ({number(least / table.scale, table.places)}) "
            f"and largest at {last.name} noise ({number(most / table.scale, table.places)}): "
            + (
                "more than the spread among the runs explains, though these two were picked as the extremes."
                if told
                else "these runs do not tell them apart."
            )
        )
