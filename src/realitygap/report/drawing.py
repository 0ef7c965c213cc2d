"""Pictures of what drives: the robot, its arena to scale, its paths, and films of them.

Figures 1 and 2 are arenas with a robot and its rays; 3 and 5 are paths with the paper's tails, "constructed
by failing to erase a line, plotted on each previous time step" (§6). All lengths are in cm.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, Polygon, Rectangle, Wedge
from matplotlib.text import Text
from matplotlib.ticker import MaxNLocator

from realitygap.errors import UsageError
from realitygap.files import atomic_path
from realitygap.kernels.types import RAYS, Arena, Robot
from realitygap.report import style
from realitygap.report.style import COLUMN, PAGE, SIMULATED, Look, new_figure, noise_styles, styled
from realitygap.tasks.task import Task
from realitygap.track import Track, Trajectory
from realitygap.values import Floats, fed
from realitygap.world import arena as world
from realitygap.world.robot import Profile
from realitygap.world.sensors import RAY_ANGLES_DEG

__all__ = [ "LIT_RAYS_CM", "PICTURES", "WHEEL_CM", "PathPanel", "Scene", "arena_figure",
    "draw_arena", "draw_path", "draw_robot", "frames", "front", "paths_figure", "rays_of", "robot_figure",
    "room_figure", "save_animation", "save_picture", "shown_sensors", "tail",
]  # fmt: skip

WHEEL_CM = (1.9, 0.45)
"""Length and width of a drawn wheel."""
DISC_CM = 0.34
"""Radius of a drawn sensor: nearer than this, two are one, as a calibration places them."""
LIT_RAYS_CM = 15.0
"""Only walls end the ambient sensors' rays: a picture shows this much of them."""
TALLEST = 3.0
"""A figure's arena is at most so many times as high as wide: a longer one is drawn narrower."""
PICTURES = (".png", ".svg", ".pdf")
FILMS = (".gif", ".mp4")
DPI = 100


# The robot


def draw_robot(
    ax: Axes, robot: Robot, pose: tuple[float, float, float], look: Look = SIMULATED, *, edge: str = style.INK
) -> list[Patch | Line2D]:
    """Draw a robot to scale at a pose (x, y in cm, heading in rad): body, wheels, a line to its leading edge.

    Returns its artists.
    """
    x, y, heading = pose
    cos, sin = math.cos(heading), math.sin(heading)
    turned = robot.outline[:, :2] @ np.array([[cos, sin], [-sin, cos]]) + (x, y)
    body = Polygon(turned, closed=True) if len(turned) else Circle((x, y), robot.radius)
    body.set(facecolor=look.body, edgecolor=edge, linestyle=look.line, linewidth=1.1, zorder=5)
    length, width = WHEEL_CM[0] / 2, WHEEL_CM[1] / 2
    shapes: list[Patch] = [body]
    for side in (1, -1):
        inner, outer = (side * (robot.wheels.track / 2 - width) + part for part in (-width, width))
        corners = np.array([[length, inner], [length, outer], [-length, outer], [-length, inner]])
        turned = corners @ np.array([[cos, sin], [-sin, cos]]) + (x, y)
        shapes.append(Polygon(turned, closed=True, facecolor=edge, linewidth=0, zorder=5.1))
    for shape in shapes:
        ax.add_artist(shape)  # unlike add_patch it measures nothing: the limits are set
    ahead = front(robot)
    tip = (x + ahead * cos, y + ahead * sin)
    line = ax.plot([x, tip[0]], [y, tip[1]], color=edge, linewidth=1.3, zorder=5.2, solid_capstyle="butt")
    return [*shapes, *line]


def front(robot: Robot) -> float:
    """Distance from the axle's middle to the body's edge ahead, cm."""
    x, y, nx, ny = robot.outline[robot.outline[:, 2] > 0].T
    return float(((nx * x + ny * y) / nx).min(initial=robot.radius))


