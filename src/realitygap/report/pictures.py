"""Single pictures and films of a trajectory, for `simulate` and `replay`."""

from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.text import Text

from realitygap.errors import UsageError
from realitygap.files import atomic_path
from realitygap.report import style
from realitygap.report.arenas import draw_arena
from realitygap.report.paths import Scene, draw_path, tail
from realitygap.report.robots import draw_robot, front
from realitygap.report.style import new_figure, styled
from realitygap.tasks.task import Task
from realitygap.track import Trajectory
from realitygap.values import fed
from realitygap.world.robot import Profile

__all__ = ["FILMS", "PICTURES", "checked_ending", "frames", "save_animation", "save_picture"]

STAMPS = {".png": "Software", ".svg": "Date", ".pdf": "CreationDate"}
"""Metadata left out of each kind of file, so that the same picture has the same bytes."""
PICTURES = tuple(STAMPS)

FILMS = (".gif", ".mp4")
DPI = 100


def checked_ending(path: str | Path, allowed: tuple[str, ...]) -> Path:
    """The path, if its file ending is among the allowed ones.

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
        path: its ending decides the format.
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
        with atomic_path(path) as spare:
            figure.savefig(spare, dpi=200, metadata={STAMPS[path.suffix.lower()]: None})
    return path


def save_animation(
    path: str | Path,
    task: Task,
    profile: Profile,
    trajectory: Trajectory,
    title: str = "",
    speed: float = 1.0,
) -> Path:
    """Write a trajectory as a GIF or an MP4, a frame for each step of `speed`-fold time.

    Args:
        path: its ending decides the format.
        task: whose arena is drawn.
        profile: the robot.
        trajectory: what is shown.
        title: a line above.
        speed: 1 is real time, 2 twice as fast.

    Raises:
        UsageError: an ending that cannot be written, or a speed of 0 or less.
    """
    path = checked_ending(path, FILMS)
    if not speed > 0:
        raise UsageError(f"speed: expected more than 0 (1 = real time), got {speed!r}.")
    pictures = frames(task, profile, trajectory, title)
    with atomic_path(path) as spare:
        if path.suffix.lower() == ".gif":
            _save_gif(spare, pictures, profile.period_s / speed)
        else:
            _save_mp4(spare, pictures, speed / profile.period_s)
    return path


def frames(task: Task, profile: Profile, trajectory: Trajectory, title: str = "") -> Iterator[np.ndarray]:
    """Pictures [height, width, 3] of 8 bits, one a step, both even; arguments as of `save_animation`."""
    arena, robot = task.arena.to_kernel(), profile.to_kernel()
    with styled():
        figure, room, bars, text = _stage(task, profile, trajectory, title)
        canvas = FigureCanvasAgg(figure)
        strokes = tail(trajectory, front(robot)).reshape(-1, 3, 2)
        draw_arena(room, arena)
        canvas.draw()
        stroke = room.plot([], [], color=style.INK, linewidth=0.9, animated=True, zorder=3)[0]
        kept = canvas.copy_from_bbox(figure.bbox)
        for step in range(len(trajectory.t)):
            canvas.restore_region(kept)
            stroke.set_data(*strokes[step, :2].T)
            room.draw_artist(stroke)
            kept = canvas.copy_from_bbox(figure.bbox)  # every stroke stays: "failing to erase" (§6)
            pose = (trajectory.x[step], trajectory.y[step], trajectory.heading[step])
            for artist in draw_robot(room, robot, pose):
                room.draw_artist(artist)
                artist.remove()
            _draw_bars(bars, trajectory, task.feeds, step)
            text.set_text(f"{trajectory.t[step]:5.1f} s" + ("   touches" if trajectory.contact[step] else ""))
            room.draw_artist(text)
            yield np.asarray(canvas.buffer_rgba())[:, :, :3].copy()


def _stage(
    task: Task, profile: Profile, trajectory: Trajectory, title: str
) -> tuple[Figure, Axes, list[Rectangle], Text]:
    """The empty picture: a room for the path, axes with bars for readings and commands, a clock."""
    width, depth = (float(v) for v in task.arena.to_kernel().size)
    tall = 4.0
    wide = min(7.0, (tall - 0.9) * width / depth + 0.8)
    figure = new_figure(round(wide + 2.4, 1), tall, dpi=DPI)
    total = float(figure.get_size_inches()[0])
    room = figure.add_axes((0.6 / total, 0.13, (wide - 0.8) / total, 0.75))
    room.set_title(title, loc="left")
    readings = fed(trajectory, task.feeds)
    top = max(
        {"proximity": profile.infrared.top, "ambient": profile.ambient.dark}[kind] for kind in task.kinds
    )
    upper = figure.add_axes(((wide + 0.35) / total, 0.56, 1.9 / total, 0.32))
    kind = task.feeds if len(task.kinds) == 1 else "fed"
    upper.set(title=f"{kind} readings (counts)", xlabel="sensor")
    upper.set(ylim=(0, top), xlim=(-0.7, readings.shape[1] - 0.3))
    upper.set_xticks(range(0, readings.shape[1], 1 + readings.shape[1] // 10))
    lower = figure.add_axes(((wide + 0.35) / total, 0.13, 1.9 / total, 0.22))
    limit = max(10.0, float(np.abs(trajectory.commands).max(initial=0)))
    lower.set(title="wheel commands (−10 to 10)", ylim=(-limit, limit), xlim=(-0.7, 1.7))
    lower.set_xticks([0, 1], ["left", "right"])
    lower.axhline(0, color=style.MUTED, linewidth=0.7)
    bars = [
        *upper.bar(range(readings.shape[1]), 0, color=style.RAY, animated=True),
        *lower.bar([0, 1], 0, width=0.5, color=style.INK, animated=True),
    ]
    text = room.text(1.0, 1.03, "", ha="right", va="bottom", transform=room.transAxes, animated=True)
    return figure, room, bars, text


def _draw_bars(bars: list[Rectangle], trajectory: Trajectory, feeds: str, step: int) -> None:
    for bar, value in zip(bars, [*fed(trajectory, feeds)[step], *trajectory.commands[step]], strict=True):
        bar.set_height(float(value))
        assert bar.axes is not None
        bar.axes.draw_artist(bar)


def _save_gif(path: Path, pictures: Iterator[np.ndarray], seconds: float) -> None:
    """Write all frames with one palette, to avoid flicker."""
    from PIL import Image

    images = [Image.fromarray(picture) for picture in pictures]
    palette = images[-1].quantize(128)
    small = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    small[0].save(path, save_all=True, append_images=small[1:], duration=round(1000 * seconds), loop=0)


def _save_mp4(path: Path, pictures: Iterator[np.ndarray], rate: float) -> None:
    """H.264 where this PyAV has it, MPEG-4 otherwise."""
    import av

    codec = "libx264" if "libx264" in av.codecs_available else "mpeg4"
    with av.open(str(path), "w") as film:
        stream: Any = None
        for picture in pictures:
            if stream is None:
                stream = film.add_stream(codec, rate=Fraction(rate).limit_denominator(1000))
                stream.height, stream.width = (n - n % 2 for n in picture.shape[:2])
                stream.pix_fmt = "yuv420p"
            even = np.ascontiguousarray(picture[: stream.height, : stream.width])
            film.mux(stream.encode(av.VideoFrame.from_ndarray(even, format="rgb24")))
        if stream is not None:
            film.mux(stream.encode())
