"""What stands under the figures, and what is told to those who cannot see them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from realitygap.report.gather import PER_CONDITION, TaskPart
from realitygap.report.page import Words
from realitygap.report.wiring import read_wiring
from realitygap.world.profile import Profile

__all__ = ["arena_words", "curve_words", "network_words", "path_words", "robot_words", "sheet_words"]


def robot_words(profile: Profile) -> Words:
    """Of the robot's picture."""
    robot = profile.to_kernel()
    count = max(len(robot.proximity_place), len(robot.ambient_place))
    text = f"The robot from above, to scale: {count} sensors with their numbers and directions, two wheels."
    return Words(text, text + " It looks up; in the arenas a line points to its front.")


def arena_words(part: TaskPart) -> Words:
    """Of a task's arena."""
    arena = part.task.arena.to_kernel()
    width, depth = arena.size
    things = [
        f"{len(arena.cylinders)} cylinders" if len(arena.cylinders) else "",
        f"{len(arena.segments)} inner walls" if len(arena.segments) else "",
        f"{len(arena.lamp_centre)} lamp" + "s" * (len(arena.lamp_centre) > 1)
        if len(arena.lamp_centre)
        else "",
    ]
    named = ", ".join(thing for thing in things if thing) or "no obstacles"
    what = (
        "infrared rays, as far as they can add to a reading"
        if part.task.feeds == "proximity"
        else "ambient light sensors' rays (their first 15 cm)"
    )
    caption = (
        f"The arena, {width:g} × {depth:g} cm, with {named}, where trials start, "
        f"and a robot with its {what}, to what they meet."
    )
    return Words(caption, caption)


def curve_words(part: TaskPart, curves: Mapping[float, Sequence[np.ndarray]], fresh: bool) -> Words:
    """Of the curves of evolution."""
    counts = sorted({len(runs) for runs in curves.values()})
    over = (
        f"{counts[0]} run" + "s" * (counts[0] > 1)
        if len(counts) == 1
        else f"{counts[0]} to {counts[-1]} runs"
    )
    many = counts[-1] > 1
    caption = (
        (f"Mean over {over} of each" if many else "One run of each")
        + " noise level of the fittest individual's "
        "stored fitness at each evaluation"
        + ("; the bands are 95 % intervals of the mean." if many else ": no spread can be shown.")
    )
    if fresh:
        caption += (
            " Open marks at the right: what the final fittest score on fresh trials at their own noise."
        )
    ends = ", ".join(
        f"{part.names[level]} {np.mean([run[-1] for run in runs]) / part.task.fitness_scale:.2f}"
        for level, runs in curves.items()
    )
    return Words(f"Fitness of the fittest against evaluations. At the end: {ends}.", caption)


def path_words(part: TaskPart, seen: str) -> Words:
    """Of the chosen runs' paths."""
    unit = f" (in {part.task.fitness_unit})" if part.task.fitness_unit else ""
    many = any(len(c.rows) > 1 for c in part.conditions)
    which = (
        "For each noise level the run whose retested champion is the median one on fresh trials. "
        if many
        else ""
    )
    caption = (
        f"Simulated paths of {part.task.seconds:g} s at the noise that each individual evolved under. {which}"
        f"After the colon: this trial's score{unit}. Ring: start, the same for all; each stroke of the tail "
        "joins the robot's centre to its leading edge, every 0.1 s, and none is erased."
    )
    return Words(f"Paths. {seen}.", caption)


def sheet_words(part: TaskPart, seen: str) -> Words:
    """Of the sheet with all runs' paths."""
    most = max(len(c.rows) for c in part.conditions)
    few = f"the first {PER_CONDITION} of {most} runs" if most > PER_CONDITION else "every run"
    return Words(
        f"Paths of {few}. {seen}.",
        f"One trial of the retested champion of {few}, all from the same start; a row a noise level. The "
        "number is the trial's score.",
    )


def network_words(genes: np.ndarray, title: str, inputs: int, *, champion: bool) -> Words:
    """Of one network."""
    wiring = read_wiring(genes, inputs=inputs, outputs=2)
    links = sum(wiring.works(link) for link in wiring.links)
    hidden = sum(h in wiring.useful for h in wiring.hidden)
    who = "Retested champion" if champion else "Fittest so far"
    facts = f"{links} working link{'s' * (links != 1)}, {hidden} working hidden neuron{'s' * (hidden != 1)}"
    spelled = "; ".join(
        f"{k.source} to {k.target} weight {k.weight} delay {k.delay}" for k in wiring.links if wiring.works(k)
    )
    return Words(f"Network of {title}: {facts}. {spelled}.", f"{who}, {title}: {facts}.")
