# ---
# jupyter:
#   jupytext:
#     formats: py:percent
#   kernelspec:
#     display_name: Python 3
#     name: python3
# ---

# %% [markdown]
# # A task of your own
#
# A task is an arena, a start, the sensors that feed the network, a length, and a *score*: a plain Python
# function of the path that was driven. In this one a robot drives in circles round the middle of the room,
# anticlockwise, and the score counts the turns.

# %%
# %matplotlib inline
import tempfile
from pathlib import Path

import realitygap

folder = Path(tempfile.mkdtemp())

# %% [markdown]
# The function is compiled, so it lives in a file. It may use numbers, `math` and NumPy. `path` has a row a
# step: `x`, `y` (cm), `heading` (rad), `left`, `right` (ground speed of each wheel, cm/s) and `contact`.
# `room` has `size` (cm), `cylinders`, `lamps`, `top_speed` (cm/s) and `radius` (of the robot, cm).

# %%
# %%writefile {folder}/circles.py
import math

from realitygap import Start, Task


def score(path, room):
    """Turns about the room's middle, anticlockwise, of steps that touched nothing."""
    turned = 0.0
    for i in range(1, path.x.size):
        ax, ay = path.x[i - 1] - room.size[0] / 2, path.y[i - 1] - room.size[1] / 2
        bx, by = path.x[i] - room.size[0] / 2, path.y[i] - room.size[1] / 2
        if path.contact[i] == 0:
            turned += math.atan2(ax * by - ay * bx, ax * bx + ay * by)
    return max(0.0, turned / (2 * math.pi))


task = Task(
    name="circles",
    arena="obstacle-avoidance",
    feeds="proximity",
    sensors=(0, 1, 2, 3, 4, 5, 6, 7),
    start=Start(x_cm=25, y_cm=10, radius_cm=3, heading_deg=(0, 90)),
    seconds=20,
    trials=2,
    score=score,
)

# %% [markdown]
# Before a score is used it is tested on example paths in the task's own room, compiled and as plain Python;
# the two must agree. An error message names the line. Then the task evolves as the paper's do:

# %%
config = realitygap.StudyConfig.single(
    folder / "circles.py", "observed", runs=2, evaluations=400, fresh_trials=50
)
study = realitygap.run_study(folder / "study", config, workers=1)
for run in study.runs:
    fresh = run.tests["champion", 1.0]
    print(f"{run.name}: {fresh.mean():.2f} turns, sd {fresh.std(ddof=1):.2f}")

# %%
from realitygap.report.drawing import PathPanel, Scene, paths_figure

task, robot = study.task("circles"), study.profile
simulation = realitygap.Simulation(task, robot, noise="observed")
drives = []
for run in study.runs:
    trajectory, score = simulation.trajectory(
        study.networks(run.task, run.champion), stream=3
    )
    drives.append(
        PathPanel(
            noise=1.0,
            title=f"run {run.index}: {score:.2f} turns",
            trajectory=trajectory,
        )
    )
paths_figure(Scene.of(task, robot), [drives])

# %% [markdown]
# Evolution often finds a behaviour that the author of the score did not intend: it takes the score literally.
# `realitygap evolve circles.py` does the same from the command line. An arena of your own is a [TOML
# file](../how-to-own-parts.md#an-arena).
