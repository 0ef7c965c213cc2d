"""The looping picture: `python docs/loop.py out/reproduce`, of a study such as `reproduce` makes.

Of each level of noise the trial that the study filmed: simulated, beside the same controller on the twin
from the same start. Threefold speed, with the paper's tails.
"""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.lines import Line2D
from PIL import Image

from realitygap import load_study
from realitygap.files import atomic_path
from realitygap.report import style
from realitygap.report.drawing import Scene, draw_arena, draw_robot, front, tail
from realitygap.report.evolution import parts_of
from realitygap.report.style import SIMULATED, SITUATED
from realitygap.report.transfers import Pair, pairs_of
from realitygap.track import Track
from realitygap.world.robot import noise_name

THERE = Path(__file__).parent / "_static"
TASK = "obstacle-avoidance"
STEP_S, STROKES, SPEED, HOLD_S = 0.2, 2, 3.0, 1.5
"""Between two frames of a drive; strokes of the tail in it; the speed; how long the last frame stays."""
INCHES, DPI = (7.2, 4.0), 100


def main(folder: str) -> None:
    """Write the picture of a study, and its last frame alone for those who want no motion."""
    study = load_study(folder)
    pairs = [pair for pair in pairs_of(study, parts_of(study))[TASK] if pair.filmed]
    scene = Scene.of(study.task(TASK), study.profile)
    pictures: list[Image.Image] = []
    lasting: list[int] = []
    for level in sorted({pair.level for pair in pairs}):
        pair = next(pair for pair in pairs if pair.level == level)
        new = [Image.fromarray(frame) for frame in drive(pair, scene)]
        pictures += new
        lasting += [round(1000 * STEP_S / SPEED)] * (len(new) - 1) + [round(1000 * HOLD_S)]
    how: dict[str, Any] = {"format": "webp", "lossless": True, "quality": 70, "method": 4}
    with atomic_path(THERE / "loop.webp") as spare:
        pictures[0].save(spare, save_all=True, append_images=pictures[1:], duration=lasting, loop=0, **how)
    with atomic_path(THERE / "loop-still.webp") as spare:
        pictures[-1].save(spare, **how)


def drive(pair: Pair, scene: Scene) -> Iterator[np.ndarray]:
    """Frames [height, width, 3] of both tracks."""
    with style.styled():
        figure = style.new_figure(*INCHES, dpi=DPI)
        colour = style.noise_styles([pair.level])[pair.level]
        tracks = (even(pair.simulated), even(pair.situated))
        apart = np.hypot(tracks[0].x - tracks[1].x, tracks[0].y - tracks[1].y)
        figure.text(
            0.03, 0.94, f"{colour.sign} evolved under {noise_name(pair.level)} noise", fontsize=11,
            color=colour.colour, fontweight="bold",
        )  # fmt: skip
        clock = figure.text(0.97, 0.94, "", fontsize=10, ha="right", color=style.MUTED, animated=True)
        halves = []
        for track, look, name, left in zip(
            tracks, (SIMULATED, SITUATED), ("simulated", pair.where), (0.03, 0.52), strict=True
        ):
            axes = figure.add_axes((left, 0.0, 0.45, 0.45 * INCHES[0] / INCHES[1]))
            draw_arena(axes, scene.arena, labels=False)
            figure.text(left + 0.008, 0.85, name, fontsize=10, color=style.INK)
            halves.append((axes, track, look))
        canvas = figure.canvas
        canvas.draw()
        kept = canvas.copy_from_bbox(figure.bbox)
        for k in range(0, len(apart), STROKES):
            canvas.restore_region(kept)
            for axes, track, look in halves:
                strokes = tail(track.only(np.arange(max(0, k - STROKES + 1), k + 1)), front(scene.robot))
                line = Line2D(*strokes.T, color=colour.colour, linewidth=0.9, alpha=look.tail_alpha, zorder=3)
                axes.draw_artist(axes.add_line(line))
                line.remove()
            kept = canvas.copy_from_bbox(figure.bbox)  # no stroke is erased
            for axes, track, look in halves:
                pose = (track.x[k], track.y[k], track.heading[k])
                for artist in draw_robot(axes, scene.robot, pose, look, edge=colour.colour):
                    axes.draw_artist(artist)
                    artist.remove()
            clock.set_text(f"{k * STEP_S / STROKES:.0f} s, {apart[k]:.1f} cm apart")
            figure.draw_artist(clock)
            yield np.asarray(canvas.buffer_rgba())[:, :, :3].copy()


def even(track: Track) -> Track:
    """A track at even times."""
    known = np.flatnonzero(track.found)
    times = np.arange(0.0, track.t[-1] + 1e-6, STEP_S / STROKES)
    return track.only(known[np.clip(np.searchsorted(track.t[known], times - 1e-6), 0, len(known) - 1)])


if __name__ == "__main__":
    main(*sys.argv[1:])
