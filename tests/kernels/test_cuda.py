"""The steps compile for NVIDIA GPUs as they are (through numba-cuda), and give the CPU's trials there."""

from __future__ import annotations

import importlib
import importlib.util
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from realitygap.controller.handmade import braitenberg
from realitygap.controller.layout import Layout
from realitygap.controller.network import decode
from realitygap.kernels import batch
from realitygap.kernels.params import Path, World
from realitygap.kernels.trial import draw_start, run_trial
from realitygap.kernels.work import new_work
from realitygap.tasks import load_task
from tests.kernels.scenes import PAPER

TRIALS, STEPS = 3, 50
OLDEST = (7, 5)
"""Compute capability that is compiled for where there is no GPU."""


def cuda_or_skip():
    """numba.cuda as numba-cuda provides it: the one within Numba is no longer kept up."""
    if importlib.util.find_spec("numba_cuda") is None:
        pytest.skip('no numba-cuda here: pip install "numba-cuda[cu12]"')
    if importlib.import_module("numba").config.ENABLE_CUDASIM:
        pytest.skip("CUDA's simulator cannot call compiled steps")
    return importlib.import_module("numba.cuda")


def some_trials(world, nets, streams, work, paths):
    """The kernel: one thread goes through the trials one after the other."""
    for t in range(streams.shape[0]):
        draw_start(world.task, streams[t], work.start)
        p = paths[t]
        path = Path(p[0], p[1], p[2], p[3], p[4], p[5])
        run_trial(world, nets, 0, streams[t], work, path)


def arguments(name: str):
    """A Braitenberg vehicle at a task, with observed noise."""
    task = replace(load_task(name), seconds=STEPS / 10)
    nets = decode(braitenberg(task.feeds, Layout()), Layout())
    trial = task.to_kernel(PAPER)
    work = new_work(PAPER.to_kernel(), trial, nets)
    streams, paths = np.arange(TRIALS, dtype=np.uint64), np.zeros((TRIALS, 6, STEPS))
    world = World(robot=PAPER.to_kernel(), arena=task.arena.to_kernel(), task=trial, level=1.0)
    return world, nets, streams, work, paths


def test_steps_compile_for_a_gpu(monkeypatch):
    """A whole trial compiles to a GPU's assembler: no allocation, no Python object (no GPU is needed)."""
    numba = importlib.import_module("numba")
    cuda = cuda_or_skip()
    if not cuda.is_available():
        # Called steps are compiled for the present device; without one, for the oldest.
        dispatcher = importlib.import_module("numba.cuda.dispatcher")
        device = SimpleNamespace(compute_capability=OLDEST)
        monkeypatch.setattr(dispatcher, "get_current_device", lambda: device)
    types = tuple(numba.typeof(value) for value in arguments("light-seeking"))
    try:
        code, _ = cuda.compile(some_trials, numba.types.void(*types), device=False, abi="numba", cc=OLDEST)
    except Exception as error:
        if "nvvm" in str(error).lower() or "libdevice" in str(error).lower():
            pytest.skip(f"no NVVM here (install numba-cuda[cu12]): {str(error).splitlines()[0]}")
        raise
    text = code.decode() if isinstance(code, bytes) else code
    assert ".entry" in text
    assert "NRT_" not in text and "malloc" not in text


@pytest.mark.parametrize("name", ["obstacle-avoidance", "light-seeking"])
def test_a_gpu_agrees_with_the_cpu(name):
    """Trials on the GPU follow the CPU's: other roundings (fused multiply-add), no other course."""
    cuda = cuda_or_skip()
    if not cuda.is_available():
        pytest.skip("no NVIDIA GPU here")
    world, nets, streams, work, paths = arguments(name)
    cuda.jit(some_trials)[1, 1](world, nets, streams, work, paths)
    expected = np.zeros_like(paths)
    which = np.zeros(TRIALS, np.int64)
    batch.run_trials(world, nets, which, streams, expected, work)
    np.testing.assert_allclose(paths[:, :5, :10], expected[:, :5, :10], rtol=1e-9, atol=1e-9)
    # Later a rounding may tip one count of one reading: the courses stay close.
    np.testing.assert_allclose(paths[:, :2], expected[:, :2], atol=1.0)
