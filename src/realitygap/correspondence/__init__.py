"""How alike behaviour in simulation and on a robot is, and the names of behaviours (tables 1 and 2)."""

from realitygap.lazy import names_of

__all__, __getattr__ = names_of(__name__, {
    "judging": "agreement blind_pairs read_marks",
    "names": "Name Namer namer",
    "score": "Comparison behaviour_score compare",
    "setting": "Setting setting_of",
    "trials": "Trial read_transfer read_trials trial_of",
})  # fmt: skip
