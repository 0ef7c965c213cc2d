"""Recording: the program places the twin, a person the robot; what is broken off is gone on with."""

from __future__ import annotations

import contextlib
import json
import math
import os
import signal
import subprocess
import sys
import time
from contextlib import closing
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner

from realitygap.calibration import record as recorder
from realitygap.calibration.load import load_recording
from realitygap.calibration.model import scene_of
from realitygap.calibration.plan import (
    FLOOR_CM,
    ROOM,
    Plan,
    Trial,
    infrared_task,
    wheel_trials,
)
from realitygap.calibration.record import OwnSite, PersonSite, StoppedByUserError, drive_trial, record
from realitygap.calibration.recordings import BODY_RADIUS_CM, SensorRecording
from realitygap.cli import realitygap
from realitygap.errors import RecordingError, UsageError
from realitygap.film import calibrate as film_calibrate
from realitygap.film.calibrate import calibrate_camera
from realitygap.robots.address import Address
from realitygap.robots.body import Body as RobotBody
from realitygap.robots.body import Channel
from realitygap.values import Pose, Readings
from realitygap.world.arena import Arena, Cylinder
from realitygap.world.robot import Body, load_profile
from tests.calibration.written import save_recording
from tests.kernels.reference.outline import clearance
from tests.kernels.test_outline import OUTLINES
from tests.robots.conftest import ROOT, Bench, bench

__all__ = ["bench"]

WORDS = ["record", "--plan", "infrared", "--object", "wall", "--repeats", "1"]


def run(*words: object, answers: str = "") -> tuple[int, str, str]:
    """A command's exit code and what it said."""
    made = CliRunner().invoke(realitygap, [str(word) for word in words], input=answers)
    return made.exit_code, made.stdout, made.stderr


@pytest.mark.parametrize("name", ["wall", "cylinder:2.7"])
def test_a_plan_puts_the_robot_where_its_table_says(name):
    """Distance from edge to edge, bearing from the robot's front; each place once."""
    plan = infrared_task(name)
    for place in plan.stops:
        distance, bearing = place.where
        if name == "wall":
            gap, x = place.pose.x - BODY_RADIUS_CM, 0.0
        else:
            ((x, y, radius),) = plan.room["cylinders"]
            gap = math.hypot(place.pose.x - x, place.pose.y - y) - BODY_RADIUS_CM - radius
        assert gap == pytest.approx(distance)
        towards = math.atan2(0.0, x - place.pose.x) - place.pose.heading
        assert math.cos(towards - math.radians(bearing)) == pytest.approx(1.0)
        if 0 < bearing < 180:
            assert "left" in place.says
    assert len({place.where for place in plan.stops}) == len(plan.stops)
    assert {place.where[0] for place in plan.stops} >= {0.5, 8.0}


@pytest.mark.parametrize("outline", OUTLINES)
@pytest.mark.parametrize("name", ["wall", "cylinder:2.7"])
def test_a_polygons_distances_count_from_its_outline(tmp_path, name, outline):
    """The plan puts it down, and a calibration sees it stand, that far from its very edge; files keep it."""
    body = Body(outline_cm=outline)
    plan = infrared_task(name, body)
    distance, bearing = np.array([place.where for place in plan.stops]).T
    save_recording(tmp_path, SensorRecording(
        kind="infrared", object=name, distance_cm=distance, bearing_deg=bearing,
        repeat=np.zeros(len(distance), np.int64), counts=np.zeros((len(distance), 2)),
        body_radius_cm=body.radius_cm, body_outline_cm=body.outline_cm,
    ))  # fmt: skip
    scene = scene_of(load_recording(tmp_path))
    stands = [(place.pose.x, place.pose.y, place.pose.heading) for place in plan.stops]
    for size, things, poses in (
        (plan.room["size_cm"], plan.room.get("cylinders", []), stands),
        (scene.arena.size, scene.arena.cylinders, scene.poses[scene.row]),
    ):
        round_ones = tuple(Cylinder(x_cm=x, y_cm=y, radius_cm=radius) for x, y, radius in things)
        room = Arena(name="room", size_cm=tuple(size), cylinders=round_ones)
        gaps = [clearance(room, outline, pose) for pose in poses]
        assert gaps == pytest.approx(distance.tolist(), abs=1e-9)


