"""`realitygap arena` and `realitygap profile`: rooms and robots to look at, to copy and to change."""

import click

from realitygap.cli.option import as_json
from realitygap.cli.output import tell

__all__ = ["arena", "profile"]


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
    """Print a room's walls, cylinders and lamps.

    NAME is a shipped arena or a TOML file. Without --json this is TOML:
    save it, change it, and give the file to --arena.

    \b
    Example: a room of your own
        realitygap arena show obstacle-avoidance > room.toml
    """
    from realitygap.world.arena import load_arena
    from realitygap.world.files import shipped_text

    loaded = load_arena(name)
    tell(json_output, loaded.to_dict(), (shipped_text("arenas", name) or loaded.to_toml()).rstrip())


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

    NAME is a shipped profile or a TOML file. Without --json this is TOML:
    save it, change it, and give the file to --profile.

    \b
    Example: a robot of your own
        realitygap profile show paper > mine.toml
    """
    from realitygap.world.files import shipped_text
    from realitygap.world.profile import load_profile

    loaded = load_profile(name)
    tell(json_output, loaded.to_dict(), (shipped_text("profiles", name) or loaded.to_toml()).rstrip())
