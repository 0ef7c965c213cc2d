"""studies/noise-level: its tables are what the archived data give, its plan is the one that was stated."""

import hashlib
import re
import subprocess
import sys
from pathlib import Path

import pytest

STUDY = Path(__file__).parents[2] / "studies" / "noise-level"
CURE = "python studies/noise-level/analyse.py --write"
DIGEST = "10b0b1603553ca95280ae9d9fbd5ba63250817347aabbf388479f598ecd49ddc"
VERDICTS = {
    ("default-first", "both tasks"): ("supported", "not supported", "supported"),
    ("default", "both tasks"): ("supported", "not supported", "supported"),
    ("default-again", "both tasks"): ("supported", "not supported", "supported"),
    ("evaluations-5000", "both tasks"): ("supported", "not supported", "not supported"),
    ("twin-noise-2", "both tasks"): ("supported", "not supported", "supported"),
    ("default-first", "light-seeking"): ("supported", "in part", "in part"),
    ("default", "light-seeking"): ("supported", "not supported", "not supported"),
    ("default-again", "light-seeking"): ("supported", "not supported", "supported"),
    ("default-again", "obstacle-avoidance"): ("supported", "not supported", "in part"),
    ("evaluations-5000", "light-seeking"): ("in part", "opposite", "not supported"),
}
"""As published in November 2026."""


def rows(text: str) -> list[list[str]]:
    """The cells of each line of a Markdown text's tables."""
    return [[c.strip() for c in line[1:-1].split("|")] for line in text.splitlines() if line.startswith("|")]


@pytest.fixture(scope="module")
def tables() -> str:
    """The committed tables."""
    return (STUDY / "tables.md").read_text("utf-8")


def test_the_tables_are_what_the_archived_data_give(tables: str) -> None:
    """analyse.py prints tables.md, byte for byte."""
    command = [sys.executable, str(STUDY / "analyse.py")]
    made = subprocess.run(command, capture_output=True, text=True, encoding="utf-8", check=True).stdout
    for number, (ours, theirs) in enumerate(
        zip(made.splitlines(), tables.splitlines(), strict=False), start=1
    ):
        assert ours == theirs, f"line {number}: {CURE}"
    assert made == tables, CURE


def test_the_verdicts_are_those_published(tables: str) -> None:
    """Verdicts of all makings, and of the single tasks where they differ."""
    found = {(row[0], row[3]): tuple(row[4:7]) for row in rows(tables) if len(row) == 11}
    assert {key: found[key] for key in VERDICTS} == VERDICTS


def test_the_plan_is_the_one_stated_beforehand() -> None:
    """claims.toml has not changed since commit 6a0b566f; the plan has its three claims."""
    claims = (STUDY / "claims.toml").read_bytes()
    assert hashlib.sha256(claims).hexdigest() == DIGEST
    plan = (STUDY / "plan.md").read_text("utf-8")
    for words in re.findall(r'^text = """\\\n(.*?)"""', claims.decode(), re.DOTALL | re.MULTILINE):
        assert words.replace("\\\n", "") in plan
