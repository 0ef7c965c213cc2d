"""Flip bits of a study's database, one at a time: each is noticed, or nothing that is read changes.

    python -m tests.hostile.flips [--flips 2000] [--seed 1] [STUDY]

Without STUDY a small one is made. Ends with 1 if a flip was read as other data.
"""

from __future__ import annotations

import argparse
import hashlib
import random
import shutil
import sys
import tempfile
from collections import Counter
from pathlib import Path

from realitygap.errors import RealityGapError
from realitygap.study.load import load_study
from realitygap.study.runner import run_study
from realitygap.study.store import DATABASE, Reader
from tests.study.helpers import small

NOTICED, HARMLESS, BELIEVED = "noticed", "harmless", "read as other data"


def all_that_is_read(folder: Path) -> str:
    """A hash of everything that a study gives to who reads it."""
    study, found = load_study(folder), hashlib.sha256()
    tasks = Reader(folder / DATABASE).meta("tasks")
    for value in (study.runs, study.versions(), tasks):
        found.update(repr(value).encode())
    for table in (study.evaluations(), study.tests(), study.retests()):
        for name, column in table.items():
            found.update(name.encode() + column.tobytes())
    for run in study.runs:
        state = study.state(run.id)
        found.update(study.genotypes(run.id).tobytes() + (b"" if state is None else state.to_bytes()))
        for number in (run.fittest_number, run.champion_number):
            found.update(b"" if number is None else study.genotype(run.id, number).tobytes())
    return found.hexdigest()


def flips(folder: Path, count: int, seed: int) -> Counter[str]:
    """What became of `count` flipped bits in a study's database, which is as it was at the end."""
    file, draw = folder / "study.db", random.Random(seed)
    data, expected, found = bytearray(file.read_bytes()), all_that_is_read(folder), Counter[str]()
    for _ in range(count):
        at, bit = draw.randrange(len(data)), 1 << draw.randrange(8)
        data[at] ^= bit
        file.write_bytes(data)
        try:
            same = all_that_is_read(folder) == expected
            found[HARMLESS if same else BELIEVED] += 1
            if not same:
                print(f"believed: byte {at}, bit {bit}", file=sys.stderr)
        except RealityGapError:
            found[NOTICED] += 1
        data[at] ^= bit
    file.write_bytes(data)
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("study", nargs="?", type=Path)
    parser.add_argument("--flips", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "study"
        if given.study is None:
            run_study(folder, small(), workers=1)
        else:
            shutil.copytree(given.study, folder)
        found = flips(folder, given.flips, given.seed)
    print(", ".join(f"{found[word]} {word}" for word in (NOTICED, HARMLESS, BELIEVED)))
    return 1 if found[BELIEVED] else 0


if __name__ == "__main__":
    sys.exit(main())
