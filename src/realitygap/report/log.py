"""Draws a log as it is looked at: its path, and over time what its columns seem to be."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.files import atomic_path
from realitygap.logs.cuts import jumps
from realitygap.report.style import GRID, MUTED, PAGE, new_figure, styled
from realitygap.values import Floats

__all__ = ["draw_log"]

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7")
PANELS = {
    "heading, degrees": ("heading_deg",),
    "counters, pulses since the start": ("counter_left", "counter_right"),
    "speeds": ("speed_left", "speed_right", "v", "w"),
    "commands": ("command_left", "command_right", "command_v", "command_w"),
}
"""What is drawn over time."""


def draw_log(target: Path, columns: Mapping[str, Floats], run: NDArray[np.int64], heading: str) -> None:
    """Draw columns [n] by name, as a `Look` or a `Mapped` has them, and their runs [n] into a file."""
    t, placed, drawn = columns.get("t_s"), {"x_cm", "y_cm"} <= columns.keys(), list[Any]()

    def values(name: str) -> Floats:
        first = columns[name][0] if name.startswith("counter") else 0.0
        return np.degrees(columns[name]) if name == "heading_deg" else columns[name] - first

    if t is not None:
        step = np.where(np.diff(run, prepend=-1) == 0, np.diff(t, prepend=0), np.nan)
        drawn.append(("time to the row before, s", t, {"t_s": step}, ".o"))
        for title, some in PANELS.items():
            if there := {name: values(name) for name in some if name in columns}:
                drawn.append((title, t, there, ("-", "--")))
    near = {name: columns[name] for name in columns if name == "reading" or name[1:].isdecimal()}
    if near and "distance_cm" in columns:
        drawn.append(("readings by distance, cm", columns["distance_cm"], near, "ooooxxxx^^^^ssss"))
    with styled():
        wide = min(max(len(drawn) + placed, 1), 3)
        rows = -(-max(len(drawn) + placed, 1) // wide)
        figure = new_figure(PAGE, 0.5 + 2.0 * rows, layout="constrained")
        axes = list(figure.subplots(rows, wide, squeeze=False).ravel())
        figure.suptitle(heading, fontsize=8.5)
        if placed:
            ax, x, y = axes.pop(0), columns["x_cm"], columns["y_cm"]
            for k in np.unique(run):
                ax.plot(x[run == k], y[run == k], lw=0.7, color=COLOURS[k % 4])
            off = np.zeros(len(x), bool) if t is None else np.logical_or(*jumps(t, np.stack([x, y], 1), run))
            ax.plot(x[off], y[off], "x", ms=5, color=COLOURS[1])
            ax.set(xlabel="x, cm", ylabel="y, cm", title=f"path{', crosses: jumps' * bool(off.any())}")
            ax.set_aspect("equal", adjustable="datalim")
        for title, across, lines, styles in drawn:
            ax = axes.pop(0)
            for k, (name, line) in enumerate(lines.items()):
                ax.plot(across, line, styles[k % len(styles)], ms=2, lw=0.8, color=COLOURS[k % 4], label=name)
            ax.set(title=title, xlabel="time, s" if across is t else "")
            if len(lines) > 1:
                ax.legend(fontsize=6, ncols=2)
        for spare in axes:
            spare.set_visible(False)
        for ax in figure.axes:
            ax.grid(True, color=GRID, lw=0.5)
            ax.tick_params(colors=MUTED)
        with atomic_path(target) as new:
            figure.savefig(new, dpi=150)
