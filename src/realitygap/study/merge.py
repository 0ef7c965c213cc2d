"""Merges a study's shards, which were carried out separately: the same bits as in one piece."""

import shlex
import shutil
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from pathlib import Path

from realitygap.errors import StudyError
from realitygap.files import move_whole
from realitygap.study.digest import OF_RUN, seal, verify_all
from realitygap.study.folder import refuse_other
from realitygap.study.load import Study, load_study
from realitygap.study.lock import LOCK, lock
from realitygap.study.reader import DATABASE, Reader, open_to_read
from realitygap.study.schema import told
from realitygap.work.shard import MARK, Mark, Shard, read_mark

__all__ = ["all_shards", "merge_runs", "new_folder"]


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


@contextmanager
def new_folder(out: Path, then: str) -> Iterator[Path]:
    """A folder to fill, which becomes `out` when it is complete; one left by a kill is started again.

    `then` is the command for what comes after that, if only that is left.

    Raises:
        StudyError: `out` exists already.
        StudyBusyError: another process is filling it.
    """
    if not out.name.strip(".") or (out.exists() and (not out.is_dir() or any(out.iterdir()))):
        left = f"If it is this study, without its report, `{then}` makes that; else choose another --out."
        raise StudyError(f"{out} exists already, and is not overwritten. {left}")
    half = out.with_name(f".{out.name}.half")
    with lock(half), told(out):
        _empty(half)
        try:
            yield half
            if out.exists():
                out.rmdir()
            move_whole(half, out)
        except BaseException:
            _empty(half)
            raise


def _empty(half: Path) -> None:
    for path in half.iterdir() if half.exists() else ():
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        elif path.name != LOCK:
            path.unlink(missing_ok=True)


def merge_runs(shards: Mapping[Shard, Path], out: Path) -> Study:
    """The study of all shards' runs, in a new folder, complete or not at all.

    Raises:
        StudyError: shards of different studies, a damaged or unfinished one, or `out` exists.
    """
    first = next(iter(shards.values()))
    for folder in shards.values():
        refuse_other(first, folder)
    sources = Reader(first / DATABASE).sources()
    with new_folder(out, f"realitygap report {shlex.quote(str(out))}") as half:
        for name, content in sources.items():
            (half / name).parent.mkdir(parents=True, exist_ok=True)
            (half / name).write_bytes(content)
        with closing(sqlite3.connect(half / DATABASE, isolation_level=None)) as database:
            for shard, folder in shards.items():
                with told(folder), closing(open_to_read(folder / DATABASE)) as source:
                    verify_all(source, folder / DATABASE)
                    runs = _finished(source, folder, shard)
                    with told(out):
                        if folder is first:
                            source.backup(database)
                            database.execute("PRAGMA journal_mode = DELETE")
                        else:
                            _take(database, source, runs)
    return load_study(out)


def _finished(source: sqlite3.Connection, folder: Path, shard: Shard) -> list[int]:
    """Ids of a shard's runs.

    Raises:
        StudyError: one is not finished, although the shard is marked as finished.
    """
    own = shard.own(source.execute("SELECT id, finished FROM run ORDER BY id"))
    left = [run for run, finished in own if not finished]
    if left:
        raise StudyError(
            f"{folder}: run {left[0]} of shard {shard} is not finished, though the shard is marked so: it "
            "was copied while it was worked on. Copy it once more, or finish the copy (--resume)."
        )
    return [run for run, _ in own]


def _take(database: sqlite3.Connection, source: sqlite3.Connection, runs: Sequence[int]) -> None:
    """Copy all rows of a shard's runs."""
    database.execute("BEGIN")
    for part, key in (
        *((part, "run") for part in OF_RUN if part != "run"),
        ("digest", "run"),
        ("run", "id"),
    ):
        for run in runs:
            database.execute(f"DELETE FROM {part} WHERE {key} = ?", (run,))
            rows = source.execute(f"SELECT * FROM {part} WHERE {key} = ?", (run,))
            insert = f"INSERT INTO {part} VALUES ({', '.join('?' * len(rows.description))})"
            database.executemany(insert, rows)
    rows = source.execute("SELECT began, pid, versions FROM session ORDER BY id")
    database.executemany("INSERT INTO session (began, pid, versions) VALUES (?, ?, ?)", rows)
    seal(database, 0, "session")
    database.execute("COMMIT")
