"""The long commands as functions, for scripts, notebooks and the command line.

    study = realitygap.evolve("light-seeking", noise="double", runs=3)
    study.show()

Progress is told to `on_progress`; without it, it shows on a terminal, as lines where stderr is not one, and
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
from typing import TYPE_CHECKING, Any, NamedTuple

from realitygap.errors import CalibrationError, StudyError, StudyInterruptedError, UsageError
from realitygap.files import as_path, atomic_write, must_be
from realitygap.work.progress import OnProgress, Progress, ProgressLine, counts

if TYPE_CHECKING:
    from realitygap.calibration.calibrate import Calibration
    from realitygap.calibration.recordings import Recording
    from realitygap.experiments.reproduction import Reproduction
    from realitygap.report.scores import ScoreTable
    from realitygap.study.config import Condition, StudyConfig
    from realitygap.study.load import Study
    from realitygap.tasks.task import Task
    from realitygap.transfer.load import Transferred
    from realitygap.work.shard import Shard
    from realitygap.work.workers import Workers
    from realitygap.world.robot import Profile

__all__ = [
    "Carried", "begun_config", "calibrate", "carry_out", "changed_config", "different_versions", "evolve",
    "folder_of", "load_recordings", "merge", "reported", "reproduce", "reproduction", "write_profile",
]  # fmt: skip

Place = str | PathLike[str]


class Carried(NamedTuple):
    """A study that was carried out, in its folder; its page (None for a shard), its tables of scores, and the
    trials on a robot that were part of the work (None: they were not)."""

    folder: Path
    study: Study
    page: Path | None = None
    tables: Sequence[ScoreTable] = ()
    transfers: Sequence[Transferred] | None = None


def evolve(
    task: Place | Task,
    *,
    noise: str | float | Sequence[str | float] = (),
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
    on_progress: OnProgress | None = None,
) -> Study:
    """Evolve controllers for a task and make the report, as `realitygap evolve` does.

    A shard makes its share of the runs in a folder of its own, beside `out`, and no report; `merge` puts all
    shards together.

    Args:
        task: "obstacle-avoidance", "light-seeking", a Python file, or a Task.
        noise: a level, or several, each a condition; "observed" if none.
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
        on_progress: called with each event; None shows them.

    Raises:
        UsageError: something that cannot be done, by name.
        StudyError: the folder holds a study and `resume` is not set, or something else.
        StudyInterruptedError: Ctrl-C; finished work is kept.
    """
    from realitygap.tasks.load import reference
    from realitygap.work.shard import Shard
    from realitygap.world.robot import noise_level

    _require_engine(engine)
    name, share = reference(task), None if shard is None else Shard.parse(shard)
    folder = folder_of(name) if out is None else as_path(out, "out")
    folder = folder if share is None else share.folder(folder)
    levels = _several(noise, "noise", "Give a level, or a list of them.")
    spreads = tuple(_several(() if spread is None else spread, "spread", "Give a share, or a list of them."))
    begun = begun_config(folder, name, None if config is None else as_path(config, "config"), resume)
    must_be(settings or {}, Mapping, "settings", 'Give them as {"evolution.rows": 10}.')
    texts = [f"{key}={json.dumps(value, default=repr)}" for key, value in (settings or {}).items()]
    fields = {"profile": _name(profile), "arena": _name(arena), "seed": seed, "runs": runs}
    given = _given({**fields, "evaluations": evaluations, "spreads": spreads})
    chosen = changed_config(begun, name, tuple(map(noise_level, levels)), texts, given)
    return carry_out(
        folder, chosen, workers=workers, engine=engine, resume=resume, shard=share, watch=watch,
        on_progress=on_progress,
    ).study  # fmt: skip


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
    from realitygap.study.folder import agree
    from realitygap.study.merge import all_shards, merge_runs
    from realitygap.study.runner import WORK
    from realitygap.work.shard import read_mark, whole_of

    several = shards if isinstance(shards, Iterable) and not isinstance(shards, str) else [shards]
    folders = [as_path(one, "shards") for one in several]
    found = all_shards(folders)
    for folder in found.values():
        mark = read_mark(folder)
        if mark is None or mark.work != WORK:
            cure = "`realitygap merge` puts together what other commands made"
            raise StudyError(f"{folder}: expected a shard of a study. {cure}.")
        if trust:
            agree(folder)
    target = whole_of(folders[0]) if out is None else as_path(out, "out")
    study = merge_runs(found, target)
    for said in different_versions([study.versions()]):
        warnings.warn(said, stacklevel=2)
    return reported(target, study, workers=workers, on_progress=on_progress).study


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
    _require_engine(engine)
    options = {"runs": runs, "evaluations": evaluations, "seed": seed, "starts": starts}
    folder = as_path(out, "out")
    requested = reproduction(folder, resume, {"profile": _name(profile), **options})
    return carry_out(
        folder, requested, workers=workers, engine=engine, resume=resume, watch=watch, transfer=transfer,
        on_progress=on_progress,
    ).study  # fmt: skip


def reproduction(out: Path, resume: bool, options: Mapping[str, Any]) -> Reproduction:
    """A reproduction's settings: those given, and for the rest the saved or the usual ones."""
    from realitygap.experiments.reproduction import Reproduction, begun

    return replace((begun(out) if resume else None) or Reproduction(), **_given(options))


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
) -> Carried:
    """Run or continue the study in `folder`, then report on it.

    Args:
        folder: the study's, or the shard's.
        config: what to do; a study that is there must have been made with it. A reproduction calibrates its
            robot first.
        workers, engine, resume, watch, on_progress: as of `evolve`.
        shard: which share of the study, without a report; None continues a shard that is there.
        transfer: whether a reproduction's champions drive the twin before the report.

    Raises:
        UsageError: a shard is to be watched.
        StudyInterruptedError: Ctrl-C; finished work is kept.
    """
    from realitygap.experiments.reproduction import ASKED, Reproduction, configured, transferred
    from realitygap.study.reader import DATABASE
    from realitygap.study.runner import run_study
    from realitygap.work.shard import read_mark
    from realitygap.work.workers import opened

    part = shard is not None or read_mark(folder) is not None
    if part and watch:
        raise UsageError("watch: a shard has no page. Leave it out.")
    with _resumable(folder, DATABASE, ASKED), _shown(on_progress) as tell, ExitStack() as stack:
        if isinstance(config, Reproduction) and workers != 1:
            # One pool for all phases: its processes load and compile once.
            workers = stack.enter_context(opened(workers, one_thread=True))
        show = tell
        if watch:
            from realitygap.report.watch import Watch

            seen = stack.enter_context(Watch(folder, tell))
            sys.stderr.write(f"watch {seen.page.resolve().as_uri()}\n")
            show = seen.show
        requested = config
        if isinstance(requested, Reproduction):
            requested = configured(
                folder, requested, resume=resume, workers=workers, on_progress=_calibrating(tell)
            )
        study = run_study(
            folder, requested, workers=workers, engine=engine, resume=resume, shard=shard, on_progress=show
        )
        if part:
            return Carried(folder, study)
        made = None
        if isinstance(config, Reproduction) and transfer:
            made = transferred(study, starts=config.starts, workers=workers, on_progress=tell)
        return reported(folder, study, workers=workers, on_progress=tell)._replace(transfers=made)


