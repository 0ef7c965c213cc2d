"""A share of some work, done apart from the other shares, and the folder that holds it.

    Shard.parse("2/3").folder(Path("out/study"))  # out/study-shard-2-of-3

A shard's folder is marked, so that only shards that belong together are merged.
"""

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self, TypeVar

from realitygap.errors import ConfigError, StudyError
from realitygap.files import atomic_write

__all__ = ["MARK", "Mark", "Shard", "all_shards", "marked", "read_mark", "whole_of"]

MARK = "shard.json"
MOST = 10**5
"""Shards; a cluster's array jobs are fewer."""

_SUFFIX = re.compile(r"-shard-\d+-of-\d+$")
One = TypeVar("One")


@dataclass(frozen=True)
class Shard:
    """Share `number` (from 1) of `of`.

    Raises:
        ConfigError: there is no such share.
    """

    number: int
    of: int

    def __post_init__(self) -> None:
        if not 1 <= self.number <= self.of <= MOST:
            raise _no_shard(str(self))

    @classmethod
    def parse(cls, text: str | Self) -> Self:
        """From "2/3"; a Shard stays what it is.

        Raises:
            ConfigError: not a shard, or one that does not exist.
        """
        found = re.fullmatch(r"(\d{1,6})/(\d{1,6})", str(text).strip())
        if found is None:
            raise _no_shard(text)
        return cls(int(found[1]), int(found[2]))

    def __str__(self) -> str:
        return f"{self.number}/{self.of}"

    def own(self, every: Iterable[One]) -> list[One]:
        """Its share of things that are the same, in the same order, in every shard."""
        return list(every)[self.number - 1 :: self.of]

    def folder(self, out: Path) -> Path:
        """Its folder, beside the one that the whole is to have.

        Raises:
            ConfigError: the folder's name is that of another shard.
        """
        out = out if out.name.strip(".") else out.resolve()
        suffix = f"-shard-{self.number}-of-{self.of}"
        if out.name.endswith(suffix):
            return out
        if _SUFFIX.search(out.name):
            raise ConfigError(f"{out}: expected a name for the whole, or shard {self}'s, got another's.")
        return out.with_name(out.name + suffix)


def _no_shard(text: object) -> ConfigError:
    return ConfigError(
        f"shard: expected I/N, share I (from 1 to N) of N up to {MOST}, such as 2/3, got {text!r}."
    )


def whole_of(folder: Path) -> Path:
    """The folder that the whole is to have, by the name of a shard's."""
    folder = folder if folder.name.strip(".") else folder.resolve()
    return folder.with_name(_SUFFIX.sub("", folder.name))


@dataclass(frozen=True, kw_only=True)
class Mark:
    """What a shard's folder says of itself.

    Attributes:
        shard: which it is.
        work: of what, as a command's name.
        facts: what all shards of one work share.
        finished: whether its share is done.
    """

    shard: Shard
    work: str
    facts: Mapping[str, Any] = field(default_factory=dict)
    finished: bool = False

    def write(self, folder: Path, *, finished: bool) -> None:
        """Write it into the folder, which is made if needed."""
        folder.mkdir(parents=True, exist_ok=True)
        table = {"shard": str(self.shard), "work": self.work, "finished": finished, "facts": self.facts}
        atomic_write(folder / MARK, json.dumps(table, indent=1) + "\n")


def read_mark(folder: Path) -> Mark | None:
    """What a folder says it is a shard of; None for one that holds a whole.

    Raises:
        StudyError: the mark cannot be read.
    """
    file = folder / MARK
    if not file.is_file():
        return None
    try:
        table = json.loads(file.read_text("utf-8"))
        shard = Shard.parse(table["shard"])
        facts = dict(table["facts"])
        return Mark(shard=shard, work=str(table["work"]), facts=facts, finished=table["finished"] is True)
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        raise StudyError(f"{file}: expected a shard's mark. Restore it from a copy.") from None


def marked(folder: Path, shard: Shard | None, work: str, *, begun: bool, **facts: Any) -> Mark | None:
    """The mark of the share that is worked on in a folder; None if all of the work is done there.

    Args:
        folder: in which work begins or continues.
        shard: that was requested; None continues whatever the folder holds.
        work: what the command does.
        begun: whether there is work of its kind in the folder.
        facts: what all shards share.

    Raises:
        StudyError: the folder holds another share, or all of it.
    """
    there, cure = read_mark(folder), "Choose another --out."
    if there is None:
        if shard is not None and begun:
            raise StudyError(f"{folder} holds more than a shard: it was started without one. {cure}")
        return None if shard is None else Mark(shard=shard, work=work, facts=facts)
    if shard not in (None, there.shard) or there.work != work:
        asked = there.shard if shard is None else shard
        raise StudyError(
            f"{folder} holds shard {there.shard} of {there.work!r}, not {asked} of {work!r}. {cure}"
        )
    return replace(there, facts=facts)


def all_shards(folders: Sequence[Path]) -> dict[Shard, Path]:
    """The folders of all finished shards of one study, in order.

    Raises:
        StudyError: a folder without a shard, a shard of another study, a repeated, unfinished or missing one:
            says which.
    """
    found: dict[Shard, Path] = {}
    first: Mark | None = None
    for folder in folders:
        mark = read_mark(folder)
        if mark is None:
            raise StudyError(
                f"{folder}: expected a shard's folder, such as `--shard 1/3` makes ({MARK} is missing)."
            )
        first = first or mark
        if (mark.work, mark.shard.of) != (first.work, first.shard.of):
            raise StudyError(
                f"{folder} holds shard {mark.shard} of {mark.work!r}; {folders[0]} holds {first.shard} of "
                f"{first.work!r}. Merge shards of one work only."
            )
        if mark.shard in found:
            raise StudyError(f"shard {mark.shard} is given twice: {found[mark.shard]}, {folder}. Give one.")
        if not mark.finished:
            raise StudyError(f"{folder}: shard {mark.shard} is not finished. Finish it first.")
        found[mark.shard] = folder
    if first is None:
        raise StudyError("expected the folders of all shards, got none.")
    every = [Shard(number, first.shard.of) for number in range(1, first.shard.of + 1)]
    missing = [str(shard) for shard in every if shard not in found]
    if missing:
        shown = ", ".join(missing[:10]) + (f" … ({len(missing)} in all)" if len(missing) > 10 else "")
        raise StudyError(f"missing: shard {shown}. Give the folders of all {first.shard.of} shards.")
    return {shard: found[shard] for shard in every}
