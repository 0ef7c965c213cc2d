"""Between bearings where readings jump: which places are read, and what a fit takes from them."""

from __future__ import annotations

import os
import shutil
from contextlib import closing
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from realitygap.calibration import record_edges as recorder
from realitygap.calibration.judge import judge
from realitygap.calibration.model import proximity, scene_of
from realitygap.calibration.plan import Plan
from realitygap.calibration.record import record
from realitygap.calibration.record_edges import look_between
from realitygap.calibration.recordings import SensorRecording, load_recording
from realitygap.calibration.unit import thinned
from realitygap.robots.address import Address
from realitygap.world.robot import Profile
from tests.calibration.test_measured import HALF, odd
from tests.calibration.written import save_recording

BEARINGS, TOP = 180, 1023.0


def looked(readings, repeats: int = 3, noise: float = 2.0) -> list[tuple[float, float]]:
    """Where a robot is read between the bearings of a grid at 1 and 2 cm: `readings` there."""
    random = np.random.default_rng(1)

    def at(distance, bearing):
        where = (distance, 180.0 - (180.0 - bearing) % 360.0)
        return SimpleNamespace(where=where, key=tuple(f"{number:g}" for number in where))

    def read(place, many):
        clean = np.array(readings(place.where[0], place.where[1] % 360.0))
        drawn = clean + noise * random.normal(size=(many, len(clean)))
        return [(*place.key, str(k), *map(str, row)) for k, row in enumerate(drawn.tolist())]

    grid = [at(d, k * 360.0 / BEARINGS) for d in (1.0, 2.0) for k in range(BEARINGS)]
    made, told = {}, []
    look_between(
        SimpleNamespace(done={place.key: read(place, repeats) for place in grid}),
        SimpleNamespace(done=made, add=lambda rows: made.update({rows[0][:2]: rows})),
        at, lambda place: read(place, 2), TOP, lambda *so_far: told.append(so_far),
    )  # fmt: skip
    assert told == [(k, len(told) - 1) for k in range(len(told))]
    return [(float(distance), float(bearing) % 360.0) for distance, bearing in made]


def test_a_jump_is_followed_and_a_slope_is_not():
    """To a sixty-fourth of a degree from two, by seven readings; at the distance and bearing where it is."""
    for edge in (33.33, 201.07, 359.1):
        found = looked(
            lambda d, b, edge=edge: [
                500.0 * (d > 1.5) * ((b - edge) % 360.0 < 180.0),
                400.0 + 300.0 * np.sin(np.radians(3 * b)),
            ]
        )
        assert {d for d, _ in found} == {2.0} and len(found) == 14
        for there in (edge, edge - 180.0):
            off = [(b - there + 180.0) % 360.0 - 180.0 for _, b in found]
            before = max([-(there % 2.0), *(o for o in off if -2.0 < o < 0)])
            behind = min([2.0 - there % 2.0, *(o for o in off if 0 <= o < 2.0)])
            assert behind - before == pytest.approx(2.0 / 2**7, abs=2e-3)


def test_noise_is_followed_nowhere():
    assert looked(lambda d, b: [500.0, 20.0], noise=60.0) == []


def beams(turn: float = 0.0, wider: float = 0.0) -> Profile:
    """A robot with three rays a sensor that see no farther than 6 cm."""
    law = odd().infrared
    sensors = tuple(replace(s, direction_deg=s.direction_deg + turn) for s in law.sensors)
    law = replace(
        law, sensors=sensors, lobe=(1 / 3, 0.0, 0.0, 0.0, 2 / 3), overlap=2 / 3, aperture_deg=15.0 + wider,
        range_cm=6.0, dead=0.0,
    )  # fmt: skip
    return replace(HALF, infrared=law)


def seen(robot: Profile, object: str, where: np.ndarray, repeats: int) -> SensorRecording:
    """Its noisy readings at distances and bearings [m, 2]."""
    rows = np.repeat(where, repeats, axis=0)
    blank = SensorRecording(
        kind="infrared", object=object, distance_cm=rows[:, 0], bearing_deg=rows[:, 1],
        repeat=np.tile(np.arange(repeats), len(where)),
        counts=np.zeros((len(rows), len(robot.infrared.sensors))),
        source=f"made {object}", facts={"placed_by": "program"},
    )  # fmt: skip
    clean = proximity(robot, scene_of(blank))
    drawn = clean + 4.0 * np.random.default_rng(len(rows)).normal(size=clean.shape)
    return replace(blank, counts=np.clip(np.rint(drawn), 0, 1023))


