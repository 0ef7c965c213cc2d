"""`realitygap camera track` and `realitygap camera calibrate`, as a person types them."""

import json

import pytest
from click.testing import CliRunner

from realitygap.cli.console import Commands
from realitygap.cli.tracks import camera
from realitygap.film.camera import load_camera
from realitygap.track import read_track
from tests.film.test_camera import write_frames


def run(*words):
    """A command's result."""
    group = Commands(name="realitygap", commands={"camera": camera})
    return CliRunner().invoke(group, [str(word) for word in words])


@pytest.fixture
def camera_file(camera, tmp_path):
    """The camera as a file."""
    camera.save(tmp_path / "camera.json")
    return tmp_path / "camera.json"


def test_calibrate(tmp_path, frames):
    """Calibrating prints a line for each frame and writes a camera that can be read."""
    write_frames(tmp_path, frames[:8])
    words = ("--frames", tmp_path, "--poses", tmp_path / "poses.csv", "--out", tmp_path / "camera.json")
    result = run("camera", "calibrate", *words)
    assert result.exit_code == 0, result.output
    assert "f00.png" in result.stdout
    assert "8 of 8 frames used" in result.stdout
    facts = json.loads(run("camera", "calibrate", *words, "--json").stdout)
    assert len(facts["residuals"]) == 8
    assert load_camera(tmp_path / "camera.json").width_px == 640


def test_track(tmp_path, clean_film, camera_file):
    """Tracking writes the track and the tails, and says what was found."""
    out, tails = tmp_path / "track.csv", tmp_path / "tails.png"
    result = run("camera", "track", clean_film, "--camera", camera_file, "--out", out, "--tails", tails)
    assert result.exit_code == 0, result.output
    assert "found in 40" in result.stdout
    assert len(read_track(out)) == 40
    assert tails.stat().st_size > 10_000
    facts = json.loads(
        run("camera", "track", clean_film, "--camera", camera_file, "--out", out, "--json").stdout
    )
    assert facts["lost"] == 0
    assert len(facts["x_cm"]) == 40
