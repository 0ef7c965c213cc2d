"""Transfer (§6): evolved individuals on robots, each trial paired with its simulation."""

from realitygap.lazy import names_of

__all__, __getattr__ = names_of(__name__, {
    "drive": "Drove drive",
    "load": "Transferred load_transfers",
    "options": "Transfer",
    "rig": "Rig",
    "run": "Attendant run_transfer",
    "score_rows": "marks_of",
})  # fmt: skip
