"""The command line. What a command needs is imported when it runs."""

import click

from realitygap import __version__
from realitygap.cli.calibrate import calibrate
from realitygap.cli.console import Commands
from realitygap.cli.evolve import evolve, merge, report, reproduce
from realitygap.cli.experiment import experiment
from realitygap.cli.look import look
from realitygap.cli.overview import best, compare, figures, listed, open_page
from realitygap.cli.robot import record, robot
from realitygap.cli.simulate import arena, probe, profile, simulate
from realitygap.cli.study import export, replay, show
from realitygap.cli.tracks import camera, classify, judge, score
from realitygap.cli.transfer import drive, transfer

__all__ = ["main", "realitygap"]


@click.group(
    cls=Commands,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100, "show_default": True},
)
@click.version_option(__version__, prog_name="realitygap")
def realitygap() -> None:
    """Evolve robot controllers in a calibrated, noisy simulation, and measure the reality gap.

    A rebuild of Jakobi, Husbands and Harvey, "Noise and the Reality Gap" (1995). Lengths are in
    cm, headings in degrees counter-clockwise from +x; the origin is the arena's lower left corner.

    \b
    Example: the paper's thirty runs, and a page that shows them
        realitygap reproduce
    """


for _command in (
    *(reproduce, evolve, experiment, simulate, probe, show, best, replay, compare, open_page, report),
    *(figures, export, transfer, drive, score, merge, classify, judge, robot, record, look, calibrate),
    *(camera, listed, profile, arena),
):
    realitygap.add_command(_command)


def main() -> None:
    """Entry point of the `realitygap` script: runs a command and exits with its code."""
    realitygap(prog_name="realitygap")
