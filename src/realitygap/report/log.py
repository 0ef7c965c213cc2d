"""Draws a log as it is looked at: its path, and over time what its columns seem to be."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from realitygap.files import atomic_path
from realitygap.logs.cuts import jumps
from realitygap.report.style import GRID, MUTED, PAGE, new_figure, styled
from realitygap.values import Floats

__all__ = ["draw_log"]

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7")
PANELS = {
    "heading_deg": ("heading, degrees", ("heading_deg",)),
    "counter": ("counters, pulses since the start", ("counter_left", "counter_right")),
    "speed": ("speeds", ("speed_left", "speed_right", "v", "w")),
    "command": ("commands", ("command_left", "command_right", "command_v", "command_w")),
}
"""What is drawn over time: its name, and the columns."""


def draw_log(target: Path, columns: Mapping[str, Floats], run: NDArray[np.int64], title: str) -> None:
    """Draw a log into a file.

    Args:
        target: .png, .svg or .pdf.
        columns: [n] by name, as `realitygap.logs.Look` has them.
        run: [n] the run of each row.
        title: above all.
    """
    shown = {key: told for key, told in PANELS.items() if set(told[1]) & columns.keys()}
    placed, timed = {"x_cm", "y_cm"} <= columns.keys(), "t_s" in columns
    near = {name for name in columns if name[:1] == "s" and name[1:].isdecimal()} | (
        columns.keys() & {"reading"}
    )
    count = len(shown) * timed + placed + timed + bool(near)
    wide = min(max(count, 1), 3)
    rows = -(-max(count, 1) // wide)
    with styled():
        figure = new_figure(PAGE, 0.5 + 2.0 * rows, layout="constrained")
        axes = list(figure.subplots(rows, wide, squeeze=False).ravel())
        for spare in axes[count:]:
            spare.set_visible(False)
        figure.suptitle(title, fontsize=8.5)
        if placed:
            ax, x, y = axes.pop(0), columns["x_cm"], columns["y_cm"]
            for k in np.unique(run):
                ax.plot(x[run == k], y[run == k], lw=0.7, color=COLOURS[k % 4])
            off = jumps(columns["t_s"], np.stack([x, y], 1), run)[0] if timed else np.zeros(len(x), bool)
            ax.plot(x[off], y[off], "x", ms=5, color=COLOURS[1])
            ax.set(xlabel="x, cm", ylabel="y, cm", title=f"path{', crosses: jumps' * bool(off.any())}")
            ax.set_aspect("equal", adjustable="datalim")
        if timed:
            t, within = columns["t_s"] - np.nanmin(columns["t_s"]), np.diff(run) == 0
            ax = axes.pop(0)
            ax.plot(t[1:][within], np.diff(t)[within], ".", ms=2, color=COLOURS[0])
            ax.set(xlabel="time, s", ylabel="s", title="time to the row before", ylim=(0, None))
            for name, names in shown.values():
                ax = axes.pop(0)
                for k, one in enumerate(n for n in names if n in columns):
                    values = np.degrees(columns[one]) if one == "heading_deg" else columns[one]
                    values = values - values[0] if one.startswith("counter") else values
                    ax.plot(t, values, ("-", "--")[k % 2], lw=0.8, color=COLOURS[k], label=one)
                ax.set(xlabel="time, s", title=name)
                if len(ax.lines) > 1:
                    ax.legend(fontsize=6)
        if near and "distance_cm" in columns:
            ax = axes.pop(0)
            for k, one in enumerate(sorted(near)):
                ax.plot(
                    columns["distance_cm"],
                    columns[one],
                    "ox^s"[k // 4 % 4],
                    ms=3,
                    color=COLOURS[k % 4],
                    mfc="none",
                    label=one,
                )
            ax.set(xlabel="distance, cm", ylabel="counts", title="readings")
            ax.legend(fontsize=6, ncols=2)
        for ax in figure.axes:
            ax.grid(True, color=GRID, lw=0.5)
            ax.tick_params(colors=MUTED)
        with atomic_path(target) as new:
            figure.savefig(new, dpi=150)
