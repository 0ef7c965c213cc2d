"""Tracks: one value, radians inside, degrees in its CSV."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from realitygap import track as track_file
from realitygap.control.genotype import Genotype
from realitygap.errors import StudyError, TrackError
from realitygap.kernels.types import STEP_S
from realitygap.simulation.simulation import Simulation
from realitygap.tasks import load_task
from realitygap.testing import TrackContract
from realitygap.track import Track, read_track, read_tracks, settled
from realitygap.values import Floats
from realitygap.world.robot import load_profile

LOST = math.nan


class TestSimulatedTrack(TrackContract):
    """Where the simulation says that a robot was."""

    def track(self) -> Track:
        simulation = Simulation(load_task("avoidance"), load_profile("paper"), "observed")
        networks = Genotype.braitenberg("proximity").networks()
        return simulation.trajectory(networks, stream=3, seconds=3)[0].track


class TestTrackOfFrames(TrackContract):
    """With frames in which the robot was lost."""

    def track(self) -> Track:
        rows = [
            f"{k * 0.04},{20 + k * 0.1},25,{170 + k},0.9" if k % 7 else f"{k * 0.04},,,,0" for k in range(30)
        ]
        return read_text("\n".join(["t_s,x_cm,y_cm,heading_deg,quality", *rows]))


@pytest.mark.parametrize("wrong", [np.degrees, lambda heading: heading + np.pi / 2])
def test_other_headings_are_found_out(wrong: Callable[[Floats], Floats]) -> None:
    """Degrees for radians, and a marker that was put on aside, break the contract."""

    class Wrong(TestSimulatedTrack):
        def track(self) -> Track:
            right = super().track()
            return replace(right, heading=wrong(right.heading))

    with pytest.raises(AssertionError):
        Wrong().test_headings_are_radians()


@pytest.mark.parametrize("ticks", [1000.0, 10.0])
def test_times_in_other_units_are_found_out(ticks: float) -> None:
    """Milliseconds or numbers of frames for seconds break the contract."""

    class Wrong(TestSimulatedTrack):
        def track(self) -> Track:
            right = super().track()
            return replace(right, t=right.t * ticks)

    with pytest.raises(AssertionError):
        Wrong().test_time_runs_forward()


Rows = list[tuple[int, int, int, int]]


def track() -> Track:
    """Five frames, two of them lost."""
    return Track(
        t=np.arange(5) * 0.04,
        x=np.array([20, 21, LOST, LOST, 24.0]),
        y=np.array([25, 25.5, LOST, LOST, 26.0]),
        heading=np.radians([0, 10, LOST, LOST, 40.0]),
        quality=np.array([0.99, 0.98, 0, 0, 0.97]),
        seen_by="camera",
    )


def read_text(text: str) -> Track:
    """The track of a file's text."""
    with TemporaryDirectory() as folder:
        file = Path(folder) / "track.csv"
        file.write_text(text, encoding="utf-8")
        return read_track(file)


def text_of(one: Track) -> str:
    """The text of a track's file."""
    with TemporaryDirectory() as folder:
        one.write_csv(Path(folder) / "track.csv")
        return (Path(folder) / "track.csv").read_text(encoding="utf-8")


def rows(degrees: int) -> st.SearchStrategy[Rows]:
    """Times, places and headings in whole units of the last digit; no heading of −180° or less."""
    place = st.integers(-(10**8), 10**8)
    return st.lists(
        st.tuples(st.integers(0, 9999), place, place, st.integers(1 - 180 * degrees, 180 * degrees)),
        min_size=1,
        max_size=30,
    )


@given(rows(10**6), st.sets(st.integers(0, 29)))
def test_a_path_keeps_every_byte(told, lost):
    """A file of steps that is read and written again is the same file, lost rows included."""
    lines = ["t_s,x_cm,y_cm,heading_deg"]
    for k, (t, *place) in enumerate(told):
        empty = k in lost
        lines.append(",".join([f"{t / 10:.1f}", *("" if empty else f"{value / 1e6:.6f}" for value in place)]))
    text = "\n".join(lines) + "\n"
    back = read_text(text)
    assert text_of(back) == text
    assert back.lost == len(lost & set(range(len(told)))) and np.isnan(back.heading).sum() == back.lost


@given(rows(10**3), st.lists(st.integers(0, 1000), min_size=30, max_size=30))
def test_a_trackers_file_keeps_every_byte(told, quality):
    """A tracker's file that is read and written again is the same file; quality 0 is a lost frame."""
    lines = ["t_s,x_cm,y_cm,heading_deg,quality"]
    for (t, x, y, heading), q in zip(told, quality, strict=False):
        place = [f"{x / 1e4:.4f}", f"{y / 1e4:.4f}", f"{heading / 1e3:.3f}"] if q else ["", "", ""]
        lines.append(",".join([f"{t / 1e4:.4f}", *place, f"{q / 1e3:.3f}" if q else "0"]))
    text = "\n".join(lines) + "\n"
    assert text_of(read_text(text)) == text