def robot_figure(profile: Profile) -> Figure:
    """The robot enlarged: its sensors with their numbers and directions, its wheels, a scale."""
    robot = profile.to_kernel()
    figure = new_figure(2.6, 2.7, layout="constrained")
    ax = figure.add_subplot()
    span = robot.radius * 1.75
    draw_robot(ax, robot, (0.0, 0.0, math.pi / 2))
    arrow = {"arrowstyle": "-|>", "color": style.RAY, "lw": 0.8, "mutation_scale": 6}
    for place, ahead, name in shown_sensors(robot):  # a half disc in its direction, an arrow and a number
        spot, facing = np.array([-place[1], place[0]]), math.atan2(ahead[1], ahead[0]) + math.pi / 2
        out, turn = np.array([math.cos(facing), math.sin(facing)]), math.degrees(facing)
        disc = Wedge(tuple(spot), DISC_CM, turn - 90, turn + 90, facecolor=style.RAY, edgecolor="none")
        ax.add_artist(disc).set(zorder=6)
        ax.annotate("", tuple(spot + 1.35 * out), tuple(spot + DISC_CM * out), zorder=6, arrowprops=arrow)
        x, y = spot + 1.75 * out
        ax.text(x, y, name, ha="center", va="center", fontsize=8, zorder=7)
    ax.plot([-robot.radius, robot.radius], [-span * 0.93] * 2, color=style.INK, linewidth=0.9, marker="|")
    ax.text(0, -span * 0.98, f"{2 * robot.radius:.3g} cm", ha="center", va="top", fontsize=7.5)
    ax.set(xlim=(-span, span), ylim=(-span * 1.12, span), aspect="equal")
    ax.axis("off")
    return figure


def shown_sensors(robot: Robot) -> Iterator[tuple[Floats, Floats, str]]:
    """Place, direction and number of every sensor, except ambient ones at a proximity sensor's place."""
    for i, (place, ahead) in enumerate(zip(robot.proximity.place, robot.proximity.facing, strict=True)):
        yield place, ahead, str(i)
    for i, (place, ahead) in enumerate(zip(robot.ambient.place, robot.ambient.facing, strict=True)):
        if np.hypot(*(robot.proximity.place - place).T).min(initial=np.inf) > DISC_CM:
            yield place, ahead, f"a{i}"


# The arena


def draw_arena(ax: Axes, arena: Arena, *, labels: bool = True, names: bool = False) -> None:
    """Floor, walls, inner walls, cylinders and lamps of an arena, to scale; the axes become cm.

    `labels`: axes with ticks in cm, otherwise nothing but the picture; `names`: write "lamp" at the lamps.
    """
    width, depth = (float(v) for v in arena.size)
    edge = 0.02 * max(width, depth)
    floor = Rectangle((0, 0), width, depth, facecolor=style.FLOOR, edgecolor=style.WALL, linewidth=1.6)
    ax.add_artist(floor).set(zorder=0)
    for x, y, radius in arena.cylinders.reshape(-1, 3):
        post = Circle((x, y), radius, facecolor=style.CYLINDER, edgecolor=style.WALL, linewidth=0.8, zorder=1)
        ax.add_artist(post)
    words: dict[str, Any] = {"color": style.INK, "fontsize": 6, "zorder": 1.5}
    for (x, y, _), value in zip(arena.cylinders, arena.reflectance[1:], strict=False):
        ax.text(x, y, f"×{value:g}", ha="center", va="center", **words)
    for value in arena.reflectance[:1]:  # of surfaces that state one, relative to usual ones
        ax.text(0.02 * width, 0.02 * depth, f"walls ×{value:g}", ha="left", va="bottom", **words)
    segments = arena.segments.reshape(-1, 2, 2)
    if len(segments):
        ax.add_collection(LineCollection(list(segments), colors=style.WALL, linewidths=1.6, zorder=1))
    _draw_lamps(ax, arena, names=names)
    right = width + edge * (1.6 if len(arena.lamp_centre) else 1.0)
    ax.set(xlim=(-edge, right), ylim=(-edge, depth + edge), aspect="equal")
    ax.spines[:].set_visible(False)
    if labels:
        ax.set(xlabel="x (cm)", ylabel="y (cm)")
        for axis in (ax.xaxis, ax.yaxis):
            axis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
    else:
        ax.set(xticks=[], yticks=[])


