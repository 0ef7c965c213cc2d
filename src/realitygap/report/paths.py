"""Figures 3 and 5: paths with the paper's tails, a line from the centre to the leading edge a step.

"These were constructed by failing to erase a line, plotted on each previous time step" (§6).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from realitygap.kernels.types import Arena, Robot
from realitygap.report import style
from realitygap.report.arenas import draw_arena
from realitygap.report.robots import draw_robot, front
from realitygap.report.style import PAGE, SIMULATED, Look, new_figure, noise_styles
from realitygap.tasks.task import Task
from realitygap.track import Track, Trajectory
from realitygap.world.robot import Profile

__all__ = ["PathPanel", "Scene", "draw_path", "pairs_figure", "panels_figure", "sheet_figure", "tail"]


class Scene(NamedTuple):
    """Where a path is drawn: arena, robot, and all noise levels of the page, for their colours."""

    arena: Arena
    robot: Robot
    levels: tuple[float, ...] = ()

    @classmethod
    def of(cls, task: Task, profile: Profile) -> Self:
        return cls(task.arena.to_kernel(), profile.to_kernel())


@dataclass(frozen=True, kw_only=True)
class PathPanel:
    """One path to be drawn: noise level, title, path and look."""

    noise: float
    title: str
    trajectory: Trajectory | Track
    look: Look = SIMULATED


def tail(trajectory: Trajectory | Track, radius: float) -> np.ndarray:
    """The tail as one broken line [3 n, 2]: centre, leading edge, gap; one stroke a step, cm."""
    track = trajectory.track if isinstance(trajectory, Trajectory) else trajectory
    strokes = np.full((len(track), 3, 2), np.nan)
    strokes[:, 0] = np.stack([track.x, track.y], axis=1)
    strokes[:, 1] = strokes[:, 0] + radius * np.stack([np.cos(track.heading), np.sin(track.heading)], axis=1)
    return strokes.reshape(-1, 2)


def draw_path(
    ax: Axes,
    scene: Scene,
    trajectory: Trajectory | Track,
    *,
    colour: str = style.INK,
    look: Look = SIMULATED,
    labels: bool = True,
) -> None:
    """A trajectory in its arena: the tail, a cross at the start, the robot at the end.

    Args:
        ax: where to draw.
        scene: arena and robot.
        trajectory: the trial.
        colour: of the tail.
        look: simulated or situated.
        labels: whether axes have names.
    """
    draw_arena(ax, scene.arena, labels=labels)
    strokes = tail(trajectory, front(scene.robot))
    ax.plot(
        *strokes.T, color=colour, linewidth=look.tail_width, linestyle=look.line, alpha=look.tail_alpha,
        solid_capstyle="butt", zorder=3, scalex=False, scaley=False,
    )  # fmt: skip
    ax.plot(
        *strokes[:1].T, "o", markersize=4 if labels else 2.6, markerfacecolor=style.PAPER,
        markeredgecolor=style.INK, markeredgewidth=1.0, zorder=4.5,
    )  # fmt: skip
    end = trajectory.end
    draw_robot(ax, scene.robot, (end.x, end.y, end.heading), look)


def panels_figure(scene: Scene, panels: Sequence[PathPanel]) -> Figure:
    """One panel a noise level, side by side."""
    return _grid(scene, [list(panels)], wide=min(PAGE, 2.6 * len(panels) + 0.3), labels=True)


def pairs_figure(scene: Scene, heads: Sequence[str], rows: Sequence[Sequence[PathPanel | None]]) -> Figure:
    """Simulated paths above, situated ones below; a column a noise level, which `heads` name."""
    wide = min(PAGE, 2.6 * len(heads) + 0.3)
    return _grid(scene, rows, wide=wide, labels=True, heads=heads)


def sheet_figure(scene: Scene, rows: Sequence[Sequence[PathPanel | None]]) -> Figure:
    """Every run's path: a row a noise level (simulated, then situated), a column a run."""
    return _grid(scene, rows, wide=PAGE, labels=False)


def _grid(
    scene: Scene,
    rows: Sequence[Sequence[PathPanel | None]],
    *,
    wide: float,
    labels: bool,
    heads: Sequence[str] = (),
) -> Figure:
    """Panels in rows; all arenas at the same scale, laid out by hand (cheap and deterministic)."""
    styles = noise_styles([*scene.levels, *(panel.noise for row in rows for panel in row if panel)])
    columns = max(len(row) for row in rows)
    left, bottom, gap, head = (0.46, 0.42, 0.14, 0.27) if labels else (0.06, 0.06, 0.1, 0.2)
    if labels and columns == 1:
        wide = 3.4
    cell = (wide - left - 0.06 - gap * (columns - 1)) / columns
    tall = cell * float(scene.arena.size[1] / scene.arena.size[0])
    height = bottom + len(rows) * (tall + head) + (0.11 if heads else 0.0)
    figure = new_figure(wide, height)
    for c, text in enumerate(heads):
        spot = (left + c * (cell + gap)) / wide
        figure.text(spot, 1 - 0.02 / height, text, fontsize=9, fontweight="bold", color=style.INK, va="top")
    for r, row in enumerate(rows):
        for c, panel in enumerate(row):
            if panel is None:
                continue
            box = (left + c * (cell + gap), bottom + (len(rows) - 1 - r) * (tall + head))
            ax = figure.add_axes((box[0] / wide, box[1] / height, cell / wide, tall / height))
            colour = styles[panel.noise].colour
            draw_path(ax, scene, panel.trajectory, colour=colour, look=panel.look, labels=labels)
            if labels:
                _spare_labels(ax, inner=c > 0, upper=r + 1 < len(rows) and rows[r + 1][c] is not None)
            ax.set_title(panel.title, fontsize=8.5 if labels else 7, pad=3, loc="left", color=style.INK)
    return figure


def _spare_labels(ax: Axes, *, inner: bool, upper: bool) -> None:
    """Omit the cm labels of panels with a neighbour to the left or below."""
    if inner:
        ax.set_ylabel("")
        ax.set_yticklabels([])
    if upper:
        ax.set_xlabel("")
        ax.set_xticklabels([])