@pytest.fixture(scope="module")
def recordings() -> list[SensorRecording]:
    """A wall and a cylinder, at two degrees, and between them where readings jump."""
    made, robot = [], beams()
    grid = np.array([(d, 180.0 - 2.0 * k) for d in (0.5, 1.5, 3.0, 4.5) for k in range(180)])
    for object in ("wall", "cylinder:4"):
        one = seen(robot, object, grid, 3)
        rows = {
            (f"{d:g}", f"{b:g}"): [("", "", "", *map(str, row)) for row in counts.tolist()]
            for (d, b), counts in zip(grid.tolist(), one.counts.reshape(-1, 3, 4), strict=True)
        }
        between: list[SensorRecording] = []

        def read(place, object=object, between=between):
            between.append(seen(robot, object, np.array([place.where]), 2))
            return [(*place.key, "", *map(str, row)) for row in between[-1].counts.tolist()]

        def at(distance, bearing):
            where = (distance, 180.0 - (180.0 - bearing) % 360.0)
            return SimpleNamespace(where=where, key=tuple(f"{number:g}" for number in where))

        done: dict = {}
        look_between(
            SimpleNamespace(done=rows),
            SimpleNamespace(done=done, add=lambda rows, done=done: done.update({rows[0][:2]: rows})),
            at, read, TOP, lambda *_: None,
        )  # fmt: skip
        columns = ("distance_cm", "bearing_deg", "repeat", "counts")
        joined = {name: np.concatenate([getattr(r, name) for r in between]) for name in columns}
        made.append(replace(one, edges=replace(one, **joined)))
    return made


def test_no_error_is_counted_between(recordings):
    """A profile is judged at the places of the grid; with other readings between them no figure differs."""
    one, robot = recordings[1], beams()
    told = judge(one, robot)
    assert one.edges is not None
    wrong = replace(one, edges=replace(one.edges, counts=1023.0 - one.edges.counts))
    assert (
        judge(wrong, robot).per_sensor == judge(replace(one, edges=None), robot).per_sensor == told.per_sensor
    )


def test_a_share_of_the_places_has_none_between(recordings):
    assert thinned(recordings[0], 0.5, 1).edges is None


def test_they_are_kept_in_a_table_of_their_own(recordings, tmp_path):
    """And are read with the others."""
    one = recordings[1]
    assert one.edges is not None
    save_recording(tmp_path / "a", replace(one, facts={}))
    plain = load_recording(tmp_path / "a")
    save_recording(tmp_path / "b", replace(one.edges, facts={}))
    shutil.copy(tmp_path / "b" / "readings.csv", tmp_path / "a" / "edges.csv")
    read = load_recording(tmp_path / "a")
    assert (read.counts == plain.counts).all() and (read.edges.counts == one.edges.counts).all()
    assert read.hash != plain.hash and len(read.edges.counts) > 100


@pytest.mark.skipif(
    not os.path.exists("/usr/include/enki/PhysicalEngine.h"), reason="Enki is not installed here"
)
def test_a_recorder_looks_between_and_goes_on_where_it_stopped(tmp_path, monkeypatch):
    """A robot that places itself is read between, by the plan's own names; stopped in the midst and resumed,
    the table is the same."""
    monkeypatch.setattr(recorder, "HALVINGS", 3)
    wanted = Plan(kind="infrared", object="cylinder:4", repeats=3, bearings=120, distances_cm=(2.0, 4.0))

    def recorded(name, stop_at=None, **how):
        def told(part, done, total):
            assert done < total or done > 240 or wanted.repeats == 1
            if done == stop_at:
                raise KeyboardInterrupt

        with closing(Address.parse("enki:epuck:1").open()) as body:
            return record(wanted, tmp_path / name, body, on_progress=told, **how)

    (made,) = recorded("whole")
    assert made.places == 240 and made.between > 20
    with pytest.raises(KeyboardInterrupt):
        recorded("again", stop_at=243)
    (said,) = load_recording(tmp_path / "again").warnings
    assert "unfinished: places between the bearings" in said and "--resume` goes on" in said
    short = (tmp_path / "again" / "edges.csv").read_text().splitlines()
    (resumed,) = recorded("again", resume=True)
    text = (tmp_path / "whole" / "edges.csv").read_text()
    assert len(short) < len(text.splitlines()) == 2 * made.between + 1
    assert (tmp_path / "again" / "edges.csv").read_text() == text and resumed.between == made.between
    for name in ("whole", "again"):
        read = load_recording(tmp_path / name)
        assert read.edges.repeat.max() == 1 and not read.warnings and read.facts["between"] == made.between
    wanted = replace(wanted, repeats=1)  # so nothing is known of the noise
    (once,) = recorded("once")
    assert once.between == 0 and not (tmp_path / "once" / "edges.csv").exists()
