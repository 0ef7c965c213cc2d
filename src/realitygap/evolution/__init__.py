"""§5.1: the distributed genetic algorithm and two baselines, behind the same ask and tell as a user's."""

from typing import Any

from realitygap.errors import UsageError
from realitygap.evolution.algorithm import Algorithm, Batch, State, Variation
from realitygap.evolution.ga import DistributedGA, Panmictic, Population, RandomSearch
from realitygap.plugins import made, place_of
from realitygap.values import as_count

__all__ = [
    "ALGORITHMS", "Algorithm", "Batch", "DistributedGA", "Panmictic", "Population", "RandomSearch",
    "State", "Variation", "make_algorithm",
]  # fmt: skip

ALGORITHMS: dict[str, type[DistributedGA] | type[Panmictic] | type[RandomSearch]] = {
    "torus": DistributedGA,
    "panmictic": Panmictic,
    "random": RandomSearch,
}
"""The algorithms by name: the paper's, and two to compare it with."""


def make_algorithm(name: str, encoding: Any, **params: Any) -> Algorithm[Any]:
    """The algorithm of a name, for individuals of an encoding.

    Args:
        name: "torus" (rows, columns), "panmictic" (size), "random" (size), or `FILE.py:NAME`: a class of
            a user's own, made by `NAME(encoding=…, **params)`; its file is run.
        encoding: how individuals begin and change: `Variation` is the paper's.
        params: the algorithm's own.

    Raises:
        UsageError: an unknown name or parameter, or a value out of range.
    """
    if place_of(name):
        ways = ("cells", "init", "ask", "tell", "from_bytes")
        own: Algorithm[Any] = made(name, "algorithm", ways, params, encoding=encoding)
        as_count(own.cells, f"{name}: cells")
        return own
    if name not in ALGORITHMS:
        raise UsageError(
            f"the algorithm: expected one of {', '.join(ALGORITHMS)}, or FILE.py:NAME, got {name!r}."
        )
    needs = ("random",) if name == "random" else ("random", "crosses", "offspring")
    if not all(hasattr(encoding, way) for way in needs):
        raise UsageError(
            f"encoding: the algorithm {name!r} expected one with {', '.join(needs)}, "
            f"such as a Variation, got {encoding!r}"
        )
    known = [key for key in ALGORITHMS[name].__dataclass_fields__ if key != "encoding"]
    if unknown := set(params) - set(known):
        raise UsageError(f"the algorithm {name!r} has {', '.join(known)}; no {min(unknown)!r}")
    return ALGORITHMS[name](encoding=encoding, **params)
