"""Fits find what a recording was made with; noise is measured; nonsense is refused."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from realitygap.calibration.calibrate import _agreed, calibrate, joined
from realitygap.calibration.fit import Fit
from realitygap.calibration.judge import judge
from realitygap.calibration.load import load_recording
from realitygap.errors import CalibrationError
from realitygap.report.calibration import write_calibration_page
from realitygap.world.robot import Constant, load_profile
from tests.calibration.tables import DIRTY, TURN_DEG

PAPER = load_profile("paper")


@pytest.fixture(scope="module")
def by_a_wall(recorded):
    """The extended form's fit to a wall that is not matt, with the usual noise."""
    return calibrate([recorded("wall")], PAPER, form="extended")


@pytest.fixture(scope="module")
def unrepeated(recorded):
    """The paper's form's fit to a wall read once at each place."""
    return calibrate([recorded("wall", repeats=1)], PAPER, form="paper")


def test_the_extended_form_finds_the_robot(robot, recorded):
    """Gains, directions, offset and exponent come back, the rig's turn apart from them."""
    made = calibrate(
        [recorded("wall", turn=2.0, repeats=2), recorded("cylinder:4", turn=-1.0, repeats=2, seed=5)],
        PAPER,
        form="extended",
    )
    fit = made.infrared
    assert fit is not None and fit.rmse < 16
    for found, true in zip(made.profile.infrared.sensors, robot.infrared.sensors, strict=True):
        assert found.a == pytest.approx(true.a, rel=0.15)
        assert found.direction_deg == pytest.approx(true.direction_deg, abs=1.0)
    assert made.profile.infrared.exponent == pytest.approx(2.0, abs=0.25)
    assert fit.fit.values["turn_0_deg"][0] == pytest.approx(2.0, abs=0.4)
    assert fit.fit.values["turn_1_deg"][0] == pytest.approx(-1.0, abs=0.4)
    assert max(m.ratio for m in fit.sensors) < 0.5
    assert max(fit.by_form, key=fit.by_form.__getitem__) == "paper"


@pytest.mark.parametrize("matt", [0.0, 1.0])
def test_a_wall_tells_whether_it_is_matt(recorded, matt):
    """A wall read well tells whether it is matt, so that a cylinder nobody fitted is predicted too."""
    made = calibrate([recorded("wall", matt=matt, noise=5.0, repeats=2)], PAPER, form="extended")
    assert made.profile.infrared.matt == matt
    assert [w for w in made.warnings if not w.startswith("ambient: no recording")] == []
    other = recorded("cylinder:2.7", matt=matt, noise=5.0, seed=9)
    assert judge(other, made.profile).rmse < 1.5 * made.infrared.rmse


def test_a_surface_of_unknown_reflectance_is_fitted(recorded):
    """A cylinder 0.4 times as white as the wall: the ratio comes back with its interval, in words too, in a
    fit and where a profile is judged; said to be as white as the wall it reads like another unit."""
    wall, dark = recorded(repeats=1), recorded("cylinder:4", repeats=1, reflectance=0.4, seed=5)
    unknown = replace(dark, reflectance=math.nan)
    made = calibrate([wall, unknown], PAPER, form="extended")
    (found,) = (c for c in made.profile.provenance.constants if c.key == "infrared.reflectance_1")
    assert found.told and found.low < 0.4 < found.high and found.high - found.low < 0.08
    assert made.surfaces[0] in made.profile.provenance.notes and "cylinder:4, fitted: 0." in made.surfaces[0]
    assert "if the form extended is right)" in made.surfaces[0]
    judged = [judge(one, made.profile) for one in (dark, unknown, replace(dark, reflectance=1.0))]
    assert [one.reflectance for one in judged] == pytest.approx([0.4, 0.4, 1.0], abs=0.03)
    assert judged[2].plain > 2 * judged[0].rmse > 1.9 * judged[1].rmse
    assert judged[2].gain == pytest.approx(0.4, abs=0.05) and (judged[0].gain, judged[1].gain) == (1.0, 1.0)
    assert "another unit, or another surface, 0.4 times as sensitive" in "; ".join(judged[2].fitted_out)
    assert any("reflects 0.4" in words for words in judged[1].fitted_out) and judged[0].fitted_out[1:] == []


