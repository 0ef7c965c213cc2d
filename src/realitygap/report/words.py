"""Captions of the figures, and their text alternatives.

"Real" and "reality" are reserved for hardware; the twin is a stand-in, a pseudo-reality.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from realitygap.control.genotype import Genotype
from realitygap.report.gather import PER_CONDITION
from realitygap.report.page import Words
from realitygap.report.robots import shown_sensors
from realitygap.report.tables import TaskPart, counted
from realitygap.report.transfers import Pair
from realitygap.report.wiring import read_wiring
from realitygap.world.robot import Profile

__all__ = [
    "about", "arena_words", "curve_words", "network_words", "pair_words", "path_words", "robot_words",
    "sheet_words", "transfer_sheet_words",
]  # fmt: skip


def robot_words(profile: Profile) -> Words:
    """Words for the robot's picture."""
    sensors = counted(sum(1 for _ in shown_sensors(profile.to_kernel())), "sensor")
    text = f"The robot from above, to scale: {sensors} with their numbers and directions, two wheels."
    return Words(text, text + " It faces up; in the arenas a line points to its front.")


def arena_words(part: TaskPart) -> Words:
    """Words for a task's arena."""
    arena = part.task.arena.to_kernel()
    width, depth = arena.size
    things = {"cylinder": arena.cylinders, "inner wall": arena.segments, "lamp": arena.lamp_centre}
    named = ", ".join(counted(len(those), name) for name, those in things.items() if len(those))
    rays = {
        "proximity": "infrared rays, as far as they can add to a reading",
        "ambient": "ambient light sensors' rays (their first 15 cm)",
    }
    what = ", and its ".join(rays[kind] for kind in part.task.kinds)
    caption = (
        f"The arena, {width:g} × {depth:g} cm, with {named or 'no obstacles'}, where trials start, "
        f"and a robot with its {what}, drawn up to whatever they meet."
    )
    if len(arena.reflectance):
        caption += " ×: a surface's reflectance, relative to the calibration's."
    return Words(caption, caption)


def curve_words(part: TaskPart, curves: Mapping[float, Sequence[np.ndarray]], fresh: bool) -> Words:
    """Words for the curves of evolution."""
    counts = sorted({len(runs) for runs in curves.values()})
    over = counted(counts[0], "run") if len(counts) == 1 else f"{counts[0]} to {counts[-1]} runs"
    many = counts[-1] > 1
    begins = f"Mean over {over} of each" if many else "One run of each"
    ends = "; the bands are 95 % intervals of the mean." if many else ": no spread can be shown."
    caption = f"{begins} noise level of the fittest individual's stored fitness at each evaluation{ends}"
    if fresh:
        caption += (
            " Open markers at the right: what the final fittest score on fresh trials at their own noise."
        )
    ends = ", ".join(
        f"{part.names[level]} {np.mean([run[-1] for run in runs]) / part.task.fitness_scale:.2f}"
        for level, runs in curves.items()
    )
    return Words(f"Fitness of the fittest against evaluations. At the end: {ends}.", caption)


def _median(part: TaskPart) -> str:
    """What makes a shown run the median one, as `median_run` chooses it."""
    rows = [(row, one.level) for one in part.conditions for row in one.begun]
    tested = all(row.mean("champion", level) for row, level in rows)
    where = "" if tested else ", or in stored fitness where none are at its own noise"
    return f"the median one on fresh trials{where}"


def path_words(part: TaskPart, seen: str) -> Words:
    """Words for the chosen runs' paths."""
    unit = f" (in {part.task.fitness_unit})" if part.task.fitness_unit else ""
    many = any(len(c.rows) > 1 for c in part.conditions)
    which = f"For each noise level the run whose retested champion is {_median(part)}. " * many
    caption = (
        f"Simulated paths of {part.task.seconds:g} s at the noise that each individual evolved under. {which}"
        f"After the colon: this trial's score{unit}. Ring: start, the same for all; each stroke of the tail "
        "joins the robot's centre to its leading edge at each step, and none is erased."
    )
    return Words(f"Paths. {seen}.", caption)


def sheet_words(part: TaskPart, seen: str) -> Words:
    """Words for the sheet of all runs' paths."""
    most = max(len(c.rows) for c in part.conditions)
    few = f"the first {PER_CONDITION} of {most} runs" if most > PER_CONDITION else "every run"
    return Words(
        f"Paths of {few}. {seen}.",
        f"One trial of the retested champion of {few}, all from the same start, one row per noise level. The "
        "number is the trial's score.",
    )


