"""Readings of robots that nobody has seen here: tables written by other hands, programs and machines."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from realitygap.calibration import infrared
from realitygap.calibration.calibrate import calibrate
from realitygap.calibration.judge import judge
from realitygap.calibration.load import find_recordings, load_recording
from realitygap.calibration.noise import Yardstick, lit_noise, misfits, sample_noise
from realitygap.calibration.readings import Readings
from realitygap.calibration.recordings import SensorRecording
from realitygap.errors import CalibrationError, RecordingError
from realitygap.world.robot import load_profile
from tests.calibration.test_recording import FACTS, HEAD, ROW, written

THYMIO, PAPER = load_profile("thymio"), load_profile("paper")
FALLS = {0: 4300, 1: 4100, 2: 3700, 3: 3200, 4: 2700, 5: 2300, 6: 1900, 8: 1400, 10: 0}


def series(folder: Path, *lines: str, name: str = "sensor02_light.csv") -> Path:
    """A Thymio's series of these lines."""
    (folder / name).write_bytes("\n".join([*lines, ""]).encode())
    return folder


def fallen(away: str = "{}cm", readings: int = 12) -> list[str]:
    """Lines of a series whose readings fall with the distance."""
    counts = {at: [str(high + k % 5) for k in range(readings)] for at, high in FALLS.items()}
    return [",".join([away.format(at), *row]) for at, row in counts.items()]


@pytest.mark.parametrize(
    "changed",
    [
        lambda line: line.replace("cm", " CM"),
        lambda line: ",".join(f'"{cell}"' for cell in line.split(",")),
        lambda line: line + ",,,\r",
    ],
)
def test_a_series_is_read_as_other_programs_write_it(tmp_path, changed):
    """Capitals, quotes, blank cells at the end: the same readings; and a file's name may be in capitals."""
    plain = load_recording(*find_recordings(series(tmp_path, *fallen())))
    (tmp_path / "sensor02_light.csv").unlink()
    for beside in ("README.md", "LICENSE", ".DS_Store"):
        (tmp_path / beside).write_bytes(b"\xff\x00")
    there = series(tmp_path, *map(changed, fallen()), "", name="SENSOR02_LIGHT.CSV")
    same = load_recording(*find_recordings(there))
    assert isinstance(plain, SensorRecording) and isinstance(same, SensorRecording)
    assert np.array_equal(same.counts, plain.counts, equal_nan=True) and same.sensors == 7
    assert np.array_equal(same.distance_cm, plain.distance_cm)


def test_stale_readings_are_left_out_by_where_they_stand(tmp_path):
    """The first two of a row still show the distance before; where one is missing no third is stale."""
    (tmp_path / "sensor02_light.csv").write_text("9cm,,4000,1400,1401,,1402\n12.5mm,1,2,4000\n", "utf-8")
    read = load_recording(tmp_path / "sensor02_light.csv")
    assert isinstance(read, SensorRecording)
    assert read.counts[:, 2].tolist() == [1400, 1401, 1402, 4000]
    assert read.distance_cm.tolist() == [9, 9, 9, 1.25]


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("1.2.3cm,1,2,3", "line 1: expected a distance as in 9cm or 87.5mm"),
        ("9cm;1;2;3", "line 1: expected values separated by commas, got semicolons. Save"),
        ("900cm,1,2,3", "at most 300 cm, and more than 2 readings, counts from 0 on, got '900cm,"),
        (f"{'9' * 200},1,2,3", "got '9999999999999999999999999999999999999999'."),
        ("9cm,1,2,NaN", "and more than 2 readings, counts from 0 on"),
    ],
)
def test_a_line_that_is_none_of_a_series_is_named(tmp_path, line, says):
    """A distance that is no number had ended in an error that nobody expected."""
    with pytest.raises(RecordingError) as raised:
        load_recording(series(tmp_path, line) / "sensor02_light.csv")
    assert says in str(raised.value)


def test_a_series_pasted_twice_is_pointed_out(tmp_path):
    """By its first line that is a copy, as in other tables; silence repeats by itself."""
    once, silent = fallen(), "11cm,0,0,0,0"
    assert load_recording(series(tmp_path, silent, *once, silent) / "sensor02_light.csv").warnings == ()
    told = load_recording(series(tmp_path, silent, *once, "", *once) / "sensor02_light.csv").warnings
    assert len(told) == 1 and "sensor02_light.csv, line 12: a copy of line 2 (such rows: 9)" in told[0]


def test_a_thymio_brighter_than_the_shipped_one_is_told_what_to_do(tmp_path):
    """At the line that has such a reading: it is the right robot, and another profile is no cure."""
    (tmp_path / "sensor02_light.csv").write_text("9cm,1,2,1400,1401\n1cm,1,2,4400,4600\n", "utf-8")
    says = (
        r"light\.csv, line 2: s2: .*4500.*got 4600\..* take a copy of that profile with another infrared\.top"
    )
    with pytest.raises(RecordingError, match=says):
        calibrate([load_recording(*find_recordings(tmp_path))], THYMIO)