def test_the_wheels_plan_has_every_kind_and_stays_on_the_floor():
    """Steps of many sizes, starts, lines, turns; each trial ends standing."""
    trials = wheel_trials(10, 0)
    assert {trial.kind for trial in trials} == {"step", "start", "straight", "turn"}
    assert [trial.number for trial in trials] == list(range(len(trials)))
    assert all(trial.commands[-1] == (0, 0) for trial in trials)
    assert {c for trial in trials for c, _ in trial.commands} == set(range(-10, 11))
    for trial in trials:
        x, y, heading = trial.pose.x, trial.pose.y, trial.pose.heading
        for left, right in trial.commands:
            x += 0.04 * (left + right) * math.cos(heading)
            y += 0.04 * (left + right) * math.sin(heading)
            heading += 0.08 * (right - left) / 5.3
            assert 4 < x < FLOOR_CM - 4 and 4 < y < FLOOR_CM - 4, trial
    assert trials == wheel_trials(10, 0) != wheel_trials(10, 1)


def test_a_twin_is_recorded(tmp_path):
    """Every place of the plan, the nearer the more counts; the same command makes the same table."""
    words = [*WORDS, "--robot", "twin:3", "--seed", 4]
    code, said, _ = run(*words, "--out", tmp_path / "a", "--json")
    facts = json.loads(said)
    assert code == 0 and facts["finished"] and facts["unit"] == 3
    made = load_recording(tmp_path / "a")
    assert isinstance(made, SensorRecording) and made.warnings == ()
    assert len(made.repeat) == facts["recordings"][0]["places"] == len(infrared_task("wall").stops)
    ahead = made.counts[np.abs(made.bearing_deg) <= 15, 2:4]
    assert ahead[:3].min() > 900 and ahead[-3:].max() < 100
    assert made.facts["twin_noise"] == 1.0
    assert run(*words, "--out", tmp_path / "b")[0] == 0
    tables = [(tmp_path / name / "readings.csv").read_text() for name in "ab"]
    assert tables[0] == tables[1]
    code, _, error = run(*words, "--out", tmp_path / "a")
    assert code == 2 and "already holds a recording" in error
    code, _, error = run(*words, "--out", tmp_path / "a", "--resume", "--twin-noise", 2)
    assert code == 2 and "twin_noise" in error


def test_one_process_records_into_a_folder_at_a_time(tmp_path):
    """A second one, which would write the same places once more, is told so; then it goes on."""
    words = [*WORDS, "--robot", "twin:3", "--out", str(tmp_path / "a")]
    with recorder._alone(tmp_path / "a"):
        code, _, error = run(*words, "--resume")
        assert code == 2 and f"{tmp_path / 'a'}: another process records there. Wait" in error
    assert not (tmp_path / "a").exists()
    assert run(*words, "--resume")[0] == 0


