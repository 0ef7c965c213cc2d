"""`realitygap slurm`: a script that gives a command's shards to a cluster's queue."""

import shlex
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from realitygap.cli import option
from realitygap.cli.kinds import Whole
from realitygap.cli.output import tell

__all__ = ["slurm"]

SHARED = "evolve, transfer, experiment noise"
"""Commands that take --shard."""
OURS = ("--shard", "--workers", "--resume")
"""Options that the script gives."""
ALONE = {"evolve": "watch", "transfer": "controller"}
"""Options that no shard takes."""


@click.command(context_settings={"ignore_unknown_options": True, "allow_interspersed_args": False})
@click.option(
    "--shards",
    type=Whole(1, 10**5),
    required=True,
    help="Jobs in the array, one shard each; clusters often allow 1000.",
)
@click.option("--cores", type=Whole(1, 1024), default=4, help="Cores per job, one worker each.")
@click.option("--hours", type=Whole(1, 10**4, "H"), default=24, help="Time limit of a job.")
@option.as_json
@click.argument("command", nargs=-1, required=True, type=click.UNPROCESSED)
@click.pass_context
def slurm(
    ctx: click.Context, shards: int, cores: int, hours: int, json_output: bool, command: tuple[str, ...]
) -> None:
    """Print an array job for Slurm: COMMAND (evolve, transfer, experiment noise) in shards.

    The cluster needs only realitygap. A requeued job continues where it was. The head of the script says how
    to submit it, and how to merge the shards.

    \b
    Example:
        realitygap slurm --shards 20 evolve light-seeking --runs 400 --out out/many > many.sh
    """
    given = _checked(ctx, list(command))
    merging = f"realitygap merge {shlex.quote(str(_whole(given)))}-shard-*-of-{shards}"
    here, python = shlex.quote(str(Path.cwd())), shlex.quote(sys.executable)
    script = Path(__file__).with_name("slurm.sh").read_text("utf-8").format(
        command=shlex.join(["realitygap", *command]), words=shlex.join(command), shards=shards, cores=cores,
        hours=hours, here=here, python=python, resume=" --resume" if "resume" in given else "",
        wrapped=shlex.quote(f"cd {here} && {python} -m {merging}"),
    )  # fmt: skip
    tell(json_output, {"script": script, "merge": merging}, script.rstrip("\n"))


def _checked(ctx: click.Context, words: list[str]) -> dict[str, Any]:
    """A command's options, read as it will read them in every job.

    Raises:
        click.UsageError: no command that takes shards, or options that it would refuse.
    """
    for word in words:
        if word.partition("=")[0] in OURS:
            raise click.UsageError(f"{word}: the script sets it; leave it out.", ctx)
        if not word.isprintable():
            raise click.UsageError(f"expected words of one line for a script, got {word!r}.", ctx)
    assert ctx.parent is not None
    group, above, typed = ctx.parent.command, ctx.parent, " ".join(words[:2])
    while isinstance(group, click.Group) and words:
        name, found, words = group.resolve_command(above, words)
        assert found is not None
        above, group = click.Context(found, parent=above, info_name=name), found
    if not any(param.name == "shard" for param in group.params):
        raise click.UsageError(f"expected a command that can be sharded ({SHARED}), got {typed!r}.", ctx)
    given = dict(group.make_context(group.name, words, parent=above.parent).params)
    alone = ALONE.get(str(group.name))
    if alone is not None and given[alone]:
        raise click.UsageError(f"--{alone}: expected none with shards. Leave it out.", ctx)
    return given


def _whole(given: Mapping[str, Any]) -> Path:
    """What the shards' folders are named after, before -shard-I-of-N: the study, or its transfer."""
    from realitygap.cli.evolve import folder_of
    from realitygap.transfer.run import shard_folder
    from realitygap.work.shard import Shard, whole_of

    if "study" in given:
        return whole_of(shard_folder(Path(given["study"]), Shard(1, 1)))
    return whole_of(Shard(1, 1).folder(given["out"] or folder_of(given["task"])))
