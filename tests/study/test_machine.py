"""A study names the machine and the versions that it was made with."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from realitygap.errors import StudyInterruptedError
from realitygap.study import versions as machine
from realitygap.study.config import StudyConfig
from realitygap.study.load import load_study
from realitygap.study.runner import EVOLVING, Progress, run_study
from realitygap.study.versions import versions

NAMED = ["realitygap", "python", "numpy", "numba", "mujoco", "opencv", "sqlite", "platform", "processor"]
ASKED = "from realitygap.study.versions import processor; print(processor())"


def test_a_processor_is_named_as_its_maker_does(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the instruction sets that NumPy has code for; without a list of processors, by its kind."""
    file = tmp_path / "cpuinfo"
    file.write_text("processor : 0\nmodel name\t: Made Up(R) 1 @ 2 GHz\nflags : fma avx2\n", "utf-8")
    monkeypatch.setattr(machine, "CPUINFO", file)
    monkeypatch.setattr("numpy.show_config", lambda mode: {"SIMD Extensions": {"found": ["AVX2"]}})
    machine.processor.cache_clear()
    assert machine.processor() == "Made Up(R) 1 @ 2 GHz (AVX2)"
    file.unlink()
    machine.processor.cache_clear()
    assert machine.processor().endswith(" (AVX2)")
    machine.processor.cache_clear()


def test_an_instruction_set_that_is_not_used_is_not_named() -> None:
    """NumPy without what it could do without has other bits."""
    off = np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])
    if not off:
        pytest.skip("a processor without such sets")
    environment = {**os.environ, "NPY_DISABLE_CPU_FEATURES": " ".join(off)}
    command = [sys.executable, "-c", ASKED]
    said = subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout.strip()
    assert said != machine.processor() and machine.processor().startswith(said.split(" (")[0])


def test_a_study_knows_all_machines_that_worked_on_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One that is resumed elsewhere names both processors, and every version once."""
    config = StudyConfig.single("avoidance", 0.0, evaluations=64, seed=3, fresh_trials=2, retest_trials=2)
    config = config.with_settings(["task.seconds=0.5"])
    here = versions()
    assert set(NAMED) <= set(here)

    def stop(progress: Progress) -> None:
        if progress.phase == EVOLVING:
            raise KeyboardInterrupt

    monkeypatch.setattr("realitygap.work.progress.EVERY_S", 0.0)
    with pytest.raises(StudyInterruptedError):
        run_study(tmp_path / "study", config, workers=1, on_progress=stop)
    monkeypatch.setattr("realitygap.study.runner.versions", lambda: {**here, "processor": "another"})
    run_study(tmp_path / "study", None, resume=True, workers=1)
    told = load_study(tmp_path / "study").versions()
    assert told["processor"] == [here["processor"], "another"] and told["numpy"] == [here["numpy"]]
