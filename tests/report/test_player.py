"""What the page's player is told is what happened, and the page says it so that everyone can use it."""

from __future__ import annotations

import base64
import json
import re
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from realitygap.export import logs as trial
from realitygap.report import player
from realitygap.report.evolution import individual, parts_of
from realitygap.report.player import LOST, activity, pack
from realitygap.report.transfers import pairs_of
from realitygap.robots.drive import Recording
from realitygap.study.load import Study
from realitygap.work.archive import unpacked
from tests.report.scenes import random_genotype

AVOID, LIGHT = 0, 1


def _unpacked(text: str, kind: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), kind)


def _data(study: Study) -> dict[str, Any]:
    """What the page was given, read back from it."""
    text = (study.folder / "report" / "index.html").read_text("utf-8")
    found = re.search(r'<script type="application/json" id="player-data">(.*?)</script>', text, re.DOTALL)
    assert found
    return dict(json.loads(found[1]))


def _run(study: Study, task: int, run: int) -> dict[str, Any]:
    """A run of a task's zero noise."""
    return dict(_data(study)["tasks"][task]["noises"][0]["runs"][run])


def test_numbers_come_back_from_their_packing() -> None:
    """Rounded to whole numbers; what is not known, or too large, is told by the ends of the range."""
    values = np.array([[0.4, -1.6], [np.nan, 1e6], [-1e6, 32767.0]])
    told = _unpacked(pack(values, "<i2"), "<i2").reshape(3, 2)
    assert told.tolist() == [[0, -2], [LOST, 32767], [LOST + 1, 32767]]
    assert _unpacked(pack([[-10, 10]], "i1"), "i1").tolist() == [-10, 10]


def _recorded(trial: Path) -> Recording:
    """Of a trial in its run's archive."""
    with unpacked(trial) as folder:
        return Recording.from_folder(folder)


def test_a_situated_drive_is_the_recording(played: Study) -> None:
    """Readings and commands as they were recorded; the path as it is on file, to a hundredth of a cm."""
    pair = pairs_of(played, parts_of(played))["obstacle-avoidance"][0]
    told, kept = _run(played, AVOID, 0)["trials"][0]["driven"], _recorded(pair.folder)
    readings = _unpacked(told["readings"], "<i2").reshape(told["steps"], 8)
    assert told["steps"] == 20 and np.array_equal(readings, kept.proximity)
    assert np.array_equal(_unpacked(told["commands"], "i1").reshape(-1, 2), kept.commands)
    poses = _unpacked(told["poses"], "<i2").reshape(-1, 3) / 100
    assert np.allclose(poses[:, 0], pair.paths[1].x, atol=0.0051)
    assert np.allclose(poses[:, 1], pair.situated.y, atol=0.0051)


def test_commands_in_a_robots_own_units_are_shown_as_the_networks(played: Study) -> None:
    """Whether its top command is 10 or 30: the same, with the network's neurons, on the page and in a log."""
    run, (pair, *_) = played.runs[0], pairs_of(played, parts_of(played))["obstacle-avoidance"]
    genotype, kept, task = individual(run), _recorded(pair.folder), played.task(run.task)
    other = replace(played.profile, wheels=replace(played.profile.wheels, top_command=30.0))
    shown, logged = [], []
    for profile, recorded in ((played.profile, kept), (other, replace(kept, commands=3 * kept.commands))):
        side = player._Side(task=task, genotype=genotype, slots=range(10), profile=profile)
        shown.append(side.drive("a robot", "0.5", pair.situated, recorded, genotype))
        side = trial._side("situated", pair.situated, recorded, (genotype, [*range(10)]), (task, profile))
        logged.append({name: values.tolist() for name, values in side.inside.items()})
    assert shown[0] == shown[1] and shown[1]["outputs"] is not None
    assert logged[0] == logged[1] and {"commands", "outputs"} <= logged[1].keys()


def test_activity_is_that_of_the_one_who_drove() -> None:
    """Another's commands, even in one step, are not explained by this network."""
    genotype = random_genotype(4)
    network, random = genotype.controller(), np.random.default_rng(1)
    inputs = random.integers(-10, 11, (30, 8))
    commands = np.array([list(vars(network.decide(row.tolist())).values()) for row in inputs])
    slots = [0, 8, 9]
    shown = activity(genotype, inputs, commands, slots)
    assert shown is not None
    assert np.array_equal(shown[:, 0], inputs[:, 0]) and np.array_equal(shown[:, 1:], commands)
    other = commands.copy()
    other[-1, 1] += 1
    assert activity(genotype, inputs, other, slots) is None


def test_a_run_without_a_transfer_is_simulated_alone(played: Study) -> None:
    """With all that a simulation knows; the other task's runs have both, up to the number that is shown, and
    the motors of the network that lights up are the commands, step by step."""
    alone = _run(played, LIGHT, 0)["trials"]
    assert len(alone) == 1 and alone[0]["driven"] is None and alone[0]["simulated"]["outputs"]
    run = _run(played, AVOID, 0)
    assert [trial["name"] for trial in run["trials"]] == ["twin unit 1, start 1", "twin unit 1, start 2"]
    kinds = [neuron["kind"] for neuron in run["network"]["neurons"]]
    assert kinds[8:10] == ["output", "output"]
    for drive in (one[who] for one in run["trials"] for who in ("simulated", "driven")):
        outputs = _unpacked(drive["outputs"], "i1").reshape(drive["steps"], len(kinds))
        assert np.array_equal(outputs[:, 8:10], _unpacked(drive["commands"], "i1").reshape(-1, 2))


def test_nothing_in_the_data_ends_its_script() -> None:
    """Whatever a user calls a task."""
    text = player.player_json({"title": "</script><b>"})
    assert "<" not in text and json.loads(text) == {"title": "</script><b>"}


SCRIPTS = "".join(
    files("realitygap.report").joinpath("templates", name).read_text("utf-8")
    for name in ("arena.js", "player.js")
)


def test_the_page_may_fetch_nothing(played: Study) -> None:
    """Its own policy forbids it; its scripts name no address but that of SVG, and build no code; what they
    look for is there."""
    text = (played.folder / "report" / "index.html").read_text("utf-8")
    assert "default-src 'none'" in text and "unsafe-eval" not in text.replace("'wasm-unsafe-eval'", "", 1)
    assert set(re.findall(r"https?://[^\"'\s]*", SCRIPTS)) == {"http://www.w3.org/2000/svg"}
    assert not re.search(r"\b(eval|fetch|XMLHttpRequest|import|Function)\s*\(", SCRIPTS)
    asked = set(re.findall(r'byId\("([\w-]+)"\)', SCRIPTS))
    for stem in re.findall(r"byId\(`([\w-]+-)\$\{(?:side|i)\}`\)", SCRIPTS):
        asked |= {f"{stem}0", f"{stem}1"}
    assert len(asked) > 20 and asked <= set(re.findall(r'\bid="([\w-]+)"', text))
