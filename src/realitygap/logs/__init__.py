"""Logs that others wrote: any table of numbers, what its columns seem to be, and what a MAP.toml says."""

from realitygap.lazy import names_of

__all__, __getattr__ = names_of(__name__, {
    "look": "Look look",
    "mapped": "Mapped read_map",
    "table": "Log read_log",
})  # fmt: skip