def reported(
    folder: Path, study: Study, *, workers: Workers, on_progress: OnProgress | None = None
) -> Carried:
    """Score a study's runs and make its page.

    Args:
        folder: the study's.
        study: its runs.
        workers, on_progress: as of `evolve`.
    """
    from realitygap.report.build import build_report
    from realitygap.report.scores import study_tables
    from realitygap.study.reader import DATABASE
    from realitygap.transfer.score_rows import marks_of

    with _resumable(folder, DATABASE), _shown(on_progress) as tell:
        scored, drawn = (counts(tell, *words) for words in (SCORING, REPORTING))
        marks = marks_of(study, workers=workers, on_progress=scored)
        page = build_report(folder, workers=workers, on_progress=drawn)
    return Carried(folder, study, page, study_tables(study, marks))


SCORING, REPORTING = ("scoring behaviour", "runs"), ("making the report", "figures")
"""Phases, and what is counted in them."""


def folder_of(task: str) -> Path:
    """Where a task is evolved by default."""
    from realitygap.tasks import load_task

    return Path("out", load_task(task).name)


def begun_config(folder: Path, task: str, config: Path | None, resume: bool) -> StudyConfig:
    """What a study starts from: a study's TOML, its own if it is resumed, or one condition of the task.

    Args:
        folder: the study's.
        task: as typed.
        config: a study's TOML, if one was given.
        resume: whether the study in the folder goes on.
    """
    from realitygap.study.config import StudyConfig
    from realitygap.study.folder import exists, own_config

    if config is not None:
        return StudyConfig.from_toml(config, task=task)
    return own_config(folder) if resume and exists(folder) else StudyConfig.single(task)