def test_kill_9_loses_one_place_at_most(tmp_path):
    """What was written stays as it is, a half row is dropped, and --resume comes to the same places."""
    words = [*WORDS, "--robot", "twin:3", "--out", str(tmp_path / "a")]
    paths = os.pathsep.join([str(ROOT / "src"), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": paths}
    table = tmp_path / "a" / "readings.csv"
    with subprocess.Popen(
        [sys.executable, "-m", "realitygap", *words], env=environment, stderr=subprocess.DEVNULL
    ) as process:
        until = time.monotonic() + 60
        while time.monotonic() < until and not (table.is_file() and table.read_text().count("\n") > 20):
            time.sleep(0.01)
        process.kill()
    kept = table.read_text()
    assert 20 < kept.count("\n") < len(infrared_task("wall").stops)
    with table.open("a") as file:
        file.write("8,345,0,1,2")
    with pytest.raises(RecordingError, match=r"readings\.csv, line"):
        load_recording(tmp_path / "a")
    assert run(*words, "--resume")[0] == 0
    whole = table.read_text()
    assert whole.startswith(kept)
    made = load_recording(tmp_path / "a")
    assert isinstance(made, SensorRecording) and made.warnings == ()
    assert int(made.place().max()) + 1 == len(made.repeat) == len(infrared_task("wall").stops)


def test_resuming_gives_the_bits_of_an_undisturbed_recording(tmp_path, monkeypatch):
    """A place's noise follows from the place, a trial's and its pictures' from the trial: stopped or not."""
    wall = infrared_task("wall")
    few = [replace(wall, stops=wall.stops[:5])]
    drives = [t for t in wheel_trials(1, 0) if t.filmed and not t.watched][:2]
    few.append(
        replace(few[0], name="wheels", kind="wheels", key=("trial",), room=ROOM, stops=drives, facts={})
    )
    monkeypatch.setattr(recorder, "tasks_of", lambda plan, body: few)
    wanted, twin = Plan(kind="all", repeats=2, seed=7), Address.parse("twin:3")

    def stop(name: str, done: int, total: int) -> None:
        if (name, done) in (("infrared-wall", 2), ("wheels", 1)):
            raise KeyboardInterrupt

    found = []

    def once(*seen: object) -> object:  # the same each time, and slow
        found[:] = found or [calibrate_camera(*seen)]
        return found[0]

    monkeypatch.setattr(film_calibrate, "calibrate_camera", once)
    with closing(twin.open()) as body:
        record(wanted, tmp_path / "whole", body)
    for _ in range(2):
        with contextlib.suppress(KeyboardInterrupt), closing(twin.open()) as body:
            record(wanted, tmp_path / "broken", body, resume=True, on_progress=stop)
    with closing(twin.open()) as body:
        record(wanted, tmp_path / "broken", body, resume=True)
    for table in ("infrared-wall/readings.csv", "wheels/steps.csv"):
        assert (tmp_path / "broken" / table).read_text() == (tmp_path / "whole" / table).read_text(), table


def test_places_are_chosen_kept_and_resumed_as_they_were(tmp_path):
    """So many bearings at these distances; another plan does not go on with them."""
    chosen = [*WORDS, "--robot", "twin:3", "--out", tmp_path / "a", "--bearings", 5, "--distances", "1,12"]
    assert run(*chosen)[0] == 0
    made = load_recording(tmp_path / "a")
    assert len(made.counts) == 10
    assert made.facts["bearings"] == 5 and made.facts["distances_cm"] == [1.0, 12.0]
    assert sorted(set(made.bearing_deg.tolist())) == [-144.0, -72.0, 0.0, 72.0, 144.0]
    assert run(*chosen, "--resume")[0] == 0
    for other, begun in (
        (["--bearings", 2, "--distances", "1,2,3,4,5"], "5, not 2"),
        ([], "5, not the usual"),
    ):
        code, _, told = run(*WORDS, "--robot", "twin:3", "--out", tmp_path / "a", *other, "--resume")
        assert code == 2 and f"bearings: this recording was begun with {begun};" in told


def test_ctrl_c_ends_a_recording_in_order(tmp_path):
    """With exit code 130 and a word about going on; the finished places are whole."""
    words = [*WORDS, "--robot", "twin:3", "--out", str(tmp_path / "a")]
    paths = os.pathsep.join([str(ROOT / "src"), os.environ.get("PYTHONPATH", "")])
    table = tmp_path / "a" / "readings.csv"
    with subprocess.Popen(
        [sys.executable, "-m", "realitygap", *words],
        env={**os.environ, "PYTHONPATH": paths}, stderr=subprocess.PIPE, text=True,
    ) as process:  # fmt: skip
        until = time.monotonic() + 60
        while time.monotonic() < until and not (table.is_file() and table.read_text().count("\n") > 5):
            time.sleep(0.01)
        process.send_signal(signal.SIGINT)
        _, error = process.communicate(timeout=60)
    assert process.returncode == 130 and "--resume continues" in error.splitlines()[-1]
    assert "unfinished" in load_recording(tmp_path / "a").warnings[-1]


@pytest.mark.parametrize("marker", [None, "aruco:4x4_50:7,x=5"])
def test_the_camera_sees_where_a_twin_was(tmp_path, marker):
    """By its disk and by a tag: within half a millimetre of its place, and turned as its counters say."""
    commands = ((-4, 4),) * 10 + ((0, 0),) * 5
    start = Pose(x=31.0, y=27.0, heading=0.4)
    trial = Trial(number=0, kind="turn", commands=commands, pose=start, filmed=True, says="")
    room = {"size_cm": [FLOOR_CM, FLOOR_CM]}
    with (
        closing(Address.parse("twin:2").open()) as body,
        OwnSite(body, room, seed=1, camera=True, marker=marker) as site,
    ):
        assert site.go(trial)
        rows, _ = drive_trial(body, trial)
        seen = site.poses(trial)
    assert sorted(seen) == list(trial.seen()) == [0, 10, 14]
    assert math.dist((seen[0].x, seen[0].y), (31.0, 27.0)) < 0.05
    left, right = (int(count) for count in rows[-1][3:5])
    assert seen[14].heading - seen[0].heading == pytest.approx((right - left) / 120 / 5.3, rel=0.1)
    assert [float(row[0]) for row in rows] == pytest.approx([k / 10 for k in range(15)])


def test_a_person_is_guided_and_may_stop(bench: Bench, tmp_path):
    """Each place is told, one may be left out, "q" or the end of the input stops; --resume goes on."""
    twin = bench.twin()
    words = [*WORDS, "--robot", f"serial:{twin.device}", "--out", tmp_path / "a"]
    code, said, told = run(*words, answers="\n\ns\nwhat\n\nq\n")
    assert code == 0 and "--resume continues" in said
    assert "0.5 cm between body and wall, the wall straight ahead" in told
    rows = (tmp_path / "a" / "readings.csv").read_text().splitlines()
    assert [row.split(",")[:3] for row in rows[1:]] == [["0.5", "0", "0"], ["0.5", "30", "0"]]
    assert "unfinished: 2 of" in load_recording(tmp_path / "a").warnings[-1]
    code, said, told = run(*words, "--resume", answers="\n\n")
    assert code == 0 and told.count(" 15° to the left") == 1 and "straight ahead" not in told
    assert len((tmp_path / "a" / "readings.csv").read_text().splitlines()) == 4


def test_a_person_measures_where_the_wheels_led(bench: Bench):
    """Start and end of a filmed trial are asked for, nonsense again; the robot stands after it."""
    twin = bench.twin()
    khepera = bench.khepera(twin.device)
    answers = iter(["", "ten", "10 20 90", "10, 22.5, 91", "q"])
    site = PersonSite(lambda says: next(answers))
    pose = Pose(x=0, y=0, heading=0)
    trial = Trial(number=7, kind="straight", commands=((5, 5), (0, 0)), pose=pose, filmed=True, says="room")
    assert site.go(trial)
    rows, _ = drive_trial(khepera, trial)
    seen = site.poses(trial)
    assert [row[-2:] for row in rows] == [("7", "straight")] * 2
    assert int(rows[1][3]) > 0 and khepera.read("E") == (0, 0)
    assert seen[0].heading == pytest.approx(math.pi / 2) and (seen[1].x, seen[1].y) == (10, 22.5)
    with pytest.raises(StoppedByUserError):
        site.go(trial)


class Still(RobotBody):
    """A robot that stands in the dark, whose wheels must not turn."""

    channels = tuple(Channel(name=kind, sensors=8, high=1023) for kind in ("proximity", "ambient"))
    period_s, counts_turns = 0.1, True
    clock = SimpleNamespace(waits=True, now=lambda: 0.0, sleep_until=lambda t: None)
    reset = act = stop = lambda self, *_: None

    def sense(self):
        return Readings(proximity=np.full(8, 3.0), ambient=np.full(8, 3.0))


def asked(folder, *answers, wanted=None, **options):
    """What a person is asked in a recording of all plans, and what was made."""
    left, says = list(answers), []
    person = lambda words: says.append(words) or left.pop(0)  # noqa: E731
    made = record(wanted or Plan(kind="all", repeats=1), folder, Still(), ask=person, **options)
    assert not left
    return says, made


@pytest.mark.parametrize(
    ("plan", "base", "said"),
    [
        ("wheels", "thymio", "7 proximity sensors, as the base 'thymio' has; this one has 8"),
        ("ambient", "e-puck", "0 ambient sensors, as the base 'e-puck' has; this one has 8.*or a plan"),
    ],
)
def test_a_robot_is_refused_with_the_base_of_another(tmp_path, plan, base, said):
    """By a Thymio's base a Khepera's wheels were told 108 units, a metre a second; they are told nothing."""
    with pytest.raises(UsageError, match=said):
        asked(tmp_path, wanted=Plan(kind=plan, base=load_profile(base)))


def test_a_part_that_is_left_out_is_not_recorded(tmp_path):
    """Nobody who says so at "clear a level floor" sees the robot move; no empty table stays behind."""
    says, made = asked(tmp_path / "a", "s", "s", "s", "s")
    assert len(says) == 4 and says[3].startswith("Clear a level floor")
    assert [one.done for one in made] == [0] * 4 and not list(tmp_path.glob("a/*/recording.toml"))
    says, made = asked(tmp_path / "a", "s", "s", "s", "q", resume=True)
    assert made[-1].name == "wheels" and made[-1].stopped
