"""The noise experiment on several robots, each in a folder of its own."""

import shlex
from collections.abc import Iterator
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

from realitygap.errors import StudyError, UsageError
from realitygap.experiments.experiment import RESULTS, Settings, open_folder
from realitygap.experiments.noise import NoiseConfig, check_robot, noise_experiment
from realitygap.robots.address import Address
from realitygap.work.folder import lock
from realitygap.work.pool import Workers, opened
from realitygap.work.progress import OnProgress, Progress
from realitygap.world.toml import require

__all__ = ["KNOWN", "Place", "RobotsConfig", "finished", "robots_experiment"]

KNOWN = ("twin", "enki:khepera", "enki:epuck", "enki:thymio2")
"""The robots that come with the package, or with a library."""
TASK = "obstacle-avoidance"
"""The one task for which each of them has sensors: Enki has no ambient light."""
LARGE, WIDE = "obstacle-avoidance-large", ("enki:thymio2",)
"""The arena for robots that are too large for the paper's, and which these are."""


@dataclass(frozen=True, kw_only=True)
class RobotsConfig(Settings):
    """The settings, the same on each robot.

    Attributes:
        robots: addresses: "twin", "stranger", "enki:MODEL", or a robot of your own that places itself,
            "file.py:Class"; none: all of KNOWN that are available.
        base: the approximate profile of your own robots.
        levels: of noise: controllers evolve at each, and are compared with the simulation at each.
        runs: controllers of each level; starts: trials of each; evaluations: of each run.
        seconds: length of a trial; 0 for the task's own.
        seed: random seed.

    Raises:
        ConfigError: names the key, what was expected and what came.
    """

    FILE, WHAT, COMMAND = "robots.toml", "experiment on several robots", "realitygap experiment robots"

    robots: tuple[str, ...] = ()
    base: str = ""
    levels: tuple[float, ...] = (0.0, 1.0, 2.0)
    runs: int = 6
    starts: int = 4
    evaluations: int = 1000
    seconds: float = 0.0
    seed: int = 1995

    def _check(self) -> None:
        whose = "a robot of your own, whose profile it is"
        require(bool(self.programs) or not self.base, "base", whose, self.base)
        named = (self.study(robot).robot or "twin" for robot in self.robots)
        object.__setattr__(self, "robots", tuple(dict.fromkeys(named)))
        self.study(KNOWN[0])  # checks all other settings

    @property
    def programs(self) -> tuple[str, ...]:
        """Robots that are a user's programs, run only if they are named."""
        return tuple(robot for robot in self.robots if Address.parse(robot).kind == "own")

    @property
    def named(self) -> str:
        """Options for all robots, if one of them is a program."""
        return "".join(f" --robot {shlex.quote(robot)}" for robot in self.robots if self.programs)

    def study(self, robot: str) -> NoiseConfig:
        """The experiment of one robot: one unit, one set of seeds."""
        own = Address.parse(robot).kind == "own"
        return NoiseConfig(
            robot=None if robot == "twin" else robot,
            base=self.base or None if own else None,
            levels=self.levels, runs=self.runs, units=1, starts=self.starts,
            evaluations=self.evaluations, seconds=self.seconds or None, seed=self.seed, tasks=(TASK,),
            arena=LARGE if robot in WIDE else None,
        )  # fmt: skip


class Place(NamedTuple):
    """A robot and the folder of its experiment; or the reason why it was left out."""

    robot: str
    folder: Path
    why: str = ""


def robots_experiment(
    folder: str | Path,
    requested: RobotsConfig | None = None,
    *,
    workers: Workers = None,
    resume: bool = False,
    on_progress: OnProgress | None = None,
) -> list[Place]:
    """Record, calibrate, evolve, drive and compare on one robot after the other; or continue.

    Neither `workers` nor interruptions change a bit of the results.

    Args:
        folder: created if it does not exist.
        requested: the settings; None to resume with the saved ones.
        workers: processes, one a core if None; or a pool.
        resume: continue the experiment in the folder.
        on_progress: called a few times a second.

    Returns:
        All robots, with the reason for those left out.

    Raises:
        UsageError: a named robot is not available, wrong settings, a folder that cannot be used.
        StudyInterruptedError: Ctrl-C; finished work is kept.
    """
    folder = Path(folder)
    if requested is not None:
        list(_places(folder, requested))  # missing named ones are reported before a folder is created
    # One pool for all of them: its processes load once. A single worker is this process.
    shared: AbstractContextManager[Workers] = (
        nullcontext(workers) if workers == 1 else opened(workers, one_thread=True)
    )
    with lock(folder), shared as pool:
        asked = open_folder(folder, RobotsConfig, requested, resume=resume)
        places = list(_places(folder, asked))
        for robot, place, _ in (one for one in places if not one.why):

            def report(event: Progress, robot: str = robot) -> None:
                if on_progress is not None:
                    on_progress(replace(event, phase=f"{robot}: {event.phase}"))

            begun = (place / NoiseConfig.FILE).is_file()
            noise_experiment(place, asked.study(robot), workers=pool, resume=begun, on_progress=report)
    return places


def _places(folder: Path, asked: RobotsConfig) -> Iterator[Place]:
    """Each robot; with a reason for those that are neither available nor named."""
    for robot in asked.robots or KNOWN:
        config, why = asked.study(robot), ""
        try:
            check_robot(config)
        except UsageError as error:
            if robot in asked.robots:
                raise
            why = str(error)
        yield Place(robot, _folder(folder, config), why)


def _folder(folder: Path, config: NoiseConfig) -> Path:
    return folder / Address.parse(config.address(1)).folder()


def finished(folder: Path) -> list[Place]:
    """All robots of the experiment in a folder, without running anything; those without results are left out.

    Raises:
        StudyError: no such experiment there, or none of its robots has results.
    """
    asked = RobotsConfig.from_folder(folder)
    places = [Place(robot, _folder(folder, asked.study(robot))) for robot in asked.robots or KNOWN]
    file = Path(RESULTS, NoiseConfig.FACTS)
    places = [one if (one.folder / file).is_file() else one._replace(why="no results") for one in places]
    if all(one.why for one in places):
        raise StudyError(f"{folder}: no robot has results yet. Let it finish: {asked.resuming(folder)}")
    return places
