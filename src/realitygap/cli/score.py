"""`realitygap score`: how alike the behaviour in two sets of tracks is."""

from __future__ import annotations

from contextlib import ExitStack, suppress
from pathlib import Path
from typing import TYPE_CHECKING

import click

from realitygap.cli import option
from realitygap.cli.output import tell, warn
from realitygap.errors import RealityGapError, TrackError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from realitygap.correspondence.score import Comparison
    from realitygap.tasks.task import Task

__all__ = ["score"]


@click.command()
@click.argument("a", type=click.Path())
@click.argument("b", type=click.Path(), required=False)
@option.task
@click.option("--ceiling", metavar="PATH", help="Tracks of another behaviour, which define a score of 0.")
@option.as_json
def score(
    a: str,
    b: str | None,
    task: str | None,
    ceiling: str | None,
    json_output: bool,
) -> None:
    """Score how alike two sets of tracks are.

    A (say, simulated) and B (situated) are CSV files with columns t_s, x_cm, y_cm, heading_deg, where
    a column start separates several trials and a column unit several robots; or what `realitygap track`
    or `realitygap simulate --json` wrote; or folders of such files. A folder made by `realitygap
    transfer`, its trials filmed or not, needs no B: its simulated trials are compared with its situated
    ones. 10 means as alike as the same robot twice, 0 a different behaviour; the output says what these ends
    were measured on.

    \b
    Examples:
        realitygap score simulated.csv filmed/ --task avoidance
        realitygap score out/reproduce/transfer/twin-1/obstacle-avoidance-observed-1
    """
    from realitygap.correspondence.reading import doubts_of, read_transfer, read_trials
    from realitygap.correspondence.score import compare
    from realitygap.correspondence.setting import setting_of
    from realitygap.tasks.load import load_task
    from realitygap.transfer.record import unpacked

    whose = None

    with ExitStack() as stack:

        def there(path: str) -> Path:
            return stack.enter_context(unpacked(Path(path)))

        if b is None:
            sets = read_transfer(there(a))
            whose = _task_of(Path(a), there(a)) if task is None else None
        else:
            sets = read_trials(there(a)), read_trials(there(b))
        others = read_trials(there(ceiling)) if ceiling is not None else None
    every = [trial for trials in (*sets, others or []) for trial in trials]
    setting = setting_of(every, load_task(task)) if task else setting_of([] if whose else every, whose)
    made = compare(sets[0], sets[1], setting, ceiling=others)
    warnings = doubts_of(every)
    tell(json_output, {"a": a, "b": b, **made.to_dict(), "warnings": warnings}, *_told(made))
    warn(warnings)


def _task_of(folder: Path, trials: Path) -> Task | None:
    """The task of a transfer in its study, whose arena it is; None for trials that left their study, and
    where the task is a program that nobody agreed to run."""
    from realitygap.correspondence.reading import TRANSFER
    from realitygap.files import read_toml
    from realitygap.study.load import load_study
    from realitygap.study.store import DATABASE

    above = next((one for one in folder.resolve().parents if (one / DATABASE).is_file()), None)
    with suppress(RealityGapError):
        if above is not None:
            name = read_toml(next(trials.rglob(TRANSFER)), TrackError, "Transfer again.")["task"]
            return load_study(above).task(name)
    return None


def _told(made: Comparison) -> Iterator[str]:
    shown = "" if made.interval is None else f"   (95 %: {made.interval[0]:.1f} to {made.interval[1]:.1f})"
    yield f"correspondence score {made.score:.1f} of 10{shown}"
    yield f"  behaviour {made.behaviour:.1f}, layout {made.layout:.1f}"
    yield f"differences: {made.differences}"
    response = "" if made.responsiveness is None else f", responsiveness {made.responsiveness:+z.2f}"
    yield f"  noisiness {made.noisiness:+z.2f}{response} (log2 of B to A), looping {made.looping:+z.2f}"
    if made.matched:
        when = "never part" if made.parting_s is None else f"part by {made.parting_s:.1f} s"
        yield f"trials are paired by start; half {when}; transferability {made.transferability:z.2f}"
    yield f"can they be told apart? nearest neighbours, p = {made.p:.3f} (a test, not a scale)"
    yield f"{made.trials[0]} and {made.trials[1]} trials; task: {made.setting}"
    yield f"10 is: {made.scale.floor_from}; 0 is: {made.scale.ceiling_from}"
    for note in made.notes:
        yield f"note: {note}"
