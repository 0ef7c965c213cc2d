"""The open format: what is written is read back, and what is wrong is named with file and line."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from realitygap.calibration.load import find_recordings, load_recording
from realitygap.calibration.readings import dead_sensors
from realitygap.calibration.recordings import SensorRecording, WheelRecording
from realitygap.errors import RecordingError
from realitygap.world.arena import load_arena
from tests.calibration.written import save_recording

HEAD = "distance_cm,bearing_deg,repeat,s0,s1,s2,s3,s4,s5,s6,s7"
ROW = "1.5,30,0,10,20,30,40,50,60,70,80"
FACTS = 'kind = "infrared"\nobject = "wall"\n'


def written(folder: Path, *rows: str, facts: str = FACTS, name: str = "readings.csv") -> Path:
    """A recording's folder with a table of these lines."""
    folder.mkdir(exist_ok=True)
    (folder / "recording.toml").write_text(facts, encoding="utf-8")
    (folder / name).write_text("".join(f"{row}\n" for row in rows), encoding="utf-8")
    return folder


def infrared(n: int = 40) -> SensorRecording:
    """Some plausible readings."""
    draw = np.random.default_rng(n)
    return SensorRecording(
        kind="infrared",
        object="cylinder:2.7",
        distance_cm=np.repeat(np.arange(n // 4) / 4, 4),
        bearing_deg=np.repeat(np.arange(n // 4) * 20.0 % 360 - 170, 4),
        repeat=np.tile(np.arange(4), n // 4),
        counts=draw.integers(0, 1024, (n, 8)).astype(float),
        notes="a bench",
        reflectance=0.6,
    )


def test_readings_come_back_equal(tmp_path):
    """A folder holds all there is to sensor readings."""
    made = infrared()
    save_recording(tmp_path / "r", made)
    back = load_recording(tmp_path / "r")
    assert isinstance(back, SensorRecording)
    for name in ("distance_cm", "bearing_deg", "repeat", "counts"):
        assert np.array_equal(getattr(back, name), getattr(made, name)), name
    assert (back.kind, back.object, back.radius_cm) == ("infrared", "cylinder:2.7", 2.7)
    assert back.notes == "a bench" and back.reflectance == 0.6
    save_recording(tmp_path / "u", replace(made, reflectance=math.nan))
    assert math.isnan(load_recording(tmp_path / "u").reflectance)
    assert (back.source, len(back.hash), back.warnings) == (str(tmp_path / "r"), 64, ())


def test_poses_come_with_their_arena(tmp_path):
    """Then distance and bearing of the lamp follow from them."""
    arena = load_arena("light-seeking")
    pose = np.array([[60.0, 35.0, np.pi / 2], [100.0, 35.0, 0.0]])
    nothing = np.zeros(2)
    made = SensorRecording(
        kind="ambient", object="lamp", distance_cm=nothing, bearing_deg=nothing,
        repeat=np.zeros(2, np.int64), counts=np.full((2, 8), 400.0), pose=pose, arena=arena,
    )  # fmt: skip
    save_recording(tmp_path / "r", made)
    back = load_recording(tmp_path / "r")
    assert isinstance(back, SensorRecording) and back.arena == arena and back.pose is not None
    assert np.allclose(back.pose, pose)
    assert np.allclose(back.distance_cm, [47.25, 7.25]) and np.allclose(back.bearing_deg, [-90, 0])


@given(st.lists(st.tuples(st.integers(-10, 10), st.integers(-9999, 9999)), min_size=1, max_size=30))
@settings(max_examples=20)
def test_steps_come_back_equal(tmp_path_factory, pairs):
    """Whatever the wheels did; a camera's poses stay where there were pictures."""
    n = len(pairs)
    numbers = np.array(pairs, float)
    pose = np.full((n, 3), np.nan)
    pose[0] = 10.25, 20.5, -1.5
    made = WheelRecording(
        t_s=np.arange(n) / 10, commands=numbers[:, [0, 0]], counters=numbers[:, [1, 1]],
        speeds=numbers[:, [0, 0]], trial=np.zeros(n, np.int64), kind=np.full(n, "turn"), pose=pose,
    )  # fmt: skip
    folder = tmp_path_factory.mktemp("steps") / "r"
    save_recording(folder, made)
    back = load_recording(folder / "recording.toml")
    assert isinstance(back, WheelRecording)
    for name in ("t_s", "commands", "counters", "speeds", "trial", "kind"):
        assert np.array_equal(getattr(back, name), getattr(made, name)), name
    assert back.pose is not None and np.allclose(back.pose, pose, equal_nan=True)
    assert [rows.tolist() for rows in back.trials("turn")] == [list(range(n))]
    assert back.trials("start") == []


@pytest.mark.parametrize(
    ("rows", "says"),
    [
        ((HEAD, ROW, "1.5,30,1,10,20"), "line 3: expected 11 values, got 5"),
        ((HEAD, ROW.replace("40", "4O")), "line 2: s3: expected a number"),
        ((HEAD, ROW, ROW.replace("1.5", "-1.5")), "line 3: distance_cm: expected 0 to 300 cm"),
        ((HEAD, ROW.replace("80", "1126")), "line 2: s7: expected counts from 0 to 1023"),
        ((HEAD.replace(",s7", ""), ROW[:-3]), "line 1: expected the sensors' columns s0 to s7"),
        ((HEAD.replace("_cm", "_mm"), ROW), "line 1: expected columns distance_cm"),
        (
            (HEAD, ROW.replace("1.5", "60").replace("80", "800")),
            "line 2: distance_cm: expected at most 20 cm",
        ),
        ((HEAD.replace(",", ";"), ROW.replace(",", ";")), "line 1: expected values separated by commas"),
    ],
)
def test_what_is_wrong_is_named_with_its_line(tmp_path, rows, says):
    """Empty, cut short, not numbers, out of range, columns missing, millimetres."""
    with pytest.raises(RecordingError) as refused:
        load_recording(written(tmp_path / "r", *rows, facts=FACTS + "sensors = 8\nfull_scale = 1023\n"))
    assert says in str(refused.value) and "readings.csv" in str(refused.value)


@pytest.mark.parametrize(
    ("facts", "says"),
    [
        ('object = "wall"', "recording.toml: kind: expected infrared, ambient, wheels, got None."),
        ('kind = "infrared"', '"wall" or "cylinder:RADIUS_CM"'),
        (FACTS + 'units = "mm"', "units: expected"),
        (FACTS + "body_height_cm = 1\nsensor_height_cm = 1.2", "the sensors below the body's top"),
        (FACTS + "full_scale = 72", "s7: expected counts from 0 to 72"),
        (FACTS + "body_radius = 3", "body_radius: unknown key. Did you mean 'body_radius_cm'?"),
    ],
)
def test_wrong_facts_are_named(tmp_path, facts, says):
    """What recording.toml says is checked like the table; a missing kind does not make a drive of it."""
    with pytest.raises(RecordingError) as refused:
        load_recording(written(tmp_path / "r", HEAD, ROW, facts=facts))
    assert says in str(refused.value)


@pytest.mark.parametrize("file", ["drive.toml", "recording.toml"])
@pytest.mark.parametrize(
    ("end", "says"), [("", "got a drive's that was killed"), ("[end]\n", "got a drive's. Make")]
)
def test_a_drive_is_no_recording_for_a_calibration(tmp_path, file, end, says):
    """It says so, and whether it was killed; in earlier versions its facts had the name of a recording's."""
    (tmp_path / file).write_text(f'task = "avoidance"\n{end}', "utf-8")
    (tmp_path / "steps.csv").write_text("t_s,late_s,command_left,command_right\n", "utf-8")
    assert find_recordings(tmp_path) == (tmp_path,)
    for path in (tmp_path, tmp_path / file):
        with pytest.raises(RecordingError, match=says):
            load_recording(path)


def test_a_recording_says_who_placed_the_robot(tmp_path):
    """A program's places are exact; a unit's number alone, which anybody may write, does not make them so."""
    for k, (facts, by_program) in enumerate(
        [("", False), ("unit = 3", False), ('placed_by = "program"', True), ("twin_noise = 1.0", True)]
    ):
        made = load_recording(written(tmp_path / str(k), HEAD, ROW, facts=f"{FACTS}{facts}\n"))
        assert isinstance(made, SensorRecording) and made.by_program == made.exact == by_program


def test_steps_of_a_wrong_kind_or_order_are_refused(tmp_path):
    """With the line."""
    head = "t_s,command_left,command_right,counter_left,counter_right,speed_left,speed_right,trial,kind"
    facts = 'kind = "wheels"'
    good, late = "0.0,1,1,0,0,0,0,0,step", "0.0,1,1,5,5,1,1,0,step"
    for rows, says in (
        ((good.replace("step", "jump"),), "line 2: kind: expected one of step"),
        ((good, late), "line 3: t_s: expected a time"),
        ((good, good.replace("0,step", "1,step"), good), "line 4: trial: expected a new number, got 0. A"),
    ):
        with pytest.raises(RecordingError, match=says):
            load_recording(written(tmp_path / "w", head, *rows, facts=facts, name="steps.csv"))


def test_drives_need_one_of_counters_speeds_and_commands(tmp_path):
    """Speeds become counters; a camera may see places only; without all three the columns are named."""
    rows = [f"{k / 10},{2 * k},{-k},0,{k}.5,7" for k in range(5)]
    head, facts = "t_s,counter_left,counter_right,trial,x_cm,y_cm", 'kind = "wheels"'
    made = load_recording(written(tmp_path / "a", head, *rows, facts=facts, name="steps.csv"))
    assert made.counted and not made.commanded and np.isnan(made.pose[:, 2]).all()
    speeds = head.replace("counter", "speed")
    made = load_recording(written(tmp_path / "b", speeds, *rows, facts=facts, name="steps.csv"))
    assert made.from_speeds and made.counters[-1] == pytest.approx((2 * 0.8, -0.8))
    with pytest.raises(RecordingError, match="or those of speeds or commands, got t_s, tick"):
        load_recording(
            written(tmp_path / "c", head.replace("counter", "tick"), *rows, facts=facts, name="steps.csv")
        )


def test_gaps_jumps_and_repeats_are_said_in_one_line(tmp_path):
    """Pieces are trials; a pose that stayed while the wheels turned, or was alone elsewhere, is none."""
    t, x = np.arange(60) * 0.1, np.arange(60) * 0.5
    t[40:] += 2.0
    x[20], x[11], x[50:] = 90.0, x[10], x[50:] + 30.0
    rows = [f"{a:.1f},{60 * k},{60 * k},0,{b:.2f},7" for k, (a, b) in enumerate(zip(t, x, strict=True))]
    rows[40:] = [row.replace(f",{60 * k},", f",{60 * k + 9000},") for k, row in enumerate(rows[40:], 40)]
    head, facts = "t_s,counter_left,counter_right,trial,x_cm,y_cm", 'kind = "wheels"'
    made = load_recording(written(tmp_path, head, *rows, facts=facts, name="steps.csv"))
    (said,) = made.warnings
    where = ", ".join(f"{tmp_path / 'steps.csv'}, line {k}" for k in (42, 52))
    assert said.endswith(
        f"left out: 1 repeated pose, 1 out-of-reach pose, 1 jump, 1 gap (cut at {where}): 3 pieces"
    )
    assert np.flatnonzero(np.isnan(made.pose[:, 0])).tolist() == [11, 20]
    assert np.flatnonzero(np.diff(made.trial)).tolist() == [39, 49]


def test_dead_sensors_are_pointed_out(tmp_path):
    """One that never changes, one that is always saturated, one that hardly changes."""
    made = infrared(80)
    counts = made.counts.copy()
    counts[:, 2], counts[:, 4], counts[:, 5] = 7, 1023, 3 + np.arange(80) % 5
    counts[0, 4] = 900
    save_recording(tmp_path / "r", replace(made, counts=counts))
    back = load_recording(tmp_path / "r")
    dead = dead_sensors(back, 1023.0)
    assert back.warnings == () and sorted(dead) == [2, 4, 5]  # said once, by whoever uses the recording
    assert "sensor 2 reads 7 everywhere" in dead[2] and "sensor 4 is saturated" in dead[4]
    assert "sensor 5 hardly changes" in dead[5]
