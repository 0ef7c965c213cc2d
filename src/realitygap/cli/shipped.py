"""`realitygap arena` and `realitygap profile`: arenas and robots to look at, to copy and to change."""

from typing import Any

import click

from realitygap.cli.option import as_json
from realitygap.cli.output import tell

__all__ = ["arena", "profile"]


def _show(folder: str, name: str, loaded: Any, json_output: bool) -> None:
    """A shipped file as it is, with its comments, or a user's as it was read."""
    from realitygap.world.toml import shipped_text

    tell(json_output, loaded.to_dict(), (shipped_text(folder, name) or loaded.to_toml()).rstrip())


@click.group()
def arena() -> None:
    """Show arenas.

    \b
    Example:
        realitygap arena show light-seeking
    """


@arena.command("show")
@click.argument("name")
@as_json
def show_arena(name: str, json_output: bool) -> None:
    """Print an arena's walls, cylinders and lamps.

    NAME is a shipped arena or a TOML file. Without --json this is TOML: save it, change it, and give the file
    to --arena.

    \b
    Example: an arena of your own
        realitygap arena show obstacle-avoidance > arena.toml
    """
    from realitygap.world.arena import load_arena

    _show("arenas", name, load_arena(name), json_output)


@click.group()
def profile() -> None:
    """Show robot profiles.

    \b
    Example:
        realitygap profile show paper
    """


@profile.command("show")
@click.argument("name")
@as_json
def show_profile(name: str, json_output: bool) -> None:
    """Print all constants of a robot.

    NAME is a shipped profile or a TOML file. Without --json this is TOML: save it, change it, and give the
    file to --profile.

    \b
    Example: a robot of your own
        realitygap profile show paper > mine.toml
    """
    from realitygap.world.robot import load_profile

    _show("profiles", name, load_profile(name), json_output)
