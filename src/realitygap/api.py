"""The long commands as functions, for scripts, notebooks and the command line.

    study = realitygap.evolve("light-seeking", noise="double", runs=3)
    study.show()

Progress goes to `on_progress`; without it, it shows on a terminal, as lines where stderr is not one, and
as a bar in a notebook's cell. Nothing else is printed. Errors are those of `realitygap.errors`.
"""

from __future__ import annotations

import json
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import replace
from functools import partial
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, Unpack

from realitygap.errors import CalibrationError, StudyError, StudyInterruptedError, UsageError
from realitygap.files import atomic_write, names_its_arguments
from realitygap.work.progress import OnProgress, Progress, ProgressLine, counts

if TYPE_CHECKING:
    from realitygap.calibration.calibrate import Calibration
    from realitygap.calibration.recordings import Recording
    from realitygap.experiments.reproduction import Reproduction
    from realitygap.study.config import StudyConfig
    from realitygap.study.load import Study
    from realitygap.tasks.task import Task
    from realitygap.work.pool import Workers
    from realitygap.work.shard import Shard
    from realitygap.world.robot import Profile

__all__ = [
    "calibrate", "carry_out", "different_versions", "evolve", "folder_of", "load_recordings", "merge",
    "report", "reproduce", "reproduction", "study_config",
]  # fmt: skip

Place = str | PathLike[str]


class StudyFields(TypedDict, total=False):
    """Settings of a study that stay as they are if they are None."""

    profile: str | None
    runs: int | None
    evaluations: int | None
    seed: int | None


class ReproductionFields(StudyFields, total=False):
    """The same of a reproduction."""

    starts: int | None


@names_its_arguments
def evolve(
    task: Place | Task,
    *,
    noise: str | float | Sequence[str | float] = (),
    noise_between: bool | None = None,
    spread: float | Sequence[float] | None = None,
    profile: Place | None = None,
    arena: Place | None = None,
    seed: int | None = None,
    runs: int | None = None,
    evaluations: int | None = None,
    out: Place | None = None,
    config: Place | None = None,
    settings: Mapping[str, object] | None = None,
    workers: Workers = None,
    engine: str = "cores",
    resume: bool = False,
    watch: bool = False,
    shard: str | None = None,
    trust: bool = False,
    on_progress: OnProgress | None = None,
) -> Study:
    """Evolve controllers for a task and make the report, as `realitygap evolve` does.

    A shard makes its share of the runs in a folder of its own, beside `out`, and no report; `merge` puts all
    shards together.

    Args:
        task: "obstacle-avoidance", "light-seeking", a Python file, or a Task.
        noise: a level, or several, each a condition; "observed" if none.
        noise_between: draw, once a trial for each sensor, how the profile's readings differ between
            recordings, times the level; None: no.
        spread: share, 0 to 0.9, within which constants are drawn anew for each trial; several: a
            condition each.
        profile: the robot, a shipped name or a TOML file; "paper" if None.
        arena: a shipped arena's name or a TOML file; the task's own if None.
        seed: random seed; 1995 if None.
        runs: of each condition; 1 if None.
        evaluations: in each run; 1000 if None.
        out: the study's folder; out/TASK if None.
        config: start from a study's TOML.
        settings: changes by key, such as {"evolution.rows": 10}; other arguments override them.
        workers: processes, one a core if None; or a pool. Never changes a result.
        engine: what trials run on: "cores" or "cuda".
        resume: continue what is there; arguments that are None keep their saved values.
        watch: keep watch.html in the folder up to date: how evolution goes.
        shard: "1/3": the first of three shares; None: all runs, or on resuming what the folder holds.
        trust: agree to run the programs that `config` names.
        on_progress: called with each event; None shows them.

    Raises:
        UsageError: something that cannot be done, by name.
        StudyError: the folder holds a study and `resume` is not set, or something else.
        StudyInterruptedError: Ctrl-C; finished work is kept.
    """
    from realitygap.tasks.load import reference
    from realitygap.work.shard import Shard
    from realitygap.world.robot import noise_level

    name, share = reference(task), None if shard is None else Shard.parse(shard)
    folder = folder_of(name, None if out is None else Path(out), share)
    chosen = study_config(
        folder, name, config=None if config is None else Path(config), resume=resume, trust=trust,
        noise=[noise_level(level) for level in _several(noise)],
        spread=_several(() if spread is None else spread),
        settings=[f"{key}={json.dumps(value, default=repr)}" for key, value in (settings or {}).items()],
        arena=_text(arena), profile=_text(profile), noise_between=noise_between, seed=seed, runs=runs,
        evaluations=evaluations,
    )  # fmt: skip
    study, _ = carry_out(
        folder, chosen, workers=workers, engine=engine, resume=resume, shard=share, watch=watch,
        on_progress=on_progress,
    )  # fmt: skip
    return study


