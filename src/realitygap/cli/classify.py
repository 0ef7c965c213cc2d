"""`realitygap classify`: what kind of behaviour tracks show."""

from pathlib import Path

import click

from realitygap.cli import option
from realitygap.cli.output import table, tell, warn

__all__ = ["classify"]


@click.command()
@click.argument("tracks", type=click.Path())
@option.task
@option.as_json
def classify(tracks: str, task: str | None, json_output: bool) -> None:
    """Name the behaviour in TRACKS.

    One name a trial: the paper's kinds (one way turner, two way turner, wall follower, one way looper;
    three point turner, straight looper, two way turner, bobber) or none of these. Of names with a
    confidence of 0.8 about four in five are right. TRACKS is a file or a folder, as for `realitygap score`.

    \b
    Example:
        realitygap classify track.csv --task light
    """
    from realitygap.correspondence.names import common_name, namer
    from realitygap.correspondence.reading import doubts_of, read_trials
    from realitygap.correspondence.setting import setting_of
    from realitygap.tasks.load import load_task
    from realitygap.transfer.record import unpacked

    with unpacked(Path(tracks)) as there:
        trials = read_trials(there)
    setting = setting_of(trials, load_task(task) if task else None)
    warnings = doubts_of(trials)
    named = namer(setting, trials[0].radius_cm).name(trials, setting)
    common, entries = common_name(named), [name._asdict() for name in named]
    rows = [(n.start, n.name, f"{n.confidence:.2f}") for n in named]
    facts = {"task": setting.name, "name": common, "tracks": entries, "warnings": warnings}
    shown = table(("start", "name", "confidence"), rows)
    tell(json_output, facts, shown, f"\n{common} (task: {setting.name})")
    warn(warnings)
