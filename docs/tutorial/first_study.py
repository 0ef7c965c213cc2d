# ---
# jupyter:
#   jupytext:
#     formats: py:percent
#   kernelspec:
#     display_name: Python 3
#     name: python3
# ---

# %% [markdown]
# # A first study
#
# Evolve controllers for a Khepera at two levels of noise, look at what evolved, and test the best of them at
# levels of noise that they have not met. Everything on this page ran in a few seconds while the page was
# built, so the study is small: three runs of 400 evaluations at each level, where the paper has five of 1000.

# %%
# %matplotlib inline
from pathlib import Path
from tempfile import mkdtemp

import realitygap
from realitygap.study.config import Condition

folder = Path(mkdtemp())

# %% [markdown]
# ## Evolve
#
# A *condition* is a task at a noise level: 0 is none, 1 is as much as was measured on a robot, 2 is twice
# that. Each condition is evolved `runs` times. The same configuration and seed give the same bits, with any
# number of processes.

# %%
config = realitygap.StudyConfig(
    conditions=[
        Condition(task="obstacle-avoidance", noise=noise)
        for noise in ("zero", "observed")
    ],
    runs=3,
    evaluations=400,
    fresh_trials=100,
)
study = realitygap.run_study(folder / "study", config, workers=1)
for run in study.runs:
    print(
        f"{run.name}: best during evolution {run.best_fitness:.2f}, test score {run.fitness:.2f}"
    )

# %% [markdown]
# The best during evolution is the highest of many noisy values, so it flatters; the test score, the
# champion's mean in new trials, does not. This is how fitness grew:

# %%
from realitygap.report.evolution import curves_figure, running_best

grown = {
    noise: [
        running_best(study.evaluations(run.id)["fitness"])
        for run in study.runs
        if run.noise == noise
    ]
    for noise in (0.0, 1.0)
}
curves_figure(grown, {0.0: "zero noise", 1.0: "observed noise"})

# %% [markdown]
# Curves are means of three runs. The bands are 95 % intervals of the mean; they are wide because there are
# only three.
#
# ## Look at one
#
# The *champion* of a run is the individual of its last population that does best on trials that selected
# nothing before. It is a genotype; decoded, it is a network that drives the simulated robot. Here is one
# trial, drawn as in the paper, with a tail from the robot's centre to its front at each step of 0.1 s:

# %%
from realitygap.report.drawing import PathPanel, Scene, paths_figure

task, robot = study.task("obstacle-avoidance"), study.profile
drives = []
for run in (
    study.run("obstacle-avoidance/zero/1"),
    study.run("obstacle-avoidance/observed/1"),
):
    simulation = realitygap.Simulation(task, robot, noise=1.0)
    trajectory, score = simulation.trajectory(
        study.networks(run.task, run.champion), stream=7
    )
    drives.append(
        PathPanel(
            noise=run.noise, title=f"{run.name}: {score:.2f}", trajectory=trajectory
        )
    )
paths_figure(Scene.of(task, robot), [drives])

# %% [markdown]
# Both panels show the same trial (stream 7) at observed noise: same start, same disturbances. This is the
# network of the second robot:

# %%
from realitygap.report.network import network_figure

champion = study.run("obstacle-avoidance/observed/1")
network_figure(
    study.slots(task, champion.champion),
    robot,
    feeds=task.feeds,
    sensors=task.sensors,
)

# %% [markdown]
# ## Try it on other noise
#
# Every champion was tested on 100 fresh trials at each of three levels of noise, including those at which it
# did not evolve:

# %%
print("evolved at     tested at 0     1     2")
for run in study.runs:
    tests = [run.tests["champion", level].mean() for level in (0.0, 1.0, 2.0)]
    print(f"{run.noise_name:<22}" + "  ".join(f"{mean:.2f}" for mean in tests))

# %% [markdown]
# Three runs a level are too few to conclude anything; [larger studies](../noise.md) ask with forty and more. To do the same
# from the command line, with a page to click through: `realitygap evolve obstacle-avoidance --noise zero
# --noise observed --runs 3 --evaluations 400`. [How to](../how-to-look.md#from-python) shows what else you
# can do with a finished study in Python.
