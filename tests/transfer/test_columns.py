"""Tables in columns come back to the very same text; what would not is left as it is."""

import json

import numpy as np
import pytest

from realitygap.transfer.columns import columns_of, text_of
from realitygap.transfer.packed import HOME, PACKED, Packed, content


def table(rows: int, seed: int = 0) -> bytes:
    """Of decimals that drift and jump, of whole numbers, and of what is written as short as it is."""
    draw = np.random.default_rng(seed)
    lines = ["t_s,x_cm,heading_deg,count_0,late_s"]
    x = np.cumsum(draw.normal(0, 0.3, rows))
    for k in range(rows):
        turn, count, late = draw.uniform(-180, 180), draw.integers(-99, 1024), draw.integers(0, 9) / 1000
        lines.append(f"{k / 10:.1f},{x[k]:.6f},{turn:.6f},{count},{late:.10g}")
    return ("\n".join(lines) + "\n").encode()


@pytest.mark.parametrize("rows", [1, 2, 3, 200])
def test_a_table_comes_back_byte_for_byte(rows):
    """Whatever its length."""
    for seed in range(20):
        text = table(rows, seed)
        kept = columns_of(text)
        assert kept is not None and text_of(kept) == text


@pytest.mark.parametrize(
    "text",
    [
        b"a,b\n1,-0.000\n", b"a,b\n1.0,2\n,\n", b"a\nnan\n", b"a\n1e999\n", b"a\n99999999999999999\n", b"",
        b"a\n1", b"a\r\n1\r\n", b"a\n01\n", b"a\n+1\n", b"a\n1_0\n", b"a\n1,2\n3\n", "a\n\u0661\n".encode(),
        b"a,b\n", b"\n\n", b"a\n1.50\n2\n", b"a\n0.12345678901234567890123\n",
    ],
)  # fmt: skip
def test_what_would_not_come_back_is_kept_as_it_is(text, tmp_path):
    """A zero with a sign, a row of nothing, what is no table: no byte of it changes in an archive."""
    assert columns_of(text) is None
    with Packed(tmp_path) as archive:
        archive.keep("a/b/start-1", {"steps.csv": text})
    (tmp_path / HOME).mkdir()
    (tmp_path / PACKED).rename(tmp_path / HOME / PACKED)
    assert content(tmp_path / HOME / "a" / "b" / "start-1" / "steps.csv") == text


def test_what_is_no_column_is_refused():
    """No size in the first line makes anything large."""
    for facts in ([99, 0, 0, 1], [0, 999, 0, 1], [0, 0, 10**9, 1], [0, 0, 0, 0], [0, 0, 0, 9]):
        with pytest.raises(ValueError, match="no column"):
            text_of(json.dumps(["a", 10**12, [facts]]).encode() + b"\n0")
    with pytest.raises(ValueError, match="buffer is smaller"):
        text_of(json.dumps(["a", 10**12, [[0, 0, 0, 1]]]).encode() + b"\n0")
