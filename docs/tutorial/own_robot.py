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
# class that senses and acts. This page has both for a robot with five infrared sensors of 12 bits, evolves a
# controller in a simulation of the profile, and lets it drive the body.

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
# [`five_eyes.toml`](../../examples/five_eyes.toml) says where the sensors are, where they look, and roughly how
# they read. A wrong or missing key is refused by its name.

# %%
from realitygap.report.robots import robot_figure

profile = realitygap.load_profile(examples / "five_eyes.toml")
robot_figure(profile)

# %% [markdown]
# What it would read 2 cm before a wall and 6 cm before it, without noise:

# %%
simulation = realitygap.Simulation("obstacle-avoidance", profile, noise="zero")
for gap in (2, 6):
    pose = realitygap.Pose(x=50 - gap - profile.body.radius_cm, y=25, heading=0)
    print(f"{gap} cm:", np.round(simulation.probe(pose)[0][0]).astype(int))

# %% [markdown]
# ## Evolve for it
#
# The task names the sensors that feed the network, the Khepera's eight; here they are this robot's five.

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
# [`own_robot.py`](../../examples/own_robot.py) is such a class: `channels` (what it can sense), `period_s`,
# `reset`, `sense`, `act`, `stop` and `close`. On a real robot `sense` asks a serial port; this one is a little
# simulation of its own, with another law of light than ours, and with commands that act two steps late.
# `drive` keeps the time, and stops the robot first whatever happens.

# %%
sys.path.insert(0, str(examples))
from own_robot import FiveEyes

from realitygap.robots.loop import drive
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
# Beside its simulation from the same place:

# %%
from realitygap.report.paths import PathPanel, Scene, panels_figure
from realitygap.report.style import SITUATED

simulated, score = realitygap.Simulation(
    task, profile, noise="observed"
).trajectory(
    study.networks(champion.task, champion.champion), stream=1, pose=places[0]
)
panels_figure(
    Scene.of(task, profile),
    [
        PathPanel(noise=1.0, title=f"simulated: {score:.2f}", trajectory=simulated),
        PathPanel(noise=1.0, title="driven", trajectory=situated, look=SITUATED),
    ],
)

# %% [markdown]
# The constants were guessed, so this is the reality gap as it opens. To close it, measure: `realitygap record`
# reads the sensors at known places (where the body puts itself, or you put it), `realitygap calibrate` fits the
# profile to those readings, and `realitygap transfer` compares drives. In the project's folder:
#
# ```sh
# realitygap record --robot examples/own_robot.py:FiveEyes \
#     --base examples/five_eyes.toml --plan all --out recorded
# realitygap calibrate recorded --base examples/five_eyes.toml --out robot.toml
# realitygap evolve avoidance --profile robot.toml --out study
# realitygap transfer study --robot examples/own_robot.py:FiveEyes --starts 4
# ```
#
# What a body may have besides, and the contract test that yours should pass: [how to](../how-to.md#a-robot-of-your-own).
