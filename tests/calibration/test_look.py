"""Logs of others: what their columns are is seen, asked for or refused; by a MAP.toml they are recordings."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from realitygap.calibration.load import find_recordings, load_recording
from realitygap.calibration.odometry import measure_odometry
from realitygap.cli import realitygap
from realitygap.correspondence.trials import read_trials
from realitygap.errors import RecordingError
from realitygap.logs.look import look
from realitygap.logs.mapped import read_map
from realitygap.world.robot import load_profile

PAPER = load_profile("paper")
LOGS = Path(__file__).parents[3] / "shared" / "data" / "logs"
TRACK, PULSES = 9.0, 12.0


def driven(seconds: float = 120.0, seed: int = 1):
    """A drive in curves, at 100 Hz: times, poses of the axle's middle (cm, rad), both wheels' ways (cm)."""
    random, n = np.random.default_rng(seed), int(seconds * 100)
    knots = random.uniform(-3, 12, (int(seconds / 2) + 2, 2))
    knots[:2] = 0.0
    t = np.arange(n) / 100
    speed = np.stack([np.interp(t, 2 * np.arange(len(knots)), knots[:, w]) for w in range(2)], 1)
    way = np.cumsum(speed, axis=0) / 100
    heading = 0.7 + (way[:, 1] - way[:, 0]) / TRACK
    step = np.diff(way.mean(axis=1), prepend=0.0)
    x, y = np.cumsum(step * np.cos(heading)) + 60, np.cumsum(step * np.sin(heading)) - 20
    return t, np.stack([x, y, heading], 1), way, speed


def written(path: Path, separator: str, head: list[str], columns, *above: str, decimals: str = "."):
    """A log of columns, each with its format."""
    form = separator.join(head[1::2])
    rows = [form.format(*row) for row in zip(*columns, strict=True)]
    lines = [*above, separator.join(head[::2]), *(row.replace(".", decimals) for row in rows)]
    path.write_text("\n".join(lines) + "\n", "utf-8")
    return path


def mapped(log: Path, **answers: str) -> Path:
    """The MAP.toml that a look at a log makes, each asked key answered."""
    made = look(log)
    assert made.asked.keys() == answers.keys()
    text = made.to_toml(log.parent / "MAP.toml")
    for answer in answers.values():
        text = text.replace('= "?"', f"= {answer}", 1)
    path = log.with_name("MAP.toml")
    path.write_text(text, "utf-8")
    return path


def found(path: Path):
    """Constants of the odometry by a map, and the recording."""
    recording = load_recording(path)
    made = measure_odometry(recording.of_robot(PAPER), PAPER)
    assert made is not None
    return {c.key: c for c in made.constants}, made, recording


def test_semicolons_milliseconds_millimetres_and_quaternions(tmp_path):
    """Decimal commas, a clock from 1970 at uneven steps, ticks of each row, one encoder reversed."""
    t, pose, way, _ = driven()
    random = np.random.default_rng(2)
    rows = np.cumsum(random.choice([4, 5, 6, 9, 30], len(t) // 6, p=[0.25, 0.25, 0.25, 0.23, 0.02]))
    rows = rows[rows < len(t)]
    ticks = np.round(way[rows] * 10 * PULSES)
    each = np.diff(ticks, axis=0, prepend=ticks[:1])
    seen = pose[rows] + random.normal(size=(len(rows), 3)) * [0.05, 0.05, 0.01]
    half = seen[:, 2] / 2
    head = ["Stamp", "{:.0f}", "pos.x [mm]", "{:.2f}", "pos.y [mm]", "{:.2f}", "orientation.x", "{:.1f}",
            "orientation.y", "{:.1f}", "orientation.z", "{:.6f}", "orientation.w", "{:.6f}",
            "enc_L", "{:.0f}", "enc_R", "{:.0f}", "battery", "{:.1f}"]  # fmt: skip
    nothing = np.zeros(len(rows))
    log = written(
        tmp_path / "a.csv", ";", head,
        [1.7e12 + 1000 * t[rows], 10 * seen[:, 0], 10 * seen[:, 1], nothing, nothing, np.sin(half),
         np.cos(half), -each[:, 0], each[:, 1], nothing + 7.4], "Log of our robot", decimals=",",
    )  # fmt: skip
    constants, made, recording = found(mapped(log))
    assert constants["track_cm"].value == pytest.approx(TRACK, rel=0.01)
    for side in ("left", "right"):
        assert 0.1 / constants[f"cm_per_pulse_{side}"].value == pytest.approx(PULSES, rel=0.01)
    assert recording.t_s[-1] == pytest.approx(t[rows[-1]] - t[rows[0]], abs=2e-3)
    assert made.heading_deg == pytest.approx(0.57, rel=0.2) and made.place_cm == pytest.approx(0.05, rel=0.2)
    track = read_trials(tmp_path / "MAP.toml")[0]
    assert track.x[0] == pytest.approx(pose[rows[0], 0], abs=0.3) and track.seconds > 100


def test_tabs_v_and_w_and_a_reversed_heading(tmp_path):
    """In metres and radians; a track of the robot's own makes wheels of them."""
    t, pose, _, speed = driven(seed=3)
    rows = np.arange(0, len(t), 5)
    random = np.random.default_rng(4)
    seen = pose[rows] + random.normal(size=(len(rows), 3)) * [0.05, 0.05, 0.01]
    v, w = speed[rows].mean(axis=1) / 100, (speed[rows, 1] - speed[rows, 0]) / 8.0  # by 8 cm where 9 is true
    head = ["time", "{:.3f}", "x", "{:.5f}", "y", "{:.5f}", "yaw", "{:.4f}", "v", "{:.5f}", "omega", "{:.5f}"]
    wrapped = -((seen[:, 2] + np.pi) % (2 * np.pi) - np.pi)
    log = written(
        tmp_path / "b.tsv", "\t", head, [t[rows], seen[:, 0] / 100, seen[:, 1] / 100, wrapped, v, w]
    )
    constants, made, _ = found(mapped(log, track_cm="8.0"))
    assert constants["track_cm"].value == pytest.approx(TRACK, rel=0.01)
    assert constants["cm_per_pulse_left"].value == pytest.approx(1.0, rel=0.01)
    assert made.heading_deg == pytest.approx(0.57, rel=0.2)