def test_no_series_is_left_out_for_its_name(tmp_path):
    """Of two series one of which has a name that says too little, both or none are read."""
    series(tmp_path, *fallen())
    series(tmp_path, *fallen(), name="sensor05.csv")
    with pytest.raises(RecordingError, match=r"sensor05\.csv: expected the name of a Thymio's series"):
        [load_recording(path) for path in find_recordings(tmp_path)]


def test_a_series_in_millimetres_is_refused(tmp_path):
    """Of distances ten times too large, which had made a profile that sees across a room."""
    with pytest.raises(CalibrationError, match=r"beyond 15 cm.*are too large\. Are units mixed up"):
        calibrate([load_recording(*find_recordings(series(tmp_path, *fallen("{}0cm"))))], THYMIO)


def test_a_series_of_two_distances_is_refused(tmp_path):
    """It had been called no recording of a wall, because no law fitted it."""
    few = series(tmp_path, *fallen()[2:5:2])
    with pytest.raises(CalibrationError, match=r"readings at 3 distances or more, got 2.*Record more"):
        calibrate([load_recording(*find_recordings(few))], THYMIO)


def test_a_place_beyond_every_room_is_refused(tmp_path):
    """9999 for "nothing near": the model stands outside its room there and would read a wall at its side."""
    far = written(tmp_path / "far", HEAD, ROW, ROW.replace("1.5", "9999", 1))
    with pytest.raises(
        RecordingError, match=r"line 3: distance_cm: expected at most 300 cm, got 9999.*leave"
    ):
        load_recording(far)


def test_a_spreadsheet_s_empty_columns_are_none(tmp_path):
    """Commas at the end of every line, an index at its beginning: columns without a name say nothing."""
    read = load_recording(written(tmp_path / "r", f",{HEAD},,", f"0,{ROW},,"))
    assert isinstance(read, SensorRecording) and read.counts.tolist() == [[10, 20, 30, 40, 50, 60, 70, 80]]


def test_a_sensor_that_was_not_recorded_has_an_empty_column(tmp_path):
    """It is taken to be like the others, and said to be; a gap in a column is refused, as it was."""
    row = ROW.split(",")
    rows = [",".join([f"{k % 5}", f"{20 * k}", "0", *row[3:5], "", *row[6:]]) for k in range(9)]
    read = load_recording(written(tmp_path / "r", HEAD, *rows))
    assert isinstance(read, SensorRecording)
    assert np.isnan(read.counts).all(axis=0).tolist() == [k == 2 for k in range(8)]
    with pytest.raises(RecordingError, match="line 3: s2: expected a number"):
        load_recording(written(tmp_path / "p", HEAD, ROW, rows[0]))


def test_what_is_bright_goes_by_the_converter(tmp_path):
    """350 counts far off are little of 4095, whether the full scale is said or not; of 1023 they are not."""
    far, near = "25,0,0" + ",350" * 8, "0.1,0,0" + ",3900" * 8
    assert load_recording(written(tmp_path / "r", HEAD, far, near)).sensors == 8
    with pytest.raises(RecordingError, match="at most 20 cm where a sensor reads 300 counts or more, got 25"):
        load_recording(written(tmp_path / "p", HEAD, far, ROW))


def test_a_robot_without_light_sensors_gets_the_cure(tmp_path):
    """The profile e-puck has no [ambient]: a recording of light needs a copy of it that has one."""
    facts = FACTS.replace("infrared", "ambient").replace("wall", "lamp")
    read = load_recording(written(tmp_path / "r", HEAD, ROW, facts=facts))
    with pytest.raises(RecordingError, match=r"Give --base a copy of it with an \[ambient\] of its own"):
        calibrate([read], load_profile("e-puck"))


@pytest.mark.parametrize(
    ("bearings", "measured"),
    [
        (np.arange(-180.0, 180.0, 2.0), True),
        (np.arange(-90.0, 91.0, 2.0), True),
        (np.arange(-180.0, 180.0, 15.0), False),
        (np.arange(-180.0, 180.0, 45.0), False),
    ],
)
def test_noise_shows_between_close_bearings_only(bearings, measured):
    """Further apart a model's error changes too: of 10 counts 23 to 100 had been measured, and the error over
    noise came out as small. The ends of half a turn are no neighbours."""
    distance, bearing = (at.ravel() for at in np.meshgrid(np.arange(20) * 0.6, bearings, indexing="ij"))
    error = 100.0 * np.radians(bearing) + 40.0 * np.cos(4.0 * np.radians(bearing)) * (len(bearings) < 90)
    counts = 500.0 + error + 10.0 * np.random.default_rng(0).normal(size=error.shape)
    table = SensorRecording(
        kind="infrared", object="wall", distance_cm=distance, bearing_deg=bearing,
        repeat=np.zeros(len(error), int), counts=counts[:, None],
    )  # fmt: skip
    sample = sample_noise(table, np.full((len(error), 1), 500.0), 1023.0)
    found = lit_noise(sample, "proximity", 1023.0)
    assert (found is not None) == measured
    assert found is None or found.deviation == pytest.approx(10.0, rel=0.1)


