"""TOML to frozen values and back: the only place where a robot's or arena's file is read.

A value is a frozen dataclass whose field names are the file's keys. `Value` converts what came
(a file's lists and whole numbers, or a Python caller's) to the declared types and then lets the
value check itself, so that a file and a Python call are refused with the same words.
"""

import math
import tomllib
from collections.abc import Mapping
from dataclasses import MISSING, asdict, dataclass, fields, is_dataclass
from difflib import get_close_matches
from functools import cache
from importlib.resources import files
from numbers import Real
from os import PathLike
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import numpy as np

from realitygap.errors import ConfigError
from realitygap.files import read_toml, refuse_unknown, to_toml

__all__ = ["Value", "build", "load", "require", "shipped", "shipped_text"]


T = TypeVar("T")
_hints = cache(get_type_hints)


@dataclass(frozen=True, kw_only=True)
class Value:
    """A frozen value with declared types; a subclass adds its own facts in `_check`."""

    def __post_init__(self) -> None:
        for name, hint in _hints(type(self)).items():  # type: ignore[arg-type]
            object.__setattr__(self, name, _convert(hint, getattr(self, name), name))
        self._check()

    def _check(self) -> None:
        """Raise ConfigError("key: …") for a value that makes no sense."""

    def to_dict(self) -> dict[str, Any]:
        """The value as a dictionary ready for JSON, keys as in its file."""
        listed: dict[str, Any] = _listed(asdict(self))
        return listed

    def to_toml(self) -> str:
        """The value as a TOML file, which reads back to an equal value."""
        return to_toml(self.to_dict())


def require(fact: bool, key: str, expected: str, got: object, cure: str = "") -> None:
    """Refuse `key` unless `fact` holds."""
    if not fact:
        raise ConfigError(f"{key}: expected {expected}, got {_shown(got)}.{' ' + cure if cure else ''}")


def build(cls: type[T], table: Mapping[str, Any]) -> T:
    """A value of `cls` from a table of a file.

    Raises:
        ConfigError: an unknown or missing key, or a value that `cls` refuses.
    """
    known = {field.name: field for field in fields(cls)}  # type: ignore[arg-type]
    refuse_unknown(table, known, ConfigError)
    for name, field in known.items():
        if name not in table and field.default is MISSING and field.default_factory is MISSING:
            raise ConfigError(f"{name}: missing. Add it; the shipped files show what it looks like.")
    return cls(**table)


def load(cls: type[T], name: str | PathLike[str] | T, *, folder: str) -> T:
    """A value from a shipped file's name or from the path of a user's TOML file; a value stays itself.

    Raises:
        ConfigError: unknown name, unreadable file, broken TOML, or a value that is refused.
    """
    if isinstance(name, cls):
        return name
    kind = folder.removesuffix("s")
    require(isinstance(name, str | PathLike), kind, f"{_a(kind)}'s name, or its file's path", name)
    where, names = str(name), shipped(folder)
    tidy = _tidy(where)
    table = _shipped(folder, tidy) if tidy in names else _table(Path(where), kind, names)
    try:
        return build(cls, table)
    except ConfigError as error:
        raise ConfigError(f"{where}: {error}") from None


def _tidy(name: str) -> str:
    """A name as shipped files have it."""
    return name.strip().lower().replace("_", "-").replace(" ", "-")


def shipped_text(folder: str, name: str) -> str | None:
    """A shipped file as it is, with its comments; None if none has this name."""
    if _tidy(name) not in shipped(folder):
        return None
    return files("realitygap.world").joinpath(folder, f"{_tidy(name)}.toml").read_text("utf-8")


@cache
def _shipped(folder: str, name: str) -> dict[str, Any]:
    """A shipped file's table, which nobody changes."""
    return tomllib.loads(shipped_text(folder, name) or "")


@cache
def shipped(folder: str) -> tuple[str, ...]:
    """Names of the files that come with the package, "profiles" or "arenas"."""
    inside = files("realitygap.world").joinpath(folder).iterdir()
    return tuple(sorted(f.name.removesuffix(".toml") for f in inside if f.name.endswith(".toml")))


def _table(path: Path, kind: str, names: tuple[str, ...]) -> dict[str, Any]:
    if path.suffix != ".toml" and not path.exists() and len(path.parts) == 1:
        near = get_close_matches(path.name, names, n=1)
        hint = f" Did you mean {near[0]!r}?" if near else ""
        raise ConfigError(
            f"unknown {kind} {str(path)!r}.{hint} "
            f"Known: {', '.join(names)}; or give the path of a .toml file."
        )
    cure = f"Give the path of {_a(kind)}'s .toml file, or one of: {', '.join(names)}."
    return read_toml(path, ConfigError, cure)


def _convert(hint: Any, value: Any, key: str) -> Any:
    """`value` as the declared type `hint`, or ConfigError naming `key`."""
    if hint is float:
        if type(value) is float and abs(value) <= 1e300:  # as nearly always
            return value
        require(isinstance(value, Real) and not isinstance(value, bool), key, "a number", value)
        value = float(value) if isinstance(value, np.floating) else value  # a float32 has no 1e300
        require(abs(value) <= 1e300 and math.isfinite(value), key, "a finite number", value)
        return float(value)
    if hint is str:
        require(isinstance(value, str), key, "a text in quotes", value)
        return value
    if get_origin(hint) is tuple:
        return _convert_tuple(get_args(hint), value, key)
    if is_dataclass(hint) and not isinstance(value, hint):  # type: ignore[arg-type]
        require(isinstance(value, Mapping), key, "a table of keys and values", value)
        try:
            return build(hint, value)  # type: ignore[arg-type]
        except ConfigError as error:
            raise ConfigError(f"{key}.{error}") from None
    return value


def _convert_tuple(inner: tuple[Any, ...], value: Any, key: str) -> tuple[Any, ...]:
    require(isinstance(value, list | tuple), key, "a list in square brackets", value)
    if inner[-1] is Ellipsis:
        inner = inner[:1] * len(value)
    require(len(value) == len(inner), key, f"{len(inner)} values", value)
    pairs = enumerate(zip(inner, value, strict=True))
    return tuple(_convert(hint, v, f"{key}[{i}]") for i, (hint, v) in pairs)


def _a(noun: str) -> str:
    return f"an {noun}" if noun[0] in "aeiou" else f"a {noun}"


def _shown(value: object) -> str:
    text = repr(_listed(value))
    return text if len(text) <= 60 else text[:57] + "…"


def _listed(value: Any) -> Any:
    """The value with lists where it has tuples."""
    if isinstance(value, dict):
        return {key: _listed(v) for key, v in value.items()}
    return [_listed(v) for v in value] if isinstance(value, list | tuple) else value
