"""The GPU's engine: on a GPU where there is one, else simulated; and its compilation, which needs none.

Without a GPU this file runs itself again with NUMBA_ENABLE_CUDASIM=1. There the launches are simulated, and
the steps are the processor's: so all agrees to the bit.
"""

from __future__ import annotations

import importlib.util
import os
import re
import subprocess
import sys
from dataclasses import replace
from textwrap import dedent
from threading import Thread
from types import SimpleNamespace
from typing import Any

import numba
import numpy as np
import pytest
from benchmarks.steps import random_networks
from scipy.stats import ks_2samp

from realitygap.control.genotype import Genotype
from realitygap.errors import TaskError, UsageError
from realitygap.kernels.trial import NO_NETWORK, NO_RECORD, new_scratch
from realitygap.simulation.simulation import Simulation, batch_streams
from realitygap.study.runner import run_study
from realitygap.tasks import load_task
from realitygap.testing import EngineContract
from realitygap.world.robot import load_profile
from realitygap.world.sensors import LookUp
from tests.study.helpers import content, small

if importlib.util.find_spec("numba_cuda") is None:
    pytest.skip('no numba-cuda here: pip install "realitygap[cuda]"', allow_module_level=True)

from numba import cuda

from realitygap.simulation import cuda as engine

HERE = pytest.mark.skipif(not cuda.is_available(), reason="no NVIDIA GPU here")
PAPER = load_profile("paper")
CURVE = ((-9.0, -6.0), (-2.5, 0.0), (2.0, 0.0), (7.0, 5.0), (8.0, 5.0))
CURVED = replace(PAPER, wheels=replace(PAPER.wheels, curve_left=CURVE, curve_right=CURVE[1:]))
OLDEST = (7, 5)
"""Compute capability that is compiled for where there is no GPU."""
NEVER = 1e-6
"""How often a right law may fail its test."""
OWN = """
    import numpy as np
    from realitygap import Start, Task, load_arena

    def score(path, room):
        return float(np.median(path.x) + path.x[-1])

    task = Task(name="mine", arena=load_arena("obstacle-avoidance"), feeds="proximity", score=score,
                start=Start(x_cm=25, y_cm=25, radius_cm=3), seconds=2, trials=2)
"""


@pytest.fixture(autouse=engine.SIMULATED)
def patient_simulator(monkeypatch):
    """The simulator waits for its threads. Left alone it polls each of them in a busy loop."""
    from numba.cuda.simulator.kernel import BlockThread

    monkeypatch.setattr(BlockThread, "is_alive", lambda thread: thread.join(0.1) or Thread.is_alive(thread))


@HERE
class TestCuda(EngineContract):
    exact = engine.SIMULATED

    def made(self, task, profile, noise):
        return Simulation(task, profile, noise, engine="cuda")


def scores(engine, profile, seed: int, trials: int, name: str = "obstacle-avoidance") -> np.ndarray:
    """Of a Braitenberg vehicle at a task."""
    nets = Genotype.braitenberg(load_task(name).feeds).networks()
    return Simulation(name, profile, engine=engine).scores(nets, batch_streams(seed, trials)[np.newaxis])[0]


@HERE
def test_constants_drawn_for_each_trial_are_refused():
    """All trials of a launch share one robot: said before anything is begun."""
    with pytest.raises(UsageError, match=r"engine cuda: expected a task without a spread.* with spread 0.1"):
        Simulation(load_task("avoidance").under(0.1), PAPER, engine="cuda")


@HERE
def test_a_look_up_table_is_refused():
    """Nobody has tried one on a GPU: said before anything is begun."""
    rows = ((0.0,) * 4,) * 8
    table = LookUp(nothing=(0.0,) * 8, wall_cm=(1.0, 2.0), wall=rows, cylinder_cm=(1.0, 2.0), cylinder=rows)
    profile = replace(PAPER, infrared=replace(PAPER.infrared, table=table))
    with pytest.raises(UsageError, match=r"engine cuda: expected a profile without a look-up table"):
        Simulation("avoidance", profile, engine="cuda")


