"""`realitygap profile`: a robot's constants."""

import click

from realitygap.cli.option import as_json
from realitygap.cli.output import tell

__all__ = ["profile"]


@click.group()
def profile() -> None:
    """Show robot profiles.

    \b
    Example:
        realitygap profile show paper
    """


@profile.command()
@click.argument("name")
@as_json
def show(name: str, json_output: bool) -> None:
    """Print all constants of a robot.

    NAME is a shipped profile or a TOML file. Without --json this is TOML:
    save it, change it, and give the file to --profile.

    \b
    Example: a robot of your own
        realitygap profile show paper > mine.toml
    """
    from realitygap.world.profile import load_profile

    loaded = load_profile(name)
    tell(json_output, loaded.to_dict(), loaded.to_toml().rstrip())