def _draw_lamps(ax: Axes, arena: Arena, *, names: bool) -> None:
    """Each lamp's points as dots with a half glow about its centre."""
    for points, centre in zip(arena.lamp_points, arena.lamp_centre, strict=True):
        for radius, alpha in ((9.0, 0.12), (6.0, 0.18), (3.2, 0.3)):
            glow = Circle(tuple(centre), radius, facecolor=style.LAMP, edgecolor="none", alpha=alpha)
            ax.add_artist(glow).set(zorder=0.5)
            glow.set_clip_path(Rectangle((0, 0), *arena.size, transform=ax.transData))
        ax.plot(
            *points.T, "o", color=style.LAMP, markersize=3.2, zorder=4, markeredgecolor=style.WALL,
            markeredgewidth=0.5, clip_on=False,
        )  # fmt: skip
        if names:
            aside, side = (-10, "right") if centre[0] > arena.size[0] / 2 else (10, "left")
            up = float(np.interp(centre[1] / arena.size[1], (0.05, 0.1, 0.9, 0.95), (8, 0, 0, -8)))
            ax.annotate(
                "lamp", tuple(centre), xytext=(aside, up), textcoords="offset points", ha=side, va="center",
                fontsize=7.5,
            )  # fmt: skip


def draw_start(ax: Axes, start: np.ndarray) -> None:
    """The disc that starts are drawn from ([5]: x, y, radius, lowest and highest heading), and its name.

    The name is below it, or beside it where the lower wall is near.
    """
    x, y, radius = (float(v) for v in start[:3])
    if radius > 0:
        disc = Circle((x, y), radius, fill=False, edgecolor=style.INK, linewidth=1.0, linestyle=(0, (2, 1.5)))
        ax.add_artist(disc).set(zorder=7)
    else:
        ax.plot([x], [y], "+", color=style.INK, markersize=6, markeredgewidth=1.0, zorder=7)
    line = {"arrowstyle": "-", "color": style.INK, "lw": 0.7, "shrinkA": 1, "shrinkB": 0}
    low, high = ax.get_ylim()
    if y - radius > 0.4 * (high - low):
        tip, words, sides = (x, y - radius), (0, -32), ("center", "top")
    else:
        tip, words, sides = (x + radius, y), (10, 0), ("left", "center")
    ax.annotate(
        "start", tip, xytext=words, textcoords="offset points", ha=sides[0], va=sides[1],
        fontsize=7.5, zorder=8, arrowprops=line,
    )  # fmt: skip


def cast(arena: Arena, origin: Floats, direction: Floats) -> Floats:
    """Distance in cm from each origin [N, 2] along each unit vector [N, 2] to the nearest surface."""
    width, depth = arena.size
    walls = np.array(
        [[0, 0, width, 0], [width, 0, width, depth], [width, depth, 0, depth], [0, depth, 0, 0]], dtype=float
    )
    distance = np.full(len(origin), np.inf)
    for x0, y0, x1, y1 in np.concatenate([walls, arena.segments.reshape(-1, 4)]):
        along, start = np.array([x1 - x0, y1 - y0]), np.array([x0, y0]) - origin
        across = direction[:, 0] * along[1] - direction[:, 1] * along[0]
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = (start[:, 0] * along[1] - start[:, 1] * along[0]) / across
            place = (start[:, 0] * direction[:, 1] - start[:, 1] * direction[:, 0]) / across
        hit = (across != 0) & (reach >= 0) & (place >= 0) & (place <= 1)
        distance = np.where(hit & (reach < distance), reach, distance)
    for x, y, radius in arena.cylinders.reshape(-1, 3):
        start = np.array([x, y]) - origin
        middle = (start * direction).sum(axis=1)
        miss = (start**2).sum(axis=1) - middle**2
        reach = middle - np.sqrt(np.maximum(radius**2 - miss, 0.0))
        hit = (miss < radius**2) & (reach >= 0)
        distance = np.where(hit & (reach < distance), reach, distance)
    return distance


