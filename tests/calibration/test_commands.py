"""`realitygap calibrate`: a profile that loads, a page, a judge, and refusals in one line."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
from click.testing import CliRunner

from realitygap.cli import realitygap
from realitygap.world.robot import load_profile
from tests.calibration.written import save_recording


def call(*words: object):
    return CliRunner().invoke(realitygap, [str(word) for word in words])


@pytest.fixture(scope="module")
def folder(tmp_path_factory, recorded, driven):
    """Recordings of a robot on disk."""
    place = tmp_path_factory.mktemp("recordings")
    save_recording(place / "wall", recorded("wall", repeats=2))
    save_recording(place / "wheels", driven(friction_cm_s2=0.0))
    return place


def test_a_profile_with_its_history_and_its_page(folder, tmp_path):
    """Fitted, written, loaded again; its page holds everything in one file."""
    out = tmp_path / "robot.toml"
    result = call("calibrate", folder, "--form", "individual", "--out", out, "--json")
    assert result.exit_code == 0, result.output
    assert "fitting the simulation to the recordings: 0/8" in result.stderr and ": 8/8" in result.stderr
    said = json.loads(result.stdout)
    assert said["channels"]["infrared"]["form"] == "individual"
    profile = load_profile(out)
    assert profile.name == "robot" and {f.kind for f in profile.provenance.files} == {"infrared", "wheels"}
    assert all(len(f.sha256) == 64 for f in profile.provenance.files)
    page = out.with_suffix(".html").read_text("utf-8")
    assert page.count("<svg") >= 5 and "http://" not in page.replace("http://www.w3.org", "")
    judged = call("calibrate", folder / "wall", "--check", out, "--json")
    assert judged.exit_code == 0, judged.output
    told = json.loads(judged.stdout)
    assert set(told) >= {"rmse", "bias", "per_sensor", "noise"} and len(told["per_sensor"]) == 8
    assert told["rmse"] == pytest.approx(said["channels"]["infrared"]["rmse"], rel=0.05)


def test_a_judge_warns_of_doubtful_recordings(folder, tmp_path, recorded, driven):
    """Dead sensors are named and left out, another side and swapped counters told: on stderr and in JSON."""
    near, wheels = recorded("wall"), driven(friction_cm_s2=0.0)
    counts = near.counts.copy()
    counts[:, 3] = 17.0
    save_recording(tmp_path / "dead", replace(near, counts=counts))
    save_recording(tmp_path / "mirrored", replace(near, bearing_deg=-near.bearing_deg))
    save_recording(tmp_path / "swapped", replace(wheels, counters=wheels.counters[:, ::-1]))
    said = {}
    for name in ("dead", "mirrored", "swapped"):
        result = call("calibrate", tmp_path / name, "--check", "paper", "--json")
        assert result.exit_code == 0, result.output
        said[name] = json.loads(result.stdout)
        assert said[name]["warnings"] and f"warning: {said[name]['warnings'][0]}" in result.stderr
    assert [m["sensor"] for m in said["dead"]["per_sensor"]] == [0, 1, 2, 4, 5, 6, 7]
    assert any("sensor 3 reads 17" in warning for warning in said["dead"]["warnings"])
    assert "other way round" in said["mirrored"]["warnings"][0]
    assert "columns swapped" in said["swapped"]["warnings"][0]
