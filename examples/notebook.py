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
# Evolve, look, measure, in some cells; `jupytext --to notebook notebook.py` makes an .ipynb of this file.
# It takes a minute.

# %%
from pathlib import Path
from tempfile import mkdtemp

import realitygap

folder = Path(mkdtemp())
realitygap.load_profile("paper")

# %% [markdown]
# Two short runs at each of two levels of noise. The bar says how far they are; the page whose address is
# printed shows, in a browser, the curves as they grow and the best robot as it drives.

# %%
levels = ["zero", "observed"]
study = realitygap.evolve(
    "obstacle-avoidance", noise=levels, runs=2, evaluations=150, out=folder / "study", watch=True
)
study

# %% [markdown]
# One of them, its network, and a trial of it: play it, step through it, look inside.

# %%
run = study.runs[-1]
run

# %%
run.replay(seed=3)

# %% [markdown]
# The champion drives a robot: a unit of the twin, a physics model that shares no code with the simulation.
# The page's player has the whole study.

# %%
realitygap.run_transfer(study, realitygap.Transfer(runs=[run.id], starts=1), workers=1)
study.show()

# %% [markdown]
# Figures are Matplotlib's, tables pandas'.

# %%
figures = study.figures()
figures["obstacle-avoidance-curves"]

# %%
study.to_pandas("runs")[["name", "best_fitness", "champion_fresh"]]
