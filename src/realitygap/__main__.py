"""`python -m realitygap`, and the `realitygap` script."""

import atexit
import gc
import os
import signal
import sys
import threading
import time
from typing import Any

__all__ = ["main"]

AGAIN_S = 0.02


def main() -> None:
    """Run a command; Ctrl-C ends in one line even while the commands are being loaded."""
    _open_closed()
    sys.unraisablehook = _unraisable
    atexit.register(gc.freeze)  # else all that was loaded is searched for garbage, up to a third of a second
    try:
        from realitygap.cli import main as run
    except KeyboardInterrupt:
        sys.stderr.write("stopped\n")
        sys.exit(130)
    run()


def _open_closed() -> None:
    """Where a stream was closed (`>&-`), what goes there goes nowhere, and not into the next file opened."""
    for name in ("stdin", "stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(os.open(os.devnull, os.O_RDWR), "r" if name == "stdin" else "w"))


def _unraisable(what: Any) -> None:
    """Press Ctrl-C once more where the first fell into a callback of compiled code, which drops it.

    Ctrl-C between processes leaves buffers lent out, which Python reports from 3.13 on: of no use to anybody.
    """
    if issubclass(what.exc_type, KeyboardInterrupt):
        left = threading.Event()
        threading.Thread(target=_press, args=(left,), daemon=True).start()
        left.set()
    elif not issubclass(what.exc_type, BufferError):
        sys.__unraisablehook__(what)


def _press(left: threading.Event) -> None:
    """Press Ctrl-C once the hook was left, for it would drop that as well."""
    left.wait()
    time.sleep(AGAIN_S)
    os.kill(os.getpid(), signal.SIGINT)


if __name__ == "__main__":
    main()
