"""Figures 1 and 2: the arenas to scale, in cm, with a robot, its sensors and their rays."""

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle

from realitygap.kernels.types import RAYS, Arena, Robot
from realitygap.report import style
from realitygap.report.robots import F, draw_robot
from realitygap.report.style import COLUMN, new_figure
from realitygap.world import arena as world
from realitygap.world.robot import Profile
from realitygap.world.sensors import RAY_ANGLES_DEG

__all__ = ["arena_figure", "cast", "draw_arena", "draw_start", "rays_of", "sensor_rays"]

AMBIENT_RAYS_CM = 15.0
"""Only walls end the ambient sensors' rays: a picture shows this much of them."""


def draw_arena(ax: Axes, arena: Arena, *, labels: bool = True, names: bool = False) -> None:
    """Floor, walls, inner walls, cylinders and lamps of an arena, to scale; the axes become cm.

    Args:
        ax: where to draw.
        arena: in the kernels' form.
        labels: axes with ticks in cm; otherwise nothing but the picture.
        names: write "lamp" at the lamps.
    """
    width, depth = (float(v) for v in arena.size)
    edge = 0.02 * max(width, depth)
    floor = Rectangle((0, 0), width, depth, facecolor=style.FLOOR, edgecolor=style.WALL, linewidth=1.6)
    ax.add_artist(floor).set(zorder=0)
    for x, y, radius in arena.cylinders.reshape(-1, 3):
        post = Circle((x, y), radius, facecolor=style.CYLINDER, edgecolor=style.WALL, linewidth=0.8, zorder=1)
        ax.add_artist(post)
    _name_surfaces(ax, arena)
    segments = arena.segments.reshape(-1, 2, 2)
    if len(segments):
        ax.add_collection(LineCollection(list(segments), colors=style.WALL, linewidths=1.6, zorder=1))
    _draw_lamps(ax, arena, names=names)
    right = width + edge * (1.6 if len(arena.lamp_centre) else 1.0)
    ax.set(xlim=(-edge, right), ylim=(-edge, depth + edge), aspect="equal")
    ax.spines[:].set_visible(False)
    if labels:
        ax.set(xlabel="x (cm)", ylabel="y (cm)", xticks=_ticks(width), yticks=_ticks(depth))
    else:
        ax.set(xticks=[], yticks=[])


def _name_surfaces(ax: Axes, arena: Arena) -> None:
    """Write the reflectance on surfaces that state one, relative to usual ones."""
    words: dict[str, Any] = {"color": style.INK, "fontsize": 6, "zorder": 1.5}
    walls, posts = arena.reflectance[:1], zip(arena.cylinders, arena.reflectance[1:], strict=False)
    for (x, y, _), value in posts:
        ax.text(x, y, f"×{value:g}", ha="center", va="center", **words)
    x, y = (0.02 * arena.size).tolist()
    for value in walls:
        ax.text(x, y, f"walls ×{value:g}", ha="left", va="bottom", **words)


def _ticks(length: float) -> list[float]:
    """Round values from 0 to `length`, at most seven."""
    gap = next(g for g in (1, 2, 5, 10, 20, 50, 100, 200, 500, math.inf) if length / g <= 6)
    return [k * gap for k in range(int(length / gap) + 1)] if gap < math.inf else [0.0, length]


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


def cast(arena: Arena, origin: F, direction: F) -> F:
    """Distance in cm from each origin [N, 2] along each unit vector [N, 2] to the nearest surface."""
    width, depth = arena.size
    walls = np.array(
        [[0, 0, width, 0], [width, 0, width, depth], [width, depth, 0, depth], [0, depth, 0, 0]], dtype=float
    )
    distance = np.full(len(origin), np.inf)
    for x0, y0, x1, y1 in np.concatenate([walls, arena.segments.reshape(-1, 4)]):
        along = np.array([x1 - x0, y1 - y0])
        across = direction[:, 0] * along[1] - direction[:, 1] * along[0]
        start = np.array([x0, y0]) - origin
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = (start[:, 0] * along[1] - start[:, 1] * along[0]) / across
            place = (start[:, 0] * direction[:, 1] - start[:, 1] * direction[:, 0]) / across
        met = (across != 0) & (reach >= 0) & (place >= 0) & (place <= 1)
        distance = np.where(met & (reach < distance), reach, distance)
    for x, y, radius in arena.cylinders.reshape(-1, 3):
        start = np.array([x, y]) - origin
        middle = (start * direction).sum(axis=1)
        miss = (start**2).sum(axis=1) - middle**2
        half = np.sqrt(np.maximum(radius**2 - miss, 0.0))
        met = (miss < radius**2) & (middle - half >= 0)
        distance = np.where(met & (middle - half < distance), middle - half, distance)
    return distance


