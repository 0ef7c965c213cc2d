"""Runs side by side, as arrays: the bits of each by itself, wherever they were begun and stopped."""

from __future__ import annotations

import threading

import pytest

from realitygap.errors import StudyInterruptedError
from realitygap.simulation import simulation
from realitygap.study import jobs
from realitygap.study.folder import gather, open_folder
from realitygap.study.jobs import Advanced, Job, StudyExecutor
from realitygap.study.run import ConditionRunner
from realitygap.study.runner import run_study
from realitygap.study.store import DATABASE, Store
from realitygap.work import progress
from tests.study.helpers import content, small


def of_each(messages) -> dict[int, list]:
    """The messages of each run, as plain values."""
    found: dict[int, list] = {}
    for message in messages:
        parts = message.records if isinstance(message, Advanced) else message.results
        plain = [(a.dtype, a.tolist()) if hasattr(a, "dtype") else repr(a) for a in parts]
        rest = message[2:] if isinstance(message, Advanced) else ()
        found.setdefault(message.run, []).append((type(message), plain, *rest))
    return found


@pytest.mark.parametrize("algorithm", ["torus", "panmictic", "random"])
def test_a_run_has_the_same_bits_in_a_batch(algorithm):
    """Every message of six runs at tasks of three trials. One goes on from a checkpoint; of one, only its
    tests are left."""
    changes = [f'evolution.algorithm="{algorithm}"', "task.trials=3", "encoding.slots=20"]
    executor = StudyExecutor(gather(small(runs=3).with_settings(changes)))
    alone: list = []
    for run in executor.runs:
        executor.carry_out(Job(run, None), alone.append)
    states = {run: [m.state for m in alone if m.run == run and isinstance(m, Advanced)] for run in (2, 3)}
    jobs = [Job(run, {2: states[2][1], 3: states[3][-1]}.get(run)) for run in executor.runs]
    told = of_each(message for some in executor.messages(jobs) for message in some)
    expected = of_each(alone)
    expected[2], expected[3] = expected[2][2:], expected[3][-1:]
    assert told == expected
    assert [len(told[run]) for run in (1, 2, 3)] == [6, 4, 1]


def test_interrupted_side_by_side_it_goes_on(tmp_path, monkeypatch):
    """By Ctrl-C here, and by an error in a condition's thread: what was kept goes on to the study of the
    cores, and no thread is left."""
    run_study(tmp_path / "cores", small(runs=2), workers=1)
    monkeypatch.setattr(simulation, "engine_named", lambda name: None)
    monkeypatch.setattr(jobs, "MOST", 2)
    monkeypatch.setattr(progress, "EVERY_S", 0.0)
    before = threading.active_count()

    def stop(event):
        if event.done > 60:
            raise KeyboardInterrupt

    with pytest.raises(StudyInterruptedError):
        run_study(tmp_path / "cuda", small(runs=2), engine="cuda", on_progress=stop)
    with monkeypatch.context() as patched, pytest.raises(MemoryError):
        patched.setattr(ConditionRunner, "scores", lambda runner, asked: (_ for _ in ()).throw(MemoryError))
        run_study(tmp_path / "cuda", engine="cuda", resume=True)
    assert threading.active_count() == before
    study = run_study(tmp_path / "cuda", engine="cuda", resume=True)
    assert content(tmp_path / "cuda") == content(tmp_path / "cores")
    assert len(study.versions()["engine"]) == 1


def test_what_comes_at_once_is_kept_at_once(tmp_path):
    """A run's last evaluations and its tests, in any order of runs; all of it or nothing."""
    materials = gather(small())
    executor = StudyExecutor(open_folder(tmp_path, materials, resume=False))
    messages: list = []
    for run in executor.runs:
        executor.carry_out(Job(run, None), messages.append)
    with Store(tmp_path / DATABASE) as store:
        wrong = messages[-1].results._replace(fresh={})._replace(retest=None)
        with pytest.raises(TypeError):
            store.keep([*messages[:-1], messages[-1]._replace(results=wrong)])
        assert store.unfinished() == [(1, 0), (2, 0)]
        store.keep(messages)
        assert store.unfinished() == []
    run_study(tmp_path / "cores", small(), workers=1)
    assert content(tmp_path) == content(tmp_path / "cores")
