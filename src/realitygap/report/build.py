"""Writes a study's report: `index.html`, every figure as PNG and SVG, every table as CSV."""

import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any

from markupsafe import Markup

from realitygap.experiments.reproduction import again
from realitygap.report import words
from realitygap.report.calibrated import calibrated_part
from realitygap.report.gather import PER_CONDITION, parts_of
from realitygap.report.lead import departures, is_paper, lead, made_of
from realitygap.report.page import Figures, OnProgress, Steps, noise_key, report_folder, write_page
from realitygap.report.player import player_data, player_json
from realitygap.report.robots import robot_figure
from realitygap.report.sections import Sections
from realitygap.report.statistics import mean_of
from realitygap.report.tables import TaskPart
from realitygap.report.transfers import pairs_of
from realitygap.robots.address import ROBOT
from realitygap.study.load import Study, load_study
from realitygap.transfer.scores import marks_of
from realitygap.work.pool import Workers

__all__ = ["build_report", "figures_of", "scripts"]


def build_report(
    study_path: str | PathLike[str], *, workers: Workers = 1, on_progress: OnProgress | None = None
) -> Path:
    """Write a study's report into its folder `report/`, and return the page's path.

    Args:
        study_path: the study's folder; it may be unfinished.
        workers: processes that draw the figures (None: one a core), or a pool; does not affect the result.
        on_progress: called with figures done, figures in all, and the name of the next one.

    Raises:
        StudyError: the folder holds no study that can be read.
        OSError: the report cannot be written.
    """
    study = load_study(study_path)
    folder, parts = report_folder(study.folder), parts_of(study)
    maker, shown = _gathered(study, parts, folder, Figures(workers))
    step = Steps(on_progress, len(maker.figures) + 1)
    step("player")
    with ThreadPoolExecutor(1) as beside:  # while others draw the figures
        player = beside.submit(player_data, study, parts, maker.pairs, maker.paths)

        def facts() -> dict[str, object]:
            data = player.result()
            packed = Markup("" if data is None else player_json(data))
            return {**_told(study, parts), "paper": is_paper(study, parts), "player": packed,
                    "scripts": Markup(scripts()), **shown}  # fmt: skip

        page = folder / "index.html"
        return write_page(page, "page.html.j2", maker.figures, facts, step, tables=maker.tables)


def figures_of(study: Study) -> Figures:
    """All figures of a study's page by name, not yet drawn."""
    with tempfile.TemporaryDirectory(prefix="realitygap-") as folder:  # for copies of films
        return _gathered(study, parts_of(study), Path(folder), Figures())[0].figures


def _gathered(
    study: Study, parts: Sequence[TaskPart], folder: Path, figures: Figures
) -> tuple[Sections, dict[str, object]]:
    """The sections of a page with all its figures and tables; and the page's values."""
    maker = Sections(
        study=study, folder=folder, figures=figures, tables={}, pairs=pairs_of(study, parts),
        marks=marks_of(study),
    )  # fmt: skip
    robot = figures.add("robot", partial(robot_figure, study.profile), words.robot_words(study.profile))
    sections = [maker.section(part) for part in parts]
    calibrated = calibrated_part(study, figures)
    return maker, {"robot": robot, "sections": sections, "calibrated": calibrated, **_stand_in(sections)}


def _told(study: Study, parts: Sequence[TaskPart]) -> dict[str, object]:
    """The page's values on the study and how it was made."""
    settings = study.folder / "study.toml"
    levels = sorted({c.level: c.name for part in parts for c in part.conditions}.items())
    return {
        "lead": lead(study, parts),
        "departures": departures(study.profile),
        "made_of": made_of(study.profile),
        "key": noise_key(dict(levels)),
        "config": study.config,
        "profile": study.profile,
        "mean_of": mean_of,
        "per_condition": 2 * PER_CONDITION,
        "sheet_runs": PER_CONDITION,
        "total": len(study.runs),
        "finished": sum(run.finished for run in study.runs),
        "changes": ", ".join(f"{key} = {value}" for key, value in study.config.task.to_dict().items()),
        "again": again(study),
        "evaluations": sum(run.evaluations for run in study.runs),
        "settings": settings.read_text("utf-8") if settings.is_file() else "",
        "versions": {name: ", then ".join(found) for name, found in study.versions().items()},
    }


def scripts() -> str:
    """The page's own scripts in one scope, in the order of their names."""
    files = sorted((Path(__file__).parent / "assets").glob("*.js"))
    text = "\n".join(file.read_text("utf-8") for file in files)
    return f'"use strict";\n(() => {{\n{text}}})();'


def _stand_in(sections: Sequence[dict[str, Any]]) -> dict[str, str]:
    """What the evolved networks drove besides the simulation ("twin", "robot", "both" or nothing), and that
    in words."""
    driven = {group.kind for s in sections if s["situated"] for group in s["situated"].groups}
    kinds = {name == ROBOT for name in driven}
    which = "both" if len(kinds) > 1 else "" if not kinds else "robot" if True in kinds else "twin"
    names = {
        "twin": "a physics twin of the robot", "stranger": "a second physics twin of the robot",
        "Enki": "a robot of EPFL’s simulator Enki",
    }  # fmt: skip
    told = [words for kind, words in names.items() if any(name.startswith(kind) for name in driven)]
    return {"stand_in": which, "stand_in_is": " or ".join(told) or names["twin"]}
