"""The results in plain words, generated from the numbers, whichever way they fall."""

import math
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from realitygap.experiments.noise.claims import Contrast, Finding
from realitygap.report.noise import asides
from realitygap.report.noise.asides import CHANNELS, effect_words, shown
from realitygap.report.noise.facts import FitnessRow, NoiseFacts, Scope
from realitygap.report.noise.figures import titled
from realitygap.report.noise.results import Misfit

__all__ = ["CHANNEL_TASKS", "limits", "robot_words", "thoughts", "warnings"]

TEXTS: dict[str, Any] = tomllib.loads(Path(__file__).with_name("texts.toml").read_text("utf-8"))
"""Texts that do not depend on the results."""

SET_BY_US = "The robot here is a twin, and its noise was set by us."

STAND_INS = {
    "enki": "a robot of EPFL's simulator Enki",
    "stranger": "a twin outside the family of laws that calibration can fit",
}
"""Names of robots that may replace the twin, by kind of address."""

CHANNEL_TASKS = {"infrared": "obstacle-avoidance", "ambient": "light-seeking"}

_SENTENCES = {
    "supported": "is supported",
    "in part": "is supported in part",
    "not supported": "is not supported",
    "elsewhere": "does not hold: another level does better",
    "opposite": "is reversed",
}
_WHAT = {
    "a": "Claim (a), that tracks look most like a simulation as noisy as the robot,",
    "b": "Claim (b), that in one simulation controllers evolved at the robot's noise score best,",
    "c": "Claim (c), the paper's diagonal, each controller against the simulations at the level at which it "
    "was evolved,",
}


def thoughts(facts: NoiseFacts, settings: Mapping[str, object], calibration: Sequence[Misfit]) -> list[str]:
    """The results: a few sentences each on the study, the claims, noisiness and fitness."""
    findings = facts.headline.findings
    said = [
        _opening(facts, settings),
        *(" ".join(_claim(facts, finding)) for finding in findings),
        asides.split_words(facts.headline, findings[0].coarse),
        asides.home_words(facts.headline),
        _together(findings),
        asides.ends_words(facts),
        _noisiness(facts.headline),
        " ".join([*_drops(facts), _fitness(facts.fitness)]),
        asides.falls_words(facts.falls),
        "" if "robot" in settings else f"{asides.nearness_words(calibration)} {SET_BY_US}".strip(),
    ]
    return [thought.strip() for thought in said if thought]


def robot_words(settings: Mapping[str, object]) -> str:
    """The robot in place of the twin; "" if there is none."""
    robot = Path(str(settings.get("robot", ""))).name
    whose = STAND_INS.get(_kind(settings), "the user's own robot")
    return f"{robot}, {whose}" if robot else ""


def limits(settings: Mapping[str, object]) -> tuple[str, ...]:
    """What such an experiment cannot show."""
    told = TEXTS["limits"]
    return (*told.get(_kind(settings), ()), *told["all"])


def _kind(settings: Mapping[str, object]) -> str:
    return str(settings.get("robot", "twin")).partition(":")[0]


def warnings(calibration: Sequence[Misfit], tasks: Sequence[str], lost: int = 0) -> list[str]:
    """Where calibration errors are too large for noise levels to be meaningful; lost controllers."""
    said = []
    if lost:
        who = f"{lost} controllers have" if lost > 1 else "One controller has"
        said.append(f"{who} no score and no part in what follows: the camera lost the robot too often.")
    for channel, task in CHANNEL_TASKS.items():
        far = [m for m in calibration if m.channel == channel and m.too_far]
        if far and task in tasks:
            units = ", ".join(str(m.unit) for m in far)
            worst = max(m.ratio for m in far)
            said.append(
                f"In {CHANNELS[channel]} the calibrated model's error is up to {worst:.1f} deviations of the "
                f"noise (unit{'s' * (len(far) > 1)} {units}; limit {far[0].limit:g}): model error "
                f"exceeds noise there; read {titled(task).lower()} with that in mind."
            )
    return said


def _opening(facts: NoiseFacts, settings: Mapping[str, object]) -> str:
    data = facts.data
    levels = ", ".join(f"{level:g}" for level in data.levels)
    trials = settings.get("twin_trials")
    drove = f" in {trials} trials" if isinstance(trials, int) else ""
    own = robot_words(settings)
    robot, known = "the twin", f" (its noise scale is {settings['twin_noise']:g})"
    if own:
        robot, known = own, known if _kind(settings) in STAND_INS else ""
    text = (
        f"{len(data)} controllers evolved at noise {levels} drove {robot}{drove}, and each was compared "
        f"with the simulation at every level, where 1 is the noise that was measured on "
        f"{'the twin' if not own else 'this robot'}{known}."
    )
    if data.robot != 1:
        text += f" The nearest level of the study, {data.robot:g}, stands for it."
    return text