@HERE
@pytest.mark.parametrize("name", EngineContract.tasks)
def test_scores_are_distributed_as_the_processors(name):
    """Trials on other streams: the same law; wheels a twentieth (a quarter) farther apart are found out."""
    trials, share = (10_000, 1.05)
    if engine.SIMULATED:  # where obstacles are met, far fewer tell
        trials, share = (150 if name == "obstacle-avoidance" else 1000, 1.25)
    wrong = replace(PAPER, wheels=replace(PAPER.wheels, track_cm=share * PAPER.wheels.track_cm))
    expected = scores("cores", PAPER, 1, trials, name)
    assert ks_2samp(scores("cuda", PAPER, 2, trials, name), expected).pvalue > NEVER
    assert ks_2samp(scores("cuda", wrong, 2, trials, name), expected).pvalue < NEVER


@HERE
@pytest.mark.parametrize(
    ("name", "profile"),
    [*((name, "paper") for name in EngineContract.tasks), ("avoidance", "thymio"), ("avoidance", "curved")],
)
def test_tracks_begin_as_the_processors(name, profile):
    """Ten steps of 40 trials of 20 networks, to 1e-6 cm: later a last bit may be decisive.

    One robot's noise follows tables, which scale it in place; one's wheels settle by curves.
    """
    robot = CURVED if profile == "curved" else load_profile(profile)
    task = load_task(name)
    if profile == "thymio":  # which is too large for the paper's arena
        task = replace(task, arena=replace(task.arena, cylinders=()), sensors=())
    task = task.of(robot)
    assert (robot.to_kernel().proximity.noise.shape[1] > 0) is (profile == "thymio")
    nets, streams = random_networks(Simulation(task, robot), stream=5, count=20), batch_streams(6, 40)
    ways = (
        Simulation(task, robot, engine=name).tracks(nets, streams.reshape(20, 2))
        for name in ("cuda", "cores")
    )
    for found, expected in zip(*ways, strict=True):
        assert np.allclose(found[..., :10], expected[..., :10], rtol=0, atol=0 if engine.SIMULATED else 1e-6)


@HERE
def test_a_large_batch_is_carried_out_in_parts(monkeypatch):
    """Where memory is short: the same scores, and the tracks that they are of."""
    whole = scores("cuda", PAPER, 3, 70)
    monkeypatch.setattr(engine, "MOST_BYTES", 0)  # a warp at a time
    assert np.array_equal(scores("cuda", PAPER, 3, 70), whole)


@HERE
@pytest.mark.skipif(not engine.SIMULATED, reason="on a GPU other scores may lead elsewhere")
def test_runs_side_by_side_are_the_study_of_the_cores(tmp_path):
    """Every table, genotype and checkpoint of six runs, one of which goes on from a checkpoint."""
    asked = small(runs=3)
    run_study(tmp_path / "cores", asked, workers=1)
    study = run_study(tmp_path / "cuda", asked, workers=1, engine="cuda")
    assert content(tmp_path / "cuda") == content(tmp_path / "cores")
    assert study.versions()["engine"] == ["cuda"]


@HERE
def test_a_users_score_is_taken_by_the_processor(tmp_path):
    """It may use what a GPU has not, and its indices are checked."""
    text = dedent(OWN)
    (tmp_path / "mine.py").write_text(text, "utf-8")
    (tmp_path / "wrong.py").write_text(text.replace("path.x[-1]", "path.x[path.x.size]"), "utf-8")
    robot = load_profile("paper")
    mine, wrong = (load_task(tmp_path / f"{name}.py").of(robot) for name in ("mine", "wrong"))
    nets = Genotype.braitenberg(mine.feeds).networks()
    streams = batch_streams(4, 6)[np.newaxis]
    found = Simulation(mine, robot, engine="cuda").scores(nets, streams)
    assert np.allclose(found, Simulation(mine, robot, 1.0).scores(nets, streams), rtol=1e-6)
    with pytest.raises(TaskError, match=r"wrong\.py, line \d+: the score fails with IndexError"):
        Simulation(wrong, robot, engine="cuda").scores(nets, streams)


