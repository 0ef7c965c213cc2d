"""`realitygap experiment measure-or-randomise`: which buys more, measuring a robot or randomising it?"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from realitygap.cli import option
from realitygap.cli.estimate import consider
from realitygap.cli.failure import resumable
from realitygap.cli.kinds import Whole
from realitygap.cli.output import print_json, print_table, shown
from realitygap.cli.progress import ProgressLine

if TYPE_CHECKING:
    from realitygap.experiments.randomise.results import Comparison, Outcome
    from realitygap.work.workers import Workers

__all__ = ["measure_or_randomise"]


@click.command("measure-or-randomise")
@option.out("out/measure-or-randomise")
@click.option(
    "--robot", metavar="R", help="twin, stranger or enki:khepera: whose units [default: enki:khepera]."
)
@click.option("--units", type=Whole(2, 100), help="Units, from --first-unit on [default: 16].")
@click.option("--first-unit", type=Whole(1, 10**6), help="Number of the first unit [default: 101].")
@option.runs("Runs of each condition; the units take turns [default: 20].")
@click.option("--starts", type=Whole(2, 1000), help="Trials of each controller on its unit [default: 4].")
@option.evaluations
@option.twin_noise()
@option.seed(None, " [default: 20263]")
@option.seconds
@option.workers
@option.resume
@option.as_json
def measure_or_randomise(
    out: Path, workers: Workers, resume: bool, json_output: bool, **options: Any
) -> None:
    """Ask what an hour of measuring a robot buys, against randomising the simulation.

    Controllers evolve to avoid obstacles in simulations that know nothing of a unit (the paper's
    constants), another unit's calibration, or its own from 5 %, 20 % or all places of the standard
    recording; each with and without constants drawn anew for each trial over the spread of the units, and
    at zero and observed noise. Each drives its unit; correspondence is with the simulation that it evolved
    in. Two comparisons of each outcome were planned beforehand. With --resume, omitted options keep their
    saved values.

    \b
    Examples: as planned; a small one to try
        realitygap experiment measure-or-randomise
        realitygap experiment measure-or-randomise --units 2 --runs 2 --evaluations 200 --out out/small
    """
    from dataclasses import replace

    from realitygap.experiments.randomise.plan import RandomiseConfig, conditions
    from realitygap.experiments.randomise.results import compared_in
    from realitygap.experiments.randomise.run import measure_or_randomise as carry_out
    from realitygap.report.randomise import draw_outcomes

    config = replace(RandomiseConfig.begun(out, resume=resume), **option.given(options))
    if not resume:
        runs = config.runs * len(conditions())
        consider(runs=runs, evaluations=config.evaluations, trials=runs * config.starts, workers=workers)
    with resumable(out, config.resuming(out)), ProgressLine() as progress:
        results = carry_out(out, config, workers=workers, resume=resume, on_progress=progress.show)
        picture = draw_outcomes(out)
    found, comparisons = compared_in(out)
    if json_output:
        told = [
            {**one.condition._asdict(), **one._asdict(), "condition": one.condition.name} for one in found
        ]
        places = {"experiment": str(out), "results": str(results), "picture": str(picture)}
        print_json({**places, "outcomes": told, "comparisons": [one._asdict() for one in comparisons]})
        return
    _print(found, comparisons)
    click.echo(f"\nresults {results}\npicture {picture}")


def _print(found: list[Outcome], comparisons: list[Comparison]) -> None:
    """A line a condition and outcome, then what was planned to be compared."""
    rows = [
        [
            one.outcome, one.condition.known, "yes" if one.condition.randomised else "no",
            f"{one.condition.noise:g}", shown(one.mean), shown(one.low), shown(one.high),
        ]
        for one in found
    ]  # fmt: skip
    print_table(("outcome", "known", "randomised", "noise", "mean", "low", "high"), rows)
    click.echo()
    for one in comparisons:
        span = f"95 %: {shown(one.low)} to {shown(one.high)}"
        click.echo(
            f"{one.outcome}: {one.first} against {one.second}: {shown(one.difference)} ({span}), "
            f"p {shown(one.p_holm)} by Holm: {one.found}"
        )
