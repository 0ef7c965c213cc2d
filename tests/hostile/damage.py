"""Damage the compiled code on file, an entry at a time: a command ends as before.

    python -m tests.hostile.damage [--rounds 60] [--seed 1]

Each round damages one file of a cache, in one of five ways, and runs `realitygap simulate` or a twin. What
is needed of it is compiled again. Ends with 1 if a result changed.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from realitygap import compiled

__all__ = ["KINDS", "command", "copied_cache", "damage"]

KINDS = ("cut", "empty", "flipped", "pickle", "another")
SIMULATE = [
    "-m",
    "realitygap",
    "simulate",
    "avoidance",
    "--controller",
    "constant:5,-3",
    "--pose",
    "25,25,90",
]
TWIN = ["-m", "tests.same_everywhere", "twin"]


def damage(entry: Path, kind: str, other: Path, *, seed: int) -> None:
    """Make a file wrong: cut short, empty, a bit flipped, a pickle that runs a program, or another's."""
    data, chance = bytearray(entry.read_bytes()), random.Random(seed)
    if kind == "cut":
        data = data[: chance.randrange(max(1, len(data)))]
    elif kind == "empty":
        data.clear()
    elif kind == "flipped":
        data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
    elif kind == "pickle":
        data = bytearray(b"cos\n_exit\n(I7\ntR.")
    else:
        data = bytearray(other.read_bytes()) if other != entry else data[::-1]
    entry.write_bytes(data)


def copied_cache(folder: Path) -> Path:
    """A copy of what is kept for this user, which has what SIMULATE needs."""
    command(None)
    shutil.copytree(compiled.folder(), folder / "cache" / "realitygap")
    return folder / "cache"


def command(cache: Path | None, words: list[str] = SIMULATE) -> tuple[str, str]:
    """What a command says on stdout and stderr with a cache of its own."""
    environment = dict(os.environ)
    if cache is not None:
        environment.pop("NUMBA_CACHE_DIR", None)
        environment["XDG_CACHE_HOME"] = str(cache)
    done = subprocess.run(
        [sys.executable, *words], env=environment, capture_output=True, text=True, timeout=600, check=False,
        cwd=Path(__file__).parents[2],
    )  # fmt: skip
    assert done.returncode == 0, (done.returncode, done.stderr)
    return done.stdout, done.stderr


def main() -> int:
    """The rounds; the exit code."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--rounds", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    told = parser.parse_args()
    chance = random.Random(told.seed)
    with tempfile.TemporaryDirectory() as name:
        cache = Path(name)
        right = {tuple(words): command(cache, words)[0] for words in (SIMULATE, TWIN)}
        entries = sorted(cache.rglob("*.nb[ci]"))
        met = wrong = 0
        for k in range(told.rounds):
            words = TWIN if k % 4 == 3 else SIMULATE
            entry, other = chance.choice(entries), chance.choice(entries)
            damage(entry, chance.choice(KINDS), other, seed=chance.randrange(2**32))
            before = entry.stat().st_mtime_ns
            out, _ = command(cache, words)
            met += not entry.exists() or entry.stat().st_mtime_ns != before
            wrong += out != right[tuple(words)]
        print(f"{told.rounds} entries damaged (seed {told.seed}): {met} were met, {wrong} results changed")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
