"""What has the same bits whatever the processor can do, and what has not.

    python -m tests.same_everywhere          each part under each setting, as a table (ten minutes)
    python -m tests.same_everywhere PART     one part's digest, here and now

A setting takes instructions away from NumPy, the C library, OpenBLAS, OpenCV or Numba, as an older
processor would. The parts of `ALIKE` must not differ; the others use arithmetic that is not the project's.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

__all__ = ["ALIKE", "PARTS", "SETTINGS", "digest_of"]

SETTINGS = {
    "as it is": {},
    "NumPy": {"NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR"},
    "C library": {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX,-AVX2,-FMA,-FMA4,-AVX512F"},
    "OpenBLAS": {"OPENBLAS_CORETYPE": "Prescott"},
    "OpenCV": {"OPENCV_CPU_DISABLE": "SSE4.1,SSE4.2,AVX,AVX2,FMA3,AVX512-SKX"},
    "Numba": {"NUMBA_CPU_NAME": "x86-64"},
}
ALIKE = ("evolution",)
ROOM = {
    "size_cm": [100, 80], "cylinders": [[30, 40, 4], [70, 20, 3]], "walls": [[50, 0, 60, 30]],
    "lamps": [[20, 60], [95, 75]],
}  # fmt: skip


def twin() -> list[Any]:
    """The twin's recordings: what is read from it while it drives, physics included."""
    from realitygap.twin.body import TwinBody

    found: list[Any] = []
    for unit in (1, 2):
        body = TwinBody(ROOM, unit=unit, seed=unit)
        body.place(20, 20, 0.4)
        body.set_speed(5, 4)
        for _ in range(100):
            body.advance(100)
            found.append(np.array([body.proximity(), body.ambient()]))
        found.append(np.array(body.truth()))
    return found


def physics() -> list[Any]:
    """MuJoCo alone, with the twin's model: two constant voltages, no control, no noise."""
    import mujoco

    from realitygap.twin.body import build_xml
    from realitygap.twin.unit import draw_unit, plain_arena

    model = mujoco.MjModel.from_xml_string(build_xml(plain_arena(ROOM), draw_unit(1)))
    data = mujoco.MjData(model)
    data.qpos[:2], data.ctrl[:] = (0.2, 0.2), (1.0, 0.8)
    found = []
    for _ in range(3000):
        mujoco.mj_step(model, data)
        found.append(data.qpos.copy())
    return [np.array(found)]


def evolution() -> list[Any]:
    """Both tasks' trials with noise, bred and scored: all that is kept of 300 evaluations."""
    import sqlite3

    from realitygap.study.config import Condition, StudyConfig
    from realitygap.study.runner import run_study

    with tempfile.TemporaryDirectory() as name:
        tasks = ("obstacle-avoidance", "light-seeking")
        conditions = tuple(Condition(task=task, noise=1.0) for task in tasks)
        config = StudyConfig(conditions=conditions, evaluations=300, runs=1, seed=4)
        run_study(Path(name) / "s", config, workers=1)
        with sqlite3.connect(Path(name) / "s" / "study.db") as database:
            return [repr(database.execute("SELECT * FROM evaluations").fetchall()).encode()]


def track() -> list[Any]:
    """The tracker's view of drawn frames (OpenCV's filters)."""
    from realitygap.film.disk import load_disk
    from realitygap.tasks import load_task
    from realitygap.transfer.camera import OverheadTracker

    load_disk()
    with tempfile.TemporaryDirectory() as name:
        arena = load_task("obstacle-avoidance").arena
        camera = OverheadTracker(Path(name) / "camera.json", arena, unit=1, noise=1.0, radius_cm=2.75).camera
    return [repr(camera.to_dict()).encode()]


def fit() -> list[Any]:
    """A least-squares fit as the calibration makes them (SciPy and its BLAS)."""
    from scipy.optimize import least_squares

    x = np.linspace(0.0, 1.0, 200)
    y = 3.0 / (0.1 + x) ** 2 + np.sqrt(x)

    def wrong(p: Any) -> Any:
        return p[0] / (p[1] * p[1] + x) ** 2 + p[2] * x - y

    return [least_squares(wrong, [1.0, 1.0, 0.0], method="lm").x]


PARTS: dict[str, Callable[[], list[Any]]] = {
    part.__name__: part for part in (twin, physics, evolution, track, fit)
}


def digest_of(part: str, **environment: str) -> str:
    """A part's digest in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-m", "tests.same_everywhere", part], cwd=Path(__file__).parents[1], text=True,
        env={**os.environ, **environment}, capture_output=True, check=False, timeout=900,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def main() -> int:
    """The table; the exit code: 1 where something differs that must not."""
    wrong = 0
    for part in PARTS:
        found = {name: digest_of(part, **setting) for name, setting in SETTINGS.items()}
        other = [name for name in SETTINGS if found[name] != found["as it is"]]
        print(f"{part:12} {'differs: ' + ', '.join(other) if other else 'the same'}", flush=True)
        wrong += bool(other) and part in ALIKE
    return int(wrong > 0)


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(main())
    total = hashlib.sha256()
    for piece in PARTS[sys.argv[1]]():
        total.update(piece if isinstance(piece, bytes) else np.ascontiguousarray(piece).tobytes())
    print(total.hexdigest()[:16])
