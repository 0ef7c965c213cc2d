"""Iterators that go on side by side, each in a thread of its own."""

from collections.abc import Generator, Iterator, Sequence
from contextlib import suppress
from queue import Empty, Full, Queue
from threading import Event, Thread
from typing import Any, TypeVar

__all__ = ["merged"]

T = TypeVar("T")

MOST = 128
"""Items that wait to be taken; then the threads wait."""
PATIENCE_S = 0.05


def merged(sources: Sequence[Iterator[Sequence[T]]]) -> Generator[list[T], None, None]:
    """All that the sources yield, in lists as it comes; in order, of each source.

    A source's error ends this generator. When it ends or is closed, each source is left at its next list,
    which may be an empty one; no thread outlives it.
    """
    came: Queue[Any] = Queue(MOST)
    stop = Event()

    def put(what: object) -> None:
        while not stop.is_set():
            with suppress(Full):
                came.put(what, timeout=PATIENCE_S)
                return

    def drive(source: Iterator[Sequence[T]]) -> None:
        try:
            for items in source:
                for item in items:
                    put((item, None))
                if stop.is_set():
                    return
            put(None)
        except BaseException as error:
            put((None, error))

    threads = [Thread(target=drive, args=(source,), daemon=True) for source in sources]
    try:
        for thread in threads:
            thread.start()
        left = len(threads)
        while left:
            found = []
            with suppress(Empty):
                found.append(came.get(timeout=PATIENCE_S))  # no longer: Ctrl-C waits for it on Windows
                while len(found) < MOST:
                    found.append(came.get_nowait())
            left -= found.count(None)
            told = [one for one in found if one is not None]
            error = next((error for _, error in told if error is not None), None)
            if items := [item for item, failed in told if failed is None]:
                yield items
            if error is not None:
                raise error
    finally:
        stop.set()
        for thread in threads:
            if thread.ident is not None:
                thread.join()