def sensor_rays(arena: Arena, place: F, facing: F, pose: tuple[float, float, float], reach: F | float) -> F:
    """Ends of the rays of all sensors, [S · RAYS, 2 ends, 2] in cm.

    Args:
        place, facing: [S, 2] cm, [S, 2] unit vectors; both in the robot's frame.
        pose: x, y (cm), heading (rad).
        reach: [S] cm: maximum length of each sensor's rays.
    """
    x, y, heading = pose
    turn = np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]])
    origin = np.repeat(place @ turn.T + (x, y), RAYS, axis=0)
    beta = np.radians(RAY_ANGLES_DEG)
    aside = np.stack([-facing[:, 1], facing[:, 0]], axis=1)
    ray = np.cos(beta)[:, None] * facing[:, None] + np.sin(beta)[:, None] * aside[:, None]
    direction = (ray @ turn.T).reshape(-1, 2)
    bound = np.repeat(np.broadcast_to(np.asarray(reach, dtype=float), len(place)), RAYS)
    length = np.minimum(cast(arena, origin, direction), bound)
    return np.stack([origin, origin + length[:, None] * direction], axis=1)


def _draw_rays(ax: Axes, robot: Robot, arena: Arena, feeds: str, pose: tuple[float, float, float]) -> None:
    """Draw the rays of the sensors that a task feeds."""
    rays = rays_of(robot, arena, feeds, pose)
    ax.add_collection(LineCollection(list(rays), colors=style.RAY, linewidths=0.45, zorder=3))
    ax.plot(*rays[::RAYS, 0].T, "o", color=style.RAY, markersize=1.8, zorder=6)


def rays_of(robot: Robot, arena: Arena, feeds: str, pose: tuple[float, float, float]) -> F:
    """Rays of the fed sensors, to the first surface or their range: [rays, 2 ends, 2] cm.

    Args:
        robot: the robot.
        arena: the room.
        feeds: as in a task.
        pose: x, y (cm), heading (rad).
    """
    found = []
    for kind in feeds.split("+"):
        if kind == "proximity":
            reach = np.where(np.isfinite(robot.proximity.reach), robot.proximity.reach, AMBIENT_RAYS_CM)
            found.append(sensor_rays(arena, robot.proximity.place, robot.proximity.facing, pose, reach))
        else:
            found.append(sensor_rays(arena, robot.ambient.place, robot.ambient.facing, pose, AMBIENT_RAYS_CM))
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


def arena_figure(room: world.Arena, profile: Profile, feeds: str, start: np.ndarray) -> Figure:
    """Figure 1 or 2: a task's arena to scale, with a robot and the rays of its fed sensors.

    Args:
        room: the task's arena.
        profile: the robot.
        feeds: "proximity", "ambient" or "proximity+ambient".
        start: where trials begin, as for `draw_start`.
    """
    arena, robot = room.to_kernel(), profile.to_kernel()
    width, depth = (float(v) for v in arena.size)
    wide = min(1.6 * COLUMN, 3.3 * max(width / depth, 0.7) ** 0.75)
    figure = new_figure(wide, (wide - 0.6) * depth / width + 0.55, layout="constrained")
    ax = figure.add_subplot()
    draw_arena(ax, arena, names=True)
    pose = _sensing_pose(room, robot, start)
    _draw_rays(ax, robot, arena, feeds, pose)
    draw_robot(ax, robot, pose)
    draw_start(ax, start)
    return figure
