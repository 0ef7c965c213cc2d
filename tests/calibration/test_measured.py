"""The form "measured": a sensor that follows no printed law is found, and judged on other readings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from realitygap.calibration import calibrate as calibrating
from realitygap.calibration import measured, readings
from realitygap.calibration.calibrate import calibrate
from realitygap.calibration.curves import Curves, Seen, on_curves
from realitygap.calibration.fit import choose
from realitygap.calibration.forms import fit_infrared
from realitygap.calibration.judge import judge
from realitygap.calibration.measured import fit_measured
from realitygap.calibration.model import proximity, received, scene_of
from realitygap.calibration.noise import Sample, noise_tables
from realitygap.calibration.readings import Readings
from realitygap.calibration.recordings import SensorRecording
from realitygap.world.robot import Profile, load_profile
from tests.calibration.conftest import places

PAPER = load_profile("paper")
HALF = replace(PAPER, infrared=replace(PAPER.infrared, sensors=PAPER.infrared.sensors[::2]))
"""The same robot with every other sensor: fits take less time."""


def odd(plain: Profile = HALF) -> Profile:
    """A robot whose sensors have two beams, a kink in the middle of the range and a top far below 1023."""
    base, u = plain.infrared, np.linspace(0.0, 1.0, 41)
    shape = np.interp(u, [0, 0.25, 0.4, 0.5, 0.75, 1], [0, 0, 420, 470, 930, 930])
    sensors = tuple(
        replace(s, a=1.0, b=0.0, offset_cm=0.4, curve=tuple(shape * share))
        for s, share in zip(base.sensors, np.linspace(0.8, 1.05, len(base.sensors)), strict=True)
    )
    law = replace(
        base, sensors=sensors, lobe=(0.1, 0.5, 0.3, 0.1, 0.0), aperture_deg=50.0, width_cm=2.0, curve_cm=4.0
    )
    return replace(plain, infrared=law)


def before(
    robot: Profile, object: str, *, seed: int, repeats: int = 2, shift: float = 0.0
) -> SensorRecording:
    """Readings of it at every other place; their noise grows from 4 counts in the dark to 16 at the top."""
    distance, bearing, repeat = (
        column.reshape(-1, repeats)[seed % 2 :: 2].ravel() for column in places(repeats)
    )
    blank = SensorRecording(
        kind="infrared", object=object, distance_cm=distance + shift, bearing_deg=bearing + 10 * shift,
        repeat=repeat, counts=np.zeros((len(distance), len(robot.infrared.sensors))),
        source=f"made {object}", hash=f"{object} {seed}",
    )  # fmt: skip
    clean = proximity(robot, scene_of(blank))
    drawn = clean + (4 + 12 * clean / 1023) * np.random.default_rng(seed).normal(size=clean.shape)
    return replace(blank, counts=np.clip(np.rint(drawn), 0, 1023))


@pytest.fixture
def fewer_starts(monkeypatch):
    """The quicker: one beam, and two folds."""
    monkeypatch.setattr(measured, "LOBES", measured.LOBES[:1])
    for module in (readings, calibrating):
        monkeypatch.setattr(module, "FOLDS", 2)


@pytest.mark.usefixtures("fewer_starts")
def test_a_sensor_outside_every_closed_form_is_found():
    """`auto` takes "measured" for it; an object not fitted it errs on by less than the noise, and places held
    out, each by a search that never saw them, by hardly more."""
    robot = odd()
    made = calibrate([before(robot, "wall", seed=1), before(robot, "cylinder:4", seed=2)], HALF, form="auto")
    fit = made.infrared
    assert fit is not None and fit.form == "measured"
    assert fit.held_out["measured"] < 0.6 * fit.held_out["extended"] and fit.ratio < 1.1
    told = judge(before(robot, "cylinder:3", seed=3, shift=0.15), made.profile)
    assert np.sqrt(np.mean([one.lit_ratio**2 for one in told.per_sensor])) < 1.0
    for sensor in made.profile.infrared.sensors:
        assert sensor.noise[0] == pytest.approx(4, abs=1.5) and 7 < sensor.noise[4] < 13
        assert np.diff(sensor.curve).min() >= 0 and max(sensor.curve) <= 1023


def test_rays_that_end_and_beams_that_overlap_are_found(monkeypatch):
    """Of sensors that subtract, and see no farther than 6 cm, range and beams are found.

    Two sensors turned by 6 degrees, each the other way, are found so: where a ray ends no derivative tells.
    """
    monkeypatch.setattr(measured, "LOBES", (measured.LOBES[0], measured.LOBES[2]))
    law = odd().infrared
    looks = [s.direction_deg + by for s, by in zip(law.sensors, (0.0, 6.0, -6.0, 0.0), strict=True)]
    turned = tuple(replace(s, direction_deg=look) for s, look in zip(law.sensors, looks, strict=True))
    law = replace(
        law,
        sensors=turned,
        lobe=(1 / 3, 0.0, 0.0, 0.0, 2 / 3),
        overlap=2 / 3,
        aperture_deg=15.0,
        range_cm=6.0,
    )
    robot = replace(HALF, infrared=law)
    recordings = [before(robot, "wall", seed=1), before(robot, "cylinder:4", seed=2)]
    profile = fit_measured(Readings(recordings, HALF), HALF).profile
    found = profile.infrared
    assert found.range_cm == pytest.approx(6.0, abs=0.1) and found.aperture_deg == pytest.approx(
        15.0, abs=1.0
    )
    assert found.overlap > 0.3
    assert [sensor.direction_deg for sensor in found.sensors] == pytest.approx(looks, abs=1.0)
    told = judge(before(robot, "cylinder:3", seed=3, shift=0.15), profile)
    assert np.sqrt(np.mean([one.lit_ratio**2 for one in told.per_sensor])) < 1.0


@pytest.mark.usefixtures("fewer_starts")
def test_a_printed_law_is_taken_where_it_holds(recorded):
    """`auto` keeps the printed law's fit where nothing errs less on places held out."""
    table = recorded("wall", turn=1.0, repeats=3)
    made = calibrate([replace(table, counts=table.counts[:, ::2])], HALF, form="auto")
    fit = made.infrared
    assert fit is not None and min(fit.held_out, key=fit.held_out.__getitem__) == fit.form
    assert fit.ratio < 0.6


