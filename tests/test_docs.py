"""What the docs show exists: links, commands with their options, the layers that are checked."""

from __future__ import annotations

import re
import shlex
import tomllib
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from realitygap.cli import realitygap

ROOT = Path(__file__).resolve().parents[1]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), ROOT / "examples" / "README.md"])


def anchors(page: Path) -> set[str]:
    """Of the page's headings, as GitHub makes them."""
    heads = re.findall(r"^#+ (.+)$", page.read_text("utf-8"), re.M)
    return {
        re.sub(r"[^\w\- ]", "", re.sub(r"[`*]", "", head)).strip().lower().replace(" ", "-") for head in heads
    }


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    """Every link within the project names a file, and a heading that is in it."""
    for target in re.findall(r"\]\(([^)\s]+)\)", re.sub(r"`[^`\n]*`", "", page.read_text("utf-8"))):
        if re.match(r"\w+:", target):
            continue
        name, _, heading = target.partition("#")
        file = (page.parent / name).resolve() if name else page
        assert file.exists(), f"{page.name}: {target}"
        assert not heading or heading in anchors(file), f"{page.name}: {target}"


def shown() -> Iterator[str]:
    """Every command line in a block of a page or after a `` `realitygap `` within its text."""
    for page in (page for page in PAGES if page.name != "CHANGELOG.md"):
        text = page.read_text("utf-8")
        for block in re.findall(r"^```sh\n(.*?)^```", text, re.S | re.M):
            yield from (line for line in block.splitlines() if line.startswith("realitygap "))
        yield from re.findall(r"`(realitygap [a-z][^`\n|…]*)`", text)


@pytest.mark.parametrize("line", sorted(set(shown())))
def test_commands_that_are_shown_exist(line: str) -> None:
    """Each with its options."""
    words, command = shlex.split(line, comments=True)[1:], realitygap
    words = words[: words.index("&&")] if "&&" in words else words
    while isinstance(command, click.Group) and words:
        command = command.commands[words.pop(0)]
    known = {name for param in command.params for name in (*param.opts, *param.secondary_opts)}
    assert {word.partition("=")[0] for word in words if word.startswith("--")} <= known


def test_the_architecture_has_the_layers_that_are_checked() -> None:
    """Its table names each layer of the import rules, in order, and every package is in one."""
    rules = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["importlinter"]["contracts"]
    layers = next(rule["layers"] for rule in rules if rule["type"] == "layers")
    text = (ROOT / "docs" / "architecture.md").read_text("utf-8")
    table = text.split("```\n")[1].splitlines()
    assert [re.split(r" {2,}", line)[0] for line in table] == layers
    packages = {path.parent.name for path in (ROOT / "src" / "realitygap").glob("*/__init__.py")}
    assert packages <= {name for layer in layers for name in layer.split(" | ")}


def test_the_package_cites_no_page_that_it_lacks() -> None:
    """The wheel has no docs: its help, reports and messages give no path in them."""
    for file in (ROOT / "src").rglob("*"):
        if file.suffix in (".py", ".j2", ".toml", ".html", ".js"):
            assert "docs/" not in file.read_text("utf-8"), file
