"""Figures show what they are given, to scale."""

from __future__ import annotations

import hashlib
import math
import resource
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.patches import Circle

from realitygap.report import style
from realitygap.report.arenas import arena_figure, cast, sensor_rays
from realitygap.report.curves import Curves, curves_figure, mean_curve
from realitygap.report.page import noise_key
from realitygap.report.paths import PathPanel, Scene, draw_path, panels_figure, sheet_figure, tail
from realitygap.report.robots import robot_figure
from realitygap.report.statistics import difference, mean_of, running_best, student
from realitygap.report.words import robot_words
from realitygap.tasks import load_task
from realitygap.world.arena import load_arena
from realitygap.world.robot import load_profile
from tests.report.scenes import LEVELS, circle

PROFILE = load_profile("paper")
TASKS = [load_task("avoidance"), load_task("light")]


@pytest.mark.parametrize("task", TASKS, ids=lambda task: task.name)
def test_an_arena_is_drawn_to_scale(task) -> None:
    """Axes are in cm with one scale for both, and every cylinder has its place and radius."""
    with style.styled():
        axes = arena_figure(task.arena, PROFILE, task.feeds, task.to_kernel(PROFILE).start).axes[0]
    assert axes.get_aspect() == 1.0
    assert "(cm)" in axes.get_xlabel() and "(cm)" in axes.get_ylabel()
    drawn = {(*patch.center, patch.radius) for patch in axes.patches if isinstance(patch, Circle)}
    assert {tuple(map(float, c)) for c in task.arena.to_kernel().cylinders} <= drawn


@pytest.mark.parametrize("size", [(100.0, 60.0), (300.0, 60.0)])
@pytest.mark.parametrize("y", [0.0, 30.0, 60.0])
def test_a_lamps_name_can_be_read(size: tuple[float, float], y: float) -> None:
    """It stands inside the room, off the wall that its lamp is on, and in a long room it is as large."""
    lamp = replace(TASKS[1].arena.lamps[0], x_cm=30.0, y_cm=y, line_deg=0.0)
    room = replace(TASKS[1].arena, size_cm=size, lamps=(lamp,))
    with style.styled():
        figure = arena_figure(room, PROFILE, "proximity", np.array([20.0, 30.0, 5.0, 0.0, 6.3]))
        figure.draw_without_rendering()
    axes = figure.axes[0]
    name = next(text for text in axes.texts if text.get_text() == "lamp").get_window_extent()
    (_, floor), (_, top) = axes.transData.transform([(0, 0), size])
    assert floor + 1 < name.y0 and name.y1 < top - 1
    assert figure.get_figwidth() <= 5.4


@pytest.mark.parametrize("name", ["obstacle-avoidance", "obstacle-avoidance-large"])
def test_the_starts_name_is_inside_the_room(name: str) -> None:
    """Below the starts in the paper's arena, beside them in a larger one, where the lower wall is near."""
    with style.styled():
        figure = arena_figure(load_arena(name), PROFILE, "proximity", np.array([25.0, 25.0, 3.0, 0.0, 6.3]))
        figure.draw_without_rendering()
    axes = figure.axes[0]
    words = next(text for text in axes.texts if text.get_text() == "start")
    floor = axes.transData.transform((0, 0))[1]
    assert words.get_window_extent().y0 > floor + 1


def test_what_surfaces_throw_back_is_written_on_them() -> None:
    """Where reflectances are stated those of walls and cylinders stand in the picture."""
    room = TASKS[0].arena
    first, *others = room.cylinders
    tinted = replace(room, reflectance=0.8, cylinders=(replace(first, reflectance=0.25), *others))
    for arena, words in ((room, []), (tinted, ["×0.25", "×1", "×1", "×1", "walls ×0.8"])):
        start = TASKS[0].to_kernel(PROFILE).start
        with style.styled():
            axes = arena_figure(arena, PROFILE, TASKS[0].feeds, start).axes[0]
        assert [text.get_text() for text in axes.texts if "×" in text.get_text()] == words


def test_rays_end_where_they_meet_something() -> None:
    """From the middle of the paper's arena: a wall at 25 cm ahead, a cylinder on the diagonal."""
    arena = TASKS[0].arena.to_kernel()
    away = np.array([[1.0, 0.0], [math.sqrt(0.5), math.sqrt(0.5)], [0.0, -1.0]])
    found = cast(arena, np.full((3, 2), 25.0), away)
    assert found == pytest.approx([25.0, math.hypot(10, 10) - 4.0, 25.0])


def test_rays_are_no_longer_than_a_sensor_reaches() -> None:
    """Ten rays a sensor, each from its sensor's place, none longer than the given reach."""
    robot = PROFILE.to_kernel()
    rays = sensor_rays(
        TASKS[0].arena.to_kernel(), robot.proximity.place, robot.proximity.facing, (25, 25, 0.3), 6.2
    )
    lengths = np.hypot(*(rays[:, 1] - rays[:, 0]).T)
    assert rays.shape == (80, 2, 2)
    assert lengths == pytest.approx(np.full(80, 6.2))


