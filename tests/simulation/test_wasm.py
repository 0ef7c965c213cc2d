"""The kernels of a web page: the bits of native trials in node and in a browser, from one module."""

from __future__ import annotations

import base64
import hashlib
import json
import os
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path as File
from textwrap import dedent
from typing import Any

import numba
import numpy as np
import pytest

from realitygap.control.genotype import Genotype
from realitygap.kernels.trial import new_scratch
from realitygap.kernels.types import Path
from realitygap.simulation import wasm
from realitygap.simulation.simulation import Simulation, batch_streams
from realitygap.tasks import load_task
from realitygap.world.arena import load_arena
from tests.browser import Browser, find_browser

pytestmark = pytest.mark.skipif(bool(os.environ.get("NUMBA_DISABLE_JIT")), reason="the compiler is off")

SCRIPT = File(__file__).with_name("trials.mjs").read_text("utf-8")
PAGE = """<meta charset="utf-8"><meta http-equiv="Content-Security-Policy"
content="default-src 'none'; script-src 'unsafe-inline' 'wasm-unsafe-eval'"><script>{}</script>"""
TRIALS = 20


Made = tuple[dict[str, Any], list[str], wasm.Arguments]
AVOID, SEEK = load_task("obstacle-avoidance"), load_task("light-seeking")
BOTH = replace(SEEK, feeds="proximity+ambient", sensors=(0, 2, 3, 5, 8, 10, 11, 13))
ROOMY = replace(AVOID, arena=load_arena("obstacle-avoidance-large"))
SETTINGS = [
    (AVOID, "paper"),
    (AVOID, "khepera"),
    (ROOMY, "thymio"),
    (SEEK, "paper"),
    (SEEK, "khepera"),
    (BOTH, "khepera"),
]
"""The Thymio is no disc."""


@pytest.fixture(scope="module")
def trials() -> Made:
    """Trials of as many networks in six settings, at three levels of noise; native digests."""
    memory, cases, native, kernels = wasm.Memory(), [], [], set()
    streams = batch_streams(7, TRIALS)
    for task, profile in SETTINGS:
        sim = Simulation(task, profile, 1.0)
        inputs = len(sim.trial.channels)
        random = [Genotype.random(i, inputs=inputs, start_neurons=0.3).genes for i in range(TRIALS)]
        nets = Genotype.decode(np.stack(random), inputs)
        path, scratch = Path(*np.zeros((6, sim.trial.steps))), new_scratch(sim.robot, sim.trial, nets)
        given = wasm.Arguments(sim.world, nets, 0, np.uint64(0), 0, 0, path, scratch)
        kernels.add(wasm.module(wasm.entries(given)))
        at, where = memory.lay(given)
        for level in (0.0, 1.0, 2.0):
            paths = Simulation(task, profile, level).tracks(nets, streams[:, np.newaxis])
            native.append(
                hashlib.sha256(np.stack([row[:, 0] for row in paths], axis=1).tobytes()).hexdigest()
            )
            cases.append({"at": at, "where": where, "steps": sim.trial.steps, "level": level})
    assert len(kernels) == 1
    told = {
        "kernel": base64.b64encode(kernels.pop()).decode(), "memory": base64.b64encode(memory.data).decode(),
        "base": wasm.BASE, "streams": [str(one) for one in streams],
        "cases": [*cases, {**cases[1], "nudge": "world.robot.wheels.track"}],
    }  # fmt: skip
    return told, native, given


def judged(answer: dict[str, Any], native: list[str]) -> None:
    """All bits are the native ones; one unit in a constant's last place is not overlooked."""
    assert answer["imports"] == ["__linear_memory"]
    assert answer["found"][:-1] == native
    assert answer["found"][-1] != native[1]


def test_trials_in_node_have_the_native_bits(trials: Made) -> None:
    """Two tasks, three robots, three levels of noise; the module wants nothing but a memory."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("no node in the PATH")
    told, native, _ = trials
    script = f"{SCRIPT}\ncheck({json.dumps(told)}).then((found) => console.log(JSON.stringify(found)))"
    done = subprocess.run([node, "-"], input=script, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr
    judged(json.loads(done.stdout), native)


def test_trials_in_a_browser_have_the_native_bits(trials: Made, tmp_path: File) -> None:
    """As in node; under the page's own policy, from disk."""
    path = find_browser()
    if path is None:
        pytest.skip("no Chromium in the PATH or in CHROMIUM")
    told, native, _ = trials
    (tmp_path / "page.html").write_text(PAGE.format(SCRIPT), "utf-8")
    with Browser(path, tmp_path / "profile") as browser:
        browser.show(tmp_path / "page.html")
        judged(browser.run(f"check({json.dumps(told)})"), native)
        assert browser.problems == []


def test_a_module_is_built_to_the_same_bytes_and_kept(
    trials: Made, monkeypatch: pytest.MonkeyPatch, tmp_path: File
) -> None:
    """Anew alike; what is kept is not made again, unless it is damaged."""
    told, _, given = trials
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    made = wasm.module(wasm.entries(given))
    assert base64.b64encode(made).decode() == told["kernel"]
    monkeypatch.setattr(wasm, "_in_a_child", lambda functions: b"anew")
    assert wasm.module(wasm.entries(given)) == made
    (file,) = tmp_path.glob("wasm-*.made")
    file.write_bytes(file.read_bytes()[:-1])
    assert wasm.module(wasm.entries(given)) == b"anew"


def test_another_numba_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """One error whose last word is what failed, wherever it fails."""
    monkeypatch.setattr(wasm, "kept", lambda home, name, text, make: make())
    with pytest.raises(wasm.WasmError, match=r"was not compiled for the page: \S"):
        wasm.module({"start": (dedent, (1,))})
