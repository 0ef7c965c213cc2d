"""What is in use: versions, the commit as far as it is known, and the processor."""

import json
import os
import platform
import re
import sqlite3
import subprocess
from functools import cache
from importlib.metadata import PackageNotFoundError, distribution, version
from pathlib import Path
from typing import Any

__all__ = ["UNKNOWN", "processor", "project_commit", "versions"]

UNKNOWN = "not known"
PACKAGE = Path(__file__).resolve().parent.parent
CPUINFO = Path("/proc/cpuinfo")


def versions() -> dict[str, str]:
    """Everything besides the configuration that a result's bits may depend on."""
    import numba
    import numpy

    return {
        "realitygap": version("realitygap"),
        "commit": project_commit(),
        "python": platform.python_version(),
        "numpy": numpy.__version__,
        "numba": numba.__version__,
        "mujoco": version("mujoco-core"),
        "opencv": version("opencv-python-headless"),
        "sqlite": sqlite3.sqlite_version,
        "platform": platform.platform(),
        "processor": processor(),
    }


def project_commit(package: Path = PACKAGE) -> str:
    """The commit that the package was made from, with " + changes" if files differ from it, or `UNKNOWN`.

    By the git checkout that contains the package, or pip's record of an installation (PEP 610).
    """
    if _git(package, "ls-files", "--error-unmatch", "__init__.py") is not None:
        commit, changed = (
            _git(package, "rev-parse", "HEAD"),
            _git(package, "status", "--porcelain", "--", "."),
        )
        return f"{commit} + changes" if commit and changed else commit or UNKNOWN
    try:
        record = json.loads(distribution("realitygap").read_text("direct_url.json") or "{}")
    except (PackageNotFoundError, OSError, ValueError):
        return UNKNOWN
    return str(record.get("vcs_info", {}).get("commit_id") or UNKNOWN)


def _git(folder: Path, *words: str) -> str | None:
    """Git's answer about a folder; None without git, or if it refuses."""
    own = {key: value for key, value in os.environ.items() if not key.startswith("GIT_")}
    try:
        command = ["git", "-C", str(folder), *words]
        said = subprocess.run(command, env=own, capture_output=True, text=True, timeout=20, check=True)
    except (OSError, subprocess.SubprocessError, UnicodeDecodeError):
        return None
    return said.stdout.strip()


@cache
def processor() -> str:
    """The model, and the instruction sets that NumPy uses, on which last bits may depend."""
    import numpy

    config: Any = numpy.show_config(mode="dicts")
    sets = ", ".join(config.get("SIMD Extensions", {}).get("found", []))
    try:
        found = re.search(r"^model name\s*:\s*(.+)$", CPUINFO.read_text("utf-8"), re.MULTILINE)
    except (OSError, ValueError):
        found = None
    model = found[1].strip() if found else platform.processor() or platform.machine()
    return f"{model} ({sets})" if sets else model
