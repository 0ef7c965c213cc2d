"""Bytes, lines, numbers and keys of a file changed by chance, as a slip, a damaged disk or malice would."""

from __future__ import annotations

import random
import re

__all__ = ["mutated"]

NUMBERS = (
    b"0",
    b"-0.0",
    b"-1",
    b"1e300",
    b"-1e300",
    b"1e-300",
    b"1e-9",
    b"9e18",
    b"1e19",
    b"9223372036854775807",
    b"nan",
    b"inf",
    b"-inf",
    b"NaN",
    b"Infinity",
    b"1e400",
    b"9" * 5000,
    b"0x" + b"f" * 5000,
    b"1e5",
    b"1e9",
    b"65536",
    b"0.5",
    b"",
    b"true",
    b"null",
    b'"a"',
    b"[]",
    b"{}",
    b"[1, 2]",
    b"[" * 3000 + b"]" * 3000,
    b"1979-05-27",
    b"x" * 2000,
    b"2147483648",
)
TEXTS = (
    b"",
    b"\\u0000",
    b"a" * 5000,
    b"../../etc/passwd",
    b"\\uD800",
    b"paper",
    b"mine.toml\\u0000",
    b"nan",
    b"%s%n",
    b"cylinder:nan",
    b"cylinder:1e300",
    b"/",
    b".",
    b"wall",
    b"lamp",
    b"ambient",
    b"wheels",
    b"sonar",
)
NUMBER, TEXT, KEY = rb"-?\d+\.?\d*(?:e[-+]?\d+)?", rb'"[^"\n]*"', rb'(?m)^[a-z_]+(?= =)|"[a-z_]+"(?=:)'
DEEP = (
    b"a." * 3000 + b"b = 1\n",
    b"x = " + b"[" * 3000 + b"\n",
    b"[" + b"a." * 3000 + b"b]\n",
    b'{"a":' * 3000,
)


def mutated(data: bytes, draw: random.Random) -> bytes:
    """The file with one to three things changed."""
    for _ in range(draw.choice((1, 1, 1, 2, 3))):
        data = draw.choice(CHANGES)(data, draw)
    return data


def _one(pattern: bytes, others: tuple[bytes, ...]):
    def change(data: bytes, draw: random.Random) -> bytes:
        found = list(re.finditer(pattern, data))
        if not found:
            return data
        there, new = draw.choice(found), draw.choice(others)
        quoted = b'"' + new + b'"' if there.group().startswith(b'"') and others is TEXTS else new
        return data[: there.start()] + quoted + data[there.end() :]

    return change


def _byte(data: bytes, draw: random.Random) -> bytes:
    k = draw.randrange(len(data) + 1)
    return (
        data[:k]
        + bytes([draw.choice((0, 10, 13, 34, 44, 59, 91, 123, 0xFF, draw.randrange(256)))])
        + data[k + 1 :]
    )


def _cut(data: bytes, draw: random.Random) -> bytes:
    a, b = sorted(draw.randrange(len(data) + 1) for _ in range(2))
    return draw.choice((data[:a], data[b:], data[:a] + data[b:], data[:b] + data[a:]))


def _line(data: bytes, draw: random.Random) -> bytes:
    lines = data.splitlines(keepends=True) or [b""]
    k, j = (draw.randrange(len(lines)) for _ in range(2))
    change = draw.randrange(3)
    if change == 0:
        lines.pop(k)
    elif change == 1:
        lines.insert(k, lines[j])
    else:
        lines[k], lines[j] = lines[j], lines[k]
    return b"".join(lines)


def _deep(data: bytes, draw: random.Random) -> bytes:
    new = draw.choice(DEEP)
    return draw.choice((new + data, data + new, new))


NUMBERED = _one(NUMBER, NUMBERS)
CHANGES = (
    NUMBERED,
    NUMBERED,
    NUMBERED,
    NUMBERED,
    NUMBERED,
    NUMBERED,
    _one(TEXT, TEXTS),
    _one(TEXT, TEXTS),
    _one(KEY, TEXTS),
    _byte,
    _cut,
    _line,
    _line,
    _deep,
)
