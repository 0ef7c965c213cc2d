"""Made-up transfers in a study's folder, of the layout that `realitygap transfer` writes."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from realitygap.files import to_toml
from realitygap.study.load import Run, Study

STEPS = 40
COLUMNS = "t_s,x_cm,y_cm,heading_deg"


def write_transfer(
    study: Study,
    run: Run,
    *,
    robot: str = "twin-1",
    start: int = 1,
    fitness: tuple[float, float] = (0.6, 0.4),
    film: bool = False,
    source: str = "camera",
) -> Path:
    """One transfer: the simulated robot drives a circle, the situated one a narrower one."""
    folder = study.folder / "transfer" / robot / run.name.replace("/", "-") / f"start-{start}"
    folder.mkdir(parents=True)
    _write_path(folder / "simulated.csv", 3.0)
    _write_path(folder / "situated.csv", 2.0)
    if film:
        _write_picture(folder / "tails.png")
        (folder / "film.mp4").write_bytes(b"a film")
    unit = int(robot.split("-")[1]) if robot.startswith("twin") else None
    facts: dict[str, Any] = {
        "run": run.id,
        "name": run.name,
        "task": run.task,
        "noise": run.noise,
        "individual": "champion",
        "robot": robot,
        "unit": unit,
        "twin_noise": None if unit is None else 1.0,
        "start": start,
        "pose": {"x_cm": 22.0, "y_cm": 25.0, "heading_deg": 90.0},
        "seconds": STEPS / 10,
        "film": film,
        "situated_from": "film" if film else source,
        "late_steps": 0,
        "fitness": {"simulated": fitness[0], "situated": fitness[1]},
    }
    kept = {key: value for key, value in facts.items() if value is not None}
    (folder / "transfer.toml").write_text(to_toml(kept), encoding="utf-8")
    return folder


def _write_path(path: Path, radius: float) -> None:
    rows = [COLUMNS]
    for k in range(STEPS + 1):
        turn = 4.0 * k / STEPS
        x, y = 22.0 - radius + radius * math.cos(turn), 25.0 + radius * math.sin(turn)
        rows.append(f"{k / 10:.1f},{x:.6f},{y:.6f},{180 - (90 - math.degrees(turn)) % 360:.6f}")
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")


def _write_picture(path: Path) -> None:
    """A picture larger than a page has room for."""
    from PIL import Image

    shade = np.linspace(0, 255, 1600 * 1200).reshape(1200, 1600).astype(np.uint8)
    Image.fromarray(shade).save(path)
