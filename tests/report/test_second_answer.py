"""The second study's answer: what is read, judged and told of arms whose truth is known."""

from __future__ import annotations

import csv
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from realitygap.cli import realitygap
from realitygap.errors import StudyError
from realitygap.experiments.noise.second.verdicts import CLAIMS
from realitygap.experiments.noise.simulated import LIVED
from realitygap.report.noise.arms import BEYOND, Arm
from realitygap.report.noise.orders import BY_CAMERA, FILE, order_tables, read_orders
from realitygap.report.noise.second import answer_tables, headline, read_arms, strays, warned, word_of
from tests.experiments.crosses import TASKS, comparison
from tests.experiments.second import UNITS, arm, write


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Arms E, with one task, and T: an effect of the level compared with; in T failures besides."""
    out = tmp_path_factory.mktemp("arms")
    one = arm(comparison(1.0), runs=16, fall=0.6, tasks=TASKS[:1])
    write(one, out / "E" / "results", name="E")
    write(arm(comparison(1.0), runs=16, failing=0.3, seed=3), out / "T" / "results", name="T")
    return out


@pytest.fixture(scope="module")
def alone(folder: Path) -> Arm:
    """Arm E by itself."""
    return read_arms([folder / "E"])[0]


def test_the_command_judges_arms_together_and_makes_their_page(folder: Path) -> None:
    """JSON has the verdicts; the page stands alone, with every table and both figures beside it."""
    places = [str(folder / "T"), str(folder / "E" / "results"), "--out", str(folder / "both")]
    done = CliRunner().invoke(realitygap, ["report", *places, "--json"])
    assert done.exit_code == 0, done.output
    told = json.loads(done.stdout)
    words = {name: {f"{v['claim']} {v['by']}": v["verdict"] for v in made["verdicts"]}
             for name, made in told["arms"].items()}  # fmt: skip
    assert words["E"]["a signed ranks"] == words["T"]["a signed ranks"] == "supported"
    assert words["E"]["d slopes"] == "supported" and words["T"]["b failures"] == "supported"
    assert told["headlines"]["a by signed ranks"] == "supported"
    assert told["headlines"]["b by failures"].startswith("they differ: E ")
    assert told["not_yet_run"] == ["E5", "T5", "T2", "S"] and list(told["arms"]) == ["E", "T"]
    page = (folder / "both" / "report" / "index.html").read_text("utf-8")
    linked = set(re.findall(r'href="((?:tables|figures)/[^"]+)"', page))
    assert len(linked) == 4 + 9 and all((folder / "both" / "report" / one).is_file() for one in linked)
    assert ">nan<" not in page and "not run" in page and not re.search(r'(src|href)="https?:', page)


def test_one_arm_alone_gives_no_headline(alone: Arm) -> None:
    """Its verdicts stand; the headline waits for the other."""
    assert headline([alone], alone.judged.verdicts[0].claim) == "no headline: T not run"
    assert answer_tables([alone])["verdicts"].texts()[0][1:4] == ["supported", "not run", "not run"]


def test_what_is_printed_is_what_the_tables_say(alone: Arm) -> None:
    """By hand from cells.csv: mean scores, failures and the peak's curve of arm E."""
    cells: dict[tuple[str, str], list[float]] = {}
    with (alone.folder / "cells.csv").open(newline="") as file:
        for row in csv.DictReader(file):
            if row["individual"] == "champion":
                key = (row["evolved_level"], row["comparison_level"])
                cells.setdefault(key, []).append(float(row["score"]))
    for row in answer_tables([alone])["levels"].texts():
        level = f"{float(row[2])}"
        common, own = np.array(cells[level, "1.0"]), np.array(cells[level, level])
        assert row[3:7] == [f"{len(common)}", f"{common.mean():.2f}", f"{own.mean():.2f}",
                            f"{100 * np.mean(common < 6):.0f} %"]  # fmt: skip
    for level, mean in zip(alone.judged.peak.levels, alone.judged.peak.means, strict=True):
        column = [s for key, scores in cells.items() if key[1] == f"{level}" for s in scores]
        assert mean == pytest.approx(np.mean(column))


def test_a_model_that_errs_supports_no_claim(folder: Path, tmp_path: Path) -> None:
    """On more than half of its units beyond the limit: no claim; fewer are named, and left out again."""
    data = arm(comparison(1.0), runs=16, tasks=TASKS[:1])
    write(data, tmp_path / "bad", name="E", error=60.0)
    (bad,) = read_arms([tmp_path / "bad"])
    assert bad.void and word_of(bad, CLAIMS[0]) == "no claim"
    assert "supports no claim: model error" in next(warned([bad]))
    write(data, tmp_path / "some", name="E")
    file = tmp_path / "some" / "calibration.csv"
    file.write_text(file.read_text().replace("103,infrared,20.0,20.0,1.0", "103,infrared,50,20,2.5"))
    (some,) = read_arms([tmp_path / "some"])
    assert some.beyond == [103] and not some.void
    assert len(some.data) == len(data) and 103 in some.data.home
    left = some.again[BEYOND]
    assert len(left) == len(data) * (UNITS - 1) // UNITS and 103 not in left.home


