"""§5.1: the distributed genetic algorithm and two baselines, behind the same ask and tell."""

from __future__ import annotations

from typing import Any

from realitygap.errors import UsageError
from realitygap.evolution.algorithm import Algorithm, Candidate, State, Variation
from realitygap.evolution.panmictic import Panmictic
from realitygap.evolution.random_search import RandomSearch
from realitygap.evolution.torus import DistributedGA

__all__ = [
    "ALGORITHMS",
    "Algorithm",
    "Candidate",
    "DistributedGA",
    "Panmictic",
    "RandomSearch",
    "State",
    "make_algorithm",
]

ALGORITHMS = ("torus", "panmictic", "random")
"""Names of the algorithms: the paper's, and two to compare it with."""


def make_algorithm(name: str, variation: Variation, **params: Any) -> Algorithm:
    """The algorithm of a name: "torus" (rows, columns), "panmictic" (size) or "random" (size).

    Raises:
        UsageError: an unknown name or parameter, or a value out of range.
    """
    kinds: dict[str, type[DistributedGA] | type[Panmictic] | type[RandomSearch]]
    kinds = {"torus": DistributedGA, "panmictic": Panmictic, "random": RandomSearch}
    if not isinstance(name, str) or name not in kinds:
        raise UsageError(f"the algorithm must be one of {', '.join(ALGORITHMS)}; not {name!r}")
    if not all(hasattr(variation, way) for way in ("random", "crosses", "offspring")):
        raise UsageError(f"variation: expected a Variation, got {variation!r}")
    known = [key for key in kinds[name].__dataclass_fields__ if key != "variation"]
    for key in params:
        if key not in known:
            raise UsageError(f"the algorithm {name!r} has {', '.join(known)}; no {key!r}")
    return kinds[name](variation=variation, **params)
