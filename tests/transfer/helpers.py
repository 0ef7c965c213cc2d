"""A transfer in one line: its options, and who carries it out, by keywords."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from realitygap.study.load import Study
from realitygap.transfer.load import Transferred
from realitygap.transfer.run import Attendant, Transfer, run_transfer

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
) -> list[Transferred]:
    """A transfer of these runs."""
    person = None if carry is None else Attendant(carry, found)
    wished = Transfer(runs=runs, **options)
    return run_transfer(study, wished, workers=workers, attendant=person, on_progress=on_progress)