def test_a_check_tells_what_a_millimetre_explains(recorded, robot):
    """Of places set by hand a millimetre nearer than they are it explains most; of a program's, nothing."""
    sound = recorded("wall", noise=5.0)
    near = judge(replace(sound, distance_cm=sound.distance_cm - 0.1), robot)
    assert near.ratio == pytest.approx(near.misplaced, rel=0.3) and near.ratio_placed < 0.7 * near.ratio
    assert math.isnan(judge(replace(sound, facts={"placed_by": "program"}), robot).misplaced)


def test_a_reflectance_that_hangs_on_the_form_is_not_believed():
    """Two forms whose intervals lie apart: the constant counts as not told, and both values are said."""

    def fit(value: float) -> Fit:
        at = Constant(key="reflectance_1", value=value, low=value - 0.01, high=value + 0.01)
        return Fit(values={}, constants=(at,), model=np.zeros(1))

    errors = {"extended": 10.5, "measured": 10.0}
    found, said = _agreed("measured", {"extended": fit(0.5), "measured": fit(0.62)}, errors)
    assert not found.constants[0].told and "0.620 by measured, 0.500 by extended" in said[0]
    for other, error in ((0.61, 10.5), (0.5, 12.0)):
        errors = {"extended": error, "measured": 10.0}
        found, said = _agreed("measured", {"extended": fit(other), "measured": fit(0.62)}, errors)
        assert found.constants[0].told and not said


def test_noise_that_was_not_measured_is_said(unrepeated, tmp_path):
    """One reading at each place, bearings far apart: the base's deviation is taken, and called assumed."""
    made = unrepeated
    assert made.profile.body.radius_cm == 2.75  # from whose edge its distances count
    assert not made.infrared.measured and made.profile.provenance.fits[0].noise == 21.0
    assert any("21 counts are assumed" in warning for warning in made.warnings)
    assert any("21 counts are assumed" in note for note in made.profile.provenance.notes)
    page = write_calibration_page(made, tmp_path / "page.html")
    assert "21 counts are assumed" in page.read_text("utf-8")


@pytest.mark.parametrize("size", [10.5, 42.0])
def test_noise_is_measured_within_a_tenth(recorded, size):
    """Repeated readings give the deviation that was put in, with an interval about it."""
    made = calibrate([recorded("wall", noise=size, repeats=3)], PAPER, form="individual")
    estimate = made.infrared.noise[0]
    assert estimate.deviation == pytest.approx(size, rel=0.1)
    assert estimate.low < size * 1.05 and estimate.high > size * 0.95
    assert not estimate.depends and not estimate.heavy


def test_recordings_of_several_robots_are_refused(recorded):
    """Two units are no robot, nor does a recording given twice tell more than once."""
    one, two = (replace(recorded("wall"), source=name, hash=name) for name in "ab")
    with pytest.raises(CalibrationError, match="a has unit 7, b has unit 8"):
        calibrate([replace(one, facts={"unit": 7}), replace(two, facts={"unit": 8})], PAPER)
    with pytest.raises(CalibrationError, match="b: the same recording as a"):
        calibrate([one, replace(two, hash="a")], PAPER)


def test_heights_are_taken_as_they_are_stated(recorded):
    """Of body and sensors, not fitted, and the profile says so; without them the base's stay."""
    table = recorded("lamp", noise=4.5)
    heights = {"body_height_cm": 3.0, "sensor_height_cm": 1.2}
    plain = calibrate([table], PAPER, light="linear", beside=False).profile
    assert (plain.body.height_cm, plain.ambient.sensor_height_cm) == (0.0, 0.0)
    tall = replace(table, facts=heights)
    made = calibrate([tall], PAPER, light="linear", beside=False).profile
    assert (made.body.height_cm, made.ambient.sensor_height_cm) == (3.0, 1.2)
    assert any("as the recordings state them, not fitted" in note for note in made.provenance.notes)
    other = replace(recorded("lamp", noise=4.5, seed=5), facts={**heights, "body_height_cm": 4.0})
    with pytest.raises(CalibrationError, match="expected one robot, got"):
        calibrate([tall, other], PAPER, light="linear", beside=False)


