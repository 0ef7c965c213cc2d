# ---
# jupyter:
#   jupytext:
#     formats: py:percent
#   kernelspec:
#     display_name: Python 3
#     name: python3
# ---

# %% [markdown]
# # An optimiser of your own
#
# `Problem` hands a task to whatever optimises vectors: solutions in as an array, fitness and measures of
# behaviour out, on all cores in the compiled loop. Here it is an evolution strategy of a dozen lines; pycma,
# pyribs and SciPy are used [in the same way](../optimisers.md).

# %%
import matplotlib.pyplot as plt
import numpy as np

from realitygap.problem import Problem

problem = Problem(
    "obstacle-avoidance", controller="feed-forward:4", noise="observed"
)
print(problem.dim, "weights, each within", problem.bounds[:, 0])

# %% [markdown]
# A (μ, λ) evolution strategy: 30 children of a mean, which moves to the mean of the best ten; the step shrinks.
# **Each generation has a seed of its own.** All children of one generation meet the same trials, so they are
# compared fairly; were the trials the same in every generation, the search would learn them by heart.


# %%
def strategy(problem, generations, seed, trials=2):
    """The mean of the last parents, and each generation's mean fitness."""
    random = np.random.default_rng(seed)
    mean, grown = problem.x0(), []
    for generation in range(generations):
        children = mean + 1.0 * 0.97**generation * random.standard_normal(
            (30, problem.dim)
        )
        batch = problem.evaluate(children, seed=generation, trials=trials)
        mean = np.clip(children, *problem.bounds)[
            np.argsort(-batch.fitness)[:10]
        ].mean(axis=0)
        grown.append(batch.fitness.mean())
    return mean, grown


found = [strategy(problem, 40, seed) for seed in range(3)]

# %%
figure, ax = plt.subplots(figsize=(6, 3))
for _, grown in found:
    ax.plot(grown, color="#0072B2")
ax.set(
    xlabel="generations of 30",
    ylabel="mean fitness of a generation",
    ylim=(0, None),
)
ax.grid(axis="y")

# %% [markdown]
# Each line is one of three searches. What to report is not the highest fitness met on the way, since the best
# of many noisy figures was lucky, but a retest on trials that no `evaluate` has seen:

# %%
again = problem.retest(np.array([mean for mean, _ in found]), trials=200)
for fitness, sd in zip(again.fitness, again.info["sd"], strict=True):
    print(f"{fitness:.3f}, sd {sd:.3f} over 200 fresh trials")

# %% [markdown]
# `again.measures` says how they drive: the wheels' mean speed, and how much faster the right one turned, over
# the top speed. An archive of behaviours is spanned by these ([MAP-Elites](../optimisers.md)).

# %%
print(np.round(again.measures, 2))
