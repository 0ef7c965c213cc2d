"""The docs say what is there, in the words of the glossary, and their links lead somewhere."""

from __future__ import annotations

import ast
import re
import shlex
import tomllib
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from realitygap.cli import realitygap

ROOT = Path(__file__).resolve().parents[1]
SOURCE = ROOT / "src" / "realitygap"
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), ROOT / "examples" / "README.md"])
READ = [page for page in PAGES if page.name != "CHANGELOG.md"]
WORDS = (
    "genotype", "slot", "link", "express", "decode", "network", "individual", "cell", "grid", "neighbourhood",
    "mate", "breeding event", "step", "update", "trial", "score", "evaluation", "fitness", "run", "study",
    "arena", "cylinder", "lamp", "pose", "heading", "proximity", "ambient", "reading", "command",
    "noise level", "profile", "unit", "recording", "calibration", "transfer", "track", "tail", "film",
    "frame",     "behaviour score", "correspondence score", "simulated", "situated", "pseudo-reality", "twin",
    "noise scale", "rig", "identifiable", "requested", "input range", "live camera", "Lambertian",
    "wall offset", "incidence", "score row", "evidence", "marker", "calibration unit",
)  # fmt: skip
"""Those of the project that mean one thing each."""
INSTEAD = {
    r"dials?": "noise scale", r"proud": "wall offset", r"matt": "Lambertian", r"wished": "requested",
    r"slants?": "incidence", r"home units?": "calibration unit", r"(?<!by )eyes?": "live camera",
    r"episodes?": "trial", r"rollouts?": "trial", r"rewards?": "score", r"chromosomes?": "genotype",
    r"everything random follows": "random seed", r"live again": "replay",
    r"not told": "not identifiable", r"study noise": "experiment noise",
}  # fmt: skip
"""Words of our own, or of other fields, and what is said here."""


def prose(text: str) -> str:
    """A page without code, addresses and HTML."""
    text = re.sub(r"^```.*?^```", "", text, flags=re.S | re.M)
    return re.sub(r"`[^`\n]*`|\]\([^)]*\)|<[^>]*>", " ", text)


def helps(command: click.Command, *names: str) -> Iterator[tuple[str, str]]:
    """The help of a command and of all below it, each with its name."""
    context = click.Context(command, info_name=" ".join(names))
    yield " ".join(names), command.get_help(context)
    for name in command.commands if isinstance(command, click.Group) else ():
        yield from helps(command.commands[name], *names, name)


def refuse(text: str, where: str) -> None:
    """No word that has a better one."""
    for word, better in INSTEAD.items():
        found = re.search(rf"(?<![-\w])(?:{word})(?![-\w])", " ".join(text.split()), re.I)
        assert found is None, f"{where}: {found[0]!r}: say {better!r}" if found else ""


DOOR = ("glossary.md", "gymnasium.md", "environment")
"""Pages, and a room, that speak others' language."""


@pytest.mark.parametrize("page", [p for p in READ if p.name not in DOOR], ids=lambda page: page.name)
def test_pages_keep_to_the_words(page: Path) -> None:
    """What the glossary has a word for is said with it."""
    refuse(prose(page.read_text("utf-8")), page.name)


@pytest.mark.parametrize(("name", "text"), helps(realitygap, "realitygap"))
def test_help_keeps_to_the_words(name: str, text: str) -> None:
    """Option names apart, which keep what old scripts say."""
    refuse(re.sub(r"--[\w-]+", "", text), name)


ROOMS = sorted({file.relative_to(SOURCE).parts[0].removesuffix(".py") for file in SOURCE.rglob("*.py")})


@pytest.mark.parametrize("room", [room for room in ROOMS if room not in DOOR])
def test_docstrings_keep_to_the_words(room: str) -> None:
    """Of every name in a room, private ones and all."""
    for file in [*SOURCE.glob(f"{room}.py"), *(SOURCE / room).rglob("*.py")]:
        for node in ast.walk(ast.parse(file.read_text("utf-8"))):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
                text = re.sub(r"^ +[\w, ]+:", "", ast.get_docstring(node) or "", flags=re.M)  # a field's name
                refuse(prose(text), f"{file.name}: {getattr(node, 'name', 'module')}")


def test_the_glossary_has_every_word() -> None:
    """Each with one sentence, and no word twice."""
    rows = re.findall(r"^\| ([^|]+) \| ([^|]+) \|$", (ROOT / "docs" / "glossary.md").read_text("utf-8"), re.M)
    said = [word for word, _ in rows if word not in ("word", "---")]
    assert set(WORDS) <= set(said) and len(said) == len(set(said))
    assert all(text.endswith(".") for word, text in rows if word not in ("word", "---"))


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


def lines() -> Iterator[str]:
    """Every command line that a page shows."""
    for page in READ:
        for block in re.findall(r"^```sh\n(.*?)^```", page.read_text("utf-8"), re.S | re.M):
            yield from (line for line in block.splitlines() if line.startswith("realitygap "))


@pytest.mark.parametrize("line", sorted(set(lines())))
def test_commands_that_are_shown_exist(line: str) -> None:
    """Each with its options."""
    words, command = shlex.split(line, comments=True)[1:], realitygap
    while isinstance(command, click.Group):
        command = command.commands[words.pop(0)]
    known = {name for param in command.params for name in (*param.opts, *param.secondary_opts)}
    inner = next((realitygap.commands[word] for word in words if word in realitygap.commands), command)
    known |= {
        name for param in inner.params for name in param.opts
    }  # of a command that is another's argument
    used = {word.partition("=")[0] for word in words if word.startswith("--")}
    assert used <= known


def test_the_house_has_the_layers_that_are_checked() -> None:
    """The architecture shows what the import rules hold, and every room that there is."""
    rules = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["importlinter"]["contracts"]
    layers = next(rule["layers"] for rule in rules if rule["type"] == "layers")
    text = (ROOT / "docs" / "architecture.md").read_text("utf-8")
    assert "```\n" + "\n".join(layers) + "\n```" in text
    rooms = {path.parent.name for path in (ROOT / "src" / "realitygap").glob("*/__init__.py")}
    assert rooms == set(re.findall(r"^  (\w+)/ ", text, re.M))
