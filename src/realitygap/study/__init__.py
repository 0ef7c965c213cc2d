"""Studies: configuration, one run, many runs, the database, resuming. A study is a folder."""

from realitygap.lazy import names_of

__all__, __getattr__ = names_of(__name__, {
    "config": "StudyConfig",
    "load": "Run Study load_study",
    "runner": "run_study",
})  # fmt: skip
