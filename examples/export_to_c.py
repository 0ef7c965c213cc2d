"""Put an evolved controller on a chip of your own: evolve, write C, compile and test it (some seconds).

python examples/export_to_c.py FOLDER
"""

import subprocess
import sys
from pathlib import Path

from realitygap import StudyConfig, run_study
from realitygap.export import on_board, write_source
from realitygap.study.config import Condition


def main(folder: Path) -> None:
    """Evolve for a short while, then write the champion's source to FOLDER/avoider."""
    config = StudyConfig(evaluations=200, conditions=(Condition(task="avoidance", noise=1.0),))
    run = run_study(folder / "study", config).runs[0]
    board = on_board(run, "champion", run.champion, name="avoider")
    header, source, test = write_source(board, "c99", folder / "avoider")
    size = f"{len(board.thresholds)} neurons, {board.state_bytes} bytes of state"
    print(f"{header.name}, {source.name}: {size}", flush=True)  # before what the test program prints
    program = folder / "test_avoider"
    subprocess.run(["cc", "-std=c99", "-Wall", "-Werror", "-o", program, test, source], check=True)
    subprocess.run([program], check=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
