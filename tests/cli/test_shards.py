"""`--shard`, `merge` and `slurm` as they are typed."""

import json
import os
import shlex
import subprocess
import sys

import pytest

from realitygap.cli.estimate import note_versions

WORDS = (
    "evolve", "light", "--noise", "double", "--seed", "7", "--runs", "2", "--evaluations", "70",
    "--set", "retest_trials=2", "--set", "fresh_trials=3", "--set", "task.seconds=2",
)  # fmt: skip


def _stopped(*_, **__):
    raise KeyboardInterrupt


@pytest.mark.usefixtures("undrawn")
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
    said = refused("merge", "many-shard-1-of-2", "many-shard-2-of-2")
    assert "many exists already" in said and "`realitygap report many` makes that" in said
    (tmp_path / "many-shard-2-of-2" / "transfer").mkdir()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("realitygap.transfer.score_rows.marks_of", _stopped)
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
        (("slurm", "--shards", "2", "show", "x"), "expected a command that can be sharded (evolve"),
        (("slurm", "--shards", "2", "evolve", "light", "--runs", "0"), "'--runs': expected 1 or more"),
        (("slurm", "--shards", "2", "evolve", "light", "--workers", "2"), "--workers: the script sets it"),
        (("slurm", "--shards", "2", "evolve", "light", "--noise", "loud"), "'--noise'"),
        (("slurm", "--shards", "2", "evolve", "light", "--out", "a\nb"), "expected words of one line"),
        (("slurm", "--shards", "2", "evolve", "light", "--watch"), "--watch: expected none with shards"),
        (
            (
                "slurm",
                "--shards",
                "2",
                "transfer",
                "out/x",
                "--robot",
                "twin:1",
                "--controller",
                "constant:5,5",
            ),
            "--controller: expected none with shards",
        ),
        (
            ("slurm", "--shards", "2", "experiment", "measure-or-randomise"),
            "(evolve, transfer, experiment noise), got 'experiment measure-or-randomise'",
        ),
        (("slurm", "--shards", "2", "experiment"), "(evolve, transfer, experiment noise), got 'experiment'"),
    ],
)
def test_what_cannot_be_done_in_shards_is_refused(refused, words, said):
    """Before any job is queued."""
    assert said in refused(*words)


@pytest.mark.parametrize(
    ("words", "merged"),
    [
        (("evolve", "--runs", "4", "light"), "out/light-seeking-shard-*-of-2"),
        (("evolve", "light", "--out", "a b's/many/"), "'a b'\"'\"'s/many'-shard-*-of-2"),
        (("transfer", "out/many/", "--robot", "twin:1"), "out/many-transfer-shard-*-of-2"),
        (("experiment", "noise"), "out/noise-shard-*-of-2"),
    ],
)
def test_a_script_names_the_folders_of_its_shards(call, monkeypatch, tmp_path, words, merged):
    """Wherever the task stands, and however the folder is typed; from a folder that a shell has to quote."""
    here = tmp_path / "it's here"
    here.mkdir()
    monkeypatch.chdir(here)
    told = json.loads(call("slurm", "--json", "--shards", 2, "--cores", 3, "--hours", 5, *words).stdout)
    assert told["merge"] == f"realitygap merge {merged}"
    line = next(line for line in told["script"].splitlines() if "--dependency" in line).removeprefix("# ")
    sbatch = shlex.split(line)
    assert sbatch[1:-2] == ["--dependency=afterok:$jobs", "--cpus-per-task=3", "--time=5:00:00"]
    there, command = sbatch[-1].split(" && ")
    assert shlex.split(there) == ["cd", str(here)]
    assert command == f"{shlex.quote(sys.executable)} -m {told['merge']}"


def test_shards_of_different_machines_are_told(capsys):
    """By what differs, each version once; the system's name tells nothing about bits."""
    note_versions([{"numpy": ["2.1"], "platform": ["a"]}, {"numpy": ["2.1", "2.2"], "platform": ["b"]}])
    assert capsys.readouterr().err == "note: the shards were made with different numpy: 2.1, 2.2\n"