def test_the_papers_form_is_the_papers_with_any_base(unrepeated, recorded, driven):
    """What a base was fitted to beyond the paper does not come into the form that is called the paper's."""
    base = load_profile("khepera")
    base = replace(base, wheels=replace(base.wheels, kp=4500.0, ki=0.0, lag=0.3, play_cm=0.05))
    lamp, drive = recorded("lamp", noise=4.5, repeats=1), driven(friction_cm_s2=0.0)
    found = [
        calibrate(recordings, one, form="paper", beside=False).profile
        for recordings, one in (([lamp, drive], PAPER), ([recorded("wall", repeats=1), lamp, drive], base))
    ]
    law, wheels = found[1].infrared, found[1].wheels
    assert (law.exponent, law.matt, {s.offset_cm for s in law.sensors}) == (1.0, 0.0, {0.0})
    assert (wheels.kp, wheels.ki, wheels.kd, wheels.lag, wheels.play_cm) == (3800, 800, 100, 0, 0)
    assert unrepeated.profile.infrared == law
    assert found[0].ambient == found[1].ambient and found[0].wheels == wheels


def test_wheels_come_back(driven):
    """Gains, lag, speed per unit of each wheel, track, pulses per mm and slip, lengths within 1 %."""
    truth = {
        "speed_per_unit_cm_s": (0.84, 0.83), "track_cm": 5.2, "kp": 4500.0, "ki": 0.0, "kd": 200.0,
        "lag": 0.3, "friction_cm_s2": 0.0,
        "play_cm": 0.08,
    }  # fmt: skip
    made = calibrate([driven(slip=0.06, **truth)], PAPER)
    wheels = made.profile.wheels
    assert wheels.speed_per_unit_cm_s == pytest.approx((0.84, 0.83), rel=0.01)
    assert wheels.track_cm == pytest.approx(5.2, rel=0.01)
    assert made.profile.provenance.pulses_per_mm == pytest.approx((12, 12), rel=0.01)
    assert (wheels.lag, wheels.kp) == pytest.approx((0.3, 4500), rel=0.1)
    assert wheels.play_cm == pytest.approx(0.08, rel=0.1)
    assert made.profile.noise.wheel == pytest.approx(0.06, rel=0.15)
    assert made.wheels.rmse["refitted"] < 0.05 < made.wheels.rmse["printed"]


def test_a_dead_sensor_is_named_and_mended(recorded):
    """A constant sensor is warned of by its number and takes the others' median."""
    sound = recorded("wall", repeats=1)
    counts = sound.counts.copy()
    counts[:, 3] = 17.0
    made = calibrate([replace(sound, counts=counts)], PAPER, form="individual")
    assert any("sensor 3 reads 17 everywhere" in warning for warning in made.warnings)
    told = {c.key: c for c in made.profile.provenance.constants}
    for key in ("a", "b"):
        one = told[f"infrared.{key}[3]"]
        assert one.value == getattr(made.profile.infrared.sensors[3], key) and not one.told
        assert one.low < one.value < one.high and told[f"infrared.{key}[2]"].told
    others = [s.a for k, s in enumerate(made.profile.infrared.sensors) if k != 3]
    assert min(others) <= made.profile.infrared.sensors[3].a <= max(others)
    counts[:, 4:7] = 17.0
    made = calibrate([replace(sound, counts=counts)], PAPER, form="paper")
    assert len(made.infrared.dead) == 4 and made.profile.infrared.bands == pytest.approx((0, 1023), abs=30)


def _swapped(r):
    return replace(r, counts=r.counts[:, [5, 4, 3, 2, 1, 0, 7, 6]])


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda r: replace(r, bearing_deg=-r.bearing_deg), "other way round|swapped"),
        (_swapped, "answer to another side"),
        (lambda r: replace(r, counts=np.full_like(r.counts, 1023.0)), "most sensors tell nothing"),
        (lambda r: replace(r, counts=np.random.default_rng(1).permutation(r.counts)), "explains only|answer"),
        (lambda r: replace(r, kind="ambient", object="lamp"), 'made: .* Is its kind "infrared"'),
    ],
)
def test_nonsense_is_refused(recorded, spoil, words):
    """No profile is made of mirrored bearings, swapped columns, dead tables, wrong units or shuffled rows."""
    with pytest.raises(CalibrationError, match=words):
        calibrate([spoil(recorded("wall", repeats=1))], PAPER, form="extended")


