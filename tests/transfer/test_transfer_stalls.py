"""A study's transfer to an e-puck2 whose WiFi stalls as a real one's does."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from itertools import cycle
from pathlib import Path

import pytest

from realitygap.cli.transfer import transfer_lines
from realitygap.robots.drive import Recording
from realitygap.study.config import StudyConfig
from realitygap.study.runner import run_study
from realitygap.transfer.options import Transfer
from realitygap.transfer.record import load_transfers
from realitygap.transfer.run import Operator, run_transfer
from realitygap.work.archive import STALLED
from realitygap.world.robot import load_profile

if not os.path.exists("/usr/include/enki/PhysicalEngine.h") or shutil.which("g++") is None:
    pytest.skip("Enki is not installed here: apt install libenki-dev g++", allow_module_level=True)

from tests.robots.epuck import WifiEpuck

TASK, PERIOD_S, SECONDS = "obstacle-avoidance", 0.108, 4.0
USUAL = [0.02] * 9 + [0.25]
"""Delays (s) of answers that give steps like those of three e-puck2s over WiFi: half of 0.108 s, a tenth of
0.3 s (real ones: 0.306, which a busy computer may take for a stall); and the longest of 4051."""
LONGEST = 2.1


class Air:
    """Delays each answer with readings; a stall in some trials, at its 15th step."""

    def __init__(self, stalls: set[int]) -> None:
        self.stalls, self.trial, self.read, self._usual = stalls, 0, 0, cycle(USUAL)

    def __call__(self, packet: bytes) -> bytes:
        if len(packet) > 1 and self.trial:
            self.read += 1
            time.sleep(LONGEST if self.read == 15 and self.trial in self.stalls else next(self._usual))
        return packet

    def begins(self, *_: object) -> None:
        self.trial, self.read = self.trial + 1, 0


@pytest.fixture
def robot() -> Iterator[WifiEpuck]:
    with closing(WifiEpuck()) as made:
        yield made


def test_trials_that_stall_are_repeated_once_and_marked(robot: WifiEpuck, tmp_path: Path) -> None:
    """One trial gets through at once, one at its second try, one stalls twice; all are kept, each says so."""
    profile = replace(load_profile("enki-epuck"), period_s=PERIOD_S)
    (tmp_path / "robot.toml").write_text(profile.to_toml(), "utf-8")
    config = StudyConfig.single(TASK, profile=str(tmp_path / "robot.toml"), evaluations=30)
    config = config.with_settings(["evolution.rows=3", "evolution.columns=3", f"task.seconds={SECONDS}"])
    study = run_study(tmp_path / "study", config, workers=1)
    robot.spoil, said = Air({2, 4, 5}), list[str]()
    person = Operator(robot.spoil.begins, says=said.append)
    made = run_transfer(study, Transfer(robots=(f"epuck2:{robot.place}",), starts=3), operator=person)
    assert [(one.stalls > 0, one.repeated) for one in made] == [(False, False), (False, True), (True, True)]
    assert all(len(one.situated) == round(SECONDS / PERIOD_S) + 1 for one in made)
    assert made[0].timing is None and made[1].timing is None and "stalled" in (made[2].timing or "")
    assert made[2].stalled_s > 1.8 and len(said) == 2 and "The robot's line stalled (" in said[0]
    first = Recording.from_folder(made[1].folder / STALLED)
    assert first.stalls and first.ended == "finished"
    kept = load_transfers(study.folder)
    assert [(one.stalled_s, one.repeated) for one in kept] == [(one.stalled_s, one.repeated) for one in made]
    told = "\n".join(transfer_lines(study.folder, made))
    assert "2 of 3 trials were repeated since the line stalled; 1 stalled again" in told