def test_a_tail_has_a_stroke_from_centre_to_leading_edge_for_every_step() -> None:
    """Strokes start at the path's places, are one radius long, point ahead, and are not joined."""
    trajectory = circle(50)
    strokes = tail(trajectory, 2.9).reshape(-1, 3, 2)
    assert len(strokes) == 51
    assert strokes[:-1, 0, 0] == pytest.approx(trajectory.x)
    along = strokes[:, 1] - strokes[:, 0]
    assert np.hypot(*along.T) == pytest.approx(np.full(51, 2.9))
    assert np.cos(np.arctan2(along[:-1, 1], along[:-1, 0]) - trajectory.heading) == pytest.approx(np.ones(50))
    assert np.isnan(strokes[:, 2]).all()


def test_a_trajectory_can_be_drawn_into_any_axes() -> None:
    """`draw_path` needs an Axes and where the robot drove."""
    with style.styled():
        axes = style.new_figure(3, 3).add_subplot()
        draw_path(axes, Scene.of(TASKS[0], PROFILE), circle())
    assert any(len(line.get_xdata()) == 3 * 51 for line in axes.lines)


def test_panels_and_sheets_hold_every_path() -> None:
    """A panel for each path, rows of different lengths included."""
    panels = [PathPanel(noise=level, title=name, trajectory=circle(10)) for level, name in LEVELS.items()]
    with style.styled():
        assert len(panels_figure(Scene.of(TASKS[1], PROFILE), panels).axes) == 3
        assert len(panels_figure(Scene.of(TASKS[1], PROFILE), panels[:1]).axes) == 1
        assert len(sheet_figure(Scene.of(TASKS[0], PROFILE), [panels, panels[:2], panels[:1]]).axes) == 6


def test_a_curve_is_the_mean_of_the_runs_with_its_interval() -> None:
    """The 95 % interval of a mean of five holds the true mean in about 95 of 100 cases, not in 80."""
    random = np.random.default_rng(1)
    held = []
    for _ in range(400):
        mean, half = mean_curve(random.normal(3.0, 1.0, (5, 1)))
        held.append(abs(mean[0] - 3.0) <= half[0])
    assert 0.92 <= np.mean(held) <= 0.98


def test_a_curve_goes_as_far_as_all_runs_do() -> None:
    """Runs of an unfinished study are averaged over the evaluations that all of them have."""
    mean, half = mean_curve([np.arange(10.0), np.arange(7.0)])
    assert mean == pytest.approx(np.arange(7.0)) and half == pytest.approx(np.zeros(7))


@pytest.mark.parametrize("runs", [1, 5])
def test_curves_have_units_and_an_entry_for_each_noise_level(runs: int) -> None:
    """Also for a single run, which has no band."""
    curves = {level: [running_best(np.linspace(0, 1, 20))] * runs for level in LEVELS}
    with style.styled():
        axes = curves_figure(
            Curves(runs=curves, names=LEVELS, unit="10⁻⁶ cm⁻²", scale=1e-6, fresh={1.0: 0.5})
        ).axes[0]
    assert "10⁻⁶ cm⁻²" in axes.get_ylabel()
    assert [text.get_text() for text in axes.get_legend().get_texts()] == list(LEVELS.values())
    assert len(axes.collections) == (3 if runs > 1 else 0)


@pytest.mark.parametrize("fresh", [0.02, -0.3])
def test_curves_are_not_pressed_flat_or_covered(fresh: float) -> None:
    """Two unlike runs' interval does not set the scale; no legend covers a curve or an open marker."""
    runs = [np.linspace(0.1, 0.2, 20), np.linspace(0.1, 0.6, 20)]
    with style.styled():
        figure = curves_figure(Curves(runs={1.0: runs}, names={1.0: LEVELS[1.0]}, fresh={1.0: fresh}))
        figure.draw_without_rendering()
    axes = figure.axes[0]
    low, high = axes.get_ylim()
    assert low == pytest.approx(min(0, fresh)) and 0.6 < high < 0.75
    legend = axes.get_legend().get_window_extent()
    for line in axes.lines:
        assert not legend.count_contains(axes.transData.transform(line.get_xydata()))


def test_running_best_never_falls() -> None:
    """It is the highest fitness so far."""
    assert running_best([1, 3, 2, 4]).tolist() == [1, 3, 3, 4]


