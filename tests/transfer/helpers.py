"""A transfer in one line: its options, and who carries it out, by keywords."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from realitygap.study.load import Study
from realitygap.transfer.record import TransferredTrial
from realitygap.transfer.run import Operator, Transfer, run_transfer

__all__ = ["transfer"]


def transfer(
    study: Study,
    runs: Sequence[int | str] = (),
    *,
    workers: int | None = None,
    carry: Any = None,
    found: Any = None,
    on_progress: Any = None,
    **options: Any,
) -> list[TransferredTrial]:
    """A transfer of these runs."""
    person = None if carry is None else Operator(carry, found)
    wished = Transfer(runs=runs, **options)
    return run_transfer(study, wished, workers=workers, operator=person, on_progress=on_progress)
