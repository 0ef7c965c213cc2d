"""The report of a study of the level of noise: stands in until the real one is here."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

__all__ = ["build_noise_report", "noise_summary"]


def build_noise_report(
    out: str | Path, *, on_progress: Callable[[int, int, str], None] | None = None
) -> Path:
    """The page about a study's results."""
    return Path(out) / "results"


def noise_summary(out: str | Path) -> dict[str, Any]:
    """What came out, ready for JSON."""
    return {"paragraph": f"The results are in {Path(out) / 'results'}."}