@names_its_arguments
def merge(
    shards: Place | Iterable[Place],
    *,
    out: Place | None = None,
    workers: Workers = None,
    trust: bool = False,
    on_progress: OnProgress | None = None,
) -> Study:
    """Put the shards of a study together and make the report, as `realitygap merge` does.

    Args:
        shards: the folders of all of them, in any order.
        out: the study's folder; their name without -shard-I-of-N if None.
        workers: processes, one a core if None; or a pool.
        trust: agree to run the task files that they bring.
        on_progress: called with each event; None shows them.

    Raises:
        StudyError: a shard is missing, unfinished or of another study; or `out` exists.
    """
    from realitygap.study.folder import trust_programs
    from realitygap.study.runner import WORK, merge_runs
    from realitygap.work.shard import all_shards, read_mark, whole_of

    several = [shards] if isinstance(shards, str | PathLike) else list(shards)
    folders = [Path(one) for one in several]
    found = all_shards(folders)
    for folder in found.values():
        mark = read_mark(folder)
        if mark is None or mark.work != WORK:
            cure = "`realitygap merge` puts together what other commands made"
            raise StudyError(f"{folder}: expected a shard of a study. {cure}.")
        if trust:
            trust_programs(folder)
    target = whole_of(folders[0]) if out is None else Path(out)
    study = merge_runs(found, target)
    for difference in different_versions([study.versions()]):
        warnings.warn(difference, stacklevel=3)
    report(target, study, workers=workers, on_progress=on_progress)
    return study


@names_its_arguments
def reproduce(
    out: Place = "out/reproduce",
    *,
    profile: Place | None = None,
    runs: int | None = None,
    evaluations: int | None = None,
    seed: int | None = None,
    starts: int | None = None,
    transfer: bool = True,
    workers: Workers = None,
    engine: str = "cores",
    resume: bool = False,
    watch: bool = False,
    on_progress: OnProgress | None = None,
) -> Study:
    """Repeat the paper's experiment and make the page about it, as `realitygap reproduce` does.

    Args:
        out: the study's folder.
        profile: the robot; None calibrates one first, to unit 1 of the twin.
        runs: for each task and noise level; 5 if None.
        evaluations: in each run; 1000 if None.
        seed: random seed; 1995 if None.
        starts: trials of each champion on the twin; 8 if None.
        transfer: let the champions drive the twin.
        workers: processes, one a core if None; or a pool. Never changes a result.
        engine: what evolution's trials run on: "cores" or "cuda".
        resume: continue what is there; arguments that are None keep their saved values.
        watch: keep watch.html in the folder up to date: how evolution goes.
        on_progress: called with each event; None shows them.

    Raises:
        UsageError: something that cannot be done, by name.
        StudyError: the folder holds a study and `resume` is not set, or something else.
        RobotError: a recording or a trial failed.
        StudyInterruptedError: Ctrl-C; finished work is kept.
    """
    folder = Path(out)
    requested = reproduction(
        folder, resume, profile=_text(profile), runs=runs, evaluations=evaluations, seed=seed, starts=starts
    )
    study, _ = carry_out(
        folder, requested, workers=workers, engine=engine, resume=resume, watch=watch, transfer=transfer,
        on_progress=on_progress,
    )  # fmt: skip
    return study


