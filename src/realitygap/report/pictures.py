"""Single pictures of a trajectory, for `simulate` and `replay`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from realitygap import whole
from realitygap.errors import UsageError
from realitygap.report.paths import draw_trajectory
from realitygap.report.style import new_figure, styled
from realitygap.track import Trajectory

__all__ = ["PICTURES", "checked_ending", "save_picture"]

PICTURES = (".png", ".svg", ".pdf")


def checked_ending(path: str | Path, allowed: tuple[str, ...]) -> Path:
    """The path, if its file ending is among those that can be written.

    Raises:
        UsageError: it is not.
    """
    path = Path(path)
    if path.suffix.lower() not in allowed:
        raise UsageError(
            f"{path}: expected a file name that ends in {', '.join(allowed[:-1])} or {allowed[-1]}, "
            f"got {path.suffix or 'no ending'!r}."
        )
    return path


def save_picture(
    path: str | Path, task: Any, profile: Any, trajectory: Trajectory, title: str = "", **options: Any
) -> Path:
    """Write a trajectory in its arena, with its tail, as PNG, SVG or PDF.

    Args:
        path: its ending says the format.
        task: whose arena is drawn.
        profile: the robot.
        trajectory: what is drawn.
        title: a line above.
        options: as for `paths.draw_path`, such as `colour`.

    Raises:
        UsageError: an ending that cannot be written.
    """
    path = checked_ending(path, PICTURES)
    width, depth = (float(v) for v in task.arena.to_kernel().size)
    wide = 4.6 if width >= depth else 3.4
    with styled():
        figure = new_figure(wide, (wide - 0.6) * depth / width + 0.75, layout="constrained")
        ax = figure.add_subplot()
        draw_trajectory(ax, task, profile, trajectory, **options)
        ax.set_title(title, loc="left")
        stamp: dict[str, Any] = {
            ".png": {"Software": None},
            ".svg": {"Date": None},
            ".pdf": {"CreationDate": None},
        }
        with whole.named(path):
            figure.savefig(path, dpi=200, metadata=stamp[path.suffix.lower()])
    return path
