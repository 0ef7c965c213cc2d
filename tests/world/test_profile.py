"""Robot profiles: the paper's constants, what the kernels get, and every refusal by key."""

import math
from collections import namedtuple
from dataclasses import replace

import numpy as np
import pytest

from realitygap.errors import ConfigError, RealityGapWarning
from realitygap.kernels import types
from realitygap.kernels.types import EYES
from realitygap.world.robot import Body, Profile, largest_pole, load_profile, profile_names
from realitygap.world.sensors import UNLIT

PARTS = ("wheels", "proximity", "ambient", "light", "noise")


@pytest.fixture(scope="module")
def paper() -> Profile:
    """The paper's robot."""
    return load_profile("paper")


@pytest.fixture
def refused(paper, tmp_path):
    """Write the paper's profile with one text replaced; return the words it is refused with."""

    def refuse(old: str, new: str) -> str:
        text = paper.to_toml()
        assert old in text
        file = tmp_path / "mine.toml"
        file.write_text(text.replace(old, new, 1), encoding="utf-8")
        with pytest.raises(ConfigError) as caught:
            load_profile(file)
        message = str(caught.value)
        assert message.startswith(f"{file}: ")
        assert "\n" not in message
        return message.removeprefix(f"{file}: ")

    return refuse


def test_the_papers_constants(paper):
    """The profile `paper` holds the constants that §3 prints."""
    assert 2 * paper.body.radius_cm == 5.8
    assert (paper.wheels.kp, paper.wheels.ki, paper.wheels.kd, paper.wheels.divisor) == (
        3800,
        800,
        100,
        50000,
    )
    assert {(s.a, s.b) for s in paper.infrared.sensors} == {(3515.0, -91.4)}
    assert (paper.ambient.floor, paper.ambient.reflectance, paper.ambient.exponent) == (55, 1.5, 2)
    assert len(paper.infrared.sensors) == len(paper.ambient.sensors) == 8


def test_the_papers_wheels_settle(paper):
    """The law as read has its largest pole at 0.804 (docs/differences.md)."""
    wheels = paper.wheels
    assert largest_pole(wheels.kp, wheels.ki, wheels.kd, wheels.divisor) == pytest.approx(0.8037, abs=1e-4)


def test_rays_of_the_kernels(paper):
    """Ten rays from −81° to +81° about each sensor, weighed cos β and 1.5 cos² β, as five mirrored pairs."""
    robot = paper.to_kernel()
    beta = np.radians(np.arange(-81, 0, 18))
    np.testing.assert_allclose(robot.proximity.fan, [np.cos(beta), np.sin(beta), np.cos(beta)], atol=1e-7)
    np.testing.assert_allclose(robot.ambient.fan[2], 1.5 * np.cos(beta) ** 2, rtol=1e-6)
    angles = np.radians([sensor.direction_deg for sensor in paper.infrared.sensors])
    np.testing.assert_allclose(
        robot.proximity.facing, np.stack([np.cos(angles), np.sin(angles)], 1), atol=1e-14
    )
    np.testing.assert_array_equal(robot.proximity.rows[0, 2:4].T, robot.proximity.facing.astype(np.float32))


def test_mirror_image_sensors_have_mirror_images(paper):
    """Place and direction of a sensor are, to the last bit, those of its mirror image."""
    rows = paper.to_kernel().proximity.rows[0, :4]
    for one, other in ((0, 5), (1, 4), (2, 3), (6, 7)):
        np.testing.assert_array_equal(rows[:, one] * [1, -1, 1, -1], rows[:, other])


def test_kernel_arrays_have_one_type(paper):
    """Every array is a C-contiguous float64, or float32 for rays, with or without sensors: one kernel serves
    all."""
    blind = replace(
        paper, infrared=replace(paper.infrared, sensors=()), ambient=replace(paper.ambient, sensors=())
    )
    full, none = paper.to_kernel(), blind.to_kernel()
    assert full.proximity.table == none.proximity.table == ()
    parts = [(full, none), *((getattr(full, p), getattr(none, p)) for p in PARTS)]
    for name, one, other in ((name, *both) for both in parts for name in both[0]._fields):
        for value in (getattr(one, name), getattr(other, name)):
            if isinstance(value, float | tuple):
                continue
            assert value.dtype == (np.float32 if name in ("fan", "rows") else np.float64), name
            assert value.flags.c_contiguous and value.ndim == getattr(one, name).ndim, name
    assert none.proximity.rows.shape == (0, 8, EYES)


def test_reach(paper):
    """Beyond √(a/−b) − offset no ray adds anything; where b ≥ 0 there is no such distance."""
    sensor = paper.infrared.sensors[0]
    assert paper.to_kernel().proximity.reach == pytest.approx([math.sqrt(3515 / 91.4)] * 8)
    assert replace(sensor, offset_cm=0.4).reach_cm() == pytest.approx(math.sqrt(3515 / 91.4) - 0.4)
    assert replace(sensor, b=0.0).reach_cm() == math.inf