def reproduction(out: Path, resume: bool, **fields: Unpack[ReproductionFields]) -> Reproduction:
    """A reproduction's settings: those given, and for the rest the saved or the usual ones."""
    from realitygap.experiments.reproduction import Reproduction, begun

    return replace((begun(out) if resume else None) or Reproduction(), **_given(**fields))


def carry_out(
    folder: Path,
    config: StudyConfig | Reproduction,
    *,
    workers: Workers,
    engine: str,
    resume: bool,
    shard: Shard | None = None,
    watch: bool = False,
    transfer: bool = False,
    on_progress: OnProgress | None = None,
) -> tuple[Study, Path | None]:
    """Run or continue the study in `folder`, then make its page, where there are not only shards of it.

    Args:
        folder: the study's, or the shard's.
        config: what to do; a study that is there must have been made with it. A reproduction calibrates its
            robot first.
        workers, engine, resume, watch, on_progress: as of `evolve`.
        shard: which share of the study, without a report; None continues a shard that is there.
        transfer: whether a reproduction's champions drive the twin before the report.

    Raises:
        UsageError: a shard is to be watched, or an engine that is not there.
        StudyInterruptedError: Ctrl-C; finished work is kept.
    """
    from realitygap.experiments.reproduction import Reproduction, configured, transferred
    from realitygap.simulation.simulation import engine_named
    from realitygap.study.runner import run_study
    from realitygap.work.pool import opened
    from realitygap.work.shard import read_mark

    engine_named(engine)
    part = shard is not None or read_mark(folder) is not None
    if part and watch:
        raise UsageError("watch: a shard has no page. Leave it out.")
    with _resumable(folder), _shown(on_progress) as tell, ExitStack() as stack:
        show = tell
        if watch:
            from realitygap.report.live import LivePage

            watched = stack.enter_context(LivePage(folder, tell))
            sys.stderr.write(f"watch {watched.page.resolve().as_uri()}\n")
            show = watched.show
        if isinstance(config, Reproduction):
            if workers != 1:  # one pool for all phases: its processes load and compile once
                workers = stack.enter_context(opened(workers, one_thread=True))
            recorded = _calibrating(tell)
            chosen = configured(folder, config, resume=resume, workers=workers, on_progress=recorded)
        else:
            chosen = config
        study = run_study(
            folder, chosen, workers=workers, engine=engine, resume=resume, shard=shard, on_progress=show
        )
        if part:
            return study, None
        if isinstance(config, Reproduction) and transfer:
            transferred(study, starts=config.starts, workers=workers, on_progress=tell)
        return study, report(folder, study, workers=workers, on_progress=tell)


def report(
    folder: Path, study: Study, *, workers: Workers = None, on_progress: OnProgress | None = None
) -> Path:
    """Score a study's runs and make its page.

    Args:
        folder: the study's.
        study: with its transfers, if there are any.
        workers, on_progress: as of `evolve`.
    """
    from realitygap.report.build import build_report
    from realitygap.transfer.scores import marks_of

    with _resumable(folder), _shown(on_progress) as tell:
        marks_of(study, workers=workers, on_progress=counts(tell, "scoring behaviour", "runs"))
        drawn = counts(tell, "making the report", "figures")
        return build_report(folder, on_progress=drawn)


def folder_of(task: str, out: Path | None, shard: Shard | None) -> Path:
    """Where a task is evolved: `out`, or out/TASK; of a shard beside that."""
    from realitygap.tasks import load_task

    folder = Path("out", load_task(task).name) if out is None else out
    return folder if shard is None else shard.folder(folder)