def test_statistics_agree_with_scipy() -> None:
    """Student's t and Welch's interval are those of SciPy."""
    stats = pytest.importorskip("scipy.stats")
    for freedom in (1, 4, 25, 26, 40, 199):
        assert student(freedom) == pytest.approx(stats.t.ppf(0.975, freedom), rel=1e-3)
    first, second = [1.0, 2.0, 3.0, 4.0, 7.0], [2.0, 2.5, 2.0, 3.0, 1.0]
    gap = difference(first, second)
    interval = stats.ttest_ind(first, second, equal_var=False).confidence_interval(0.95)
    assert gap is not None
    assert gap.value + gap.half == pytest.approx(interval.high, rel=0.05)
    assert mean_of([]) is None and math.isnan(mean_of([2.0]).half)


def test_noise_levels_keep_their_look() -> None:
    """Zero, observed and double look the same whatever else is shown, and nothing is told by colour alone."""
    shown = style.noise_styles([0, 0.5, 1, 1.5, 2])
    assert all(shown[level] == style.noise_styles([level])[level] for level in (0.0, 1.0, 2.0))
    assert len({(s.colour) for s in shown.values()}) == len({s.marker for s in shown.values()}) == 5
    assert len({str(s.line) for s in shown.values()}) == 5
    many = style.noise_styles([k / 4 for k in range(11)])
    assert len({(s.marker, str(s.line)) for s in many.values()}) == 11
    assert all(sign for _, _, sign in noise_key(dict.fromkeys(many, "")))


def test_a_level_looks_the_same_in_all_figures_of_a_page() -> None:
    """Also where only some levels have runs, or drove a robot."""
    look = style.noise_styles([0.5, 1.5])[1.5]
    assert look != style.noise_styles([1.5])[1.5]
    path = PathPanel(noise=1.5, title="", trajectory=circle())
    with style.styled():
        paths = panels_figure(Scene.of(TASKS[0], PROFILE)._replace(levels=(0.5, 1.5)), [path])
        curves = curves_figure(Curves(runs={1.5: [np.linspace(0, 1, 20)]}, names={0.5: "", 1.5: "1.5 noise"}))
    assert curves.axes[0].lines[0].get_color() == look.colour
    assert curves.axes[0].lines[0].get_marker() == look.marker
    assert look.colour in {line.get_color() for line in paths.axes[0].lines}


@pytest.mark.parametrize(("share", "names"), [(0.97, ""), (0.5, "a0 a1 a2 a3 a4 a5 a6 a7")])
def test_sensors_that_a_calibration_moved_apart_are_drawn_as_one(share: float, names: str) -> None:
    """A light sensor a millimetre from an infrared one has no number of its own, to cover that one's."""
    light = PROFILE.ambient
    moved = tuple(replace(one, x_cm=share * one.x_cm, y_cm=share * one.y_cm) for one in light.sensors)
    robot = replace(PROFILE, ambient=replace(light, sensors=moved))
    with style.styled():
        shown = [text.get_text() for text in robot_figure(robot).axes[0].texts]
    wanted = [*"01234567", *names.split()]
    assert [name for name in shown if name and "cm" not in name] == wanted
    assert f": {len(wanted)} sensors " in robot_words(robot).caption


def test_a_figure_is_written_to_the_same_bytes(tmp_path: Path) -> None:
    """Two drawings of one thing are the same files, and SVG text stays text."""
    prints = []
    for name in "ab":
        folder = tmp_path / name
        folder.mkdir()
        with style.styled():
            svg = style.save_figure(robot_figure(PROFILE), folder, "robot", dpi=60)
        prints.append(
            [hashlib.sha256((folder / f"robot.{e}").read_bytes()).hexdigest() for e in ("png", "svg")]
        )
        assert ">5.8 cm</text>" in svg
    assert prints[0] == prints[1]


def test_a_figure_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    """On a full disk the earlier files stay, and nothing lies beside them."""
    names = {tmp_path / f"robot.{ending}" for ending in ("png", "svg")}
    for name in names:
        name.write_text("earlier")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))
    try:
        with style.styled(), pytest.raises(OSError, match=f"File too large: '{tmp_path / 'robot.png'}'"):
            style.save_figure(robot_figure(PROFILE), tmp_path, "robot", dpi=60)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert {*tmp_path.iterdir()} == names and all(name.read_text() == "earlier" for name in names)


def test_an_inline_svg_has_ids_of_its_own_and_the_pages_colours(tmp_path: Path) -> None:
    """Two figures on one page do not share an id; ink follows light and dark; the blind are told."""
    with style.styled():
        svg = style.save_figure(robot_figure(PROFILE), tmp_path, "robot", dpi=60)
    text = style.inline_svg(svg, "robot", 'A "robot" & more')
    assert text.startswith("<svg ") and 'aria-label="A &quot;robot&quot; &amp; more"' in text
    assert "var(--ink, " in text and "<metadata" not in text
    assert 'id="robot-figure_1"' in text and 'id="figure_1"' not in text
