"""A process of its own: resume the study in a folder, or make it from FOLDER.toml.

child.py FOLDER [--workers N] [--limit BYTES]: `--limit` is the largest file it may write.
"""

from __future__ import annotations

import argparse
import resource
import signal
import sys
from pathlib import Path

from realitygap.errors import RealityGapError
from realitygap.study.config import StudyConfig
from realitygap.study.runner import Progress, run_study


def tell(event: Progress) -> None:
    print(event.phase, event.done, flush=True)


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--limit", type=int)
    given = parser.parse_args()
    if given.limit:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (given.limit, given.limit))
    config = StudyConfig.from_toml(given.folder.with_suffix(".toml"))
    try:
        run_study(given.folder, config, workers=given.workers, resume=True, on_progress=tell)
    except RealityGapError as error:
        print(f"{type(error).__name__}: {error}", file=sys.stderr)
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
