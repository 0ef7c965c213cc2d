"""`--shard`, `merge` and `slurm` as they are typed."""

import os
import subprocess

import pytest

WORDS = (
    "evolve", "light", "--noise", "double", "--seed", "7", "--runs", "2", "--evaluations", "70",
    "--set", "retest_trials=2", "--set", "fresh_trials=3", "--set", "task.seconds=2",
)  # fmt: skip


def test_an_array_job_is_the_study(call, json_of, refused, monkeypatch, tmp_path):
    """What `slurm` prints does its shard, and goes on; all shards merged are the study of one process."""
    monkeypatch.chdir(tmp_path)
    script = call("slurm", "--shards", 2, "--cores", 1, *WORDS, "--out", "many").stdout
    assert "#SBATCH --array=1-2\n" in script and "realitygap merge many-shard-*-of-2" in script
    (tmp_path / "job.sh").write_text(script)
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
    assert "many exists already" in refused("merge", "many-shard-1-of-2", "many-shard-2-of-2")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("evolve", "light", "--shard", "4/3"), "--shard': expected I/N, share I (from 1 to N) of N"),
        (("slurm", "--shards", "2", "show", "x"), "expected a command that can be sharded (evolve"),
        (("slurm", "--shards", "2", "evolve", "light", "--runs", "0"), "'--runs': expected 1 or more"),
        (("slurm", "--shards", "2", "evolve", "light", "--workers", "2"), "--workers: the script sets it"),
        (("slurm", "--shards", "2", "evolve", "light", "--noise", "loud"), "'--noise'"),
    ],
)
def test_what_cannot_be_done_in_shards_is_refused(refused, words, said):
    """Before any job is queued."""
    assert said in refused(*words)
