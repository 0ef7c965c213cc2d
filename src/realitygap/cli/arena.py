"""`realitygap arena`: rooms to copy and change."""

import click

from realitygap.cli.option import as_json
from realitygap.cli.output import tell

__all__ = ["arena"]


@click.group()
def arena() -> None:
    """Show arenas.

    \b
    Example:
        realitygap arena show light-seeking
    """


@arena.command()
@click.argument("name")
@as_json
def show(name: str, json_output: bool) -> None:
    """Print a room's walls, cylinders and lamps.

    NAME is a shipped arena or a TOML file. Without --json this is TOML:
    save it, change it, and give the file to --arena.

    \b
    Example: a room of your own
        realitygap arena show obstacle-avoidance > room.toml
    """
    from realitygap.world.arena import load_arena

    loaded = load_arena(name)
    tell(json_output, loaded.to_dict(), loaded.to_toml().rstrip())
