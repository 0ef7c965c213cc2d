"""What a task file states: spreads, a score's signature, an arena's path beside it."""

import inspect
from pathlib import Path

from realitygap.tasks.scoring import Score
from realitygap.world.arena import arena_names
from realitygap.world.files import require

__all__ = ["beside", "check_score", "check_spread", "ending"]


def check_spread(spread: float, wheels: float | None) -> None:
    """Refuse invalid shares, and the wheels' alone.

    Raises:
        ConfigError: names the key.
    """
    require(_is_share(spread), "spread", "a share from 0 to 0.9", spread)
    fits = wheels is None or (_is_share(wheels) and spread > 0)
    require(fits, "spread_wheels", "a share from 0 to 0.9, beside a spread", wheels)


def _is_share(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value <= 0.9


def ending(spread: float, wheels: float | None = None) -> str:
    """What a name says of a spread: -spread-10, of 10 %."""
    of_wheels = "" if wheels is None else f"-wheels-{100 * wheels:g}"
    return f"-spread-{100 * spread:g}{of_wheels}".replace(".", "-") if spread else ""


def check_score(score: object) -> None:
    """Refuse what cannot be called with (path, room)."""
    cure = "Write `def score(path, room): …`."
    require(inspect.isfunction(score), "score", "a function", score, cure)
    try:
        inspect.signature(score).bind(None, None)  # type: ignore[arg-type]
    except TypeError:
        names = list(inspect.signature(score).parameters)  # type: ignore[arg-type]
        require(False, "score", "a function of two parameters, (path, room)", tuple(names), cure)


def beside(score: Score, arena: str | Path) -> str | Path:
    """The arena's path, taken from the folder of the file that defines `score`."""
    if str(arena) in arena_names() or Path(arena).is_absolute():
        return arena
    near = Path(inspect.getfile(score)).parent / arena
    return near if near.is_file() else arena
