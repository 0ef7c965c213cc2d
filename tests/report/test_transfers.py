"""What a page shows of transfers: pairs of paths, films, a table; and what it calls the twin."""

from __future__ import annotations

import csv
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from realitygap.film.video import FilmReader
from realitygap.report import build_report
from realitygap.report.drawing import Scene
from realitygap.report.evolution import parts_of
from realitygap.report.page import Figures
from realitygap.report.transfers import (
    Pair,
    groups_of,
    pair_figures,
    pairs_of,
    robots_of,
    shown_pair,
    transfers_csv,
)
from realitygap.study.load import Study, load_study
from realitygap.transfer.spec import shown_runs
from tests.report.scenes import STEPS, draw_only, write_film, write_transfer

AVOID, LIGHT = "obstacle-avoidance", "light-seeking"


@pytest.fixture
def study(paper: Study, tmp_path: Path) -> Study:
    """A copy to which transfers may be added."""
    ignored = shutil.ignore_patterns("report")
    return load_study(shutil.copytree(paper.folder, tmp_path / "study", ignore=ignored))


def _shown(study: Study, figures: Figures) -> list[Pair]:
    """The pairs in obstacle avoidance's figures, which are added, not drawn."""
    part = parts_of(study)[0]
    scene, pairs = Scene.of(part.task, study.profile), pairs_of(study, [part])[AVOID]
    return pair_figures(part, pairs, scene, "", figures)["shown"]


def test_figures_3_and_5_hold_both_paths_and_films_are_shown(study: Study, tmp_path, monkeypatch) -> None:
    """Pairs stand in the place of the simulated paths; the report that is given away keeps its films, and one
    that is made anew is shown anew; the twin is never called real."""
    for run in study.runs:
        write_transfer(study, run, fitness=(0.5 + 0.01 * run.id, 0.4))
    shown = _shown(study, Figures())
    assert [pair.run for pair in shown] == [run.id for run in shown_runs(study)[:3]]
    shutil.rmtree(shown[1].folder)
    folder, films = write_transfer(study, study.run(shown[1].run), film=True), []
    draw_only(monkeypatch, lambda name: "-pairs" in name)
    for shade in (60, 120):
        write_film(folder, shade)
        text = build_report(study.folder).read_text("utf-8")
        away = shutil.copytree(study.folder / "report", tmp_path / f"{shade}")
        links = re.findall(r'<a href="([^"#][^"]*)"', text)
        assert all((away / link).resolve().is_relative_to(away.resolve()) for link in links)
        (kept,) = (away / link for link in links if link.endswith(".mp4"))
        films.append(kept.read_bytes())
        (made,) = _frames(kept)[-1:]
    assert films[0] != films[1] and len(list(kept.parent.iterdir())) == 2
    for name, label in ((AVOID, "Figure 3"), (LIGHT, "Figure 5")):
        found = re.search(rf'<figure id="{name}-pairs".*?</figure>', text, re.DOTALL)
        assert found and f"<b>{label}.</b>" in found[0]
        assert found[0].count("twin unit 1: ") == 3
        assert f'<figure id="{name}-paths"' not in text
    video = (
        r'<video controls playsinline preload="none" poster="data:image/jpeg;[^"]+" width="960" height="480"'
    )
    assert len(re.findall(video, text)) == 1
    left, right = made[:, :480], made[:, 480:]
    # The tracked robot drove along y = 10 cm, the simulated one around (19, 25); each tail is in its half.
    assert right[380:388, 100:300].max(axis=(0, 2)).min() > 220 > right[200:360].max()
    assert left[220:260, 200:230].max() > 220 > right[220:260, 200:230].max()
    ids = re.findall(r'\bid="([^"]+)"', text)
    assert len(ids) == len(set(ids))
    words = re.sub(r"data:[^\"]*|<script.*?</script>|<style.*?</style>", "", text, flags=re.DOTALL)
    assert "situated" not in words and words.count("No robot was driven") == 1
    assert not re.search(r"stand-in|pseudo", words) and '<td class="text">film</td>' in words


def _frames(film: Path) -> list[np.ndarray]:
    with FilmReader(film) as reader:
        return [frame.colour() for frame in reader]


def test_a_film_that_cannot_be_read_is_shown_as_its_last_frame(study: Study, monkeypatch) -> None:
    """The page is made all the same."""
    folder = write_transfer(study, study.run(shown_runs(study)[0].id), film=True)
    (folder / "film.mp4").write_bytes(b"a film")
    draw_only(monkeypatch, lambda name: False)
    text = build_report(study.folder).read_text("utf-8")
    image = r'<img src="(data:image/jpeg;base64,[^"]+)" width="960" height="720" alt="[^"]+">'
    assert re.search(image, text) and "<video" not in text


