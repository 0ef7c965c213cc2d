"""For use elsewhere: networks as source for a microcontroller, tables, logs."""

from realitygap.lazy import names_of

__all__, __getattr__ = names_of(__name__, {
    "logs": "TrialLog trial_log write_log",
    "onboard": "LANGUAGES OnBoard on_board sizes write_source",
    "tables": "TABLES table write_tables",
})  # fmt: skip
