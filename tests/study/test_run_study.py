"""What a study does and gives back, and how it is opened again."""

from __future__ import annotations

import math
import os
import pickle
import shutil
import time
from dataclasses import replace

import numpy as np
import pytest

from realitygap.control.genotype import Genotype
from realitygap.errors import ConfigError, StudyError, StudyInterruptedError, TaskError
from realitygap.kernels.rng import substream
from realitygap.simulation.simulation import Simulation
from realitygap.streams import TRIALS
from realitygap.study import batched
from realitygap.study.config import Condition
from realitygap.study.folder import gather
from realitygap.study.jobs import Advanced, Job, StudyExecutor
from realitygap.study.load import load_study
from realitygap.study.plan import plans
from realitygap.study.run import ConditionRunner, advance, begin
from realitygap.study.runner import run_study
from realitygap.work.pool import Here
from tests.study.helpers import content, small


def test_every_evaluation_is_kept(finished):
    """The table holds each evaluation once, in order; fitness is the mean of the trials' scores."""
    table = finished.evaluations()
    assert table["run"].tolist() == [1] * 90 + [2] * 90
    assert table["number"].tolist() == list(range(90)) * 2
    assert np.allclose(table["fitness"], (table["score_1"] + table["score_2"]) / 2, rtol=1e-15)
    assert ((table["parent_a"] < table["number"]) & (table["parent_b"] < table["number"])).all()
    assert set(table["cell"].tolist()) <= set(range(64))
    assert {key: column[90:].tolist() for key, column in table.items()} == {
        key: column.tolist() for key, column in finished.evaluations(2).items()
    }


def test_a_stored_individual_lives_again(finished):
    """An evaluation's scores come out again, bit for bit, from its genotype and its streams' names."""
    run = finished.runs[1]
    task, table = finished.task(run.task), finished.evaluations(run.id)
    simulation = Simulation(task, finished.profile, run.noise)
    for number in (0, 63, 89):
        stream = substream(np.uint64(substream(run.stream, TRIALS)), number)
        streams = np.array([[substream(np.uint64(stream), t) for t in range(2)]], np.uint64)
        network = finished.networks(run.task, finished.genotype(run.id, number))
        assert simulation.scores(network, streams)[0].tolist() == [
            table["score_1"][number],
            table["score_2"][number],
        ]


def test_the_fittest_and_the_champion(finished):
    """Fittest: the highest fitness stored. Champion: the best mean in the retest, of the last population."""
    for run in finished.runs:
        table, retest = finished.evaluations(run.id), finished.retests(run.id)
        assert run.finished and run.evaluations == 90 and run.seed == 7
        assert run.best_fitness == table["fitness"].max() == table["fitness"][run.fittest_number]
        assert (run.fittest == finished.genotypes(run.id)[run.fittest_number]).all()
        means = {n: retest["score"][retest["number"] == n].mean() for n in set(retest["number"].tolist())}
        assert math.isclose(run.champion_fitness, max(means.values()))
        assert math.isclose(means[run.champion_number], max(means.values()))
        assert any((run.champion == genes).all() for genes in run.population)
        assert (Genotype(run.champion, 8).genes == run.champion).all()
        pairs = {(who, noise) for who in ("fittest", "champion") for noise in (0.0, 1.0, 2.0)}
        assert set(run.tests) == pairs and all(scores.shape == (3,) for scores in run.tests.values())


def test_how_a_run_is_cut_changes_no_bit():
    """advance by 40 is advance by 1, 7 and 32."""
    materials = gather(small())
    runner, plan = ConditionRunner(materials, 0), plans(materials)[0]

    def answered(state, n):
        asking, scores = advance(runner, plan, state, n), None
        while True:
            try:
                scores = runner.scores(asking.send(scores))
            except StopIteration as end:
                return end.value

    whole, records = answered(begin(runner, plan), 40)
    state, pieces = begin(runner, plan), []
    for n in (1, 7, 32):
        state, piece = answered(state, n)
        pieces.append(piece)
    assert state.to_bytes() == whole.to_bytes()
    for whole_column, columns in zip(records, zip(*pieces, strict=True), strict=True):
        assert (np.concatenate(columns) == whole_column).all()


def test_runs_side_by_side_are_those_one_by_one(monkeypatch):
    """Whatever is asked for at a time is scored as if it were alone: as those go that are no arrays."""
    monkeypatch.setattr(batched, "supports", lambda runner: False)
    config, alone = small(runs=3, evaluations=70), []
    jobs = [Job(plan.id, None) for plan in plans(gather(config))]
    together = [message for some in StudyExecutor(gather(config)).messages(jobs) for message in some]
    for job in jobs:
        StudyExecutor(gather(config)).carry_out(job, alone.append)
    assert len(together) == len(alone) == 6 * 5
    assert [m.run for m in together if m.run < 4][:6] == [1, 2, 3, 1, 2, 3]
    for job in jobs:
        one, other = ([m for m in every if m.run == job.run] for every in (together, alone))
        assert pickle.dumps(one) == pickle.dumps(other)


def test_the_number_of_workers_and_of_checkpoints_changes_no_bit(finished, folder):
    """Two processes and other checkpoints give the same tables as one process."""
    study = run_study(folder, small(checkpoint_every=33), workers=2)
    assert content(folder) == content(finished.folder)
    assert [run.name for run in study.runs] == [run.name for run in finished.runs]