@pytest.mark.parametrize("base", [PAPER, odd(PAPER)])
def test_auto_goes_by_places_held_out(recorded, monkeypatch, base):
    """A form that follows every fitted reading, and errs on places held out, is not taken; nor do a base's
    curves stay in the law that it is compared with."""

    def too_good(data, base, *, intervals=True):
        made = fit_infrared(data, base, "extended", intervals=intervals)
        model = data.counts + np.where(data.use, 0.0, 50.0)
        return replace(made, fit=replace(made.fit, model=model))

    monkeypatch.setattr(calibrating, "fit_measured", too_good)
    fit = calibrate([recorded("wall", repeats=2)], base, form="auto").infrared
    assert fit is not None and fit.by_form["measured"] < fit.by_form["extended"] < 16
    assert fit.form == "extended" and fit.held_out["extended"] < fit.held_out["measured"]


def test_a_form_with_more_constants_must_be_better_by_a_margin():
    """Of 2 %, for infrared and light alike."""
    assert choose({"extended": 10.0, "measured": 9.9}) == "extended"
    assert choose({"extended": 10.0, "measured": 9.7}) == "measured"


@pytest.mark.usefixtures("fewer_starts")
@pytest.mark.parametrize(
    ("kind", "form"),
    [("infrared", "extended"), ("infrared", "measured"), *(("lamp", form) for form in ("paper", "linear"))],
)
def test_places_held_out_change_no_fit(recorded, kind, form):
    """What a fold's readings are changes nothing in the fit that reads them: no choice is made by them."""
    source = before(odd(), "wall", seed=1) if kind == "infrared" else recorded("lamp", noise=4.5)
    data, read = Readings([source], HALF if kind == "infrared" else PAPER), []
    out = next(data.folds())
    for wrong in (0.0, 400.0):
        data.counts[out] = np.abs(data.counts[out] - wrong)
        tell = calibrating.Fits(data, HALF, room=False)
        tell.carry_out((form, 0), lambda told: read.append(told[1][form]))
    assert np.array_equal(*read)


