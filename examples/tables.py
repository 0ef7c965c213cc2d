"""Export a study as tables: evolve it, write Parquet, read it with pandas, query it in SQL (some seconds).

pip install 'realitygap[tables]'
python examples/tables.py FOLDER
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import pandas

from realitygap import StudyConfig, run_study
from realitygap.export import write_tables
from realitygap.study.config import Condition


def main(folder: Path, runs: int = 3) -> pandas.DataFrame:
    """Write FOLDER/tables/*.parquet and FOLDER/best.png; return champions' scores at each level of noise."""
    conditions = tuple(Condition(task="avoidance", noise=level) for level in (0.0, 1.0, 2.0))
    study = run_study(folder / "study", StudyConfig(evaluations=200, runs=runs, conditions=conditions))
    for path, rows in write_tables(study, "parquet", folder / "tables").items():
        print(f"{path.name}: {rows} rows, {path.stat().st_size:,} bytes")

    evaluations = pandas.read_parquet(folder / "tables" / "evaluations.parquet")
    evaluations["best"] = evaluations.groupby("run")["fitness"].cummax()
    curves = evaluations.groupby(["number", "noise"])["best"].mean().unstack()
    curves.plot(xlabel="evaluation", ylabel="best fitness so far, mean of runs", style=["-", "--", ":"])
    plt.savefig(folder / "best.png", dpi=80)

    query = """SELECT noise, tested_noise, avg(score) AS mean, count(*) AS trials FROM tests
               WHERE who = 'champion' GROUP BY noise, tested_noise"""
    return pandas.DataFrame(study.query(query))


if __name__ == "__main__":
    print(main(Path(sys.argv[1])))
