"""`--shard`, `merge` and the docs' array job as they are typed."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from realitygap.cli.notes import note_versions

PAGE = Path(__file__).resolve().parents[2] / "docs" / "machines.md"
WORDS = (
    "evolve", "light", "--noise", "double", "--seed", "7", "--runs", "2", "--evaluations", "70",
    "--set", "retest_trials=2", "--set", "fresh_trials=3", "--set", "task.seconds=2",
)  # fmt: skip


def _stopped(*_, **__):
    raise KeyboardInterrupt


def _job(words: tuple[str, ...], shards: int) -> str:
    """The Slurm template of the docs, with another command and size."""
    script = re.search(r"```sh\n(#!/bin/bash.*?)```", PAGE.read_text("utf-8"), re.S)[1]
    shown, size = re.search(r"^(realitygap .*) --shard \$SLURM_ARRAY_TASK_ID/(\d+)", script, re.M).groups()
    assert f"#SBATCH --array=1-{size}\n" in script
    command = shlex.join([sys.executable, "-m", "realitygap", *words])
    return script.replace(shown, command).replace(f"ID/{size}", f"ID/{shards}")


@pytest.mark.usefixtures("undrawn")
def test_an_array_job_is_the_study(call, json_of, refused, monkeypatch, tmp_path):
    """The docs' array job does its shard, and goes on; all shards merged are the study of one process."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "job.sh").write_text(_job((*WORDS, "--out", "many"), 2))
    for _ in range(2):  # once more, as after a requeue
        told = subprocess.run(
            ["bash", "job.sh"], env={**os.environ, "SLURM_ARRAY_TASK_ID": "1"}, capture_output=True, text=True
        )
        assert told.returncode == 0, told.stderr
        assert (
            "shard 1/2 in many-shard-1-of-2\nwhen all are done: realitygap merge many-shard-*-of-2"
            in told.stdout
        )
    assert "missing: shard 2/2" in refused("merge", "many-shard-1-of-2")
    second = json_of(*WORDS, "--out", "many", "--shard", "2/2", "--workers", "1")
    assert (second["study"], second["shard"]) == ("many-shard-2-of-2", "2/2")
    assert [run["run"] for run in second["runs"]] == [2]
    merged = json_of("merge", "many-shard-1-of-2", "many-shard-2-of-2", "--workers", "1")
    assert merged["study"] == "many" and (tmp_path / merged["report"]).is_file()
    alone = json_of(*WORDS, "--out", "alone", "--workers", "1")
    assert merged["runs"] == alone["runs"] and merged["tables"] == alone["tables"]
    said = refused("merge", "many-shard-1-of-2", "many-shard-2-of-2")
    assert "many exists already" in said and "`realitygap report many` makes that" in said
    (tmp_path / "many-shard-2-of-2" / "transfer").mkdir()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("realitygap.transfer.scores.marks_of", _stopped)
        told = call("merge", "many-shard-1-of-2", "many-shard-2-of-2", "--out", "again")
    assert told.exit_code == 130 and "in again; resume with `realitygap report again`" in told.stderr
    assert "warning: many-shard-2-of-2: its transfers stay there" in told.stderr


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ("evolve", "light", "--shard", "2/3", "--out", "a-shard-1-of-3"),
            "or shard 2/3's, got another's",
        ),
        (("evolve", "light", "--shard", "4/3"), "--shard': expected I/N, share I (from 1 to N) of N"),
    ],
)
def test_what_cannot_be_done_in_shards_is_refused(refused, words, said):
    """Before any job is queued."""
    assert said in refused(*words)


def test_shards_of_different_machines_are_told(capsys):
    """By what differs, each version once; the system's name tells nothing about bits."""
    note_versions([{"numpy": ["2.1"], "platform": ["a"]}, {"numpy": ["2.1", "2.2"], "platform": ["b"]}])
    assert capsys.readouterr().err == "note: the shards were made with different numpy: 2.1, 2.2\n"
