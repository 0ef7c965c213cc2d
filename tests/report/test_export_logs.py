"""A transferred trial as a log, read back with the libraries that such logs are for."""

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from realitygap import load_transfers
from realitygap.cli import realitygap
from realitygap.errors import StudyError
from realitygap.export import trial_log, write_log

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture(scope="module")
def one(played):
    """The first trial of the first run."""
    return trial_log(played.run(1), robot="twin-1", start=2)


def test_a_trial_is_what_is_on_file(one, played):
    """Both tracks; of both robots readings, inputs, commands and, since it is known who drove, outputs."""
    there = next(t for t in load_transfers(played.folder) if (t.run, t.start) == (1, 2))
    for side, track in zip(one.sides, (there.simulated, there.situated), strict=True):
        assert np.allclose(side.track.x, track.x, atol=1e-5) and len(side.track) == 21
        assert {"proximity", "inputs", "commands", "outputs"} <= side.inside.keys()
        assert side.rays.shape == (21, 80, 2, 2)
    assert one.film is None and one.name == "obstacle-avoidance-zero-1-twin-1-start-2"


def test_rerun_reads_it(one, tmp_path):
    """Every entity under one time line, number by number."""
    pytest.importorskip("rerun", reason="no Rerun here: pip install rerun-sdk")
    from rerun.chunk import RrdReader

    path = write_log(one, "rerun", str(tmp_path))
    found = {}
    for chunk in RrdReader(path).stream():
        if not chunk.is_static and "trial" in chunk.timeline_names:
            found.setdefault(chunk.entity_path, chunk.to_record_batch())
    parts = {"pose", "body", "rays", "inputs", "commands", "outputs", "proximity", "network"}
    assert {f"/{side.name}/{part}" for side in one.sides for part in parts} <= found.keys()
    for side in one.sides:
        rows = found[f"/{side.name}/pose"]
        poses = np.array(rows["Scalars:scalars"].to_pylist(), float)
        assert np.array_equal(poses[:, 0], side.track.x, equal_nan=True)
        assert np.allclose(rows["trial"].cast("int64").to_numpy(False) * 1e-9, side.track.t)
        read = np.array(found[f"/{side.name}/commands"]["Scalars:scalars"].to_pylist())
        assert np.array_equal(read, side.inside["commands"])
        rays = np.array(found[f"/{side.name}/rays"]["LineStrips3D:strips"].to_pylist(), float)
        assert np.allclose(rays[..., :2], side.rays[side.track.found], atol=1e-4)


def test_mcap_reads_it(one, tmp_path):
    """Every message in order of time, number by number; scenes in metres."""
    pytest.importorskip("mcap", reason="no MCAP here: pip install mcap")
    from mcap.reader import make_reader

    path = write_log(one, "mcap", tmp_path)
    read = {}
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            read.setdefault(channel.topic, []).append(
                (message.log_time, schema.name, json.loads(message.data))
            )
    with path.open("rb") as file:
        about = {entry.name: entry.metadata for entry in make_reader(file).iter_metadata()}
    assert about["trial"]["robot"] == "twin-1" and json.loads(about["network"]["json"])["neurons"]
    for side in one.sides:
        steps = read[f"/{side.name}/step"]
        assert [time for time, _, _ in steps] == [round(t * 1e9) for t in side.track.t]
        assert [step["x_cm"] for _, _, step in steps] == pytest.approx(side.track.x.tolist(), nan_ok=True)
        assert [step["inputs"] for _, _, step in steps[:-1]] == side.inside["inputs"].tolist()
        _, kind, scene = read[f"/{side.name}/scene"][3]
        body, _, *rays = (
            np.array([[p["x"], p["y"]] for p in line["points"]]) for line in scene["entities"][0]["lines"]
        )
        assert kind == "foxglove.SceneUpdate" and len(rays) == 80
        assert np.allclose(body[:-1].mean(0) * 100, (side.track.x[3], side.track.y[3]), atol=0.01)


def test_the_command_writes_it_and_says_what_there_is(played, tmp_path):
    """The first trial if nothing is said; of a trial that is none, those that there are."""
    pytest.importorskip("mcap", reason="no MCAP here: pip install mcap")
    words = ["export", "log", str(played.folder), "1", "--format", "mcap", "--out", str(tmp_path / "logs")]
    said = CliRunner().invoke(realitygap, words).stdout
    assert "logs/obstacle-avoidance-zero-1-twin-1-start-1.mcap: " in said
    refused = CliRunner().invoke(realitygap, [*words, "--start", "9"])
    assert refused.exit_code == 2 and "champion on twin-1 from start 2" in refused.output
    with pytest.raises(StudyError, match=r"there are: none\. Make one with `realitygap transfer`"):
        trial_log(played.run(3))
