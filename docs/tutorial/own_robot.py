# ---
# jupyter:
#   jupytext:
#     formats: py:percent
#   kernelspec:
#     display_name: Python 3
#     name: python3
# ---

# %% [markdown]
# # A robot of your own
#
# The simulation knows a robot by its *profile*: a TOML file of constants. A program knows it as a *body*: a
# class that senses and acts. This page has both for a robot with five infrared sensors of 12 bits. It evolves
# a controller in a simulation of the profile, then has it drive the body.

# %%
# %matplotlib inline
import sys
from pathlib import Path
from tempfile import mkdtemp

import numpy as np

import realitygap

examples = Path("../../examples").resolve()
folder = Path(mkdtemp())

# %% [markdown]
# ## The profile
#
# [`five_eyes.toml`](../../examples/five_eyes.toml) says where the sensors are, which way they face, and
# roughly how they read. A wrong or missing key is refused by name.

# %%
from realitygap.report.drawing import robot_figure

profile = realitygap.load_profile(examples / "five_eyes.toml")
robot_figure(profile)

# %% [markdown]
# This is what it would read 2 cm and 6 cm from a wall, without noise:

# %%
simulation = realitygap.Simulation("obstacle-avoidance", profile, noise="zero")
for gap in (2, 6):
    pose = realitygap.Pose(x=50 - gap - profile.body.radius_cm, y=25, heading=0)
    print(f"{gap} cm:", np.round(simulation.probe(pose)[0][0]).astype(int))

# %% [markdown]
# ## Evolve for it
#
# By default the task feeds the Khepera's eight sensors to the network; here it feeds this robot's five.

# %%
config = realitygap.StudyConfig.single(
    "obstacle-avoidance",
    "observed",
    profile=str(examples / "five_eyes.toml"),
    runs=2,
    evaluations=400,
    fresh_trials=50,
)
study = realitygap.run_study(folder / "study", config, workers=1)
for run in study.runs:
    print(
        f"{run.name}: champion {run.tests['champion', 1.0].mean():.2f} on fresh trials"
    )

# %% [markdown]
# ## The body
#
# [`own_robot.py`](../../examples/own_robot.py) is such a class, a `realitygap.robots.Body`: `channels` (what it can sense),
# `reset`, `sense`, `act` and `stop`. On a real robot `sense` queries a serial port. This one is a
# small simulation of its own: its light follows a different law from ours, and its commands take effect two
# steps late. `drive` keeps the time. However a drive ends, the robot is stopped first.

# %%
sys.path.insert(0, str(examples))
from own_robot import FiveEyes

from realitygap.robots.drive import drive
from realitygap.track import Track

champion = max(study.runs, key=lambda run: run.champion_fitness)
task = study.task(champion.task)
controller = study.controller(champion.task, champion.champion)

body, places = FiveEyes(), []
body.enter(task.arena.plain(), 1, realitygap.Pose(x=25, y=25, heading=0.5))


def inputs(readings):
    """Counts as five whole numbers from −10 to 10; and note where the robot is."""
    places.append(body.pose)
    return profile.inputs(readings.proximity, task.feeds, task.sensors)


drive(body, controller, seconds=task.seconds, inputs=inputs)
situated = Track(
    t=np.arange(len(places)) * body.period_s,
    **{
        key: np.array([getattr(place, key) for place in places])
        for key in ("x", "y", "heading")
    },
)

# %% [markdown]
# Here it is beside its simulation from the same pose:

# %%
from realitygap.report.drawing import PathPanel, Scene, paths_figure
from realitygap.report.style import SITUATED

simulated, score = realitygap.Simulation(
    task, profile, noise="observed"
).trajectory(
    study.networks(champion.task, champion.champion), stream=1, pose=places[0]
)
drives = [
    PathPanel(noise=1.0, title=f"simulated: {score:.2f}", trajectory=simulated),
    PathPanel(noise=1.0, title="driven", trajectory=situated, look=SITUATED),
]
paths_figure(Scene.of(task, profile), [drives])

# %% [markdown]
# The constants were guessed, so this is the reality gap before any calibration. To narrow it, measure.
# `realitygap record` reads the sensors at known poses (the body places itself, or you place it),
# `realitygap calibrate` fits the profile to those readings, and `realitygap transfer` compares drives. In the
# project's folder:
#
# ```sh
# realitygap record --robot examples/own_robot.py:FiveEyes \
#     --base examples/five_eyes.toml --plan all --out recorded
# realitygap calibrate recorded --base examples/five_eyes.toml --out robot.toml
# realitygap evolve avoidance --profile robot.toml --out study
# realitygap transfer study --robot examples/own_robot.py:FiveEyes --starts 4
# ```
#
# [How to](../how-to-own-parts.md#a-robot) lists what else a body may have, and names the contract test that
# yours should pass.