def test_noise_that_is_assumed_hides_no_error():
    """110 counts are assumed, the model is 60 off everywhere: that is its error, and not nothing."""
    counts, place = np.linspace(800.0, 3000.0, 50)[:, None], np.arange(50)
    assumed = Yardstick(kind="infrared", top=4095.0, deviation=110.0, measured=False)
    (made,) = misfits(counts, counts + 60.0, place, assumed)
    assert made.error == pytest.approx(60.0) and made.lit_ratio == pytest.approx(60.0 / 110.0)
    (hidden,) = misfits(counts, counts + 60.0, place, replace(assumed, measured=True))
    assert hidden.error == 0.0


@pytest.mark.parametrize("offset", [0.0, 150.0])
def test_a_sensor_that_reads_more_than_nothing_in_the_dark_is_dark_there(offset):
    """An e-puck2's differ in what they read with nothing near; a model that is right there and 50 counts off
    elsewhere errs by 50 where sensors see something, whatever that is."""
    dark, seen = np.full(90, offset), offset + np.linspace(300.0, 2500.0, 10)
    clean = np.concatenate([dark, seen])
    counts = np.maximum(clean + 10.0 * np.random.default_rng(1).normal(size=100), 0.0)
    model = np.concatenate([dark, seen + 50.0])
    noise = Yardstick(kind="infrared", top=4095.0, deviation=10.0)
    (made,) = misfits(counts[:, None], model[:, None], np.arange(100), noise)
    assert made.lit_ratio == pytest.approx(5.0, abs=1.0) and made.ratio < 2.0


def test_a_judge_says_that_it_could_not_measure_the_noise(recorded, robot):
    """Of one reading at each place, far from each other: the profile's noise is assumed, and said to be."""
    table = recorded("wall", repeats=1)
    found = judge(table, robot)
    assert any("21 counts are assumed" in warning for warning in found.warnings)
    assert found.ratio == pytest.approx(1.0, abs=0.2)  # the noise itself, which nothing tells from an error


def test_a_judge_gives_each_reason_once(recorded, robot):
    """Of a robot that backs off a wall most sensors see nothing: only the warning that says so names them."""
    ring = recorded("wall")
    back = ring.bearing_deg == 180.0
    some = {key: getattr(ring, key)[back] for key in ("distance_cm", "bearing_deg", "repeat", "counts")}
    (said,) = [one for one in judge(replace(ring, **some), robot).warnings if "hardly changes" in one]
    assert "most sensors tell nothing" in said and said.count("sensor 0 hardly changes") == 1


def test_readings_that_repeat_to_the_count_tell_no_noise(recorded):
    """Every line twice, say, or means of many: the base's noise stays; a profile without any was made."""
    once = recorded("wall", repeats=1)
    names = ("distance_cm", "bearing_deg", "repeat", "counts")
    twice = replace(once, **{name: np.repeat(getattr(once, name), 2, axis=0) for name in names})
    made = calibrate([twice], PAPER, form="paper")
    assert not made.infrared.measured and made.profile.noise.proximity == PAPER.noise.proximity
    assert judge(twice, made.profile).ratio == pytest.approx(made.infrared.ratio, rel=0.5)


def test_a_body_in_another_unit_is_named(tmp_path):
    """Its recording and its size are said, not only what of the profile does not go with it."""
    read = load_recording(written(tmp_path / "r", HEAD, ROW, facts=f"{FACTS}body_radius_cm = 27.5\n"))
    with pytest.raises(CalibrationError) as raised:
        calibrate([read], PAPER)
    assert str(raised.value).startswith(f"{tmp_path / 'r'}: body_radius_cm: 27.5 cm does not fit profile")
    assert "wheels.track_cm" in str(raised.value) and "Correct it (cm)" in str(raised.value)


def test_a_cylinder_like_a_barrel_is_doubted(tmp_path):
    """Its radius is in cm: 27 is nearly a wall, and would be fitted as such without a word."""
    for radius, doubted in ((2.7, False), (27, True)):
        facts = FACTS.replace("wall", f"cylinder:{radius}")
        said = load_recording(written(tmp_path / str(radius), HEAD, ROW, facts=facts)).warnings
        assert any("cylinder of 27 cm radius" in warning for warning in said) == doubted


def test_a_straight_series_turns_no_sensor(tmp_path):
    """By no printed form: two of them had turned the front's sensor by 69 degrees, and what was not recorded
    read far too much."""
    series(tmp_path, *fallen())
    series(tmp_path, *fallen("{}5mm"), name="sensor05_light.csv")
    read = [load_recording(path).of_robot(THYMIO) for path in find_recordings(tmp_path)]
    data = Readings(read, THYMIO)
    for form in infrared.INFRARED_FORMS:
        keys = set(infrared.fit_infrared(data, THYMIO, form, intervals=False).fit.values)
        assert {"a", "b"} <= keys <= {"a", "b", "offset_cm", "exponent"}
