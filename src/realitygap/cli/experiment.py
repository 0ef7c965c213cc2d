"""`realitygap experiment`: experiments of many runs, from the first recording to the answer."""

from __future__ import annotations

import math
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from realitygap.cli import option
from realitygap.cli.estimate import consider, note_new
from realitygap.cli.failure import resumable
from realitygap.cli.kinds import Whole
from realitygap.cli.output import shown, table, tell
from realitygap.cli.progress import ProgressLine
from realitygap.cli.studies import show_shard

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from realitygap.experiments.noise.config import NoiseConfig
    from realitygap.experiments.randomise.results import Comparison, Outcome
    from realitygap.work.shard import Shard
    from realitygap.work.workers import Workers

__all__ = ["experiment", "measure_or_randomise", "show_noise"]


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
    """Compare an hour of measuring a robot with randomising the simulation.

    Controllers evolve to avoid obstacles in simulations with the paper's constants, another unit's
    calibration, or the unit's own from 5 %, 20 % or all places of the standard recording, each with and
    without constants drawn anew for each trial over the spread of the units; or in a look-up table of the
    recording. All of this is at zero and observed noise. Each controller drives its unit; correspondence is
    with the simulation in which it evolved. Two comparisons of each outcome were planned beforehand.
    With --resume, omitted options keep their saved values.

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
    else:
        note_new(out, config.FILE)
    with resumable(out, config.resuming(out), config.FILE), ProgressLine() as progress:
        results = carry_out(out, config, workers=workers, resume=resume, on_progress=progress.show)
        picture = draw_outcomes(results)
    found, comparisons = compared_in(results)
    told = [{**one.condition._asdict(), **one._asdict(), "condition": one.condition.name} for one in found]
    places = {"experiment": str(out), "results": str(results), "picture": str(picture)}
    facts = {**places, "outcomes": told, "comparisons": [one._asdict() for one in comparisons]}
    tell(json_output, facts, *_told(found, comparisons), f"\nresults {results}\npicture {picture}")


def _told(found: list[Outcome], comparisons: list[Comparison]) -> Iterator[str]:
    """A line a condition and outcome, then what was planned to be compared."""
    rows = [
        [
            one.outcome, one.condition.known, "yes" if one.condition.randomised else "no",
            f"{one.condition.noise:g}", shown(one.mean), shown(one.low), shown(one.high),
        ]
        for one in found
    ]  # fmt: skip
    yield table(("outcome", "known", "randomised", "noise", "mean", "low", "high"), rows) + "\n"
    for one in comparisons:
        span = f"95 %: {shown(one.low)} to {shown(one.high)}"
        tested = f"p {shown(one.p_holm)} by Holm: {one.found}"
        tested = "no test with fewer than two units" if math.isnan(one.p) else tested
        yield f"{one.outcome}: {one.first} against {one.second}: {shown(one.difference)} ({span}), {tested}"


@click.group()
def experiment() -> None:
    """Run a multi-run experiment.

    \b
    Examples: does a simulation as noisy as the robot cross the gap best? What does an hour of measuring buy?
        realitygap experiment noise
        realitygap experiment measure-or-randomise
    """


experiment.add_command(measure_or_randomise)


@experiment.command()
@option.out("out/noise")
@click.option(
    "--arm", metavar="A",
    help="An arm of the second study, as planned (docs/noise-level-2.md): E, T, E5, T5, T2 or S. "
    "Options that would change its design are refused.",
)  # fmt: skip
@click.option(
    "--levels",
    metavar="L,L,…",
    help="Noise levels (1 = observed) to evolve at and to compare with [default: 0,0.5,1,2,4].",
)
@option.runs("Runs of each task at each level, over all seed sets [default: 40].")
@click.option(
    "--seed-sets", type=Whole(1, 100), help="Independent sets of runs, each with its own seeds [default: 2]."
)
@click.option(
    "--robot", metavar="R",
    help="twin, stranger, enki:MODEL, or a body of your own that places itself, file.py:Class: the only unit "
    "[default: twin].",
)  # fmt: skip
@option.base
@click.option("--units", type=Whole(1, 100), help="Units of the twin, the stranger, or Enki's [default: 3].")
@click.option("--starts", type=Whole(2, 1000), help="Trials of each controller on each unit [default: 8].")
@option.evaluations
@option.twin_noise()
@option.seed(None, " [default: 1995]")
@click.option("--tasks", metavar="TASK|both", help="obstacle-avoidance or light-seeking [default: both].")
@option.seconds
@option.arena
@option.workers
@option.engine
@option.shard
@option.resume
@option.as_json
def noise(
    out: Path,
    workers: Workers,
    engine: str,
    shard: Shard | None,
    resume: bool,
    json_output: bool,
    **options: Any,
) -> None:
    """Find which noise level crosses the reality gap best.

    Calibrates a simulation to each unit of the twin (pseudo-reality: a physics model behind the robot's
    own serial protocol) and evolves controllers in it at every noise level. Each controller drives every
    unit from the same starts; its tracks there are compared with the simulation at every level.
    The claims under test were written down beforehand. With --resume, omitted options keep their
    saved values.

    \b
    Examples: the full experiment; the same on a twin twice as noisy; a small one to try; a robot of your
    own; an arm of the second study
        realitygap experiment noise
        realitygap experiment noise --twin-noise 2 --out out/noise-2
        realitygap experiment noise --levels 0,1,2 --runs 4 --units 1 --starts 4 --out out/small
        realitygap experiment noise --robot my_robot.py:MyRobot --base my_robot.toml --out out/mine
        realitygap experiment noise --arm E --out out/arm-E
    """
    from realitygap.experiments.noise.run import noise_study
    from realitygap.work.shard import read_mark

    out = out if shard is None else shard.folder(out)
    config = _config(out, resume, options)
    if not resume:
        every = range(config.controllers)
        runs = len(every) if shard is None else len(shard.own(every))
        trials = config.twin_trials * runs // len(every)
        consider(runs=runs, evaluations=config.evaluations, trials=trials, workers=workers)
    else:
        note_new(out, config.FILE)
    again = config.resuming(out) + option.unusual(engine)
    with resumable(out, again, config.FILE), ProgressLine() as progress:
        results = noise_study(
            out, config, workers=workers, engine=engine, resume=resume, shard=shard, on_progress=progress.show
        )
        if read_mark(out) is not None:
            show_shard(out, {}, json_output=json_output)
            return
    show_noise(out, results, {}, json_output=json_output)


def show_noise(out: Path, results: Path, more: Mapping[str, Any], *, json_output: bool) -> None:
    """Make the report of a study of noise in its folder, and print its result, with `more` parts of the JSON;
    of an arm of the plan only say where its tables are."""
    from realitygap.experiments.noise.config import NoiseConfig
    from realitygap.report.noise.report import build_noise_report, noise_summary

    arm = NoiseConfig.from_folder(out).arm
    if arm is not None:
        facts = {"study": str(out), "arm": arm, "results": str(results), **more}
        judge = f"realitygap report {shlex.quote(str(out))}"
        tell(json_output, facts, f"arm {arm} is complete: {judge} judges it\n\nresults {results}")
        return
    with ProgressLine() as progress:
        page = build_noise_report(out, on_progress=progress.report)
    summary = noise_summary(out)
    facts = {"study": str(out), "results": str(results), "report": str(page), **summary, **more}
    tell(json_output, facts, f"{summary['paragraph']}\n\nresults {results}\nreport  {page}")


def _config(out: Path, resume: bool, options: dict[str, Any]) -> NoiseConfig:
    """The usual study with what was given; or, resumed, the one that is there."""
    from dataclasses import replace

    from realitygap.experiments.noise.config import NoiseConfig, levels_of, tasks_of

    begun = NoiseConfig.begun(out, resume=resume)
    asked = option.given(options)
    name = asked.pop("arm", begun.arm)
    if name is not None:
        return _of_arm(name, begun if resume else None, asked)
    if asked.get("robot") == "twin":
        if begun.robot is not None:
            raise click.UsageError(f"--robot: expected {begun.robot}, this experiment's robot, got twin.")
        del asked["robot"]
    if asked.get("robot", "enki").partition(":")[0] not in ("stranger", "enki"):
        for key in ("units", "twin_noise"):
            if key in asked:
                name = f"--{key.replace('_', '-')}"
                raise click.UsageError(f"{name}: belongs to the twin; leave it out with a robot of your own.")
        asked["units"] = 1
    elif begun.base is not None and "robot" not in asked:
        raise click.UsageError(
            f"--robot: expected {begun.robot}, the robot of this experiment: a program, "
            "which runs only when you name it."
        )
    for key, read in (("levels", levels_of), ("tasks", tasks_of)):
        if key in asked:
            asked[key] = read(asked[key])
    return replace(begun, **asked)


def _of_arm(name: str, begun: NoiseConfig | None, asked: dict[str, Any]) -> NoiseConfig:
    """An arm as it was planned; an option that would change it is refused, and another arm's folder."""
    from realitygap.experiments.noise.second.arms import arm

    for key, value in asked.items():
        said = f"--{key.replace('_', '-')}"
        raise click.UsageError(
            f"{said}: expected none with arm {name}, whose design is planned, got {value}. Leave it out, or "
            "leave out --arm, and choose another --out."
        )
    if begun is not None and begun.arm not in (None, name):
        raise click.UsageError(f"--arm: expected {begun.arm}, the arm of this experiment, got {name}.")
    return arm(name)