def test_round_trip(paper, tmp_path):
    """A profile written as TOML reads back equal, awkward texts and numbers included."""
    odd = replace(
        paper,
        name='quo"te \\ é\x7f\t',
        source="two\nlines",
        noise=replace(paper.noise, wheel=1 / 3, ambient=1e-17),
        ambient=replace(paper.ambient, sensors=()),
    )
    for profile in (paper, odd):
        file = tmp_path / "copy.toml"
        file.write_text(profile.to_toml(), encoding="utf-8")
        assert load_profile(file) == profile
    assert odd != paper


def test_everything_is_shown(paper):
    """`to_dict` tells every constant, sensor places and rays included, with units in the names."""
    shown = paper.to_dict()
    assert shown["infrared"]["sensors"][1] == {
        "x_cm": 1.8, "y_cm": 1.75, "direction_deg": 45.0, "a": 3515.0, "b": -91.4, "offset_cm": 0.0,
    }  # fmt: skip
    assert shown["fixed"]["ray_angles_deg"] == list(range(-81, 82, 18))
    assert shown["noise"]["wheel"] == 0.058


CURVE = "curve_left = [[-9, -5], [-2, 0], [2, 0], [8, 5], [9, {0}]]\ncurve_right = [[0, 0], [9, {0}]]"


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("radius_cm = 2.9", "radus_cm = 2.9", "body.radus_cm: unknown key. Did you mean 'radius_cm'?"),
        ("radius_cm = 2.9", "", "body.radius_cm: expected 0.2 to 100 cm, got 0.0. Or give outline_cm."),
        ("radius_cm = 2.9", "radius_cm = 0.029", "body.radius_cm: expected 0.2 to 100 cm, got 0.029."),
        ("kp = 3800.0", 'kp = "fast"', "wheels.kp: expected a number, got 'fast'."),
        ("kp = 3800.0", "kp = 48000", "wheels.kp: expected gains with which a wheel settles"),
        ("[0.8, 0.8]", "[0.8]", "wheels.speed_per_unit_cm_s: expected 2 values, got [0.8]."),
        ("[0.8, 0.8]", "[0.8, 3.0]", "wheels.speed_per_unit_cm_s: expected a top speed of at most one body"),
        ("kp = 3800.0", "kp = 3800.0\ncurve_left = [[0, 0], [9, 5]]", "wheels.curve_left: expected [[comma"),
        ("kp = 3800.0", "kp = 3800.0\n" + CURVE.format(4), "wheels.curve_left: expected speeds (cm/s) that"),
        ("kp = 3800.0", "kp = 3800.0\n" + CURVE.format(99), "wheels.curve_left: expected a top speed of at"),
        ("x_cm = 0.95", "x_cm = 2.95", "infrared.sensors[0]: expected a place inside the body"),
        ("offset_cm = 0.0", "offset_cm = -0.5", "infrared.sensors[0].offset_cm: expected more than -0.41"),
        ("bands = [0.0, 1023.0]", "bands = [1023, 0]", "infrared.bands: expected the reading far"),
        ("bands = [484.0, 55.0]", "bands = [55, 484]", "ambient.bands: expected the reading in"),
        ("track_cm = 5.3", "track_cm = 53", "wheels.track_cm: expected 0.58 to 43.5 cm"),
        ("wheel = 0.058", "wheel = 1e300", "noise.wheel: expected a share of the speed, 0 to 1"),
    ],
)
def test_wrong_values_are_refused_by_key(refused, old, new, told):
    """A wrong value is refused with the file's name, the key, what was expected and what came."""
    assert refused(old, new).startswith(told)


def test_sensors_lie_below_the_top_of_a_body_that_has_one(paper):
    """A body's height is refused unless the sensors lie lower."""
    with pytest.raises(ConfigError, match=r"sensor_height_cm: expected less than body.height_cm \(3\)"):
        replace(
            paper,
            body=replace(paper.body, height_cm=3.0),
            ambient=replace(paper.ambient, sensor_height_cm=3.0),
        )


def test_broken_toml_names_the_line(refused):
    """A file that is not TOML is refused with the line that breaks it."""
    assert "not a TOML file" in (message := refused("[wheels]", "[wheels")) and "line" in message


