"""The long commands as functions, for scripts and notebooks: the same work, into the same folders.

    study = realitygap.evolve("light-seeking", noise="double", runs=3)
    study.show()

Progress shows on a terminal, as lines where stderr is not one, and as a bar in a notebook's cell;
nothing else is printed. Errors are those of `realitygap.errors`.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from functools import partial
from os import PathLike, fspath
from typing import TYPE_CHECKING, Any

from realitygap.errors import CalibrationError, StudyError, StudyInterruptedError, UsageError
from realitygap.files import as_path, must_be

if TYPE_CHECKING:
    from realitygap.calibration.calibrate import Calibration
    from realitygap.calibration.recordings.recording import Recording
    from realitygap.study.load import Study
    from realitygap.tasks.task import Task
    from realitygap.work.workers import Workers
    from realitygap.world.robot import Profile

__all__ = ["calibrate", "evolve", "merge", "reproduce"]

Place = str | PathLike[str]


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

    Raises:
        UsageError: something that cannot be done, by name.
        StudyError: the folder holds a study and `resume` is not set, or something else.
        StudyInterruptedError: Ctrl-C; finished work is kept.
    """
    from realitygap.cli.evolve import begun_config, changed_config, folder_of
    from realitygap.cli.option import given, unusual
    from realitygap.cli.studies import carry_out
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
    chosen = changed_config(
        begun, name, tuple(map(noise_level, levels)), texts,
        {**given(fields | {"evaluations": evaluations}), "spreads": spreads},
    )  # fmt: skip
    with _stopping():
        return carry_out(
            folder, chosen, words=f"evolve {name}{unusual(engine)}", workers=workers, engine=engine,
            resume=resume, shard=share, watch=watch,
        ).study  # fmt: skip


def merge(
    shards: Place | Iterable[Place], *, out: Place | None = None, workers: Workers = None, trust: bool = False
) -> Study:
    """Put the shards of a study together and make the report, as `realitygap merge` does.

    Args:
        shards: the folders of all of them, in any order.
        out: the study's folder; their name without -shard-I-of-N if None.
        workers: processes, one a core if None; or a pool.
        trust: agree to run the task files that they bring.

    Raises:
        StudyError: a shard is missing, unfinished or of another study; or `out` exists.
    """
    from realitygap.cli.notes import note_versions
    from realitygap.cli.progress import ProgressLine
    from realitygap.cli.studies import reported
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
    note_versions([study.versions()])
    with _stopping(), ProgressLine() as progress:
        return reported(target, study, workers, progress, {}).study


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

    Raises:
        UsageError: something that cannot be done, by name.
        StudyError: the folder holds a study and `resume` is not set, or something else.
        RobotError: a recording or a trial failed.
        StudyInterruptedError: Ctrl-C; finished work is kept.
    """
    from realitygap.cli.reproduce import carried_out, requested_by

    _require_engine(engine)
    options = {"runs": runs, "evaluations": evaluations, "seed": seed, "starts": starts}
    folder = as_path(out, "out")
    requested = requested_by(folder, resume, {"profile": _name(profile), **options})
    with _stopping():
        return carried_out(
            folder, requested, transfer=transfer, workers=workers, engine=engine, resume=resume, watch=watch
        ).study


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
    from realitygap.calibration.recordings.recording import SensorRecording, WheelRecording
    from realitygap.cli.calibrate import load_all, write_profile
    from realitygap.cli.progress import ProgressLine
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
        read = load_all([fspath(one) for one in read], [objects] if isinstance(objects, str) else objects)
    elif objects and read:
        raise CalibrationError(
            "objects: expected none with recordings that are loaded already: what a table shows is said "
            f"where it is loaded, load_recording(path, object=...). Got {objects!r}."
        )
    for one in read:
        must_be(one, SensorRecording | WheelRecording, "recordings", "load_recording(path) reads one.")
    start = load_profile(base_of(read) if base is None else base)
    with ProgressLine() if on_progress is None else nullcontext() as line:
        told = on_progress if line is None else partial(line.calibrating, "fit")
        made = fit(read, start, form=form, light=light, beside=beside, workers=workers, on_progress=told)
    if target is not None:
        made = made.named(target.stem)
        write_profile(made, target)
    return made


def _name(given: Place | None) -> str | None:
    return fspath(given) if isinstance(given, PathLike) else given


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
def _stopping() -> Iterator[None]:
    """Ctrl-C as whoever waits for it in Python knows it; in the same words."""
    from realitygap.cli.failure import StoppedError

    try:
        yield
    except StoppedError as stopped:
        raise StudyInterruptedError(str(stopped)) from None
