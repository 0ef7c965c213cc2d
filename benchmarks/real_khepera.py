"""Model error over noise: how far fitted models err on a real Khepera's readings, and on other robots'.

    python benchmarks/real_khepera.py [--data ../shared/data] [--only khepera-wall-extended,twin]
        [--out out/model-errors] [--write docs/figures/model-errors.csv]

Fits each recording as `realitygap calibrate` does, and prints its error on places held out. The docs quote
the file. The real robots' tables lie beside
the project (`shared/data`); unit 1 of each simulated robot is recorded first, once, under --out.

On two idle cores the extended forms take a quarter of a minute, the wall's measured form some two minutes,
the Thymio or the twin half a minute, each of Enki's robots and the stranger a few minutes.
"""

from __future__ import annotations

import argparse
import csv
import sys
import time
from pathlib import Path

from realitygap.calibration.calibrate import calibrate
from realitygap.calibration.load import find_recordings, load_recording
from realitygap.calibration.unit import calibrated_unit
from realitygap.world.robot import Profile, load_profile

FILE = Path(__file__).parents[1] / "docs" / "figures" / "model-errors.csv"
SEED = 1995
"""Of the recordings of simulated robots: that of `realitygap reproduce`."""
TABLES = {
    "khepera-wall-extended": ("khepera/wall.sam", "wall", "paper", "extended"),
    "khepera-wall-measured": ("khepera/wall.sam", "wall", "paper", "measured"),
    "khepera-light-extended": ("khepera/light.sam", "lamp", "paper", "extended"),
    "thymio": ("thymio", None, "thymio", "measured"),
}
"""Real robots' readings: path under `--data`, what the sensors were held against, base profile, form."""
UNITS: dict[str, int | str] = {
    "twin": 1,
    "stranger": "stranger:1",
    "enki-khepera": "enki:khepera:1",
    "enki-epuck": "enki:epuck:1",
    "enki-thymio2": "enki:thymio2:1",
}
"""Unit 1 of simulated robots, fitted in the form that `reproduce` and `experiment robots` fit it in."""
COLUMNS = ("name", "channel", "form", "ratio", "noise", "percent_of_scale", "held_out_rmse", "rmse")
NAMES = (*TABLES, *UNITS)


def table(data: Path, name: str, workers: int = 2) -> list[dict[str, str]]:
    """The rows of a real robot's table."""
    path, thing, base, form = TABLES[name]
    found = [load_recording(place, object=thing) for place in find_recordings(data / path)]
    made = calibrate(found, load_profile(base), form=form, beside=False, workers=workers)
    return rows(name, made.profile)


def unit(folder: Path, name: str, workers: int = 2) -> list[dict[str, str]]:
    """The rows of a simulated robot's unit 1, which is recorded and fitted, once, in a folder."""
    made = calibrated_unit(folder / name, unit=UNITS[name], noise=1.0, seed=SEED, workers=workers)
    return rows(name, load_profile(made))


def rows(name: str, profile: Profile) -> list[dict[str, str]]:
    """One row for each kind of sensor.

    `ratio`, `noise` (its deviation, counts) and `percent_of_scale` are of places held out whose readings are
    neither dark nor saturated; `held_out_rmse` and `rmse`, counts, are of all readings with their noise, on
    places held out and where fitted.
    """
    tops = {"infrared": profile.infrared.top, "ambient": profile.ambient.dark - profile.ambient.floor}
    return [
        {
            "name": name,
            "channel": fit.channel,
            "form": fit.form,
            "ratio": f"{fit.ratio:.2f}",
            "noise": f"{fit.noise:.2f}",
            "percent_of_scale": f"{100 * fit.model_error / tops[fit.channel]:.2f}",
            "held_out_rmse": f"{fit.held_out_rmse:.1f}",
            "rmse": f"{fit.rmse:.1f}",
        }
        for fit in profile.provenance.fits
        if fit.channel in tops
    ]


def main() -> None:
    """Print the rows as CSV, and write them if told to."""
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    words.add_argument("--data", type=Path, default=Path(__file__).parents[2] / "shared" / "data")
    words.add_argument("--only", default=",".join(NAMES), help=f"of {', '.join(NAMES)}")
    words.add_argument("--out", type=Path, default=Path("out/model-errors"))
    words.add_argument("--workers", type=int, default=2)
    words.add_argument("--write", type=Path, help="file to write: docs/figures/model-errors.csv")
    given = words.parse_args()
    made = []
    for name in given.only.split(","):
        begun = time.perf_counter()
        if name in TABLES:
            made += table(given.data, name, given.workers)
        else:
            made += unit(given.out, name, given.workers)
        print(f"{name}: {time.perf_counter() - begun:.0f} s", file=sys.stderr)
    write(made, sys.stdout)
    if given.write:
        with given.write.open("w", newline="", encoding="utf-8") as file:
            write(made, file)


def write(made: list[dict[str, str]], file: object) -> None:
    """The rows as CSV."""
    out = csv.DictWriter(file, COLUMNS, lineterminator="\n")  # type: ignore[type-var]
    out.writeheader()
    out.writerows(made)


if __name__ == "__main__":
    main()