def test_a_run_is_the_same_in_another_study(finished, folder):
    """A run does not depend on which other conditions are in its study."""
    config = replace(small(), conditions=(Condition(task="light", noise=2.0),))
    alone = run_study(folder, config, workers=1).evaluations()
    again = finished.evaluations(2)
    assert all((alone[key] == again[key]).all() for key in alone if key != "run")


def test_an_existing_study_is_not_touched_unasked(finished):
    """Without resume a folder that holds a study is refused, with the cure."""
    with pytest.raises(StudyError, match=r"already holds a study. Resume it \(--resume\)"):
        run_study(finished.folder, small())


def test_another_configuration_is_refused_by_its_first_key(finished, tmp_path):
    """Resuming with another configuration names the first key, or the file, that differs."""
    with pytest.raises(StudyError, match="made with evaluations = 90, not 91"):
        run_study(finished.folder, small(evaluations=91), resume=True)
    robot = tmp_path / "robot.toml"
    text = (finished.folder / "profile.toml").read_text()
    robot.write_text(text.replace("radius_cm = 2.9", "radius_cm = 2.8"))
    with pytest.raises(StudyError, match=r"keeps a different profile.toml"):
        run_study(finished.folder, small(profile=str(robot)), resume=True)


def test_a_wrong_configuration_makes_no_folder(folder):
    """What is wrong is told before anything is written."""
    with pytest.raises(TaskError, match="unknown task"):
        run_study(folder, small(conditions=(Condition(task="avoidence!"),)))
    with pytest.raises(ConfigError, match="workers"):
        run_study(folder, small(), workers=0)
    assert not folder.exists()


def test_a_study_that_was_killed_while_it_was_made_is_made_anew(finished, folder):
    """Everything but the database was written: resuming makes the study, and sweeps what was half written."""
    shutil.copytree(finished.folder, folder, ignore=shutil.ignore_patterns("study.db*"))
    half, writing = folder / ".part-1-study.db", folder / ".part-2-index.html"
    for part, age_s in ((half, 7200.0), (writing, 0.0)):
        part.write_bytes(b"half")
        os.utime(part, (0.0, time.time() - age_s))
    assert run_study(folder, small(), workers=1, resume=True).runs[0].finished
    assert not half.exists() and writing.exists()
    assert content(folder) == content(finished.folder)


def test_a_moved_study_goes_on(finished, folder):
    """A study is self-contained: a copy elsewhere, cut back to the middle, resumes to the same bits."""
    config = small()
    executor = StudyExecutor(gather(config))
    from realitygap.study.folder import open_folder
    from realitygap.study.store import Store

    folder.mkdir()
    open_folder(folder, gather(config), resume=False)
    with Store(folder / "study.db") as store:
        messages: list = []
        executor.carry_out(Job(2, None), messages.append)
        assert all(isinstance(message, Advanced) for message in messages[:2])
        store.keep(messages[:2])
    half = load_study(folder)
    assert [run.evaluations for run in half.runs] == [0, 40]
    assert half.runs[0].fittest is None and half.runs[1].champion is None and not half.runs[1].tests
    assert (half.runs[1].fittest == half.genotype(2, half.runs[1].fittest_number)).all()
    moved = folder.rename(folder.with_name("moved"))
    run_study(moved, resume=True, workers=1)
    assert content(moved) == content(finished.folder)


def test_ctrl_c_keeps_what_was_saved(finished, folder):
    """Ctrl-C in this process ends in one message, is a KeyboardInterrupt too, and loses nothing saved."""

    def press(event):
        if event.done >= 20:
            raise KeyboardInterrupt

    with pytest.raises(StudyInterruptedError, match="is kept: resume it") as stopped:
        run_study(folder, small(), workers=1, on_progress=press)
    assert isinstance(stopped.value, KeyboardInterrupt) and stopped.value.exit_code == 130
    assert sum(run.evaluations for run in load_study(folder).runs) >= 20
    run_study(folder, resume=True, workers=1)
    assert content(folder) == content(finished.folder)


class Faulty(Here):
    """A pool that passes on other messages than it was sent."""

    def __init__(self, passed):
        self.passed = passed

    def work(self, setup, jobs, tell):
        """All of them, when the work is done."""
        sent = []
        super().work(setup, jobs, sent.append)
        for k in self.passed:
            tell(sent[k])


@pytest.mark.parametrize("passed", [(0, 2, 3), (0, 1, 2), (0, 1, 3), (0, 0, 1, 2, 3), (0, 1, 2, 3, 3)])
def test_a_pool_that_loses_or_doubles_messages_is_found_out(folder, passed):
    """No study has a gap, none looks finished that is not; what came in turn is kept."""
    few = small(evaluations=30, checkpoint_every=10, conditions=(Condition(task="avoidance", noise=1.0),))
    with pytest.raises(StudyError, match="workers: expected each message of a job once"):
        run_study(folder, few, workers=Faulty(passed))
    study = run_study(folder, resume=True, workers=1)
    assert study.runs[0].finished and study.evaluations()["number"].tolist() == list(range(30))
