# ---
# jupyter:
#   jupytext:
#     formats: py:percent
#   kernelspec:
#     display_name: Python 3
#     name: python3
# ---

# %% [markdown]
# # A study in a notebook
#
# Evolve, look and measure in a few cells. `jupytext --to notebook notebook.py` makes an .ipynb of this file.
# It takes a minute.

# %%
from pathlib import Path
from tempfile import mkdtemp

import realitygap

folder = Path(mkdtemp())
realitygap.load_profile("paper")

# %% [markdown]
# Make two short runs at each of two levels of noise. The bar shows their progress. Open the printed address
# in a browser to see the curves as they grow and a drive of the best robot.

# %%
levels = ["zero", "observed"]
study = realitygap.evolve(
    "obstacle-avoidance", noise=levels, runs=2, evaluations=150, out=folder / "study", watch=True
)
study

# %% [markdown]
# Look at one run, its network and a trial: play the trial, step through it, look inside.

# %%
run = study.runs[-1]
run

# %%
run.replay(seed=3)

# %% [markdown]
# The champion drives a robot: a unit of the twin, a physics model that shares no code with the simulation.
# The page's player shows the whole study.

# %%
realitygap.run_transfer(study, realitygap.Transfer(runs=[run.id], starts=1), workers=1)
study.show()

# %% [markdown]
# Figures are Matplotlib figures, tables are pandas data frames.

# %%
figures = study.figures()
figures["obstacle-avoidance-curves"]

# %%
study.to_pandas("runs")[["name", "best_fitness", "champion_fresh"]]