def study_config(
    folder: Path,
    task: str,
    *,
    config: Path | None,
    resume: bool,
    trust: bool,
    noise: Sequence[float],
    spread: Sequence[float],
    settings: Iterable[str],
    arena: str | None = None,
    noise_between: bool | None = None,
    **fields: Unpack[StudyFields],
) -> StudyConfig:
    """The configuration of a study of one task.

    Args:
        folder: the study's.
        task: as typed.
        config, resume: a study's TOML to start from; else the folder's own study if it is resumed, else one
            condition of the task.
        trust: agree to run the programs that `config` names.
        noise, spread: a condition for each pair; those that it starts from where there are none.
        settings: KEY=VALUE each, as in --set.
        arena: the task's; None: as it starts from; likewise `noise_between` and the `fields`.

    Raises:
        StudyError: `config` names a program that this user neither named nor agreed to run.
    """
    from realitygap.study.config import Condition, StudyConfig
    from realitygap.study.folder import exists, own_config, require_trusted, trust_contents
    from realitygap.tasks import load_task

    if config is not None:
        begun = StudyConfig.from_toml(config, task=task)
    else:
        begun = own_config(folder) if resume and exists(folder) else StudyConfig.single(task)

    def same(other: str) -> bool:
        """By what it is called: a configuration's task files are not run to find that out."""
        if task.endswith(".py") or other.endswith(".py"):
            return Path(other).name == Path(task).name
        return load_task(other) is load_task(task)

    pairs = [(c.noise, c.spread) for c in begun.conditions if same(c.task)] or [(1.0, 0.0)]
    if noise or spread:
        levels, shares = (dict.fromkeys(column) for column in zip(*pairs, strict=True))
        pairs = [(level, share) for share in spread or shares for level in noise or levels]
    conditions = tuple(Condition(task=task, noise=level, spread=share) for level, share in pairs)
    name = load_task(task).name
    arenas = {key: value for key, value in begun.arenas.items() if key == name}
    made = replace(begun, conditions=conditions, arenas=arenas).with_settings(settings)
    if config is not None:
        theirs = set(begun.own_files().values()) & set(made.own_files().values())
        programs = [file for file in theirs if file.is_file()]
        if trust:
            trust_contents(file.read_bytes() for file in programs)
        require_trusted(config, programs, "--trust")
    if arena is not None:
        made = replace(made, arenas={name: arena})
    return replace(made, **_given(noise_between=noise_between, **fields))


def different_versions(found: Iterable[Mapping[str, Iterable[str]]]) -> list[str]:
    """What differed between the machines that made shards, in words: bits may differ too."""
    seen: dict[str, dict[str, None]] = {}
    for one in found:
        for name, values in one.items():
            seen.setdefault(name, {}).update(dict.fromkeys(values))
    return [
        f"the shards were made with different {name}: {', '.join(map(str, values))}"
        for name, values in seen.items() if len(values) > 1 and name != "platform"
    ]  # fmt: skip


