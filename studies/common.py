"""What the studies' analyses share: the archived tables, and numbers and tables as printed.

`data.tar.xz` holds every table that a printed figure comes from; `SHA256SUMS` its files' checksums
(`tar xf data.tar.xz && sha256sum -c SHA256SUMS`).
"""

import hashlib
import io
import math
import tarfile
import tomllib
from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import pandas as pd

STUDIES = Path(__file__).resolve().parent


@cache
def archive() -> dict[str, bytes]:
    """Every archived file by its name, each checked against SHA256SUMS.

    Raises:
        ValueError: a file is missing or differs from its checksum.
    """
    lines = (STUDIES / "SHA256SUMS").read_text("utf-8").splitlines()
    expected = {name: digest for digest, name in (line.split(maxsplit=1) for line in lines)}
    with tarfile.open(STUDIES / "data.tar.xz") as tar:
        files = {one.name: tar.extractfile(one).read() for one in tar if one.isfile()}  # type: ignore[union-attr]
    found = {name: hashlib.sha256(content).hexdigest() for name, content in files.items()}
    wrong = sorted(name for name in expected.keys() | found.keys() if expected.get(name) != found.get(name))
    if wrong:
        raise ValueError(f"data.tar.xz: expected the files of SHA256SUMS, got others: {', '.join(wrong)}")
    return files


def table(name: str) -> pd.DataFrame:
    """An archived CSV table, such as "noise-level-2/E/cells.csv"; every digit as written."""
    return pd.read_csv(io.BytesIO(archive()[name]), float_precision="round_trip")


def settings(name: str) -> dict[str, Any]:
    """An archived TOML file."""
    return tomllib.loads(archive()[name].decode())


def number(value: float, places: int = 2, *, signed: bool = False) -> str:
    """A number as printed: a real minus sign, a dash where there is none."""
    if not math.isfinite(value):
        return "–"
    return f"{value:{'+' if signed else ''}.{places}f}".replace("-", "−")


def estimate(value: float, low: float, high: float, places: int = 2, *, signed: bool = False) -> str:
    """A value with its interval: "+0.13 (+0.09 to +0.17)"; without one if it is unknown."""
    text = number(value, places, signed=signed)
    if not math.isfinite(low):
        return text
    return f"{text} ({number(low, places, signed=signed)} to {number(high, places, signed=signed)})"


def markdown(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(map(str, line)) + " |" for line in lines)


def told(event: Any) -> None:
    """Print an experiment's progress, a line each."""
    print(f"{event.phase}: {event.done} of {event.total} {event.what}", flush=True)
