"""Recordings survive whatever ends a drive."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from realitygap.errors import UsageError
from realitygap.robots.body import Odometry
from realitygap.robots.drive import Recorder, Recording, Step
from realitygap.values import Command, Readings

FACTS = {"port": 'a "port"', "baud": 38400, "noise": 0.5, "unit": {"number": 3, "kinds": ["proximity"]}}


def step(k: int, speeds: tuple[int, int] | None = (4, 5)) -> Step:
    """Some step."""
    readings = Readings(proximity=np.arange(8.0) + k, ambient=np.zeros(0))
    odometry = Odometry((k, 2 * k), speeds)
    return Step(k / 10, 0.02 * (k == 2), readings, [k, -k], Command(left=k, right=-k), odometry)


def equal(one: Recording, two: Recording) -> bool:
    """Array for array."""
    arrays = ("t", "late", "proximity", "ambient", "inputs", "commands", "counters", "speeds")
    same = all(np.array_equal(getattr(one, a), getattr(two, a), equal_nan=True) for a in arrays)
    return same and one.ended == two.ended and one.facts == two.facts


@pytest.mark.parametrize("speeds", [(4, 5), None])
def test_a_recording_reads_back_as_it_was(tmp_path: Path, speeds: tuple[int, int] | None) -> None:
    """From memory, and from the folder it was written to as it went."""
    recorder = Recorder(tmp_path / "one", facts=FACTS)
    for k in range(5):
        recorder.add(step(k, speeds))
    recorder.finish("finished")
    recording = recorder.recording()
    assert recording.late_steps == 1
    assert equal(Recording.from_folder(tmp_path / "one"), recording)


def test_a_killed_recording_is_readable_to_its_last_whole_line(tmp_path: Path) -> None:
    """Nothing was closed, and the last line is cut short."""
    recorder = Recorder(tmp_path / "r", facts=FACTS)
    for k in range(3):
        recorder.add(step(k))
    with (tmp_path / "r/steps.csv").open("a") as file:
        file.write("0.3,0,1,2")
    recording = Recording.from_folder(tmp_path / "r")
    recorder.finish("too late")
    assert recording.ended == "killed" and len(recording.t) == 3


@pytest.mark.parametrize("steps", [0, 1])
def test_a_recording_of_no_or_one_step_is_one(tmp_path: Path, steps: int) -> None:
    """A drive that broke at once."""
    recorder = Recorder(tmp_path / "r")
    for k in range(steps):
        recorder.add(step(k))
    recorder.finish("LineError: gone")
    recording = Recording.from_folder(tmp_path / "r")
    assert recording.t.shape == (steps,) and recording.commands.shape == (steps, 2)
    assert recording.ended == "LineError: gone"


def test_a_folder_is_never_overwritten(tmp_path: Path) -> None:
    """A second recording wants a folder of its own."""
    Recorder(tmp_path / "r").finish("finished")
    for name in ("drive.toml", "recording.toml"):  # a calibration's, or an earlier version's drive
        (tmp_path / "r" / "drive.toml").replace(tmp_path / "r" / name)
        with pytest.raises(UsageError, match="already holds a recording"):
            Recorder(tmp_path / "r")
    assert Recording.from_folder(tmp_path / "r").ended == "finished"


def test_what_is_no_recording_is_refused(tmp_path: Path) -> None:
    """An empty folder; a row of words: the line is named."""
    with pytest.raises(UsageError, match="holds no recording"):
        Recording.from_folder(tmp_path)
    recorder = Recorder(tmp_path / "r")
    recorder.add(step(0))
    with (tmp_path / "r/steps.csv").open("a") as file:
        file.write("a,b\n")
    recorder.finish("finished")
    with pytest.raises(UsageError, match=r"steps\.csv, line 3: expected 18 numbers, got 'a,b'"):
        Recording.from_folder(tmp_path / "r")


@pytest.mark.parametrize(
    ("of", "instead", "words"),
    [
        (
            "t_s,late_s",
            "command_x,t_s,late_s",
            "expected columns command_left, command_right, got command_x, comm",
        ),
        (
            "command_left,command_right",
            "command_right,command_left",
            "expected columns command_left, command_right",
        ),
        (
            "proximity_0,proximity_1",
            "proximity_1,proximity_0",
            "expected columns proximity_0, .*got proximity_1, ",
        ),
        ("t_s,", "t_x,t_s,", "expected columns t_s, got t_x, t_s"),
    ],
)
def test_columns_in_another_order_are_not_taken_for_others(
    tmp_path: Path, of: str, instead: str, words: str
) -> None:
    """A column too many, or the left wheel's where the right one's belongs, is refused by its names."""
    recorder = Recorder(tmp_path / "r")
    recorder.add(step(0))
    recorder.finish("finished")
    head, _, rest = (tmp_path / "r/steps.csv").read_text().partition("\n")
    more = ",0" * (instead.count(",") - of.count(","))
    changed = head.replace(of, instead)
    assert changed != head
    (tmp_path / "r/steps.csv").write_text("\n".join((changed, rest.replace("\n", more + "\n"))))
    with pytest.raises(UsageError, match=words):
        Recording.from_folder(tmp_path / "r")
