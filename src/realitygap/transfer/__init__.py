"""Transfer (§6): evolved individuals on robots, each trial paired with its simulation."""

from realitygap.lazy import names_of

__all__, __getattr__ = names_of(__name__, {
    "drive": "DriveResult drive",
    "options": "Transfer",
    "record": "TransferredTrial load_transfers",
    "rig": "Rig",
    "run": "Operator run_transfer",
    "scores": "marks_of",
})  # fmt: skip
