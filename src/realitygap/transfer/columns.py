"""Tables of decimal numbers as columns of integers, which compress to half the size of their text.

Each column is counted in its last decimal place and stored as it is, as differences, or as second
differences, whichever are smallest: the lowest byte of every row, then the next. A table that would not
convert back to exactly the same text is left as it is.
"""

import json

import numpy as np
from numpy.typing import NDArray

__all__ = ["columns_of", "text_of"]

GENERAL = -1
"""Instead of a number of decimals: each number as short as possible, ten digits at most
(`recording.Recorder`)."""
LARGEST = 2.0**50
"""Beyond this a float has no exact last decimal."""
Whole = NDArray[np.int64]


def columns_of(text: bytes) -> bytes | None:
    """A table [rows, columns] with a line of names, as columns; None if it is not one, or not exactly
    reversible.

    A line of JSON: the names, the number of rows, and of each column its decimals, its power of ten, the
        order of differences and the bytes of a number. Then every column's bytes.
    """
    try:
        head, *lines = text.decode("ascii").split("\n")
        columns = list(zip(*(line.split(",") for line in lines[:-1]), strict=True))
        kept = [_packed(column) for column in columns]
    except ValueError:
        return None
    if None in kept or not columns:
        return None
    facts = [head, len(columns[0]), [one[0] for one in kept if one]]
    data = json.dumps(facts, separators=(",", ":")).encode() + b"\n" + b"".join(one[1] for one in kept if one)
    return data if text_of(data) == text else None


def text_of(data: bytes) -> bytes:
    """The table's text.

    Raises:
        ValueError: these are no columns.
    """
    line, _, rest = data.partition(b"\n")
    head, rows, facts = json.loads(line)
    at, columns, forms = 0, [], []
    for decimals, power, times, width in facts:
        if not (GENERAL <= decimals <= 20 and 0 <= power <= 20 and 0 <= times <= 2 and 1 <= width <= 8):
            raise ValueError(f"no column: {[decimals, power, times, width]}")
        count = rows * width
        low = np.frombuffer(rest, np.uint8, count, at).reshape(width, rows)
        zigzag = np.zeros((rows, 8), np.uint8)
        zigzag[:, :width] = low.T
        whole = zigzag.view("<u8")[:, 0]
        told = (whole >> 1).astype(np.int64) ^ -(whole & 1).astype(np.int64)
        for _ in range(times):
            told = np.cumsum(told)
        columns.append(told / 10.0**power)
        forms.append("%.10g" if decimals == GENERAL else f"%.{int(decimals)}f")
        at += count
    every = (",".join(forms) + "\n") * rows % tuple(np.column_stack(columns).ravel().tolist())
    return f"{head}\n{every}".encode("ascii")


def _packed(column: tuple[str, ...]) -> tuple[tuple[int, int, int, int], bytes] | None:
    decimals = {len(word.partition(".")[2]) for word in column}
    power = max(decimals)
    counted = np.rint(np.array(column, np.float64) * 10.0**power)
    if not (np.abs(counted) < LARGEST).all():
        return None
    ways: list[Whole] = [counted.astype(np.int64)]
    for _ in range(2):
        ways.append(np.diff(ways[-1], prepend=0))
    sizes = [float(np.log2(1 + np.abs(way[k:])).sum()) for k, way in enumerate(ways)]
    times = sizes.index(min(sizes))
    told = ways[times]
    low = ((told << 1) ^ (told >> 63)).astype("<u8").view(np.uint8).reshape(-1, 8).T
    width = 1 + int(np.flatnonzero(low.any(axis=1)).max(initial=0))
    form = power if len(decimals) == 1 and power else GENERAL
    return (form, power, times, width), low[:width].tobytes()
