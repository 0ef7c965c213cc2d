"""Kill commands at random moments, begin them again, and compare with what they leave undisturbed.

    python -m tests.hostile.kill [--kills 20] [--seed 1] [evolve] [reproduce] [transfer]

A process gets SIGKILL, or its whole group SIGINT (as by Ctrl-C) or SIGTERM. Ends with 1 if a bit of a
result differs, if anybody sees a traceback, or if a process lives on.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

from tests.study.helpers import content

SIGNALS = (signal.SIGKILL, signal.SIGINT, signal.SIGTERM)
QUICK = ("--set", "retest_trials=2", "--set", "fresh_trials=3", "--set", "task.seconds=2")
COMMANDS = {
    "evolve": ("evolve", "light", "--runs", "3", "--evaluations", "800", *QUICK, "--resume", "--out"),
    "reproduce": ("reproduce", "--profile", "paper", "--no-transfer", "--runs", "1", "--evaluations", "150",
                  "--resume", "--out"),
    "transfer": ("transfer", "--robot", "twin:1", "--robot", "twin:2", "--starts", "2", "--seconds", "2"),
}  # fmt: skip
LOADED_S = 0.5
"""Before that Python itself is loading, and says so in its own way."""
SAME = ("simulated.csv", "situated.csv", "steps.csv", "sealed.csv", "track.csv")
"""What a trial on the twin leaves, without the times of the computer's own clock."""


@dataclass
class Told:
    """What went wrong, and how often a command was disturbed."""

    kills: int = 0
    rounds: int = 0
    wrong: list[str] = field(default_factory=list)


def run(words: tuple[str, ...], folder: Path, how: tuple[float, int] | None = None) -> tuple[int, str]:
    """A command on a folder, which gets a signal after so many seconds: exit code and stderr."""
    command = [sys.executable, "-m", "realitygap", *words, str(folder), "--workers", "2"]
    if words[0] == "transfer":
        command = [*command[:4], str(folder), *words[1:], "--workers", "2"]
    kinds = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, start_new_session=True, **kinds) as process:
        if how is not None:
            try:
                process.wait(how[0])
            except subprocess.TimeoutExpired:
                send = os.kill if how[1] == signal.SIGKILL else os.killpg
                send(process.pid, how[1])
        said = process.communicate(timeout=600)[1]
        return process.returncode, said


def disturbed(words: tuple[str, ...], folder: Path, told: Told, seconds: float, draw: random.Random) -> None:
    """Kill and begin again until it comes to its end."""
    code = -1
    while code != 0:
        number = draw.choice(SIGNALS)
        moment = LOADED_S + draw.uniform(0.0, seconds) * draw.choice((0.2, 1.0))
        code, said = run(words, folder, (moment, number))
        told.kills += code != 0
        what = f"{signal.Signals(number).name} after {moment:.2f} s"
        if code not in (0, 130, -number):
            told.wrong.append(f"{what}: exit {code}: {said[-300:]}")
        if "Traceback" in said or "unexpected" in said:
            told.wrong.append(f"{what}: {said[-600:]}")
        if told.wrong:
            return


def result(folder: Path) -> dict[str, object]:
    """All that has to be the same: the database's rows, and the paths of trials on the twin."""
    files = [path for path in folder.glob("transfer/*/*/start-*/*.csv") if path.name in SAME]
    return {**content(folder), **{str(path.relative_to(folder)): path.read_bytes() for path in files}}


def living(folder: Path) -> list[str]:
    """Processes that still work on a folder, after a moment to end."""
    for _ in range(50):
        found = [
            words for path in Path("/proc").glob("[0-9]*/cmdline")
            if str(folder) in (words := path.read_bytes().replace(b"\0", b" ").decode(errors="replace"))
        ]  # fmt: skip
        if not found:
            break
        time.sleep(0.1)
    return found


def attack(name: str, place: Path, kills: int, draw: random.Random) -> Told:
    """One command, undisturbed in one folder and disturbed in others, until it was killed often enough."""
    begun, calm, told = place / "begun", place / "calm", Told()
    if name == "transfer":
        run(COMMANDS["evolve"], begun)
        shutil.copytree(begun, calm)
    since = time.monotonic()
    code, said = run(COMMANDS[name], calm)
    assert code == 0, said
    seconds = time.monotonic() - since
    while told.kills < kills and not told.wrong:
        wild = place / f"wild-{told.rounds}"
        if begun.exists():
            shutil.copytree(begun, wild)
        disturbed(COMMANDS[name], wild, told, seconds, draw)
        told.rounds += 1
        if not told.wrong and result(calm) != result(wild):
            told.wrong.append("the result has other bits")
        told.wrong += [f"lives on: {words}" for words in living(wild)]
    return told


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("commands", nargs="*", metavar="COMMAND")
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    failed = False
    for name in given.commands or COMMANDS:
        with tempfile.TemporaryDirectory() as place:
            told = attack(name, Path(place), given.kills, random.Random(f"{given.seed}/{name}"))
        counts = f"{told.kills} kills in {told.rounds} rounds, {len(told.wrong)} faults"
        print(f"{name}: {counts}", *told.wrong, sep="\n  ", flush=True)
        failed |= bool(told.wrong)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
