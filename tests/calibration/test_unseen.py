"""Readings of robots that nobody has seen here: tables written by other hands, programs and machines."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from realitygap.calibration import forms
from realitygap.calibration.load import find_recordings, load_recording
from realitygap.calibration.noise import Yardstick, lit_noise, misfits, sample_noise
from realitygap.calibration.readings import Readings
from realitygap.calibration.recordings import SensorRecording
from realitygap.world.robot import load_profile
from tests.calibration.test_recording import HEAD, ROW, written

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


def test_a_sensor_that_was_not_recorded_has_an_empty_column(tmp_path):
    """It is taken to be like the others, and said to be; an empty cell is a reading that was not taken."""
    row = ROW.split(",")
    rows = [",".join([f"{k % 5}", f"{20 * k}", "0", *row[3:5], "", *row[6:]]) for k in range(9)]
    read = load_recording(written(tmp_path / "r", HEAD, *rows))
    assert isinstance(read, SensorRecording)
    assert np.isnan(read.counts).all(axis=0).tolist() == [k == 2 for k in range(8)]
    some = load_recording(written(tmp_path / "p", HEAD, ROW, rows[0]))
    assert isinstance(some, SensorRecording)
    assert np.argwhere(np.isnan(some.counts)).tolist() == [[1, 2]]


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


def test_a_straight_series_turns_no_sensor(tmp_path):
    """By no printed form: two of them had turned the front's sensor by 69 degrees, and what was not recorded
    read far too much."""
    series(tmp_path, *fallen())
    series(tmp_path, *fallen("{}5mm"), name="sensor05_light.csv")
    read = [load_recording(path).of_robot(THYMIO) for path in find_recordings(tmp_path)]
    data = Readings(read, THYMIO)
    for form in forms.INFRARED_FORMS:
        keys = set(forms.fit_infrared(data, THYMIO, form, intervals=False).fit.values)
        assert {"a", "b"} <= keys <= {"a", "b", "offset_cm", "exponent"}
