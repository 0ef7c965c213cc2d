"""Tasks as problems for any optimiser: arrays of solutions in, fitness and measures out."""

from realitygap.lazy import names_of

__all__, __getattr__ = names_of(__name__, {
    "controllers": "WeightedController",
    "problem": "Batch Problem",
})  # fmt: skip
