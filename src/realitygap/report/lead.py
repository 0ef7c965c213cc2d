"""The introduction of a study's page: whose experiment it is, and what was simulated."""

from collections.abc import Sequence
from pathlib import Path

from realitygap.report.tables import TaskPart
from realitygap.study.config import Encoding, Evolution, StudyConfig
from realitygap.study.load import Study
from realitygap.tasks import load_task
from realitygap.world.robot import NOISE_LEVELS, Profile, load_profile, noise_name
from realitygap.world.toml import shipped

__all__ = ["departures", "is_paper", "lead", "made_of", "twin_unit"]

FOUND = {
    "torus": "evolved by the paper’s distributed genetic algorithm",
    "panmictic": "evolved by a genetic algorithm in one well-mixed population",
    "random": "found by random search",
}


KHEPERAS = ("paper", "khepera", "enki-khepera")
"""Shipped profiles of the paper's robot; the others are other robots'."""
NO_GAIN = 1e-3
"""Below this the wheels' integral gain, printed as 800, has no effect: a fit ends near its bound."""


def is_paper(study: Study, parts: Sequence[TaskPart]) -> bool:
    """Whether this is the paper's study: its tasks, noise levels, robot, networks, genetic algorithm."""
    tasks = {part.task.name: part.task for part in parts}
    if set(tasks) != {"obstacle-avoidance", "light-seeking"}:
        return False
    config, levels = study.config, sorted(NOISE_LEVELS.values())
    return (
        all(task.source is None and task.arena == load_task(name).arena for name, task in tasks.items())
        and all([c.level for c in part.conditions] == levels for part in parts)
        and (config.evolution, config.encoding) == (Evolution(), Encoding())
        and not _other_rates(config)
        and _is_khepera(study.profile)
    )


def lead(study: Study, parts: Sequence[TaskPart]) -> str:
    """What was evolved, how, in the simulation of which robot, and under what noise, from the settings."""
    config = study.config
    name = config.evolution.algorithm
    found = FOUND.get(name, f"evolved by {Path(name).name}")
    if name != "random" and _other_rates(config):
        found += " (operators at other rates)"
    levels = sorted({c.level for part in parts for c in part.conditions})
    names = [noise_name(level) for level in levels]
    listed = names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
    noise = "without noise" if levels == [0.0] else f"at {listed} noise"
    return f"Neural networks {found} in a simulation of {_robot(study.profile)}, {noise}"


def departures(profile: Profile) -> str:
    """The paper's printed equations that a calibrated simulation of its robot no longer has; "" for none."""
    if (profile.provenance.base or profile.name) not in KHEPERAS:
        return ""
    forms = {fit.channel: fit.form for fit in profile.provenance.fits}
    other = [forms.get(channel, "paper") != "paper" for channel in ("infrared", "ambient")]
    sensors = {
        (True, True): "none of the printed sensor equations is used as it stands",
        (True, False): "the infrared sensors have an equation other than the printed one",
        (False, True): "the ambient light sensors have equations other than the printed ones",
    }.get((other[0], other[1]), "")
    wheels = profile.wheels
    gone = [
        *(["integral term"] if wheels.ki < NO_GAIN else []),
        *(["static friction"] if wheels.friction_cm_s2 == 0 else []),
    ]
    told = [sensors, f"the wheels have no {' and no '.join(gone)}" if gone and forms else ""]
    return ", and ".join(words for words in told if words)


def made_of(profile: Profile) -> str:
    """A robot's shape and sensors, in words."""
    near, light = len(profile.infrared.sensors), len(profile.ambient.sensors)
    sensors = f"{'infrared' if near else 'light'} sensors"
    if near and light:
        same = "infrared sensors, which can also measure the light that falls on them"
        sensors = same if near == light else "infrared and light sensors"
    return f"{'body' if profile.body.outline_cm else 'disc'} on two wheels with {sensors}"


def twin_unit(profile: Profile) -> str:
    """Number of the twin's unit that a profile was calibrated to, from its name; "" for other robots."""
    start, _, unit = profile.name.partition("-")
    return unit if start == "twin" and unit.isdecimal() else ""


def _other_rates(config: StudyConfig) -> bool:
    """Whether the operators' rates are not the usual ones."""
    return bool(config.variation != type(config.variation)())


def _is_khepera(profile: Profile) -> bool:
    """Whether its constants are a Khepera's: shipped, or fitted to recordings starting from such."""
    if profile.name in KHEPERAS:
        return profile == load_profile(profile.name)
    return bool(profile.provenance.fits) and profile.provenance.base in KHEPERAS


def _robot(profile: Profile) -> str:
    """The robot and the source of its constants, in words."""
    name, unit = f"profile “{profile.name}”", twin_unit(profile)
    if profile.name in shipped("profiles"):
        if profile != load_profile(profile.name):
            return f"the robot of a changed {name}"
        constants = "the paper’s constants" if profile.name == "paper" else name
        return f"a Khepera robot ({constants})" if profile.name in KHEPERAS else f"the robot of {name}"
    if not profile.provenance.fits:
        return f"the robot of {name}"
    if unit:
        return f"a Khepera robot, calibrated to unit {unit} of its twin"
    return f"the robot of {name}, calibrated to recordings of it"