def test_unknown_names_and_files(tmp_path):
    """An unknown name lists the names; a missing or unreadable file is named."""
    names = profile_names()
    assert {"khepera", "paper", "thymio"} <= set(names) and list(names) == sorted(names)
    words = rf"unknown profile 'papr'\. Did you mean 'paper'\? Known: {', '.join(names)}"
    with pytest.raises(ConfigError, match=words):
        load_profile("papr")
    with pytest.raises(ConfigError, match=r"gone\.toml: no such file"):
        load_profile(tmp_path / "gone.toml")
    with pytest.raises(ConfigError, match="cannot be read"):
        load_profile(tmp_path)
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match="UTF-8"):
        load_profile(tmp_path / "binary.toml")


def test_no_constant_goes_by_its_place(monkeypatch):
    """With the fields of the kernels' robot the other way round, each name still has its constant."""
    profile = load_profile("khepera")
    before = profile.to_kernel()
    for name in ("Robot", "Wheels", "Noise"):
        monkeypatch.setattr(types, name, namedtuple(name, getattr(types, name)._fields[::-1]))
    after = profile.to_kernel()
    assert before._fields[::-1] == after._fields
    for part in PARTS:
        one, other = getattr(before, part), getattr(after, part)
        for key in one._fields:
            np.testing.assert_array_equal(getattr(one, key), getattr(other, key), err_msg=key)
    noise, wheels = profile.noise, profile.wheels
    assert (before.noise.wheel, before.noise.friction) == (noise.wheel, noise.friction)
    own = before.wheels
    assert (own.kp, own.kd, own.friction) == (wheels.kp, wheels.kd, wheels.friction_cm_s2)
    assert (before.ambient.low, before.ambient.high) == profile.ambient.bands


SQUARE = "outline_cm = [[-2, -2], [3, -2], [3, 2], [-2, 2]]"


@pytest.mark.parametrize(
    ("outline", "told"),
    [
        ("outline_cm = [[0, 1], [1, 0]]", "three corners or more"),
        (
            "outline_cm = [[-2, 2], [3, 2], [3, -2], [-2, -2]]",
            "clockwise, got [[-2.0, 2.0], [3.0, 2.0], [3.0, -2.0], [-2.0, -2.0]]. Turn their",
        ),
        (
            "outline_cm = [[-2, -2], [3, -2], [1, 0], [3, 2], [-2, 2]]",
            "outline_cm: expected corners of a convex polygon",
        ),
        ("outline_cm = [[1, -2], [3, -2], [3, 2], [1, 2]]", "the axle's middle (0, 0) inside"),
        ("outline_cm = [[-8, -0.5], [8, -0.5], [8, 0.5], [-8, 0.5]]", "a body at least 2 cm wide"),
        (
            f"{SQUARE}\nradius_cm = 2.9",
            "radius_cm: expected 3.60555, of the circle about the outline",
        ),
    ],
)
def test_outlines_that_are_none_are_refused(refused, outline, told):
    """Too few corners, the wrong way round, a dent, the axle outside, a needle, another radius."""
    message = refused("radius_cm = 2.9", outline)
    assert message.startswith("body.") and told in message


def test_an_outline_gives_the_radius_and_reads_back(tmp_path):
    """The radius is that of the circle about the corners; sensors may lie on the edge, none beyond it."""
    paper = load_profile("paper")
    eyes = tuple(replace(s, x_cm=3.0, y_cm=0.1 * k) for k, s in enumerate(paper.infrared.sensors))
    body = Body(outline_cm=((-2, -2), (3, -2), (3, 2), (-2, 2)))
    square = replace(paper, body=body, ambient=UNLIT, infrared=replace(paper.infrared, sensors=eyes))
    (tmp_path / "square.toml").write_text(square.to_toml(), "utf-8")
    assert load_profile(tmp_path / "square.toml") == square
    assert square.body.radius_cm == pytest.approx(13**0.5) and square.body.depth_cm(2.5, 1) == 0.5
    beyond = (replace(eyes[0], x_cm=3.01), *eyes[1:])
    with pytest.raises(ConfigError, match="a place inside the body"):
        replace(square, infrared=replace(square.infrared, sensors=beyond))


def test_a_robot_with_left_and_right_exchanged_is_doubted(paper, tmp_path):
    """Sensors on the left that look to the right, and the other way round; none of the shipped ones' do."""
    eyes = [replace(one, y_cm=-one.y_cm) for one in paper.infrared.sensors]
    lights = [replace(one, y_cm=-one.y_cm) for one in paper.ambient.sensors]
    wrong = replace(
        paper, infrared=replace(paper.infrared, sensors=tuple(eyes)),
        ambient=replace(paper.ambient, sensors=tuple(lights)),
    )  # fmt: skip
    (tmp_path / "mine.toml").write_text(wrong.to_toml(), "utf-8")
    with pytest.warns(RealityGapWarning, match=r"is the sign of y_cm or direction_deg exchanged\?"):
        load_profile(tmp_path / "mine.toml")
    assert not any(load_profile(name).is_mirrored for name in profile_names())
