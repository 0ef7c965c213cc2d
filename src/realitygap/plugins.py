"""A user's own Python files: loaded, named, and blamed for their errors."""

import hashlib
import importlib.util
import os
import pickle
import sys
import traceback
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from types import ModuleType
from typing import Any

from realitygap.errors import RealityGapError, UsageError

__all__ = ["blamed_on", "made", "named_object", "packed", "place_of", "placed", "run_file", "unpacked"]


def place_of(text: str) -> tuple[Path, str] | None:
    """The file and the name of `file.py:Name`; None for a text of another form."""
    file, _, name = str(text).rpartition(":")
    return (Path(file).expanduser(), name) if file.endswith(".py") else None


def placed(text: str, file: Path | str) -> str:
    """The same name in another file."""
    return f"{file}:{text.rpartition(':')[2]}"


def made(text: str, what: str, ways: Iterable[str], settings: Mapping[str, Any], **given: Any) -> Any:
    """What a user's class, `file.py:Name`, makes of the user's settings and of what it is given: `what`, such
    as "algorithm", which must have these attributes, `ways`.

    Raises:
        UsageError: no such class, a setting that it does not have, or a value that it refuses.
    """
    kind: Any = named_object(text, UsageError, what)
    file, _, name = text.rpartition(":")
    with blamed_on(Path(file).expanduser().resolve(), UsageError, f"{name}() fails"):
        thing = kind(**given, **settings)
        lacking = [way for way in ways if not hasattr(thing, way)]
    if lacking:
        raise UsageError(f"{text}: {what}: got {thing!r}, which has no {', '.join(lacking)}.")
    return thing


def named_object(text: str, error: type[UsageError], what: str) -> object:
    """What `file.py:Name` or `module:Name` names; the file is run, the module imported.

    `what` it is to be, such as "robot", stands in the message.

    Raises:
        UsageError: of the class `error`: no such file, module or name, or one that fails.
    """
    place, _, name = text.rpartition(":")
    if not place or not name.isidentifier():
        raise error(f"{what}: expected file.py:Name or module:Name, got {text!r}.")
    if place.endswith(".py"):
        path = Path(place).expanduser()
        if not path.is_file():
            raise error(f"{what}: {place}: no such file. Give the path of a .py file, as in file.py:Name.")
        module = run_file(path.resolve(), error)
    else:
        if importlib.util.find_spec(place.partition(".")[0]) is None:
            raise error(f"{what}: no module {place!r} is installed. A file of your own: {place}.py:{name}.")
        with blamed_on(place, error, "importing it fails"):
            module = importlib.import_module(place)
    found = getattr(module, name, None)
    if found is None:
        own = [key for key, one in vars(module).items() if getattr(one, "__module__", "") == module.__name__]
        has = f"It has {', '.join(own)}." if own else "Nothing is defined in it."
        raise error(f"{what}: {place}: expected {name!r} in it. {has}")
    return found


_files: dict[str, tuple[Path, bytes]] = {}
"""Of each module that a user's file became: the file, and its content then."""


def run_file(path: Path, error: type[UsageError], *, anew: bool = False) -> ModuleType:
    """A file as a module, under a name made from its path: Numba finds compiled functions by it.

    It is run once, and again when it was edited, so that what it defines stays the same object and can be
    sent to other processes; with `anew` always, for what it may read from other files.

    Raises:
        UsageError: of the class `error`: the file fails; names the line.
    """
    name = f"realitygap_task_{hashlib.sha256(os.fsencode(path)).hexdigest()[:16]}"
    with blamed_on(path, error), redirect_stdout(sys.stderr):  # or what it prints stands before the JSON
        content, before = path.read_bytes(), sys.modules.get(name)
        unchanged = before is not None and _files.get(name) == (path, content)
        if before is not None and unchanged and not anew:
            return before
        spec = importlib.util.spec_from_file_location(name, path)
        assert spec is not None
        sys.modules[name] = module = importlib.util.module_from_spec(spec)
        try:
            exec(compile(content, str(path), "exec", dont_inherit=True), module.__dict__)
            _files[name] = path, content
        except BaseException:
            del sys.modules[name]
            raise
        if before is not None and unchanged:
            sys.modules[name] = before
    return module


def packed(what: object) -> tuple[list[str], bytes]:
    """What is sent to another process, pickled, and the user's files that define something of it."""
    data = pickle.dumps(what)
    return [str(path) for name, (path, _) in _files.items() if name.encode() in data], data


def unpacked(files: Iterable[str], data: bytes) -> Any:
    """What `packed` packed, once the files are run here too.

    Raises:
        UsageError: a file fails.
    """
    for file in files:
        run_file(Path(file), UsageError)
    return pickle.loads(data)


@contextmanager
def blamed_on(
    place: str | Path, error: type[UsageError], does: str = "the file fails", *, own: bool = False
) -> Iterator[None]:
    """Any error of a user's code as one that names the file (or module) and the line; a robot's own errors
    pass, and with `own` those that no line of the file led to.

    Raises:
        UsageError: of the class `error`.
    """
    try:
        yield
    except (KeyboardInterrupt, GeneratorExit):
        raise
    except BaseException as why:
        passes = isinstance(why, RealityGapError) and not isinstance(why, UsageError)
        if passes or (own and _line(place, why) == str(place)):
            raise
        raise error(_told(place, does, why)) from None


def _told(place: str | Path, does: str, why: BaseException) -> str:
    if isinstance(why, SyntaxError):
        return f"{why.filename or place}, line {why.lineno}: not valid Python: {why.msg}. Correct that line."
    where = _line(place, why)
    if isinstance(why, UsageError):
        return f"{where}: {why}"
    if isinstance(why, OSError) and why.filename is not None:
        return f"{where}: {why.strerror or why}. Check the path."
    what = f"{where}: {does} with {f'{type(why).__name__}: {why}'.rstrip(': ')}."
    if isinstance(why, OSError):  # a line or a device, as often as not
        return what
    folder = Path(place).absolute().parent
    if isinstance(why, ModuleNotFoundError) and (folder / f"{why.name}.py").is_file():
        return f"{what} It lies in {folder}: set PYTHONPATH={folder}."
    return f"{what} Correct that line."


def _line(place: str | Path, error: BaseException) -> str:
    """The file, and the last of its lines that was running."""
    lines = [f.lineno for f in traceback.extract_tb(error.__traceback__) if f.filename == str(place)]
    return f"{place}, line {lines[-1]}" if lines else str(place)