def test_without_a_gpu_one_message_says_the_cure(monkeypatch, tmp_path):
    """And nothing is begun."""
    monkeypatch.setattr(cuda, "is_available", lambda: False)
    monkeypatch.setattr(cuda, "cuda_error", lambda: "no driver", raising=False)
    with pytest.raises(UsageError, match=r"engine cuda: expected an NVIDIA GPU.*Leave out --engine"):
        Simulation("obstacle-avoidance", PAPER, engine="cuda")
    with pytest.raises(UsageError, match="engine cuda: expected an NVIDIA GPU"):
        run_study(tmp_path / "study", small(), engine="cuda")
    assert not list(tmp_path.iterdir())
    monkeypatch.setattr(cuda, "cuda_error", lambda: None, raising=False)
    with pytest.raises(UsageError, match=r"expected NVIDIA's compiler NVVM.*pip install"):
        Simulation("obstacle-avoidance", PAPER, engine="cuda")


@pytest.mark.skipif(cuda.is_available(), reason="there is a GPU, or it is simulated")
def test_all_of_it_holds_in_the_simulator():
    """This file again, with simulated launches."""
    words = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", __file__]
    done = subprocess.run(
        words, env={**os.environ, "NUMBA_ENABLE_CUDASIM": "1"}, capture_output=True, text=True
    )
    assert done.returncode == 0 and re.search(r"\d\d passed", done.stdout), done.stdout[-3000:]


@pytest.fixture
def compiler(monkeypatch):
    """numba-cuda's compiler for the oldest GPU, whatever is here."""
    if engine.SIMULATED:
        pytest.skip("the simulator does not compile")
    if np.lib.NumpyVersion(np.__version__) >= engine.TOO_NEW:
        pytest.skip(f"numba-cuda cannot be loaded with NumPy {np.__version__}")
    # Called steps are compiled for the present device.
    device = SimpleNamespace(compute_capability=OLDEST)
    monkeypatch.setattr("numba.cuda.dispatcher.get_current_device", lambda: device)
    from numba.cuda.typing.typeof import Purpose, typeof

    def compiled(kernel: Any, *given: Any) -> str:
        types = tuple(typeof(value, Purpose.argument) for value in given)
        try:
            code, _ = cuda.compile(
                kernel, numba.cuda.types.void(*types), device=False, abi="numba", cc=OLDEST
            )
        except (OSError, RuntimeError, ImportError) as error:  # without NVVM or its libraries
            pytest.skip(f"cannot compile (install realitygap[cuda]): {str(error).splitlines()[0]}")
        return code.decode() if isinstance(code, bytes) else code

    compiled(lambda: None)  # whether it can: a trial takes long
    return compiled


@pytest.mark.parametrize("name", EngineContract.tasks)
def test_trials_compile_for_a_gpu(monkeypatch, compiler, name):
    """A trial and its score become a GPU's assembler, which allocates nothing."""
    monkeypatch.setattr(engine.Cuda, "_placed", lambda self, value: value)
    made = engine.Cuda(Simulation(name, PAPER))
    nets = NO_NETWORK
    work = made._rows(new_scratch(made.simulation.robot, made.simulation.trial, nets), nets, 64)
    paths = np.zeros((64, 6, made.simulation.trial.steps))
    batch = engine.Batch(np.zeros(64, np.int64), np.zeros(64, np.uint64), paths, np.zeros((64, 2)))
    trial = compiler(engine.trials().py_func, made.simulation.world, nets, NO_RECORD, work, batch)
    score = compiler(engine.scoring(made.simulation.score.compiled).py_func, made.simulation.room, batch)
    for text in (trial, score):
        assert ".entry" in text and "NRT_" not in text and "malloc" not in text
