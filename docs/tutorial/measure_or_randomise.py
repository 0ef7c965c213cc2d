# ---
# jupyter:
#   jupytext:
#     formats: py:percent
#   kernelspec:
#     display_name: Python 3
#     name: python3
# ---

# %% [markdown]
# # Measure, or randomise?
#
# Your robot is not the one in the file. Two ways lead to a controller that still drives it. You can *measure*
# the robot, even with little data, and evolve in a simulation of what you measured. Or you can *randomise*
# the simulation, so that whatever evolves there copes with many robots, yours among them. This page tries
# both, small enough to run while it is built.
#
# What it can show is limited. The robots here are simulated ones, whose constants were drawn at random and
# hidden from training. A measurement can get them exactly right, since the truth has the model's own form; a
# real robot's does not. And there are only six robots, with one search for each, on one task.

# %%
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
from scipy.optimize import least_squares

import realitygap
from realitygap.problem import Problem

TASK = "obstacle-avoidance"
paper = realitygap.load_profile("paper")
SENSORS = len(paper.infrared.sensors)


def robot_of(constants):
    """The paper's robot but for its sensors' gains, then its wheels' (1: as printed)."""
    gains, wheels = constants[:SENSORS], constants[SENSORS:]
    sensors = tuple(
        replace(s, a=s.a * g)
        for s, g in zip(paper.infrared.sensors, gains, strict=True)
    )
    speeds = tuple(
        speed * w
        for speed, w in zip(paper.wheels.speed_per_unit_cm_s, wheels, strict=True)
    )
    return replace(
        paper,
        infrared=replace(paper.infrared, sensors=sensors),
        wheels=replace(paper.wheels, speed_per_unit_cm_s=speeds),
    )


def drawn(random):
    """By chance: sensors' gains within a factor of two or so, wheels' a fifth."""
    return np.exp(
        np.concatenate([random.normal(0, 0.35, SENSORS), random.normal(0, 0.1, 2)])
    )


# %% [markdown]
# ## Measuring
#
# The data are few: what eight sensors read at six poses near a corner, once each, with noise; and where the
# robot was as it drove straight ahead for two seconds. Two numbers from the drive give the wheels; least
# squares against the simulation without noise give the sensors.

# %%
PLACES = [
    realitygap.Pose(x=4.5, y=4.5, heading=h) for h in np.arange(6) * np.pi / 3
]
START = realitygap.Pose(x=25, y=10, heading=np.pi / 2)
straight = realitygap.Genotype.constant(8, 8).networks()


def read(robot, noise, stream=0):
    """[6, 8] readings, counts."""
    simulation = realitygap.Simulation(TASK, robot, noise=noise)
    return np.array(
        [simulation.probe(p, stream=stream + i)[0][0] for i, p in enumerate(PLACES)]
    )


def measured(robot, stream):
    """The constants that explain what the robot did."""
    seen = read(robot, 1.0, stream)
    path, _ = realitygap.Simulation(TASK, robot, noise=1.0).trajectory(
        straight, stream=stream, pose=START, seconds=2.0
    )
    ahead = np.hypot(*np.diff([path.x, path.y]))
    turn = np.diff(path.heading)
    going = slice(5, None)  # once it is up to speed
    sides = (
        np.array([-1, 1]) * turn[going].mean() * paper.wheels.track_cm / 2
        + ahead[going].mean()
    )
    wheels = sides / 0.1 / (8 * np.array(paper.wheels.speed_per_unit_cm_s))

    def misfit(gains):
        return (
            read(robot_of(np.concatenate([np.exp(gains), wheels])), 0.0) - seen
        ).ravel()

    fitted = least_squares(
        misfit, np.zeros(SENSORS), diff_step=0.01, ftol=1e-4, bounds=(-1.5, 1.5)
    )
    return np.concatenate([np.exp(fitted.x), wheels])


random = np.random.default_rng(1995)
hidden = [drawn(random) for _ in range(6)]
known = [
    measured(robot_of(constants), 100 + i) for i, constants in enumerate(hidden)
]
off = np.abs(np.log(np.array(known) / hidden))
before = np.abs(np.log(hidden))
for name, of in (("sensors", slice(SENSORS)), ("wheels", slice(SENSORS, None))):
    print(f"{name}: off by {np.median(before[:, of]):.1%} as printed,", end=" ")
    print(f"by {np.median(off[:, of]):.1%} as measured (medians)")

# %% [markdown]
# ## Training
#
# All use the same search, the evolution strategy of [the page on optimisers](own_optimiser.py). It takes a
# list of simulations and uses them in turn:
#
# - *printed* has one, with the paper's constants;
# - *randomised* has sixteen, drawn as the hidden robots were, so the spread is exactly right: a kind
#   assumption;
# - *measured* has one, with the measured constants;
# - *told* has one of the hidden robot itself, which no measurement can better.


# %%
def problem_of(constants):
    return Problem(
        TASK,
        controller="feed-forward:4",
        profile=robot_of(constants),
        noise="observed",
    )


def search(problems, seed, generations=30):
    """Weights of a controller after 30 generations of 30, two trials each."""
    random = np.random.default_rng(seed)
    mean = problems[0].x0()
    for generation in range(generations):
        children = mean + 0.97**generation * random.standard_normal((30, mean.size))
        fitness = (
            problems[generation % len(problems)]
            .evaluate(children, seed=generation, trials=2)
            .fitness
        )
        mean = np.clip(children, *problems[0].bounds)[
            np.argsort(-fitness)[:10]
        ].mean(axis=0)
    return mean


many = [problem_of(drawn(random)) for _ in range(16)]
ways = ("printed", "randomised", "measured", "told")
scores = np.zeros((len(ways), len(hidden)))
for i, constants in enumerate(hidden):
    truth = problem_of(constants)
    trained = {
        "printed": [problem_of(np.ones(SENSORS + 2))],
        "randomised": many,
        "measured": [problem_of(known[i])],
        "told": [truth],
    }
    found = np.array([search(trained[way], seed=i) for way in ways])
    scores[:, i] = truth.retest(found, trials=200).fitness

# %% [markdown]
# ## Results
#
# Each controller drives its hidden robot in 200 fresh trials. A line joins the four controllers of one robot.

# %%
figure, ax = plt.subplots(figsize=(6, 3.2))
ax.plot(scores, "o-", color="#56B4E9", linewidth=0.8, markersize=4)
ax.plot(scores.mean(axis=1), "_", color="black", markersize=26, markeredgewidth=2)
ax.set(
    xticks=range(len(ways)),
    xticklabels=ways,
    ylabel="score on the hidden robot",
    ylim=(0, None),
)
ax.grid(axis="y")


# %%
def said(first, second):
    """The mean difference over the robots, with its 95 % interval (t, 5 d.f.)."""
    gap = scores[ways.index(first)] - scores[ways.index(second)]
    half = 2.571 * gap.std(ddof=1) / np.sqrt(len(gap))
    low, high = gap.mean() - half, gap.mean() + half
    return f"{first} − {second}: {gap.mean():+.3f} ({low:+.3f} to {high:+.3f})"


for pair in (
    ("measured", "printed"),
    ("randomised", "printed"),
    ("measured", "randomised"),
    ("told", "measured"),
):
    print(said(*pair))

# %% [markdown]
# An interval that contains 0 shows no difference; it does not show that there is none. Before you apply any
# of this to your robot, measure it with [`realitygap calibrate`](../how-to-robots.md#calibrate), which
# reports how well its constants are known and how far off the model is, and ask the question there.
