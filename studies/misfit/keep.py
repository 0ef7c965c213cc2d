"""Puts finished arms' tables and tracks into the studies' archive: python studies/misfit/keep.py out/misfit/K

Of each arm's folder `misfit/NAME/`: its tables, `study.toml`, its profiles if no real readings are in them,
and `tracks.npy`: int16 [champions as in controllers.csv, starts, half-seconds, 3], x and y in mm and heading
in degrees, -32768 where unknown. run.py makes the whole tracks again.
"""

from __future__ import annotations

import argparse
import hashlib
import io
import sys
import tarfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from common import STUDIES, archive
from run import Design, Study

EVERY = 5
TABLES = ("controllers.csv", "cells.csv", "misfits.csv", "calibration.csv")


def tracks(made: Study) -> bytes:
    """All champions' tracks."""
    order = sorted(made.controllers(), key=lambda one: one.key[1:])  # that of controllers.csv
    every = [made.read_driven(one).poses[0, :, ::EVERY] for one in order if one.individual == "champion"]
    poses = np.array(every)
    poses[..., 2] = np.degrees(np.unwrap(poses[..., 2], axis=-1))
    poses[..., :2] *= 10.0
    file = io.BytesIO()
    np.save(file, np.where(np.isfinite(poses), np.rint(poses), -32768).astype(np.int16))
    return file.getvalue()


def kept(folder: Path) -> dict[str, bytes]:
    """What is archived of an arm's folder, by name."""
    config = Design.from_folder(folder)
    made, results = Study(folder.resolve(), config), folder / "results"
    files = {name: (results / name).read_bytes() for name in TABLES}
    facts = (results / config.FACTS).read_text("utf-8").splitlines(keepends=True)
    files["study.toml"] = "".join(line for line in facts if not line.startswith("data =")).encode()
    files["tracks.npy"] = tracks(made)
    if config.arm != "K":
        for unit in config.every_unit:
            place = config.place(unit)
            name = f"profiles/{place.reality} {place.simulation}.toml"
            files[name.replace(" ", "-").replace(",", "")] = made.profile_file(unit).read_bytes()
    return {f"misfit/{folder.name}/{name}": content for name, content in files.items()}


def write(files: dict[str, bytes]) -> None:
    """The archive of these files, and their checksums."""
    with tarfile.open(STUDIES / "data.tar.xz", "w:xz", preset=9) as tar:
        for name, content in sorted(files.items()):
            one = tarfile.TarInfo(name)
            one.size = len(content)
            tar.addfile(one, io.BytesIO(content))
    lines = [f"{hashlib.sha256(content).hexdigest()}  {name}\n" for name, content in sorted(files.items())]
    (STUDIES / "SHA256SUMS").write_text("".join(lines), encoding="utf-8")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folders", nargs="+", type=Path, help="finished arms, such as out/misfit/E-1")
    known = dict(archive())
    for folder in parser.parse_args().folders:
        known = {name: what for name, what in known.items() if not name.startswith(f"misfit/{folder.name}/")}
        known |= kept(folder)
    write(known)