def rays_of(robot: Robot, arena: Arena, feeds: str, pose: tuple[float, float, float]) -> Floats:
    """Rays of the sensors that a task feeds, from a pose (x, y in cm, heading in rad) to the first surface or
    their range: [rays, 2 ends, 2] cm."""
    x, y, heading = pose
    turn = np.array([[np.cos(heading), np.sin(heading)], [-np.sin(heading), np.cos(heading)]])
    found = []
    for kind in feeds.split("+"):
        sensors = robot.proximity if kind == "proximity" else robot.ambient
        reach = robot.proximity.reach if kind == "proximity" else np.full(len(sensors.place), np.inf)
        origin = np.repeat(sensors.place @ turn + (x, y), RAYS, axis=0)
        facing = np.arctan2(sensors.facing[:, 1], sensors.facing[:, 0])
        angle = (heading + facing[:, None] + np.radians(RAY_ANGLES_DEG)).ravel()
        direction = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        bound = np.repeat(np.where(np.isfinite(reach), reach, LIT_RAYS_CM), RAYS)
        length = np.minimum(cast(arena, origin, direction), bound)
        found.append(np.stack([origin, origin + length[:, None] * direction], axis=1))
    return np.concatenate(found)


def _sensing_pose(arena: world.Arena, robot: Robot, start: np.ndarray) -> tuple[float, float, float]:
    """Pose of the robot in figure 1: its start, or beside an obstacle where starts are a region."""
    x, y, region = (float(v) for v in start[:3])
    heading = float(start[3]) if start[4] - start[3] < 6.28 else 0.0
    radius = float(robot.radius)
    if region <= 0:
        return x, y, heading
    places = [
        (x + d * math.cos(h), y + d * math.sin(h), h)
        for d in np.arange(region + 1.7 * radius, region + 12 * radius, 0.5)
        for h in np.radians(np.arange(30, 390, 10))
    ]
    for px, py, h in places:
        if not arena.obstacle_at(px, py, radius + 1.5) and arena.obstacle_at(px, py, radius + 3.0):
            return px, py, h
    return x, y, heading


def arena_figure(place: world.Arena, profile: Profile, feeds: str, start: np.ndarray) -> Figure:
    """Figure 1 or 2: a task's arena to scale, with a robot and the rays of the sensors that it feeds.

    `start` is as for `draw_start`.
    """
    arena, robot = place.to_kernel(), profile.to_kernel()
    wide = min(1.6 * COLUMN, 3.3 * max(1 / steepness(arena), 0.7) ** 0.75)
    figure = new_figure(wide, (wide - 0.6) * steepness(arena) + 0.55, layout="constrained")
    ax = figure.add_subplot()
    draw_arena(ax, arena, names=True)
    pose = _sensing_pose(place, robot, start)
    rays = rays_of(robot, arena, feeds, pose)
    ax.add_collection(LineCollection(list(rays), colors=style.RAY, linewidths=0.45, zorder=3))
    ax.plot(*rays[::RAYS, 0].T, "o", color=style.RAY, markersize=1.8, zorder=6)
    draw_robot(ax, robot, pose)
    draw_start(ax, start)
    return figure


def room_figure(place: world.Arena) -> Figure:
    """An arena alone, with the names of what is in it."""
    figure = new_figure(4.0, 4.0 * steepness(place.to_kernel()), layout="constrained")
    draw_arena(figure.add_subplot(), place.to_kernel(), names=True)
    return figure


def steepness(arena: Arena) -> float:
    """Height of an arena's picture over its width, at most `TALLEST`."""
    return min(TALLEST, float(arena.size[1] / arena.size[0]))


# Paths


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


