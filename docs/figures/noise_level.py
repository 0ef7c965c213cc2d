"""Writes docs/noise-level.md and its figures from the results kept in docs/noise-level.

`python docs/figures/noise_level.py` renders docs/noise-level/page.md.j2: what is said stands there, what
is printed as a figure comes from the tables of the studies, NAME/controllers.csv, cells.csv,
calibration.csv and study.toml (and home.csv, scores on the home unit alone, where a study's cells.csv has
none of single units). A study that the template does not speak of gets a place after the others.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import matplotlib
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from noise_level_power import STUDIES, Power, least_delta, powers, table
from noise_level_told import AVOIDANCE, LIGHT, Makings, Told, judged_against, overview, paper_marks

from realitygap.errors import UsageError
from realitygap.report.noise.facts import BOTH, FAILED, PAPER, SATURATED
from realitygap.report.noise.results import real_misfits

DOCS = Path(__file__).resolve().parent.parent
DRAWN_BY = DOCS / "figures" / "noise-level-drawn-by.txt"
"""Another version of Matplotlib draws other pixels."""
FIGURES = {"noise-map": "map", "noise-claims": "claims", "noise-fitness": "fitness"}
STUDIES_TOLD = ("default", "evaluations-5000", "twin-noise-2", "default-first", "default-again")
UNDRAWN = STUDIES_TOLD[3:]
TABLES = (
    "both-tasks-a", "both-tasks-b", "both-tasks-c", "both-tasks-split", "ends", "peaks", "paper", "fitness",
    "falls", "names", "calibration",
)  # fmt: skip
HEAD = "<!-- Made by docs/figures/noise_level.py of noise-level/page.md.j2: change that, not this. -->\n"


def main() -> None:
    """Read the studies, draw them, write the page."""
    try:
        told = read()
    except UsageError as error:
        sys.exit(str(error))
    for name in drawn(told):
        print(f"{name} …", flush=True)
        draw(told[name], DOCS / "figures")
    DRAWN_BY.write_text(f"matplotlib {matplotlib.__version__}\n", encoding="utf-8")
    (DOCS / "noise-level.md").write_text(page(told), encoding="utf-8")
    print(f"wrote {DOCS / 'noise-level.md'}")


def read() -> dict[str, Told]:
    """The kept studies by name; those that the template speaks of first."""
    names = sorted(file.parent.name for file in (DOCS / "noise-level").glob("*/study.toml"))
    order = sorted(names, key=lambda name: name not in STUDIES_TOLD)
    return {name: Told(DOCS / "noise-level" / name) for name in order}


def drawn(told: dict[str, Told]) -> list[str]:
    """Studies with a section of their own."""
    return [name for name in told if name not in UNDRAWN]


def draw(one: Told, folder: Path) -> None:
    """A study's figures."""
    for which, word in FIGURES.items():
        file = f"noise-level-{one.name}-{word}"
        replace(one.report.figures[which], name=file).save(folder, dpi=130)
        (folder / f"{file}.svg").unlink()


def page(told: dict[str, Told]) -> str:
    """The page's text."""
    default, long, loud, first, again = (told[name] for name in STUDIES_TOLD)
    marks, p = paper_marks()
    rows = powers(default.data)
    environment = Environment(
        loader=FileSystemLoader(DOCS / "noise-level"), undefined=StrictUndefined, keep_trailing_newline=True,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    return HEAD + environment.get_template("page.md.j2").render(
        default=default, first=first, again=again, long=long, loud=loud, avoidance=AVOIDANCE, light=LIGHT,
        failed=f"{FAILED:g}", saturated=f"{SATURATED:g}",
        loud_at_two=judged_against(loud, 2.0), makings=Makings(first, default),
        real={m.channel: f"{m.ratio:.2f}" for m in real_misfits()},
        over_all={m.channel: f"{m.ratio_over_all:.2f}" for m in real_misfits()},
        paper={level: _paper_mean(level) for level in (0, 1, 2)}, paper_table=marks, paper_p=p,
        studies=STUDIES, power_table=table(rows), least_delta=f"{least_delta(rows):.2f}",
        failures_found=one_of(rows[-1]), overview=overview([*told.values()]),
        home_tables=tables(default, [f"{s.replace(' ', '-')}-home" for s in (BOTH, AVOIDANCE, LIGHT)]),
        study=lambda name: study(told[name]), others=[name for name in told if name not in STUDIES_TOLD],
    )  # fmt: skip


def study(one: Told) -> str:
    """One study's part of the page."""
    command = one.settings.get("command", "realitygap experiment noise")
    command = command.replace("study noise", "experiment noise")  # what it was called when these were made
    parts = [f"```sh\n{command}\n```", one.report.paragraph]
    for which, word in FIGURES.items():
        file = f"noise-level-{one.name}-{word}"
        parts += [
            f"![{word.capitalize()} of the study {one.name}](figures/{file}.png)",
            one.report.figures[which].caption,
        ]
    return "\n\n".join([*parts, tables(one, TABLES)])


def tables(one: Told, names: list[str] | tuple[str, ...]) -> str:
    """Some of a study's tables, each with its title; those that it has."""
    made = (one.report.tables[name] for name in names if name in one.report.tables)
    return "\n\n".join(f"{table.title}\n\n{table.markdown()}" for table in made if table.rows)


def one_of(row: Power) -> str:
    """How often something is found, in words."""
    return f"one study of {1 / row.found:.0f}"


def _paper_mean(level: float) -> str:
    marks = [mark for task in (AVOIDANCE, LIGHT) for mark in PAPER[task][level]]
    return f"{sum(marks) / len(marks):.1f}"


if __name__ == "__main__":
    main()