def test_places_only_that_repeat_and_jump(tmp_path):
    """Blanks, no names, cumulative 16-bit counters, left and right exchanged; no heading."""
    t, pose, way, _ = driven(seed=5)
    rows = np.arange(0, len(t), 4)
    random = np.random.default_rng(6)
    seen = pose[rows, :2] + random.normal(size=(len(rows), 2)) * 0.05
    seen = seen[np.arange(len(rows)) // 3 * 3]  # a picture for three rows
    seen[len(rows) // 2 :] += 80.0
    ticks = np.round(way[rows] * 10 * PULSES) + 60000
    ticks = (ticks + 2**15) % 2**16 - 2**15
    head = [
        "t",
        "{:.2f}",
        "x_cm",
        "{:.4f}",
        "y_cm",
        "{:.4f}",
        "left_ticks",
        "{:.0f}",
        "right_ticks",
        "{:.0f}",
    ]
    log = written(tmp_path / "c.txt", " ", head, [t[rows], *seen.T, ticks[:, 1], ticks[:, 0]])
    constants, made, recording = found(mapped(log))
    assert constants["track_cm"].value == pytest.approx(TRACK, rel=0.015)
    assert 0.1 / constants["cm_per_pulse_left"].value == pytest.approx(PULSES, rel=0.01)
    assert np.isnan(made.heading_deg) and not constants["marker_turn_deg"].told
    (said,) = recording.warnings
    jump = (len(rows) // 2 + 2) // 3 * 3 + 2
    assert "after 16 bits (1 time)" in said and "repeated poses" in said
    assert f"1 jump (cut at {log}, line {jump}): 2 pieces" in said


def test_rows_of_a_camera_between_those_of_the_wheels(tmp_path):
    """Each row has one or the other: counters, of 16 bits here, are what they were in between, to a pulse."""
    t, pose, way, _ = driven(seed=8)
    rows = [
        f"{t[k]:.2f},,,{x:.3f},{y:.3f},{h:.4f}"
        for k, (x, y, h) in zip(range(0, 12000, 7), pose[::7], strict=True)
    ]
    rows += [
        f"{t[k]:.2f},{120 * left % 65536:.0f},{120 * right % 65536:.0f},,,"
        for k, (left, right) in enumerate(way)
        if k % 5 == 3
    ]
    rows.sort(key=lambda row: float(row.split(",")[0]))
    (tmp_path / "f.csv").write_text("\n".join(["t,left_enc,right_enc,x_cm,y_cm,yaw", *rows]), "utf-8")
    constants, made, recording = found(mapped(tmp_path / "f.csv"))
    assert constants["track_cm"].value == pytest.approx(TRACK, rel=0.003) and made.place_cm < 0.03
    assert "empty cells filled from its neighbours" in recording.warnings[0]


def test_no_names_and_names_that_do_not_fit(tmp_path):
    """Columns without names are asked for; names are taken from the left, which is said."""
    t, pose, way, _ = driven(60.0, seed=7)
    columns = [t[::3], *pose[::3].T, *(120 * way[::3]).T]
    form = ["{:.2f}", *["{:.3f}"] * 3, *["{:.0f}"] * 2]
    rows = [",".join(form).format(*row) for row in zip(*columns, strict=True)]
    (tmp_path / "d.txt").write_text("\n".join(row.replace(",", " ") for row in rows), "utf-8")
    bare = look(tmp_path / "d.txt")
    assert bare.asked.keys() == {"kind"} and "# Not told: 1, 2, 3, 4, 5, 6." in bare.to_toml(tmp_path / "m")
    (tmp_path / "e.csv").write_text("\n".join(["% A title", "t,x,y,yaw,tick_l", *rows, "1,2", ""]), "utf-8")
    log = look(tmp_path / "e.csv").log
    assert log.names == ("t", "x", "y", "yaw", "tick_l", "6") and len(log.values) == len(rows)
    assert log.notes == (
        f"1 line left out: no rows of 6 values (line {len(rows) + 3})",
        "line 2 has 5 names for 6 values: taken from the left; check them",
    )


SENSORS = """# set down by hand
day|sensor|distance_mm|count
30|0|10|156
30|0|20|84
30|1|10|300
31|1|10|310
"""


def test_readings_of_one_sensor_a_row(tmp_path):
    """A sensor's number beside its reading; the bearing is asked for each sensor, repeats are counted."""
    log = tmp_path / "tidy.csv"
    log.write_text(SENSORS, "utf-8")
    path = mapped(log, object='"wall"', bearing_deg="[90, 45]")
    made = read_map(path)
    assert made.sensors is not None and np.isnan(made.sensors).sum() == 4
    path.write_text(path.read_text("utf-8").replace("[90, 45]", "[90, 45, 0]"), "utf-8")
    with pytest.raises(RecordingError, match="bearing_deg: expected degrees: a number, or a list of 2"):
        load_recording(path)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('t_s = { column = "T" }', "t_s: column: expected one of run.csv's, time, a, b, or its number"),
        ('t_s = { column = 1, unit = "?" }', "t_s: unit: expected one of s, ms, us, ns, got '?'"),
        ("t_s = { column = 1, sign = 2 }", "t_s: sign: expected 1 or -1, got 2"),
        ("x_mm = 1", "x_mm: unknown key. Did you mean 'x_cm'"),
        ("t_s = 1", "expected columns counter_left, counter_right, or those of speeds or commands, got t_s"),
        ("t_s = 1\nv = 2\nw = 3", "track_cm: expected the cm"),
        ('[other]\npulses_per_mm = "?"', "other: unknown key"),
    ],
)
def test_what_is_wrong_in_a_map_is_named_by_its_key(tmp_path, text, says):
    """With the file; what was asked and not answered, too."""
    (tmp_path / "run.csv").write_text("time,a,b\n" + "".join(f"{k},{k % 3},1\n" for k in range(9)), "utf-8")
    head = 'logs = ["run.csv"]\nkind = "wheels"\n[columns]\n'
    (tmp_path / "MAP.toml").write_text(head + text.replace("[other]", "t_s = 1\n[other]"), "utf-8")
    with pytest.raises(RecordingError) as refused:
        load_recording(*find_recordings(tmp_path))
    assert says in str(refused.value) and str(tmp_path) in str(refused.value)


def test_a_log_is_sent_to_look_first_and_looked_at(tmp_path):
    """The command prints what it guessed, draws it, and writes the map; it overwrites none."""
    t, _, way, _ = driven(30.0)
    head = ["t", "{:.2f}", "enc_l", "{:.0f}", "enc_r", "{:.0f}"]
    log = written(tmp_path / "run.log", " ", head, [t[::10], *(120 * way[::10]).T])
    run = CliRunner().invoke
    refused = run(realitygap, ["calibrate", str(log), "--out", str(tmp_path / "o.toml")])
    assert "Run `realitygap look" in refused.output
    made = run(realitygap, ["look", str(log)])
    assert "enc_l   counter_left   pulses" in made.output and "asked: pulses_per_mm" in made.output
    assert max(map(len, made.stdout.splitlines()[:7])) <= 80 and (tmp_path / "MAP.png").stat().st_size > 5000
    assert "there is one already" in run(realitygap, ["look", str(log)]).output
    told = json.loads(run(realitygap, ["look", str(log), "--out", str(tmp_path / "b.toml"), "--json"]).stdout)
    assert told["asked"].keys() == {"pulses_per_mm"} and told["columns"][0]["name"] == "t_s"
    text = (tmp_path / "b.toml").read_text("utf-8").replace('= "?"', "= 12")
    (tmp_path / "b.toml").write_text(text, "utf-8")
    assert "1 run" in run(realitygap, ["look", str(log), "--map", str(tmp_path / "b.toml")]).output


@pytest.mark.parametrize("pair", [((1, 2), (3, 4)), ((3, 4), (1, 2))])
def test_a_real_robots_raw_runs_are_predicted(tmp_path, pair):
    """Fitted on two runs as they were logged, the other two end within 12.6 cm and 5°; two keys are asked."""
    if not LOGS.is_dir():
        pytest.skip("the logs of other people's robots are not here")
    trento = LOGS / "trento-wheels"
    base, read = load_profile(trento / "base.toml"), []
    for numbers in pair:
        made = look(trento / f"cleaned_0{numbers[0]}.txt")
        assert made.asked.keys() == {"x_cm.unit"}
        files = json.dumps([str(trento / f"cleaned_0{k}.txt") for k in numbers])
        text = "\n".join(made.to_toml(tmp_path / "MAP.toml").replace('"?"', '"cm"').splitlines()[2:])
        (tmp_path / "MAP.toml").write_text(f"logs = {files}\n{text}\n", "utf-8")
        read.append(load_recording(tmp_path / "MAP.toml").of_robot(base))
    made = measure_odometry(read[0], base)
    told = {c.key: c.value for c in made.constants}
    assert told["track_cm"] == pytest.approx(55.6, abs=0.3)
    for place, heading in made.ends(read[1]):
        assert place < 12.6 and heading < np.radians(5)


def test_a_raw_logs_reversed_heading_and_encoder_are_seen():
    """As its makers' own cleaned table has them."""
    if not LOGS.is_dir():
        pytest.skip("the logs of other people's robots are not here")
    made = {guess.name: guess for guess in look(LOGS / "trento-wheels" / "original_01.txt").guesses}
    assert [made[name].sign for name in ("heading_deg", "counter_left", "counter_right")] == [-1, -1, 1]
    assert made["heading_deg"].unit == "rad" and made["t_s"].unit == "ms"


def test_logs_of_one_name_are_runs_apart(tmp_path):
    """Named by their folders; an empty cell at the begin of one says nothing of the one before."""
    for k in range(2):
        (tmp_path / f"{k}").mkdir()
        rows = [f"{t / 10},{t},{'' if t == 0 else 40 * t + 9000 * k}" for t in range(20)]
        (tmp_path / f"{k}" / "run.csv").write_text("\n".join(["t,x,n", *rows]), "utf-8")
    columns = "\n".join(f'{name} = "{column}"' for name, column in
                        (("t_s", "t"), ("x_cm", "x"), ("y_cm", "x"), ("heading_deg", "x"),
                         ("counter_left", "n"), ("counter_right", "n")))  # fmt: skip
    path = tmp_path / "MAP.toml"
    path.write_text(f'logs = ["0/run.csv", "1/run.csv"]\nkind = "wheels"\n[columns]\n{columns}\n', "utf-8")
    made = read_map(path)
    assert [name for name, _ in made.tracks()] == ["0/run.csv", "1/run.csv"]
    with (tmp_path / "1" / "run.csv").open("a", encoding="utf-8") as file:
        file.write("\n0.5,5,5")
    with pytest.raises(RecordingError, match="line 22: t_s: expected a time after"):
        read_map(path).tracks()
    np.testing.assert_array_equal(np.diff(made.columns["counter_left"])[[0, 20]], [0, 0])


def test_an_empty_cell_of_pulses_a_row_is_told(tmp_path):
    """What was not counted is lost: the sum goes on without it."""
    rows = "".join(f"{k / 10},{'' if k == 7 else 5},5\n" for k in range(20))
    (tmp_path / "run.csv").write_text("t,l,r\n" + rows, "utf-8")
    each = ", unit = 'pulses', per_row = true }\n"
    (tmp_path / "MAP.toml").write_text(
        f"logs = ['run.csv']\nkind = 'wheels'\n[columns]\nt_s = 't'\ncounter_left = {{ column = 'l'{each}"
        f"counter_right = {{ column = 'r'{each}",
        "utf-8",
    )
    made = read_map(tmp_path / "MAP.toml")
    assert made.notes == ("counter_left: 1 empty cell taken as no pulse",)
    assert np.ptp(made.columns["counter_left"]) == np.ptp(made.columns["counter_right"]) - 5