@names_its_arguments
def calibrate(
    recordings: Place | Sequence[Place | Recording],
    base: Profile | Place | None = None,
    *,
    objects: str | Sequence[str] = (),
    form: str = "auto",
    light: str | None = None,
    beside: bool = True,
    out: Place | None = None,
    workers: Workers = 1,
    on_progress: Callable[[int, int], None] | None = None,
) -> Calibration:
    """Fit a robot's constants to recordings, as `realitygap calibrate` does.

    Args:
        recordings: folders made by `realitygap record` (or a folder of several), .sam tables, or what
            `load_recording` reads; those of one kind are fitted together.
        base: profile that supplies what they do not cover; None: what the recorded robot names, or "paper".
        objects: what .sam tables show: "wall", "cylinder:RADIUS_CM" or "lamp"; one for all or one for each
            path.
        form: "paper", "individual", "extended", "measured", "lookup", or "auto": extended or measured,
            whichever errs less on places held out.
        light: another form for ambient light.
        beside: fit ambient light in all other forms too, for comparison.
        out: the profile's TOML file to write.
        workers: processes for the measured form's searches, one a core if None; or a pool. Never changes a
            result.
        on_progress: called with fits done and fits in all; None shows them.

    Raises:
        RecordingError: a recording cannot be read.
        CalibrationError: recordings from which no sensible profile can be made.
        UsageError: no folder for the profile to be written to.
    """
    from realitygap.calibration.calibrate import base_of
    from realitygap.calibration.calibrate import calibrate as fit
    from realitygap.world.robot import load_profile

    target = None if out is None else Path(out)
    if target is not None and (target.is_dir() or not target.parent.is_dir()):
        raise UsageError(f"out: expected a file in a folder that exists, got {str(target)!r}. Make it first.")
    read: Any = [recordings] if isinstance(recordings, str | PathLike) else list(recordings)
    if all(isinstance(one, str | PathLike) for one in read):
        read = load_recordings([fspath(one) for one in read], _several(objects))
    elif objects:
        raise CalibrationError(
            "objects: expected none with recordings that are loaded already: load_recording(path, object=…)."
        )
    start = load_profile(base_of(read) if base is None else base)
    with nullcontext() if on_progress else ProgressLine() as line:
        show = on_progress if line is None else partial(_calibrating(line.show), "fit")
        made = fit(read, start, form=form, light=light, beside=beside, workers=workers, on_progress=show)
    if target is None:
        return made
    made = made.named(target.stem)
    where = made.profile.provenance
    files = ", ".join(f.file for f in where.files)
    head = (
        f"# Calibrated {where.date} by realitygap {where.version} from {files}.\n"
        "# Lengths cm, speeds cm/s, angles degrees, readings counts; the end says where each comes from.\n"
    )
    atomic_write(target, head + made.profile.to_toml())
    return made


def load_recordings(paths: Iterable[str], objects: Sequence[str] = ()) -> list[Recording]:
    """Every recording at some places; `objects` as of `calibrate`."""
    from realitygap.calibration.load import find_recordings, load_recording

    pairs = [(path, place) for path in paths for place in find_recordings(path)]
    found = [place for _, place in pairs]
    if len(objects) not in (0, 1, len(found)):
        raise CalibrationError(
            f"--object: expected one for all or one for each of {len(found)} recordings, got {len(objects)}."
        )
    said = [None] * len(found) if not objects else list(objects) * (len(found) if len(objects) == 1 else 1)
    return [
        replace(load_recording(place, object=name), group=str(path))
        for (path, place), name in zip(pairs, said, strict=True)
    ]


def _text(given: Place | None) -> str | None:
    return None if given is None else fspath(given)


def _given(**options: Any) -> dict[str, Any]:
    """Those options that were not left out."""
    return {name: value for name, value in options.items() if value is not None}


def _several(given: Any) -> list[Any]:
    """One value, or several, as a list."""
    return [given] if isinstance(given, str | float | int) else list(given)


@contextmanager
def _shown(on_progress: OnProgress | None) -> Iterator[OnProgress]:
    """Where progress goes: the caller's function, or a line, a bar."""
    with ProgressLine() if on_progress is None else nullcontext() as line:
        show = on_progress if line is None else line.show
        assert show is not None
        yield show


def _calibrating(report: OnProgress) -> Callable[[str, int, int], None]:
    """Reports how far the recordings for a calibration are, several at a time, or that it is fitted."""
    places: dict[str, tuple[int, int]] = {}

    def show(name: str, done: int, total: int) -> None:
        if name == "fit":
            report(Progress(phase="fitting the simulation to the recordings", done=done, total=total))
            return
        places[name] = (done, total)
        made, whole = (sum(numbers) for numbers in zip(*places.values(), strict=True))
        report(Progress(phase="recording the robot", done=made, total=whole, what="places"))

    return show


@contextmanager
def _resumable(folder: Path) -> Iterator[None]:
    """On Ctrl-C say that finished work is kept."""
    try:
        yield
    except StudyInterruptedError:
        raise
    except KeyboardInterrupt:
        raise StudyInterruptedError(f"stopped. What was saved in {folder} is kept.") from None