def changed_config(
    begun: StudyConfig, task: str, noise: tuple[float, ...], settings: Iterable[str], given: Mapping[str, Any]
) -> StudyConfig:
    """A configuration changed to one task alone.

    Args:
        begun: what it starts from.
        task: as typed.
        noise: levels, each a condition; those that the configuration has for the task if none.
        settings: KEY=VALUE each, as in --set.
        given: what else was given: `spreads`, `arena`, fields of a configuration by name.
    """
    from realitygap.tasks import load_task

    name, fields = load_task(task).name, dict(given)
    arenas = {key: arena for key, arena in begun.arenas.items() if key == name}
    conditions = _conditions(begun, task, noise, fields.pop("spreads", ()))
    begun = replace(begun, conditions=conditions, arenas=arenas).with_settings(settings)
    if "arena" in fields:
        fields["arenas"] = {name: fields.pop("arena")}
    return replace(begun, **fields)


def _conditions(
    config: StudyConfig, task: str, noise: tuple[float, ...], spreads: tuple[float, ...]
) -> tuple[Condition, ...]:
    """The task at each of `noise` within each of `spreads`; without one of them at those that a configuration
    has for it, or at observed noise with constants as they are."""
    from realitygap.study.config import Condition
    from realitygap.tasks import load_task

    def same(other: str) -> bool:
        """By what it is called: a configuration's task files are not run to find that out."""
        if task.endswith(".py") or other.endswith(".py"):
            return Path(other).name == Path(task).name
        return load_task(other) is load_task(task)

    if noise and spreads:
        pairs = [(level, spread) for spread in spreads for level in noise]
    else:
        there = [(c.noise, c.spread) for c in config.conditions if same(c.task)] or [(1.0, 0.0)]
        levels, shares = (dict.fromkeys(one) for one in zip(*there, strict=True))
        pairs = [(level, spread) for spread in spreads or shares for level in noise or levels]
        pairs = pairs if noise or spreads else there
    return tuple(Condition(task=task, noise=level, spread=spread) for level, spread in pairs)


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
    from realitygap.calibration.recordings import SensorRecording, WheelRecording
    from realitygap.world.robot import load_profile

    target = None if out is None else as_path(out, "out")
    if target is not None and (target.is_dir() or not target.parent.is_dir()):
        raise UsageError(f"out: expected a file in a folder that exists, got {str(target)!r}. Make it first.")
    if on_progress is not None and not callable(on_progress):
        raise UsageError(f"on_progress: expected a function of two counts, got {on_progress!r}.")
    read: Any = [recordings] if isinstance(recordings, str | PathLike) else recordings
    must_be(read, Iterable, "recordings", "Give [recording], or folders.")
    read = list(read)
    if read and all(isinstance(one, str | PathLike) for one in read):
        named = [objects] if isinstance(objects, str) else objects
        read = load_recordings([fspath(one) for one in read], named)
    elif objects and read:
        raise CalibrationError(
            "objects: expected none with recordings that are loaded already: what a table shows is said "
            f"where it is loaded, load_recording(path, object=...). Got {objects!r}."
        )
    for one in read:
        must_be(one, SensorRecording | WheelRecording, "recordings", "load_recording(path) reads one.")
    start = load_profile(base_of(read) if base is None else base)
    with ProgressLine() if on_progress is None else nullcontext() as line:
        told = on_progress if line is None else partial(_calibrating(line.show), "fit")
        made = fit(read, start, form=form, light=light, beside=beside, workers=workers, on_progress=told)
    if target is not None:
        made = made.named(target.stem)
        write_profile(made, target)
    return made


