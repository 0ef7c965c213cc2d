"""The command line: one file a command. What a command needs is imported when it runs."""

import click

from realitygap import __version__
from realitygap.cli.calibrate import calibrate
from realitygap.cli.camera import camera
from realitygap.cli.classify import classify
from realitygap.cli.drive import drive
from realitygap.cli.evolve import evolve
from realitygap.cli.experiment import experiment
from realitygap.cli.export import export
from realitygap.cli.failure import Commands
from realitygap.cli.judge import judge
from realitygap.cli.merge import merge
from realitygap.cli.probe import probe
from realitygap.cli.realities import realities
from realitygap.cli.record import record
from realitygap.cli.replay import replay
from realitygap.cli.report import report
from realitygap.cli.reproduce import reproduce
from realitygap.cli.robot import robot
from realitygap.cli.score import score
from realitygap.cli.shipped import arena, profile
from realitygap.cli.show import show
from realitygap.cli.simulate import simulate
from realitygap.cli.track import track
from realitygap.cli.transfer import transfer
from realitygap.cli.twin import twin

__all__ = ["main", "realitygap"]


@click.group(
    cls=Commands,
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100, "show_default": True},
)
@click.version_option(__version__, prog_name="realitygap")
@click.pass_context
def realitygap(ctx: click.Context) -> None:
    """Evolve robot controllers in a calibrated, noisy simulation, and measure the reality gap.

    A rebuild of Jakobi, Husbands and Harvey, "Noise and the Reality Gap" (1995). Lengths are in
    cm, headings in degrees counter-clockwise from +x; the origin is the arena's lower left corner.

    \b
    Example: the paper's thirty runs, and a page that shows them
        realitygap reproduce
    """
    if ctx.invoked_subcommand is None:
        click.echo(ctx.get_help())


for _command in (
    reproduce, evolve, experiment, realities, simulate, probe, show, replay, report, export, transfer, drive,
    score, merge, classify, judge, robot, twin, record, calibrate, track, camera, profile, arena,
):  # fmt: skip
    realitygap.add_command(_command)


def main() -> None:
    """Entry point of the `realitygap` script: runs a command and exits with its code."""
    realitygap(prog_name="realitygap")
