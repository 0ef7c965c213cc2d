"""The simulated robot at a task: engines that carry out batches of trials, and the simulated body (§3.2)."""

from realitygap.lazy import names_of

__all__, __getattr__ = names_of(__name__, {
    "body": "SimulatedBody",
    "simulation": "Engine Simulation",
})  # fmt: skip