def load_recordings(paths: Iterable[str], objects: Sequence[str] = ()) -> list[Recording]:
    """Every recording at some places; `objects` as of `calibrate`."""
    from realitygap.calibration.recordings import find_recordings, load_recording

    found = [place for path in paths for place in find_recordings(path)]
    if len(objects) not in (0, 1, len(found)):
        raise CalibrationError(
            f"--object: expected one for all or one for each of {len(found)} recordings, got {len(objects)}."
        )
    said = [None] * len(found) if not objects else list(objects) * (len(found) if len(objects) == 1 else 1)
    return [load_recording(place, object=name) for place, name in zip(found, said, strict=True)]


def write_profile(made: Calibration, target: Path) -> None:
    """Write a calibration's profile, under lines that say where it comes from."""
    where = made.profile.provenance
    files = ", ".join(f.file for f in where.files)
    head = (
        f"# Calibrated {where.date} by realitygap {where.version} from {files}.\n"
        "# Lengths cm, speeds cm/s, angles degrees, readings counts; the end of the file says where each "
        "comes from.\n"
    )
    atomic_write(target, head + made.profile.to_toml())


def _name(given: Place | None) -> str | None:
    return fspath(given) if isinstance(given, PathLike) else given


def _given(options: Mapping[str, Any]) -> dict[str, Any]:
    """Those options that were not left out."""
    return {name: value for name, value in options.items() if value is not None}


def _require_engine(name: str) -> None:
    """Refuse an engine that is not there, before anything is done with it."""
    from realitygap.simulation.simulation import engine_named

    must_be(name, str, "engine", "Give cores or cuda.")
    engine_named(name)


def _several(given: Any, what: str, cure: str) -> Iterable[Any]:
    """One value, or several."""
    listed: Any = [given] if isinstance(given, str | float | int) else given
    must_be(listed, Iterable, what, cure)
    return listed  # type: ignore[no-any-return]


@contextmanager
def _shown(on_progress: OnProgress | None) -> Iterator[OnProgress]:
    """Who is told of progress: the caller's function, or a line, a bar."""
    with ProgressLine() if on_progress is None else nullcontext() as line:
        told = on_progress if line is None else line.show
        assert told is not None
        yield told


def _calibrating(tell: OnProgress) -> Callable[[str, int, int], None]:
    """Who tells how far the recordings for a calibration are, several at a time, or that it is fitted."""
    places: dict[str, tuple[int, int]] = {}

    def told(name: str, done: int, total: int) -> None:
        if name == "fit":
            tell(Progress(phase="fitting the simulation to the recordings", done=done, total=total))
            return
        places[name] = (done, total)
        made, whole = (sum(numbers) for numbers in zip(*places.values(), strict=True))
        tell(Progress(phase="recording the robot", done=made, total=whole, what="places"))

    return told


@contextmanager
def _resumable(folder: Path, *files: str) -> Iterator[None]:
    """On Ctrl-C say that finished work is kept in a folder, if that has one of the files that tell of it."""
    try:
        yield
    except KeyboardInterrupt as stopped:
        if isinstance(stopped, StudyInterruptedError):
            raise
        if not any((folder / file).is_file() for file in files):
            raise StudyInterruptedError(f"stopped before the work in {folder} began.") from None
        raise StudyInterruptedError(f"stopped. What was saved in {folder} is kept.") from None