def test_the_table_has_every_transfer(study: Study) -> None:
    """Run, robot, start, both scores, and the drop, which is their difference."""
    run = study.runs[0]
    for robot in ("serial-ttyUSB0", "twin-1", "twin-2"):
        for start in (1, 2):
            write_transfer(study, run, robot=robot, start=start, fitness=(0.7, 0.1 * start))
    part = parts_of(study)[0]
    groups = groups_of(part, pairs_of(study, [part])[AVOID])
    rows = list(csv.DictReader(transfers_csv(part.task, groups, study.folder).splitlines()))
    assert [(row["robot"], row["start"]) for row in rows] == [
        (robot, start) for robot in ("serial-ttyUSB0", "twin-1", "twin-2") for start in "12"
    ]
    for row in rows:
        assert row["name"] == run.name and (study.folder / row["folder"] / "situated.csv").is_file()
        assert float(row["drop"]) == pytest.approx(0.7 - 0.1 * int(row["start"]))
    assert [(group.kind, len(group.pairs)) for group in groups] == [("robot", 2), ("twin", 4)]
    means = [groups[1].mean(of).value for of in ("fitness_simulated", "fitness_situated", "drop")]
    assert means == pytest.approx([0.7, 0.15, 0.55])


def test_a_mean_is_over_runs(study: Study) -> None:
    """A run with many transfers counts as much as one with few; twins and robots are kept apart, and the
    champion and the best during evolution."""
    one, two = (run for run in study.runs if run.task == AVOID and run.noise == 1.0)
    write_transfer(study, one, fitness=(1.0, 0.0))
    for start in (1, 2, 3):
        write_transfer(study, two, start=start, fitness=(1.0, 0.6))
    write_transfer(study, two, robot="serial-ttyUSB0", fitness=(1.0, 1.0))
    write_transfer(study, two, start=4, fitness=(1.0, -9.0), individual="fittest")
    parts = parts_of(study)
    robot, twin, best = groups_of(parts[0], pairs_of(study, parts)[AVOID])
    assert (robot.kind, twin.kind, robot.level, twin.level) == ("robot", "twin", 1.0, 1.0)
    assert best.individual == "fittest" and best.mean("drop").value == 10.0
    assert twin.mean("drop").value == pytest.approx(0.7) and twin.mean("drop").count == 2
    assert robot.mean("fitness_situated").value == 1.0


def test_a_figure_shows_one_robot_of_each_kind(study: Study) -> None:
    """Of the twin's units the one with most noise levels, and another run where the median one is missing."""
    runs = [run for run in study.runs if run.task == AVOID]
    write_transfer(study, runs[0], robot="twin-1")
    for run in runs:
        write_transfer(study, run, robot="twin-7", film=run is runs[1])
    write_transfer(study, runs[2], robot="twin-1-noise-2.0")
    parts = parts_of(study)
    pairs = pairs_of(study, parts)[AVOID]
    assert robots_of(pairs) == ["twin-7", "twin-1-noise-2.0"]
    alone = [pair for pair in pairs if pair.run == runs[1].id]
    assert shown_pair(parts[0].conditions[0], alone) is alone[0]
    figures = Figures()
    shown = _shown(study, figures)
    assert {f"{AVOID}-pairs", f"{AVOID}-pairs-twin-1-noise-2.0"} <= set(figures)
    assert shown[-1].where == "twin unit 1, 2.0 × noise"
    assert groups_of(parts[0], pairs)[-1].kind == "twin with 2.0 times its noise"


def test_a_path_is_thinned_to_the_simulations_steps(study: Study) -> None:
    """A stroke a tenth of a second, first and last pose included; poses that were lost are left out."""
    folder = write_transfer(study, study.runs[0])
    lines = (folder / "situated.csv").read_text("utf-8").splitlines()
    fine = [lines[0]]
    for line in lines[1:]:
        t, rest = line.split(",", 1)
        fine += [f"{float(t) + more:.3f},{rest}" for more in (0.0, 0.02, 0.04)]
    fine[10:13] = [f"{line.split(',')[0]},nan,nan,nan" for line in fine[10:13]]
    (folder / "situated.csv").write_text("\n".join(fine) + "\n", encoding="utf-8")
    parts = parts_of(study)
    pair = pairs_of(study, parts)[AVOID][0]
    simulated, situated = pair.paths
    assert len(simulated.x) == STEPS + 1 and len(situated.x) in (STEPS, STEPS + 1)
    assert situated.end.x == pytest.approx(situated.x[-1]) and np.isfinite(situated.x).all()
