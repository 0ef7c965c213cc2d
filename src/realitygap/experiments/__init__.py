"""Experiments of many runs: each states its plan, then carries it out."""

from realitygap.lazy import names_of

__all__, __getattr__ = names_of(__name__, {
    "noise": "NoiseConfig noise_experiment",
    "reproduction": "Reproduction",
})  # fmt: skip