def test_light_is_read_by_a_curve_where_no_straight_law_holds(recorded):
    """`auto` takes curves where a kink bends the law; the straight law where that holds."""
    straight = recorded("lamp", noise=4.5)
    kinked = np.interp(straight.counts, [0, 60, 200, 300, 480, 1023], [0, 60, 330, 370, 480, 1023])
    bent = replace(straight, counts=np.rint(kinked))
    forms = {}
    for table, form in ((straight, "extended"), (bent, "measured")):
        made = calibrate([table], PAPER, light="auto", beside=False)
        assert made.ambient is not None and made.ambient.form == form
        forms[form] = made
    fit = forms["measured"].ambient
    assert fit is not None and fit.held_out["measured"] < 0.9 * fit.held_out["extended"]
    judged = judge(bent, forms["measured"].profile)
    assert judged.rmse == pytest.approx(fit.rmse, rel=0.05)
    assert not any(sensor.noise for sensor in forms["extended"].profile.ambient.sensors)


def test_noise_of_light_is_measured_by_the_reading(recorded, tmp_path):
    """Noise of 2 counts where light is bright and 10 in the dark is found so, sensor by sensor, in the form
    of curves; the profile keeps it, and its file reads back to an equal value."""
    clean = recorded("lamp", noise=0.0)
    size = np.interp(clean.counts, [55, 484], [2.0, 10.0])
    drawn = clean.counts + size * np.random.default_rng(9).normal(size=size.shape)
    table = replace(clean, counts=np.clip(np.rint(drawn), 0, 1023))
    made = calibrate([table], PAPER, form="paper", light="measured", beside=False)
    profile, fit = made.profile, made.ambient
    assert fit is not None and fit.noise[0].depends
    for sensor in profile.ambient.sensors:
        found = np.interp([60.0, 270.0, 440.0], np.linspace(0, 1023, len(sensor.noise)), sensor.noise)
        assert found == pytest.approx([2.1, 6.0, 9.2], rel=0.25)
        assert sensor.noise_rise == 0
    (tmp_path / "robot.toml").write_text(profile.to_toml())
    assert load_profile(tmp_path / "robot.toml") == profile


def test_a_curve_passes_the_ends_of_the_converter():
    """Readings cut off at 0 and at the top do not bend it; a sensor without readings follows the others."""
    u = np.random.default_rng(4).uniform(0, 1, (1500, 3))
    true = 1600 * u - 300
    noisy = np.clip(true + 20 * np.random.default_rng(5).normal(size=u.shape), 0, 1023)
    use = np.ones(u.shape, bool)
    use[:, 2] = False
    fit = Curves(Seen(counts=noisy, use=use, top=1023.0, most=1023.0, noise=20.0), u)
    curves = fit.fitted()
    inside = (true > 60) & (true < 960)
    off = on_curves(curves, u) - true
    assert np.abs(off[inside]).max() < 25
    assert np.diff(curves, axis=1).min() >= 0 and curves.min() >= 0 and curves.max() <= 1023
    size, middle = fit.deviations(curves), slice(20, 60)
    far = np.abs(curves - (1600 * np.linspace(0, 1, 81) - 300))[:2, middle] / size[:2, middle]
    assert size[:2, middle].max() < 8 and (far < 2).mean() > 0.85 and np.isinf(size[2]).all()


def test_noise_that_rises_with_the_wheels_is_found():
    """Twice the noise at 4 cm/s is a rise of a quarter for each cm/s; where all stood, none is told."""
    random, n = np.random.default_rng(6), 4000
    speed = np.where(np.arange(n) % 2, 4.0, 0.0)
    z = 10.0 * (1 + speed / 4)[:, None] * random.normal(size=(n, 2))
    level = random.uniform(100, 900, (n, 2))
    sample = Sample(z=z, level=level, group=np.arange(n), row=np.arange(n))
    table, rise = noise_tables(sample, level, level, speed, 1023.0, knots=9)
    assert rise == pytest.approx([0.25, 0.25], abs=0.03) and table[:, 2:7] == pytest.approx(10.0, abs=1.2)
    assert noise_tables(sample, level, level, 0 * speed, 1023.0, knots=9)[1].max() == 0


