"""`realitygap judge`: pairs of tracks for human judges, and how their ratings compare with the score."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from realitygap.cli import option
from realitygap.cli.kinds import SEED, FileToWrite
from realitygap.cli.output import tell, warn
from realitygap.errors import TrackError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from realitygap.correspondence.judging import Agreement, Pair
    from realitygap.correspondence.setting import Setting

__all__ = ["judge"]


@click.group()
def judge() -> None:
    """Collect people's blind ratings of pairs of tracks.

    \b
    Example:
        realitygap judge page pairs/ --task avoidance --out judge.html --key key.json
        realitygap judge marks marks-anna.csv marks-ben.csv --key key.json
    """


@judge.command()
@click.argument("pairs", type=click.Path(exists=True, file_okay=False))
@option.task
@click.option("--out", type=FileToWrite(".html"), required=True, help="Write the page there.")
@click.option(
    "--key", type=FileToWrite(".json"), required=True,
    help="Write the key there: which pair is which. Keep it from the judges.",
)  # fmt: skip
@click.option("--seed", type=SEED, default=0, help="Random seed of order and sides.")
def page(pairs: str, task: str | None, out: Path, key: Path, seed: int) -> None:
    """Make a page of the pairs in a folder PAIRS.

    Each folder in PAIRS is a pair: it holds a (a.csv, or a folder a) and b. The page shows the two
    side by side without their names, on random sides. A judge rates each pair from 0 to 10 and saves
    the ratings as a file. Keep the key from the judges: it contains names and scores.

    \b
    Example:
        realitygap judge page pairs/ --out judge.html --key key.json
    """
    from realitygap.correspondence.judging import blind_pairs
    from realitygap.correspondence.trials import doubts_of
    from realitygap.files import atomic_write
    from realitygap.report.player import judge_page

    found, setting = _pairs(Path(pairs), task)
    data, rows = blind_pairs(found, setting, seed=seed)
    atomic_write(out, judge_page(data, setting.arena, found[0].a[0].radius_cm))
    atomic_write(key, json.dumps(rows, indent=1) + "\n")
    warn(doubts_of(trial for pair in found for trial in (*pair.a, *pair.b)))
    click.echo(f"{len(found)} pairs: open {out} in a browser; keep {key} from the judges")


@judge.command()
@click.argument("files", nargs=-1, required=True, type=click.Path(exists=True))
@click.option(
    "--key", required=True, type=click.Path(exists=True, dir_okay=False), metavar="FILE",
    help="The key file of the page.",
)  # fmt: skip
@option.as_json
def marks(files: tuple[str, ...], key: str, json_output: bool) -> None:
    """Compare ratings with the score.

    FILES are the CSV files that the page saved (columns pair, judge, mark), or folders of them.

    \b
    Example:
        realitygap judge marks marks/ --key key.json
    """
    from realitygap.correspondence.judging import agreement, read_marks

    given: dict[int, dict[str, float]] = {}
    for file in files:
        for pair, of in read_marks(file).items():
            there = given.setdefault(pair, {})
            for judge, mark in of.items():
                if there.setdefault(judge, mark) != mark:
                    raise TrackError(
                        f"{file}: pair {pair}: judge {judge!r} gave it {there[judge]:g} in another file, "
                        f"{mark:g} here. Two judges need two names: change the column judge in one."
                    )
    made = agreement(given, _scores(Path(key)))
    tell(json_output, made.to_dict(), *_told(made))


def _pairs(folder: Path, task: str | None) -> tuple[list[Pair], Setting]:
    from realitygap.correspondence.judging import Pair
    from realitygap.correspondence.score import compare
    from realitygap.correspondence.setting import setting_of
    from realitygap.correspondence.trials import read_trials
    from realitygap.tasks.load import load_task

    read = []
    for place in sorted(p for p in folder.iterdir() if p.is_dir()):
        sides = [next((p for p in sorted(place.iterdir()) if p.stem == side), None) for side in "ab"]
        if sides[0] is None or sides[1] is None:
            raise TrackError(f"{place}: expected tracks a and b in this folder (a.csv or a folder a).")
        read.append((place.name, read_trials(sides[0]), read_trials(sides[1])))
    if not read:
        raise TrackError(f"{folder}: expected a folder for each pair in it, got none.")
    setting = setting_of([t for _, a, b in read for t in (*a, *b)], load_task(task) if task else None)
    made = [Pair(name=n, a=a, b=b, score=compare(a, b, setting, resamples=2).score) for n, a, b in read]
    return made, setting


def _scores(path: Path) -> dict[int, float]:
    try:
        rows: list[dict[str, Any]] = json.loads(path.read_text(encoding="utf-8"))
        scores = {int(row["pair"]): float(row["score"]) for row in rows}
        if not all(0 <= score <= 10 for score in scores.values()):
            raise ValueError
        return scores
    except (OSError, ValueError, TypeError, KeyError, OverflowError, RecursionError):
        raise TrackError(f"{path}: expected the key that `realitygap judge page` wrote.") from None


def _told(made: Agreement) -> Iterator[str]:
    found = made.correlation
    low, high = found.interval
    yield f"{made.judges} judges, {made.pairs} pairs"
    yield f"score and mean rating: r {found.r:.2f} (95 %: {low:.2f} to {high:.2f}), rho {found.rho:.2f}"
    yield f"ratings differ from the score by {made.difference:+.1f} on average"
    if made.between_judges is not None:
        yield f"a judge and the others' mean: r {made.between_judges:.2f}"
