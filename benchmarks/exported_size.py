"""How large networks are on small processors: bytes of code and tables by links, as a figure.

python benchmarks/exported_size.py docs/exported-size.png      # needs avr-gcc and arm-none-eabi-gcc
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from realitygap.control.genotype import Genotype
from realitygap.export import on_board, sizes, write_source
from realitygap.study.config import StudyConfig
from realitygap.study.runner import run_study

LOOKS = {"ATmega328P": ("o", "#0072b2"), "Cortex-M0+": ("s", "#d55e00")}


def measured(folder: Path) -> dict[str, list[tuple[int, int]]]:
    """(links, bytes) of random networks, from nearly empty to as full as a genotype may be."""
    run = run_study(folder / "study", StudyConfig.single("avoidance", evaluations=2), workers=1).runs[0]
    found: dict[str, list[tuple[int, int]]] = {chip: [] for chip in LOOKS}
    for i, full in enumerate(np.linspace(0.0, 1.0, 16)):
        genes = Genotype.random(i, start_neurons=full, start_links=0.2 + 0.8 * full).genes
        board = on_board(run, "random", genes)
        _, source, _ = write_source(board, "c99", folder / f"{i}")
        taken = sizes(source)
        if lacking := ", ".join(found.keys() - taken.keys()):
            cure = "Install avr-gcc and arm-none-eabi-gcc."
            print(f"error: no compiler for {lacking}. {cure}", file=sys.stderr)
            sys.exit(2)
        for chip, size in taken.items():
            found[chip].append((len(board.sources), size))
    return found


def main(file: Path) -> None:
    """Draw it."""
    with tempfile.TemporaryDirectory() as folder:
        found = measured(Path(folder))
    figure, axes = plt.subplots(figsize=(4.8, 3.0), layout="constrained")
    for chip, pairs in found.items():
        mark, colour = LOOKS[chip]
        print(chip, sorted(pairs))
        axes.plot(*np.array(sorted(pairs)).T, mark, color=colour, ms=4, label=chip)
    axes.set(xlabel="links of the network", ylabel="bytes of code and tables", xlim=(0, None), ylim=(0, None))
    axes.legend(loc="upper left", fontsize=8)
    figure.savefig(file, dpi=150)


if __name__ == "__main__":
    main(Path(*(sys.argv[1:2] or ["docs/exported-size.png"])))
