"""Prints the README's table of the look-up table: `python look_up.py [--forms F,F,…] RECORDING…`.

Each RECORDING, a .sam table or a folder of `realitygap record`, is one robot's: each form's error on places
held out, and of a look-up table also on every other place, foretold by its neighbours.
"""

from __future__ import annotations

import sys

import numpy as np

from realitygap.api import load_recordings
from realitygap.calibration.calibrate import ChannelFit, base_of, calibrate
from realitygap.calibration.lookup import replayed, rings
from realitygap.calibration.noise import Yardstick, misfits
from realitygap.calibration.readings import Readings
from realitygap.calibration.recordings import SensorRecording
from realitygap.world.robot import Profile, load_profile

FORMS = "paper,individual,extended,measured"


def main(words: list[str]) -> None:
    """Print a table for each recording."""
    forms = FORMS
    if words[:1] == ["--forms"]:
        forms, words = words[1], words[2:]
    for place in words:
        thing = {"wall.sam": "wall", "light.sam": "lamp"}.get(place.rpartition("/")[2])
        found = [
            r for r in load_recordings([place], [thing] if thing else []) if isinstance(r, SensorRecording)
        ]
        base = load_profile(base_of(found))
        print(f"{place.rpartition('/')[2]}\n| form | held out, counts | over noise |\n|---|---|---|")
        for form in forms.split(","):
            last = fitted(found, base, form)
            print(f"| {form} | {last.held_out[form]:.1f} | {last.ratio:.2f} |", flush=True)
        tables(found, base, last.deviation)


def fitted(found: list[SensorRecording], base: Profile, form: str) -> ChannelFit:
    """The one channel's fit in a form."""
    made = calibrate(found, base, form=form, beside=False)
    return made.channels[0]


def tables(found: list[SensorRecording], base: Profile, deviation: float) -> None:
    """The rows of a look-up table: patches held out, as of all forms, and every other place."""
    rows = Readings([r.of_robot(base) for r in found], base)
    round_object = rings(rows)
    noise = Yardstick(kind=found[0].kind, top=rows.top, deviation=deviation)
    parts = {"patches": list(rows.folds())}
    chess = np.zeros(len(rows.counts), bool)
    for ring in round_object.values():
        chess[ring.rows] = (ring.node // ring.bearings + ring.node % ring.bearings) % 2 == 0
    parts["every other place"] = [chess, ~chess]
    for name, outs in parts.items():
        read = np.zeros(rows.counts.shape)
        for out in outs:
            read[out] = replayed(rows, ~out)[out]
        each = misfits(rows.live(), read, rows.place, noise)
        over = np.sqrt(np.nanmean([one.lit_ratio**2 for one in each]))
        print(f"| look-up table, {name} held out | {rows.rmse(read):.1f} | {over:.2f} |")


if __name__ == "__main__":
    main(sys.argv[1:])