@given(st.lists(st.floats(-50, 50), min_size=1, max_size=30), st.booleans())
def test_a_track_comes_back(headings, tracked):
    """Whatever its headings' turns, what is read is the track to the file's digits, wrapped."""
    n = len(headings)
    quality = np.full(n, 0.5) if tracked else None
    zero = np.zeros(n)
    one = Track(t=0.1 * np.arange(n), x=zero, y=zero, heading=np.array(headings), quality=quality)
    back = read_text(text_of(one))
    near = np.radians(0.5e-3 if tracked else 0.5e-6) * 1.01
    assert np.abs((back.heading - one.heading + np.pi) % (2 * np.pi) - np.pi).max() < near
    assert (back.quality is None) is not tracked and len(back) == n


@given(st.floats(-1e3, 1e3))
def test_headings_wrap(heading):
    """Degrees are above −180 and up to 180; a settled heading is the same direction, in one turn."""
    zero = np.zeros(1)
    (degrees,) = Track(t=zero, x=zero, y=zero, heading=np.array([heading])).heading_deg
    assert -180 < degrees <= 180
    for other in (math.radians(degrees), float(settled(heading)), float(settled(heading, wrapped=False))):
        assert abs(math.remainder(other - heading, math.tau)) < 1e-9
    assert -math.pi <= settled(heading) <= math.pi


def test_lost_frames_are_gaps(tmp_path):
    """Lost frames are empty in the file, with quality 0, and are told as stretches of time."""
    track().write_csv(tmp_path / "track.csv")
    lines = (tmp_path / "track.csv").read_text().splitlines()
    assert lines[0] == "t_s,x_cm,y_cm,heading_deg,quality"
    assert lines[3] == "0.0800,,,,0"
    back = read_track(tmp_path / "track.csv")
    assert back.found.tolist() == [True, True, False, False, True] and back.lost == 2
    assert np.allclose(back.gaps(), [(0.08, 0.12)])
    assert back.only(back.found).x.tolist() == [20.0, 21.0, 24.0] and back.end.x == 24.0
    for name, column in track().to_dict().items():
        assert np.allclose(back.to_dict()[name], column, atol=1e-3, equal_nan=True), name


@pytest.mark.parametrize(
    "row",
    [
        "0.1,,2,3,0.9",
        "0.1,1,nan,3,0.9",
        "0.1,1,2,NaN,0.9",
        "0.1,1,2,3,0",
        "0.1,,,,0",
        "0.1,,,,",
        "0.1,1,2,3,",
    ],
)
def test_half_a_row_is_lost(row):
    """A row without place, heading or quality is lost altogether, as files of other programs have it."""
    back = read_text(f"t_s,x_cm,y_cm,heading_deg,quality\n0,1,2,3,0.9\n{row}\n")
    assert back.found.tolist() == [True, False] and back.quality.tolist() == [0.9, 0]
    assert np.isnan([back.x[1], back.y[1], back.heading[1]]).all()


def test_other_columns_and_orders_are_read(tmp_path):
    """Columns in any order, with others between them; start and unit part a file into tracks."""
    file = tmp_path / "tracks.csv"
    file.write_text(
        "unit,heading_deg,t_s,led,x_cm,y_cm,start\n1,90,0,1,1,2,a\n1,90,0,1,3,4,b\n2,90,0,1,5,6,a\n1,90,1,1,7,8,a\n"
    )
    made = read_tracks(file)
    assert {key: one.x.tolist() for key, one in made.items()} == {
        ("a", "1"): [1, 7],
        ("b", "1"): [3],
        ("a", "2"): [5],
    }
    file.write_text("t_s,x_cm,y_cm,heading_deg\n0,1,2,3\n")
    assert list(read_tracks(file)) == [("1", "")]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("t,x\n", "line 1: expected columns t_s"),
        ("t_s,x_cm,y_cm,heading_deg,quality\n0,1,2,x,0.9\n", "line 2: heading_deg: expected a number"),
        ("t_s,x_cm,y_cm,heading_deg\n0,1,2,3\n1,inf,2,3\n", "line 3: x_cm: expected a number, got 'inf'"),
        ("t_s,x_cm,y_cm,heading_deg\n,1,2,3\n", "line 2: t_s: expected a number, got ''"),
        ("t_s,x_cm,y_cm,heading_deg\n0,1,2\n", "line 2: expected 4 values, got 3"),
        ("t_s;x_cm;y_cm;heading_deg\n", "got semicolons"),
        ("", "empty"),
    ],
)
def test_broken_tracks_are_refused(tmp_path, text, says):
    """A table that is no track is refused with file and line, and the cure where there is one."""
    path = tmp_path / "track.csv"
    path.write_text(text)
    with pytest.raises(TrackError) as refusal:
        read_track(path)
    assert says in str(refusal.value) and str(path) in str(refusal.value)
    with pytest.raises(StudyError, match=r"track\.csv.*(Make it again\.|Save the table)"):
        read_track(path, error=StudyError, cure="Make it again.")


def test_a_step_is_the_simulations():
    """The ground knows a step's length without the kernels, which it may not import."""
    assert track_file.STEP_S == STEP_S


@pytest.mark.parametrize("period_s", [0.02, 0.05, 0.1, 0.12, 0.2])
def test_steps_of_any_period_keep_their_times(tmp_path, period_s):
    """A robot's path is read back with the times of its steps, tenths of a second or not."""
    t = period_s * np.arange(30)
    Track(t=t, x=t, y=t, heading=t).write_csv(tmp_path / "path.csv")
    assert np.allclose(read_track(tmp_path / "path.csv").t, t, atol=1e-9)
