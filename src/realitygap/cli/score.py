"""`realitygap score`: how alike the behaviour in two sets of tracks is."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from realitygap.cli import option
from realitygap.cli.output import print_json, warn

if TYPE_CHECKING:
    from realitygap.correspondence.score import Comparison

__all__ = ["score"]


@click.command()
@click.argument("a", type=click.Path())
@click.argument("b", type=click.Path(), required=False)
@option.task
@click.option("--ceiling", metavar="PATH", help="Tracks of another behaviour, which define a score of 0.")
@option.as_json
def score(a: str, b: str | None, task: str | None, ceiling: str | None, json_output: bool) -> None:
    """Score how alike two sets of tracks are.

    A (say, simulated) and B (situated) are CSV files with columns t_s, x_cm, y_cm, heading_deg, where
    a column start separates several trials and a column unit several robots; or what `realitygap track`
    or `realitygap simulate --json` wrote; or folders of such files. A folder made by `realitygap
    transfer` needs no B: its simulated trials are compared with its situated ones. 10 means as alike as
    the same robot twice, 0 another behaviour; the output says what these ends were measured on.

    \b
    Example:
        realitygap score simulated.csv filmed/ --task avoidance
        realitygap score out/reproduce/transfer/twin-1/obstacle-avoidance-observed-1
    """
    from realitygap.correspondence.reading import doubts_of, read_transfer, read_trials
    from realitygap.correspondence.score import compare
    from realitygap.correspondence.setting import setting_of
    from realitygap.tasks.load import load_task

    sets = read_transfer(a) if b is None else (read_trials(a), read_trials(b))
    others = read_trials(ceiling) if ceiling is not None else None
    every = [trial for trials in (*sets, others or []) for trial in trials]
    setting = setting_of(every, load_task(task) if task else None)
    made = compare(sets[0], sets[1], setting, ceiling=others)
    warnings = doubts_of(every)
    if json_output:
        print_json({"a": a, "b": b, **made.to_dict(), "warnings": warnings})
    else:
        _print(made)
    warn(warnings)


def _print(made: Comparison) -> None:
    """The figures, and what they rest on, in plain words."""
    shown = "" if made.interval is None else f"   (95 %: {made.interval[0]:.1f} to {made.interval[1]:.1f})"
    click.echo(f"correspondence score {made.score:.1f} of 10{shown}")
    click.echo(f"  behaviour {made.behaviour:.1f}, layout {made.layout:.1f}")
    click.echo(f"differences: {made.differences}")
    response = "" if made.responsiveness is None else f", responsiveness {made.responsiveness:+.2f}"
    click.echo(f"  noisiness {made.noisiness:+.2f}{response} (log2 of B to A), looping {made.looping:+.2f}")
    if made.matched:
        when = "never part" if made.parting_s is None else f"part by {made.parting_s:.1f} s"
        click.echo(f"trials are paired by start; half {when}; transferability {made.transferability:.2f}")
    click.echo(f"can they be told apart? nearest neighbours, p = {made.p:.3f} (a test, not a scale)")
    click.echo(f"{made.trials[0]} and {made.trials[1]} trials; task: {made.setting}")
    click.echo(f"10 is: {made.scale.floor_from}; 0 is: {made.scale.ceiling_from}")
    for note in made.notes:
        click.echo(f"note: {note}")