def test_a_sign_that_turns_is_told(tmp_path: Path) -> None:
    """Where the score without jitter says the contrary of what was found, the headline says so."""
    data = arm(comparison(1.0), runs=16, tasks=TASKS[:1])
    for name in ("E", "T"):
        write(data, tmp_path / name, name=name)
        file = tmp_path / name / "cells.csv"
        with file.open(newline="") as opened:
            rows = list(csv.DictReader(opened))
        for row in rows:
            row["without_jitter"] = str(10 - float(row["score"]))
        with file.open("w", newline="") as opened:
            table = csv.DictWriter(opened, list(rows[0]))
            table.writeheader()
            table.writerows(rows)
    arms = read_arms([tmp_path / "E", tmp_path / "T"])
    told = headline(arms, arms[0].judged.verdicts[0].claim)
    assert told.startswith("supported; of another sign: E without jitter against 0")
    assert "▲" in answer_tables(arms)["E-robust"].texts()[0][3]


def test_means_on_the_other_side_of_ranks_are_told(tmp_path):
    """What ranks found and the difference of means does not bear out is no plain finding."""
    write(arm(comparison(1.0), runs=16, tasks=TASKS[:1]), tmp_path, name="E")
    one = read_arms([tmp_path])[0]
    first, *others = one.judged.verdicts
    assert "means" not in " ".join(strays(one, first.claim))
    turned = tuple(replace(each, difference=(-0.1, -0.2, 0.0)) for each in first.comparisons)
    one.__dict__["judged"] = replace(one.judged, verdicts=(replace(first, comparisons=turned), *others))
    assert {"means against 0", "means against 2"} <= set(strays(one, first.claim))
    last = one.judged.verdicts[-1]
    assert last.claim.key == "e" and last.word == "supported" and strays(one, last.claim) == []
    far = replace(last, word="reversed")
    one.robust["layout alone"] = replace(one.judged, verdicts=(*one.judged.verdicts[:-1], far))
    assert strays(one, last.claim) == ["layout alone (reversed)"]
    assert headline([one, replace(one, name="T")], last.claim).startswith(
        "supported; otherwise: E layout alone ("
    )


def _drop(text: str) -> str:
    return text.rpartition("\n")[0].rpartition("\n")[0] + "\n"


@pytest.mark.parametrize(
    ("file", "change", "said"),
    [
        ("cells.csv", _drop, "expected every controller once at each of levels"),
        ("cells.csv", lambda text: text.replace("layout_home", "rooms"), "expected columns task, seed_set"),
        ("controllers.csv", lambda text: text.replace(",101,", ",here,", 1), "home_unit: expected a"),
        ("study.toml", lambda text: text.replace('"E"', '"X"'), "arm: expected one of E, T, E5"),
        ("study.toml", lambda text: text.replace("arm =", "ark ="), "expected an arm of the second study"),
        ("study.toml", lambda text: text + '[plan]\n"claims.toml" = "0"\n', "with the version that started"),
    ],
)  # fmt: skip
def test_broken_arms_are_refused(folder: Path, tmp_path: Path, file: str, change, said: str) -> None:
    """With the file, what was expected and the cure; the command ends with code 2."""
    for one in (folder / "E" / "results").iterdir():
        text = one.read_text("utf-8")
        (tmp_path / one.name).write_text(change(text) if one.name == file else text, "utf-8")
    with pytest.raises(StudyError, match=said):
        read_arms([tmp_path])
    done = CliRunner().invoke(realitygap, ["report", str(tmp_path), str(folder / "T")])
    assert done.exit_code == 2 and "Traceback" not in done.output


def test_an_order_without_a_camera_is_read_from_its_table(tmp_path):
    """Where distances follow the camera's score it is a substitute, where they are drawn it is none."""
    draw, rows, homes = np.random.default_rng(3), [], {}
    for task, tell in (("obstacle-avoidance", 0.0), ("light-seeking", 30.0)):
        for run in range(1, 61):
            homes[task, 1 + run % 2, run, 1.0, "champion"] = 101 + run % 4
            for unit in range(101 + run % 4, 105 + run % 4):
                score = 10.0 * run / 60
                far = 10.0 - score + tell * draw.random()
                rows.append([task, 1 + run % 2, run, 1.0, "champion", unit, *5 * [far], score, *3 * [score]])
    head = ["task", "seed_set", "run", "evolved_level", "individual", "unit", *LIVED, *BY_CAMERA]
    (tmp_path / FILE).write_text("\n".join(",".join(map(str, row)) for row in [head, *rows]) + "\n")
    avoidance, light = read_orders(tmp_path, "twin", "", homes)
    assert (avoidance.task, avoidance.controllers, avoidance.units) == ("obstacle-avoidance", 60, 7)
    assert avoidance.rho == pytest.approx(1.0) and avoidance.verdict == "a substitute"
    assert 0.0 < light.low < light.rho < light.high < 0.8 and light.verdict == "no substitute"
    table = order_tables("E", (avoidance, light))[0].markdown()
    assert "no substitute" in table and "+1.00" in table
    assert order_tables("E", ()) == [] == list(read_orders(tmp_path / "none", "twin", "", {}))
    with pytest.raises(StudyError, match="expected a champion of controllers"):
        read_orders(tmp_path, "twin", "", {})