def paths_figure(
    scene: Scene, rows: Sequence[Sequence[PathPanel]], *, heads: Sequence[str] = (), small: bool = False
) -> Figure:
    """Paths in rows of panels, all arenas at one scale.

    Args:
        scene: arena and robot.
        rows: the panels; only `small` ones may be in rows of different lengths.
        heads: a line above each column.
        small: without axes, on a page's whole width: for many runs.
    """
    styles = noise_styles([*scene.levels, *(panel.noise for row in rows for panel in row)])
    columns = max(len(row) for row in rows)
    left, bottom, gap, head = (0.06, 0.06, 0.1, 0.2) if small else (0.46, 0.42, 0.14, 0.27)
    wide = PAGE if small else 3.4 if columns == 1 else min(PAGE, 2.6 * columns + 0.3)
    cell = (wide - left - 0.06 - gap * (columns - 1)) / columns
    tall = cell * steepness(scene.arena)
    height = bottom + len(rows) * (tall + head) + (0.11 if heads else 0.0)
    figure = new_figure(wide, height)  # laid out by hand: cheap and deterministic
    for c, text in enumerate(heads):
        spot = (left + c * (cell + gap)) / wide
        figure.text(spot, 1 - 0.02 / height, text, fontsize=9, fontweight="bold", color=style.INK, va="top")
    for r, row in enumerate(rows):
        for c, panel in enumerate(row):
            box = (left + c * (cell + gap), bottom + (len(rows) - 1 - r) * (tall + head))
            ax = figure.add_axes((box[0] / wide, box[1] / height, cell / wide, tall / height))
            colour = styles[panel.noise].colour
            draw_path(ax, scene, panel.trajectory, colour=colour, look=panel.look, labels=not small)
            if not small and c > 0:  # the neighbour to the left, or below, has them
                ax.set(ylabel="", yticklabels=[])
            if not small and r + 1 < len(rows):
                ax.set(xlabel="", xticklabels=[])
            ax.set_title(panel.title, fontsize=7 if small else 8.5, pad=3, loc="left", color=style.INK)
    return figure


# Pictures and films of one trajectory


def checked_ending(path: str | Path, allowed: tuple[str, ...]) -> Path:
    """The path, if its file ending is among the allowed ones."""
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
    wide = 4.6 if steepness(scene.arena) <= 1 else 3.4

    def draw() -> Figure:
        figure = new_figure(wide, (wide - 0.6) * steepness(scene.arena) + 0.75, layout="constrained")
        ax = figure.add_subplot()
        draw_path(ax, scene, trajectory)
        ax.set_title(title, loc="left")
        return figure

    style.write_figure(draw, path)
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
        figure, axes, bars, text = _stage(task, profile, trajectory, title)
        canvas = FigureCanvasAgg(figure)
        strokes, readings = tail(trajectory, front(robot)).reshape(-1, 3, 2), fed(trajectory, task.feeds)
        draw_arena(axes, arena)
        canvas.draw()
        stroke = axes.plot([], [], color=style.INK, linewidth=0.9, animated=True, zorder=3)[0]
        kept = canvas.copy_from_bbox(figure.bbox)
        for step in range(len(trajectory.t)):
            canvas.restore_region(kept)
            stroke.set_data(*strokes[step, :2].T)
            axes.draw_artist(stroke)
            kept = canvas.copy_from_bbox(figure.bbox)  # every stroke stays: "failing to erase" (§6)
            pose = (trajectory.x[step], trajectory.y[step], trajectory.heading[step])
            for artist in draw_robot(axes, robot, pose):
                axes.draw_artist(artist)
                artist.remove()
            for bar, value in zip(bars, (*readings[step], *trajectory.commands[step]), strict=True):
                bar.set_height(float(value))
                figure.draw_artist(bar)
            text.set_text(f"{trajectory.t[step]:5.1f} s" + ("   touches" if trajectory.contact[step] else ""))
            axes.draw_artist(text)
            yield np.asarray(canvas.buffer_rgba())[:, :, :3].copy()


def _stage(
    task: Task, profile: Profile, trajectory: Trajectory, title: str
) -> tuple[Figure, Axes, list[Rectangle], Text]:
    """The empty picture: axes for the path, axes with bars for readings and commands, a clock."""
    width, depth = task.arena.size_cm
    tall = 4.0
    wide = max(1.8, min(7.0, (tall - 0.9) * width / depth + 0.8))
    figure = new_figure(round(wide + 2.4, 1), tall, dpi=DPI)
    total = float(figure.get_size_inches()[0])
    axes = figure.add_axes((0.6 / total, 0.13, (wide - 0.8) / total, 0.75))
    axes.set_title(title, loc="left")
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
    text = axes.text(1.0, 1.03, "", ha="right", va="bottom", transform=axes.transAxes, animated=True)
    return figure, axes, bars, text


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