def test_two_columns_exchanged_are_warned_of(recorded):
    """Neighbours that were swapped come out turned: said, since each alone might be a sensor's mounting."""
    seen = recorded("wall", repeats=1)
    made = calibrate([replace(seen, counts=seen.counts[:, [0, 2, 1, *range(3, 8)]])], PAPER, form="extended")
    assert any("sensors 1, 2 look more than 15° elsewhere" in said for said in made.warnings)


def test_a_profile_is_judged_on_other_data(by_a_wall, recorded):
    """A fit to a wall predicts a cylinder of the same robot; the paper's constants do not, and it is said
    to be another unit, or set down elsewhere."""
    other = recorded("cylinder:2.7", seed=9, turn=1.0)
    good, bad = judge(other, by_a_wall.profile), judge(other, PAPER)
    assert good.rmse < 18 < 60 < bad.plain and (bad.gain, bad.start_cm) != (1.0, 0.0) == (
        good.gain,
        good.start_cm,
    )
    assert good.turn_deg == pytest.approx(1.0, abs=0.5) and good.noise_fits
    assert set(good.to_dict()) >= {"rmse", "bias", "per_sensor", "noise"}


@pytest.mark.parametrize("loud", [80.0, 30.0])
def test_noise_that_differs_from_sensor_to_sensor_is_said_and_kept(recorded, loud):
    """As an e-puck's front sensors have many times the noise of others; of three times nothing is said, and
    one figure serves all."""
    sound, size = recorded("wall", noise=0.0), np.array([10.0] * 6 + [loud, 10.0])
    random = np.random.default_rng(4).normal(size=sound.counts.shape)
    drawn = sound.counts + np.where(sound.counts > 0, size, 0.0) * random
    loudly = replace(sound, counts=np.clip(np.rint(drawn), 0, 1023))
    made = calibrate([loudly], PAPER, form="extended")
    said = [w for w in made.warnings if "noise differs from sensor to sensor" in w]
    assert len(said) == (loud == 80.0)
    kept = np.array([sensor.noise for sensor in made.profile.infrared.sensors])
    assert kept.shape == ((8, 9) if said else (8, 0))
    assert np.median(kept[:, 2:7] / size[:, None], axis=1) == pytest.approx(1.0, abs=0.3) if said else True


def test_a_table_with_the_faults_of_real_ones(made_tables):
    """A turned rig, dirt before a sensor, rows a millimetre off, one reading a place: found, and named."""
    made = calibrate([load_recording(made_tables / "wall.sam", object="wall")], PAPER, form="extended")
    assert made.infrared.rmse < 19 and made.infrared.held_out["extended"] < 1.15 * made.infrared.rmse
    assert 18 < made.profile.noise.proximity < 24  # measured by neighbouring bearings: 21 counts
    turn = next(c for c in made.infrared.fit.constants if c.key == "turn_0_deg")
    assert turn.value == pytest.approx(-TURN_DEG, abs=0.5)
    gains = [s.a for s in made.profile.infrared.sensors]
    assert np.argmin(gains) == DIRTY and gains[DIRTY] < 0.7 * np.median(gains)


def test_the_shipped_khepera_comes_from_these_tables(tables):
    """The profile `khepera` is what the command makes of the tables, whose hashes stand in it."""
    shipped = load_profile("khepera")
    named = (("wall.sam", "wall"), ("light.sam", "lamp"))
    recordings = [load_recording(tables / name, object=what) for name, what in named]
    assert {f.sha256 for f in shipped.provenance.files} == {r.hash for r in recordings}
    assert {r.body_radius_cm for r in recordings} == {shipped.body.radius_cm}
    assert judge(recordings[0], shipped).rmse < 30
    assert judge(recordings[1], shipped).rmse < 20


def test_kinds_calibrated_apart_are_the_calibration_by_all(unrepeated, recorded, driven) -> None:
    """Infrared, light and wheels, each by its own recordings, joined: the same profile to the last bit."""
    heights = {"body_height_cm": 3.0, "sensor_height_cm": 1.2}
    lamp = replace(recorded("lamp", repeats=1), facts=heights)
    settings = {"form": "paper", "beside": False}
    drive = driven()
    whole = calibrate([lamp, *unrepeated.recordings, drive], PAPER, **settings)
    apart = [calibrate([one], PAPER, **settings) for one in (lamp, drive)]
    made = joined([apart[0], unrepeated, apart[1]], PAPER)
    assert made.profile.body.height_cm == 3.0 and made.profile.to_toml() == whole.profile.to_toml()