def test_quiet_sensors_beside_loud_ones_keep_their_noise():
    """Twenty times apart, and few values at each reading: the shape over the reading is pooled, the size each
    sensor's own; one without any values has the noise of all together."""
    random, true = np.random.default_rng(7), np.array([200.0] * 2 + [10.0] * 5)
    level = random.uniform(0, 4095, (60, 8))
    z = random.normal(size=(60, 7)) * true * (0.3 + 0.7 * level[:, :7] / 4095)
    sample = Sample(z=np.c_[z, np.full(60, np.nan)], level=level, group=np.arange(60), row=np.arange(60))
    table, _ = noise_tables(sample, level, level, np.zeros(60), 4095.0, knots=9)
    right = np.append(true, np.sqrt((true**2).mean()))[:, None] * np.linspace(0.3, 1.0, 9)
    assert np.abs(np.log(table / right)).mean(axis=1).max() < 0.35


def series(sensor: int, gain: float, background: float) -> SensorRecording:
    """Ten readings at each of 12 distances of a sensor that takes gain · (1 / (d + 0.5)² + background) for
    light and reads nothing below 1050 counts; 4 counts of noise. A plain formula: no rays."""
    distance = np.repeat(np.arange(12.0), 10)
    root = np.sqrt(gain * ((distance + 0.5) ** -2.0 + background))
    noisy = 6000 * root / (root + 0.22) + 4 * np.random.default_rng(sensor).normal(size=len(root))
    counts = np.full((len(root), 7), np.nan)
    counts[:, sensor] = np.rint(np.where(noisy < 1050, 0, np.minimum(noisy, 4400)))
    return SensorRecording(
        kind="infrared", object="wall", distance_cm=distance, bearing_deg=0 * distance, repeat=np.arange(120),
        counts=counts, from_sensor=sensor, body_said=False, source=f"{sensor} in {background}",
        hash=f"{sensor} {background}",
    )  # fmt: skip


@pytest.mark.usefixtures("fewer_starts")
@pytest.mark.parametrize("lit", [0.0015, 0.0])
def test_light_of_a_room_is_found_where_there_is_some(lit):
    """Of two sensors' series, half of them in a room that adds 0.0015/cm², that light is found, and said;
    none where none is. A series in either room is read within 1 % of the full scale, once set up."""
    base = load_profile("thymio")
    sensors = ((2, 1.0), (5, 0.8))
    dark, bright = ([series(k, gain, light) for k, gain in sensors] for light in (1e-9, lit))
    made = calibrate([*dark, *bright], base, form="measured")
    fit = made.infrared
    assert fit is not None
    found = np.array([float(fit.fit.values[f"background_{i}"][0]) for i in range(4)]).reshape(2, 2)
    # Of what a wall straight ahead throws back the fit's fan of rays receives this much.
    blank = replace(dark[0], distance_cm=np.full(120, 10.0)).of_robot(base)
    robot = made.profile
    share = received(robot.to_kernel(), [(scene_of(blank), 0.0, 0.0)])[0, 2]
    share *= (10.0 + robot.infrared.sensors[2].offset_cm) ** 2 / robot.infrared.sensors[2].a
    assert np.diff(found, axis=0) == pytest.approx(lit * share, abs=2e-4)
    assert any("lit differently" in words for words in fit.warnings) == (lit > 0)
    for one in (dark[0], bright[1]):
        told = judge(one, made.profile)
        assert told.rmse < 0.01 * base.infrared.top and abs(told.shift_cm) < 0.1
    assert judge(bright[0], made.profile).background == pytest.approx(lit * share / 2, abs=2e-4)


def test_workers_change_no_bit():
    """Two processes find what this one finds; all fits are told, one after another."""
    made, base, told = [], load_profile("thymio"), []
    for workers in (1, 2):
        heard = []
        made.append(
            calibrate(
                [series(2, 1.0, 1e-9)], base, form="auto", workers=workers,
                on_progress=lambda *said, heard=heard: heard.append(said),
            )
        )  # fmt: skip
        told.append(heard)
    one, two = made
    assert one.profile == two.profile and one.infrared.held_out == two.infrared.held_out
    assert np.array_equal(one.infrared.model, two.infrared.model, equal_nan=True)
    assert told[0] == told[1] == [(k, 12) for k in range(13)]