def network_words(genotype: Genotype, title: str, *, champion: bool) -> Words:
    """Words for a network's picture.

    Args:
        genotype: its own.
        title: whose.
        champion: whether it was retested.
    """
    wiring = read_wiring(genotype)
    links = sum(wiring.works(link) for link in wiring.links)
    hidden = sum(h in wiring.useful for h in wiring.hidden)
    who = "Retested champion" if champion else "Fittest so far"
    facts = f"{counted(links, 'working link')}, {counted(hidden, 'working hidden neuron')}"
    spelled = "; ".join(
        f"{k.source} to {k.target} weight {k.weight} delay {k.delay}" for k in wiring.links if wiring.works(k)
    )
    return Words(f"Network of {title}: {facts}. {spelled}.", f"{who}, {title}: {facts}.")


SOURCES = {
    "film": "tracked in a film from above",
    "camera": "tracked by the camera above, ten times a second",
    "counters": "computed from the wheels’ counters, which do not see a wheel slip",
    "speeds": "computed from the speeds that its motors measure, which do not see a wheel slip",
    "robot": "as reported by the robot itself",
}
"""Sources of situated paths."""


NO_ROBOT = ". It is not a robot"
STAND_INS = {
    "robot": "a robot",
    "twin": "a physics twin of the robot, with sensors, wheels and noise of its own: a stand-in, "
    "called pseudo-reality, which shares no code with the simulation, though sizes of noise, arenas "
    "and starts have common sources" + NO_ROBOT,
    "stranger": "a second physics twin of the robot, outside the family of laws that the calibration can "
    "fit: a stand-in, called pseudo-reality" + NO_ROBOT,
    "Enki": "a robot of EPFL’s simulator Enki, with sensor models and noise made by others: a stand-in, "
    "called pseudo-reality" + NO_ROBOT,
}
"""What a situated individual drives, by the first word of its kind."""


def about(pairs: Sequence[Pair]) -> str:
    """The meaning of "situated" on this page."""
    kinds = {pair.kind.split()[0] for pair in pairs}
    places = [words for name, words in STAND_INS.items() if name in kinds]
    if len(places) == 1:
        return f"Situated means: on {places[0]}."
    short = "; or on ".join(words.removesuffix(NO_ROBOT) for words in places)
    return f"Situated means: on {short}. Each row says which; a stand-in is not a robot."


def pair_words(part: TaskPart, shown: Sequence[Pair]) -> Words:
    """Words for figure 3 or 5: the paths' ends as text alternative, and the caption."""
    where, unit = shown[0].where, part.task.fitness_unit
    kind = "physics stand-in" if shown[0].kind.startswith(("twin", "stranger")) else "stand-in"
    stood_in = shown[0].stand_in is not None
    what = f"{where}, a {kind} for the robot (pseudo-reality)" if stood_in else f"the {where}"
    sources = {pair.situated_from for pair in shown}
    source = ", or ".join(words for name, words in SOURCES.items() if name in sources)
    who = {"champion": "retested champion", "fittest": "fittest individual"}
    names = {who.get(pair.individual, pair.individual) for pair in shown}
    name = names.pop() if len(names) == 1 else "individual"
    many = any(len(c.rows) > 1 for c in part.conditions)
    caption = (
        f"Above: simulated (thin solid strokes, open body), at the noise that each {name} evolved under. "
        f"Below: situated (broad dashed strokes, filled body), on {what}; the path is {source}. "
        + f"For each noise level the run that is {_median(part)}, where it was transferred. " * many
        + "Both from the same start (ring). After the colon: the path’s score"
        + (f" in {unit}. " if unit else ". ")
        + "Each stroke of the tail joins the robot’s centre to its leading edge at each step; none is erased."
    )
    ends = "; ".join(
        f"{part.names[p.level]}: from ({before.x[0]:.0f}, {before.y[0]:.0f}) simulated to "
        f"({before.x[-1]:.0f}, {before.y[-1]:.0f}), on {p.where} to ({after.x[-1]:.0f}, {after.y[-1]:.0f}) cm"
        for p in shown
        for before, after in [p.paths]
    )
    return Words(f"Paths. {ends}.", caption)


def transfer_sheet_words(many: int, where: str, *, counted: bool) -> Words:
    """Words for the sheet of all transferred runs' paths; `counted`: some are from wheel counters."""
    alt = f"Simulated and situated paths of {many} runs, each from its first start."
    caption = f"{alt} Simulated above, {where} below; the number is the path’s score."
    if counted:
        caption += " A path that leaves the room was computed from wheels that slipped at a wall."
    return Words(alt, caption)
