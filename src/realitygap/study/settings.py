"""Settings as typed by a person (`variation.mutation=0.1`), and differences between configurations."""

import copy
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from realitygap.errors import ConfigError, StudyError
from realitygap.files import parse_toml, refuse_unknown

__all__ = [
    "EDITED", "LARGEST", "apply", "difference", "flat", "refuse_difference", "refuse_edited_settings",
    "whole",
]  # fmt: skip

LARGEST = 2**63 - 1
"""The largest seed."""

EDITED = "Restore it, or start another study with it, in a folder of its own."


def whole(key: str, value: object, low: int, high: int) -> None:
    """Refuse anything but a whole number from `low` to `high`.

    Args:
        key: its name in the message.
        value: to be checked.
        low, high: the limits, both allowed.

    Raises:
        ConfigError: names the key.
    """
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        limits = f"from {low} to {high}" if high < 2**62 else f", {low} or more"
        raise ConfigError(f"{key}: expected a whole number {limits}, got {value!r}.".replace(" ,", ","))


def apply(table: Mapping[str, Any], settings: Iterable[str]) -> dict[str, Any]:
    """A configuration's dictionary with settings "key=value" applied; `key` may have dots.

    Raises:
        ConfigError: a text that is not a setting, or an unknown first part of a key.
    """
    changed = copy.deepcopy(dict(table))
    pairs = [_pair(text) for text in settings]
    for named in ("evolution.algorithm", "encoding.kind"):
        if any(key == named for key, _ in pairs):
            changed[named.partition(".")[0]] = {}  # the settings of one algorithm are not those of another
    for key, value in pairs:
        first, *rest = key.split(".")
        refuse_unknown([first], changed, ConfigError)
        *middle, last = [first, *rest]
        inner: Any = changed
        for part in middle:
            inner = inner.get(part) if isinstance(inner, dict) else None
        if not isinstance(inner, dict):
            raise ConfigError(f"{key}: unknown key. {first!r} has no parts of that name.")
        inner[last] = value
    return changed


def _pair(text: str) -> tuple[str, Any]:
    """Key and value of "key=value": the value as TOML, or else as text."""
    key, sign, value = text.partition("=")
    key, value = key.strip(), value.strip()
    if not sign or not key or not value:
        raise ConfigError(f"expected a setting key=value, such as variation.mutation=0.1, got {text!r}.")
    try:
        return key, parse_toml(f"value = {value}")["value"]
    except (ValueError, KeyError):
        return key, value


def difference(here: Mapping[str, Any], there: Mapping[str, Any]) -> tuple[str, Any, Any] | None:
    """The first key (with dots) in which two configurations differ, and both values."""
    left, right = dict(flat(here)), dict(flat(there))
    for key in [*left, *(key for key in right if key not in left)]:
        if left.get(key) != right.get(key):
            return key, left.get(key), right.get(key)
    return None


def refuse_difference(
    what: str,
    there: Mapping[str, Any],
    requested: Mapping[str, Any],
    cure: str = "Leave it as it was, or choose another --out.",
) -> None:
    """Refuse to continue something with settings that differ from its own.

    Args:
        what: where it is and how it came about: "FOLDER: the study was made".
        there: its settings.
        requested: the present ones.
        cure: what to do.

    Raises:
        StudyError: names the first key that differs, and both values.
    """
    found = difference(there, requested)
    if found is not None:
        key, here, asked = found
        raise StudyError(f"{what} with {key} = {here!r}, not {asked!r}. {cure}")


def refuse_edited_settings(file: Path, made: Mapping[str, Any], now: Mapping[str, Any]) -> None:
    """Refuse a file whose settings differ from those its study was made with.

    Raises:
        StudyError: names the file, the first key that differs, and both values.
    """
    found = difference(made, now)
    if found is not None:
        key, was, shown = found
        raise StudyError(
            f"{file} has been edited since the study was made: {key} was {was!r}, now {shown!r}. {EDITED}"
        )


def flat(table: Mapping[str, Any], path: str = "") -> Iterator[tuple[str, Any]]:
    """Every key of a configuration, with dots, and its value."""
    for key, value in table.items():
        if isinstance(value, Mapping):
            yield from flat(value, f"{path}{key}.")
        elif isinstance(value, list) and value and isinstance(value[0], Mapping):
            yield f"{path}{key}", len(value)
            for i, entry in enumerate(value):
                yield from flat(entry, f"{path}{key}[{i}].")
        else:
            yield f"{path}{key}", value
