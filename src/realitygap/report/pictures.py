"""Single pictures of a trajectory, for `simulate` and `replay`."""

from __future__ import annotations

from pathlib import Path

from realitygap import whole
from realitygap.errors import UsageError
from realitygap.report.paths import Scene, draw_path
from realitygap.report.style import new_figure, styled
from realitygap.tasks.task import Task
from realitygap.track import Trajectory
from realitygap.world.profile import Profile

__all__ = ["PICTURES", "checked_ending", "save_picture"]

STAMPS = {".png": "Software", ".svg": "Date", ".pdf": "CreationDate"}
"""What is left out of each kind of file, so that the same picture has the same bytes."""
PICTURES = tuple(STAMPS)


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
    path: str | Path, task: Task, profile: Profile, trajectory: Trajectory, title: str = ""
) -> Path:
    """Write a trajectory in its arena, with its tail, as PNG, SVG or PDF.

    Args:
        path: its ending says the format.
        task: whose arena is drawn.
        profile: the robot.
        trajectory: what is drawn.
        title: a line above.

    Raises:
        UsageError: an ending that cannot be written.
    """
    path = checked_ending(path, PICTURES)
    scene = Scene.of(task, profile)
    width, depth = (float(v) for v in scene.arena.size)
    wide = 4.6 if width >= depth else 3.4
    with styled():
        figure = new_figure(wide, (wide - 0.6) * depth / width + 0.75, layout="constrained")
        ax = figure.add_subplot()
        draw_path(ax, scene, trajectory)
        ax.set_title(title, loc="left")
        with whole.named(path):
            figure.savefig(path, dpi=200, metadata={STAMPS[path.suffix.lower()]: None})
    return path
