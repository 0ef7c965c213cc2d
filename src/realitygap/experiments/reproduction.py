"""The paper's whole experiment in one folder: calibrate on a unit, evolve, transfer to it (§3.2.1, §6).

The settings are saved first, so that `--resume` needs no options in any phase.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from realitygap.errors import StudyError
from realitygap.study.config import LARGEST, StudyConfig, whole
from realitygap.study.folder import exists, gather, open_to_begin, own_config
from realitygap.study.load import Study
from realitygap.study.run import ConditionRunner
from realitygap.tasks import load_task
from realitygap.transfer.options import Transfer
from realitygap.transfer.record import TransferredTrial, load_transfers
from realitygap.transfer.run import run_transfer
from realitygap.transfer.spec import shown_runs
from realitygap.work.folder import RunFolder, lock
from realitygap.work.pool import Workers, near
from realitygap.work.progress import OnProgress
from realitygap.world.robot import load_profile
from realitygap.world.toml import Value, build, shipped

__all__ = ["STARTS", "UNIT", "Reproduction", "again", "begun", "configured", "transferred"]

UNIT = 1
"""The twin's unit that is measured and then driven."""
STARTS = 8
"""Trials of each champion on the unit: enough for a mean and an interval."""

ASKED = "reproduce.toml"
CALIBRATION = f"calibration/unit-{UNIT}"
HEADER = '# Settings of `realitygap reproduce`; the profile "" is one calibrated to the twin\'s unit.\n'

Calibrating = Callable[[str, int, int], None]


@dataclass(frozen=True, kw_only=True)
class Reproduction(Value):
    """A reproduction's settings.

    Attributes:
        runs, evaluations, seed: as a study's.
        profile: the robot; "" for one calibrated to unit 1 of the twin.
        starts: trials of each champion on the unit; more may be requested later.
    """

    runs: int = 5
    evaluations: int = 1000
    seed: int = 1995
    profile: str = ""
    starts: int = STARTS

    def _check(self) -> None:
        whole("runs", self.runs, 1, 10**6)
        whole("evaluations", self.evaluations, 1, 10**9)
        whole("seed", self.seed, 0, LARGEST)
        whole("starts", self.starts, 1, 10**6)

    def study(self, profile: str) -> StudyConfig:
        """The paper's study with these settings and a robot."""
        plain = StudyConfig.reproduction(runs=self.runs, evaluations=self.evaluations, seed=self.seed)
        return replace(plain, profile=profile)


def _run_folder(folder: Path) -> RunFolder:
    return RunFolder(folder, ASKED, "reproduction", ("starts",))


def _saved(folder: Path) -> Reproduction | None:
    """The settings that were requested first; None if none are saved there."""
    place = _run_folder(folder)
    return build(Reproduction, place.settings()) if place.begun else None


def begun(folder: Path) -> Reproduction | None:
    """The settings of the reproduction in a folder, finished or not; None if there is none."""
    asked = _saved(folder)
    if not exists(folder):
        return asked
    config = own_config(folder)
    kept = asked or Reproduction()
    numbers = {"runs": config.runs, "evaluations": config.evaluations, "seed": config.seed}
    return replace(kept, **numbers, profile=config.profile)


def configured(
    folder: Path,
    requested: Reproduction,
    *,
    resume: bool,
    workers: Workers,
    on_progress: Calibrating | None = None,
) -> StudyConfig:
    """The requested study in its folder, with its robot calibrated first if no profile is named.

    Args:
        folder: the study's.
        requested: the settings.
        resume: continue the one there.
        workers: processes; one a core if None.
        on_progress: called with the calibration's progress.

    Raises:
        StudyError: the folder holds something else, or a study and `resume` is not set.
        ConfigError: a profile that cannot be used.
        RobotError: a recording that failed.
    """
    from realitygap.calibration.unit import calibrated_unit

    if requested.profile:
        load_profile(requested.profile)
    profile = requested.profile
    with lock(folder):
        if not exists(folder):
            _begin(folder, requested, resume=resume)
        elif not resume:
            open_to_begin(folder)
        if not profile:
            place, seed = folder / CALIBRATION, requested.seed
            made = calibrated_unit(
                place, unit=UNIT, noise=1.0, seed=seed, workers=near(workers),
                meanwhile=[] if workers == 1 else [compile_ahead], on_progress=on_progress,
            )  # fmt: skip
            profile = str(made)
    return requested.study(profile)


def transferred(
    study: Study, *, starts: int, workers: Workers, on_progress: OnProgress | None
) -> list[TransferredTrial]:
    """Every champion on the unit from each start; the first trials of those in figures are filmed.

    Args:
        study: with its runs finished.
        starts: trials of each champion.
        workers: processes; one a core if None.
        on_progress: called with the trials' progress.
    """
    filmed = [(run.id, 1) for run in shown_runs(study)]
    driven = Transfer(robots=(f"twin:{UNIT}",), film=filmed, starts=starts)
    return run_transfer(study, driven, workers=workers, on_progress=on_progress)


def again(study: Study) -> str:
    """The options of `realitygap reproduce` that make a study again; "" if it would make another."""
    config = study.config
    plain = StudyConfig.reproduction(runs=config.runs, evaluations=config.evaluations, seed=config.seed)
    free = {key: getattr(plain, key) for key in ("title", "checkpoint_every", "profile", "arenas")}
    if replace(config, **free) != plain:
        return ""
    if any(study.task(one.task).arena != load_task(one.task).arena for one in plain.conditions):
        return ""
    requested = _saved(study.folder)
    words = ["--runs", config.runs, "--evaluations", config.evaluations, "--seed", config.seed]
    if requested is None or requested.profile:
        named = (name for name in shipped("profiles") if load_profile(name) == study.profile)
        words += ["--profile", next(named, config.profile)]
    driven = [one.start for one in load_transfers(study.folder) if one.robot == f"twin-{UNIT}"]
    starts = max([*driven, requested.starts if requested is not None else 0])
    if not driven:
        words += ["--no-transfer"]
    elif starts != STARTS:
        words += ["--starts", starts]
    return " ".join(map(str, words))


def compile_ahead() -> None:
    """Compile what evolution calls, which is the same for all robots, or load it: a worker's work while
    others record the robot."""
    materials = gather(StudyConfig.reproduction())
    for condition in range(len(materials.tasks)):
        ConditionRunner(materials, condition).compile()


def _begin(folder: Path, requested: Reproduction, *, resume: bool) -> None:
    """Save the requested settings, or check that they equal the saved ones."""
    place = _run_folder(folder)
    if not place.begun:
        open_to_begin(folder)
        place.begin(requested.to_dict(), head=HEADER, versions={})
        return
    if not resume:
        raise StudyError(
            f"{folder}: a reproduction was started there. Resume it (--resume) or choose another --out."
        )
    place.refuse_other(place.settings(), requested.to_dict())
