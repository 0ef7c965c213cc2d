"""The names of all random streams of the simulation and of what is made with it: one table.

A stream is made of its parent and a name (`kernels.rng.substream`), so two streams of one parent must
never share a name. Children that are only counted (runs, evaluations, trials, slots) are under a
stream of their own. The twin has another generator and names its draws itself (`twin/noise.py`).
Experiments of many studies name theirs in words (`named_stream`).
"""

from hashlib import blake2b

PICTURES = 5
"""Under a study's seed, beside the digests of its conditions: the trials that figures show."""

BREEDING, TRIALS, RETEST, FRESH = 1, 2, 3, 4
"""Under a run's stream: the algorithm's draws, its evaluations' trials, the retest of the last
population, the fresh trials of the fittest and the champion."""
TRANSFER, NAMED = 6, 7
"""Under a run's stream too: its transfers' trials, and those by which its behaviour is named."""

UNFED, TWIN_NOISE, CONSTANTS, BETWEEN = 1, 2, 3, 4
"""Under a trial's stream: noise of the sensors that feed nobody, the noise of a twin's unit, constants that
are drawn anew, what differs from one recording to another."""

CELL, MATE, REPLACED, OFFSPRING = 0, 1, 2, 3
"""Under an evaluation's of the algorithm: the draws of selection, and all that makes the individual."""

CROSSOVER, MUTATION, ADD_NEURON, DELETE_NEURON, ADD_LINK, DELETE_LINK, START = range(7)
"""Under OFFSPRING, as `control/slots.py` says."""


def named_stream(seed: int, *names: object) -> int:
    """An experiment's stream of whatever these names name, 0 to 2⁶⁴ − 1."""
    text = "/".join(map(repr, (seed, *names)))
    return int.from_bytes(blake2b(text.encode(), digest_size=8).digest(), "little")
