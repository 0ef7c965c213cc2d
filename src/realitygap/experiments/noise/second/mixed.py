"""Mixed models beside claims (b) and (d): random intercepts of unit and run, by statsmodels.

Each run has one champion, so what is its own is the residual; runs that share a number at different levels
share nothing else. They decide nothing; without statsmodels, an optional extra, there are none.
"""

import importlib.util
import warnings

import numpy as np
from numpy.typing import NDArray

from realitygap.experiments.noise.crossed import Crossed
from realitygap.experiments.noise.second.stratified import Tested
from realitygap.experiments.noise.second.verdicts import PLAN, Plan, falls
from realitygap.values import Floats

__all__ = ["by_mixed_models"]


def by_mixed_models(data: Crossed, plan: Plan = PLAN) -> dict[tuple[str, str], Tested]:
    """The level's coefficient, by claim and what level 1 is held against, as `Comparison.against` names it.

    For (b) it is in points, in favour of level 1; for (d) of the fall of fitness, in deviations, over the
    level's root in deviations: there the statistic is above zero where it falls.
    """
    if importlib.util.find_spec("statsmodels") is None:
        return {}
    found: dict[tuple[str, str], Tested | None] = {}
    for other in plan.against:
        part = data.only(np.isin(data.evolved, (plan.robot, other)))
        found["b", f"{other:g}"] = _fitted(part, part.at(plan.robot), part.evolved == plan.robot)
    for against, part, fall in falls(data, plan):
        root = np.sqrt(part.evolved)
        for task in part.tasks:
            rows = part.task == task
            fall[rows] = (fall[rows] - fall[rows].mean()) / (fall[rows].std() or 1.0)
        made = _fitted(part, fall, (root - root.mean()) / (root.std() or 1.0))
        found["d", against] = made and made._replace(statistic=-made.statistic)
    return {key: made for key, made in found.items() if made is not None}


def _fitted(data: Crossed, values: Floats, level: NDArray[np.generic]) -> Tested | None:
    """The coefficient of `level` [n], beside a constant for each task; None where nothing can be fitted."""
    from statsmodels.regression.mixed_linear_model import VCSpec, MixedLM  # isort: skip

    tasks = np.array([data.task == task for task in data.tasks], np.float64)
    across = np.column_stack([level.astype(np.float64), tasks.T])
    units, sizes = np.unique(data.home, return_counts=True)
    intercepts = [np.ones((size, 1)) for size in sizes]  # a component may vanish; a group's variance may not
    spec = VCSpec(["unit"], [[["unit"] for _ in units]], [intercepts])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of variances at zero, where a random intercept has nothing to do
        try:
            fit = MixedLM(values, across, groups=data.home, exog_vc=spec).fit(reml=True)
        except np.linalg.LinAlgError:
            return None
    effect, p = float(fit.params[0]), float(fit.pvalues[0])
    return Tested(effect, effect, p if np.isfinite(p) else 1.0)