def _claim(facts: NoiseFacts, finding: Finding) -> list[str]:
    """The verdict, its means, and where tasks or seed sets disagree."""
    key, contrasts = finding.claim.key, finding.contrasts
    robot = contrasts[0]
    head = f"{_WHAT[key]} {_SENTENCES[finding.verdict]}: {robot.means[0]:.1f} at {robot.level:g}"
    if all(c.found == "open" for c in contrasts):
        others = sorted(c.means[1] for c in contrasts)
        low, high = f"{others[0]:.1f}", f"{others[-1]:.1f}"
        means = f"{low if low == high else f'{low} to {high}'} elsewhere, and no difference passes the tests"
    else:
        means = ", ".join(f"{c.means[1]:.1f} at {c.other:g} ({effect_words(c)})" for c in contrasts)
    said = [f"{head}, {means}."]
    better = [c for c in contrasts if c.found == "below"]
    if better:
        said.append(f"Reliably better than the robot's level: {_levels(better)}.")
    said += _disagreements(facts, finding)
    if finding.verdict == "not supported" and (hidden := _hidden(contrasts)):
        said.append(hidden)
    top = facts.headline.curves[key].top
    levels = facts.data.levels
    if finding.verdict != "not supported" and math.isfinite(top.low):
        wide = top.low <= levels[0] and top.high >= levels[-1]
        said.append("The curve has no clear peak." if wide else f"The curve peaks at {shown(top)}.")
    return said


def _disagreements(facts: NoiseFacts, finding: Finding) -> list[str]:
    said = []
    split = [c for c in finding.contrasts if len({effect.delta > 0 for effect in c.sets.values()}) > 1]
    if split:
        said.append(f"The seed sets disagree about {_levels(split)}.")
    if len(finding.contrasts[0].sets) == 1 and finding.verdict != "not supported":
        said.append("One seed set alone: nothing has been repeated.")
    others = {
        scope.name: other.verdict
        for scope in facts.scopes[1:]
        for other in scope.findings
        if other.claim.key == finding.claim.key and other.verdict != finding.verdict
    }  # fmt: skip
    said += [f"For {titled(task).lower()} alone the verdict is “{word}”." for task, word in others.items()]
    return said


def _levels(contrasts: Sequence[Contrast]) -> str:
    names = [f"{c.other:g}" for c in contrasts]
    text = ", ".join(names[:-1]) + (" and " if len(names) > 1 else "") + names[-1]
    return f"level{'s' * (len(names) > 1)} {text}"


def _hidden(contrasts: Sequence[Contrast]) -> str:
    """Sizes of effects that an open comparison may hide: not shown is not none."""
    wide = [
        (max(map(abs, c.effect.difference_interval)), c.other)
        for c in contrasts if c.found == "open" and c.effect.difference_interval
    ]  # fmt: skip
    if not wide:
        return ""
    most, other = max(wide)
    return (
        f"Not shown does not mean none: a difference of means of {most:.1f} points (against {other:g}) is "
        "not excluded."
    )


def _together(findings: Sequence[Finding]) -> str:
    """The three verdicts together; nothing more about what was not shown."""
    held = {finding.claim.key for finding in findings if finding.verdict == "supported"}
    if held == {"a", "b", "c"}:
        return (
            "So both matter: the simulation that a robot is compared with, and the level it was evolved at."
        )
    if "b" in held:
        return "So the noise that a controller evolved under affects how well it transfers."
    if "a" in held:
        return (
            "So it matters with which simulation a robot is compared. Whether controllers transfer better "
            "for having been evolved at the robot's noise is open."
        )
    if "c" in held:
        return "So the paper's result appears again, but not which of its two explanations is right."
    if any(finding.verdict == "in part" for finding in findings):
        return "So the paper's effect was shown in part at most."
    return "So none of the three showed the paper's effect; that does not show that there is no effect."


def _noisiness(scope: Scope) -> str:
    top, means = scope.noisiness.top, scope.noisiness.means
    if math.isfinite(top.value):
        return f"The twin is noisier than simulations below level {shown(top)}, less noisy than those above."
    if (means > 0).all():
        return "The twin is noisier than the simulation at every level."
    return "The twin is less noisy than the simulation at every level." if (means < 0).all() else ""


def _fitness(rows: Sequence[FitnessRow]) -> str:
    """Levels that differ on the twin from the robot's level; states that it is not a claim."""
    apart = [
        f"{titled(r.task).lower()} at {r.level:g} {'higher' if r.delta.value > 0 else 'lower'} "
        f"(delta {shown(r.delta, signed=True)})"
        for r in rows
        if r.delta is not None and math.isfinite(r.delta.low) and r.delta.low * r.delta.high > 0
    ]
    known = any(r.delta is not None and math.isfinite(r.delta.low) for r in rows)
    if not known:
        return ""
    if not apart:
        return "Fitness on the twin is not shown to differ from that at the robot's level at any other."
    return (
        f"Fitness on the twin against that at the robot's level: {'; '.join(apart)}; the others open. This "
        "was no claim, and is not corrected for the number of comparisons."
    )


def _drops(facts: NoiseFacts) -> list[str]:
    """Loss of fitness on the twin: at the robot's level and those that decide."""
    levels = sorted({facts.data.robot, *facts.headline.findings[0].coarse})
    said = []
    for task in facts.data.tasks:
        scale, unit = facts.scales[task]
        drops = {row.level: row.drop.value / scale for row in facts.fitness if row.task == task}
        parts = ", ".join(f"{drops[level]:z.3f} at {level:g}".replace("-", "−") for level in levels)
        below = all(drops[level] >= 0 for level in levels)
        begins = "fitness on the twin is below that in simulation by"
        said.append(
            f"In {titled(task).lower()} "
            f"{begins if below else 'fitness in simulation minus that on the twin is'} {parts}"
            f"{f' ({unit})' if unit else ''}."
        )
    return said
