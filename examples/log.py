"""Write a trial on a robot as logs for Rerun's viewer and Foxglove; read one back and draw it (some seconds).

pip install 'realitygap[logs]'
python examples/log.py STUDY RUN FOLDER     # a study with transfers, such as that of `realitygap reproduce`
"""

import json
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from mcap.reader import make_reader

from realitygap import load_study
from realitygap.export import trial_log, write_log


def main(study: str, run: str, folder: Path) -> np.ndarray:
    """Write FOLDER/*.rrd, *.mcap and apart.png; return how far apart the robots were at each step, in cm."""
    one = trial_log(load_study(study).run(run))
    print(f"rerun {write_log(one, 'rerun', folder)}")
    steps = {"/simulated/step": [], "/situated/step": []}
    with write_log(one, "mcap", folder).open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages(topics=list(steps)):
            step = json.loads(message.data)
            steps[channel.topic].append([step[key] for key in ("t_s", "x_cm", "y_cm")])
    here, there = (np.array(rows, float) for rows in steps.values())
    apart = np.hypot(*(here - there)[:, 1:].T)
    figure, (paths, gap) = plt.subplots(1, 2, figsize=(8, 3.6), layout="constrained")
    for rows, name, line in ((here, "simulated", "-"), (there, "situated", "--")):
        paths.plot(rows[:, 1], rows[:, 2], line, label=name)
    paths.set(aspect="equal", xlabel="cm", ylabel="cm", title=one.name)
    paths.legend(loc="upper right", bbox_to_anchor=(0.85, 0.6))
    gap.plot(here[:, 0], apart)
    gap.set(xlabel="s", ylabel="apart, cm")
    figure.savefig(folder / "apart.png", dpi=90)
    return apart


if __name__ == "__main__":
    print(f"at most {np.nanmax(main(*sys.argv[1:3], Path(sys.argv[3]))):.1f} cm apart")
