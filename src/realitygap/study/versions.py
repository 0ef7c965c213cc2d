"""What is in use: versions, the commit as far as it can be known, and the processor."""

import filecmp
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
from urllib.parse import urlsplit
from urllib.request import url2pathname

__all__ = ["UNKNOWN", "processor", "project_commit", "versions"]

UNKNOWN = "not known"
PACKAGE = Path(__file__).resolve().parent.parent


def versions() -> dict[str, str]:
    """What the bits of a result may depend on besides the configuration."""
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
    """The commit that the package was made of; with " + changes" where files differ from it.

    Asked, in this order: the git checkout that the package lies in; what pip recorded when it installed
    from a repository (PEP 610); the checkout that pip installed from, if its package is the same to the
    byte. Else `UNKNOWN`.
    """
    if _git(package, "ls-files", "--error-unmatch", "__init__.py") is not None:
        return _state(package)
    record = _pip_record()
    recorded = record.get("vcs_info", {}).get("commit_id")
    if recorded:
        return str(recorded)
    source = Path(url2pathname(urlsplit(record.get("url", "")).path)) / "src" / package.name
    return _state(source) if "dir_info" in record and _same(package, source) else UNKNOWN


def _state(folder: Path) -> str:
    """Of the checkout that a package's folder lies in; what else is changed there does not matter."""
    commit, changed = _git(folder, "rev-parse", "HEAD"), _git(folder, "status", "--porcelain", "--", ".")
    if not commit or changed is None:
        return UNKNOWN
    return f"{commit} + changes" if changed else commit


def _git(folder: Path, *words: str) -> str | None:
    """What git says of a folder; None where there is no git, or it refuses."""
    own = {key: value for key, value in os.environ.items() if not key.startswith("GIT_")}
    try:
        command = ["git", "-C", str(folder), *words]
        said = subprocess.run(command, env=own, capture_output=True, text=True, timeout=20, check=True)
    except (OSError, subprocess.SubprocessError, UnicodeDecodeError):
        return None
    return said.stdout.strip()


def _pip_record() -> dict[str, Any]:
    """What pip wrote down about where the package came from."""
    try:
        found = json.loads(distribution("realitygap").read_text("direct_url.json") or "{}")
    except (PackageNotFoundError, OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def _same(package: Path, source: Path) -> bool:
    """Whether two folders hold the same files, but for what Python compiled."""
    names = [_files(package), _files(source)]
    if not names[0] or names[0] != names[1]:
        return False
    _, unlike, failed = filecmp.cmpfiles(package, source, names[0], shallow=False)
    return not unlike and not failed


def _files(folder: Path) -> list[str]:
    every = (path.relative_to(folder) for path in folder.rglob("*") if path.is_file())
    return sorted(str(path) for path in every if "__pycache__" not in path.parts)


CPUINFO = Path("/proc/cpuinfo")
DECISIVE = (
    "FMA3", "AVX2", "AVX512F", "AVX512_SKX", "AVX512_ICL", "AVX512_SPR", "ASIMD", "ASIMDFHM", "SVE",
)  # fmt: skip
"""Instruction sets for which NumPy and C libraries have code of their own, whose last bits may differ."""


@cache
def processor() -> str:
    """Its model, and its decisive instruction sets as NumPy uses them (NPY_DISABLE_CPU_FEATURES heeded)."""
    sets = ", ".join(name for name in DECISIVE if _features().get(name))
    return f"{_model()} ({sets})" if sets else _model()


def _model() -> str:
    """As its maker calls it, else the kind of machine."""
    try:
        if platform.system() == "Darwin":
            asked = ["/usr/sbin/sysctl", "-n", "machdep.cpu.brand_string"]
            return subprocess.run(asked, capture_output=True, text=True, check=True, timeout=5).stdout.strip()
        found = re.search(r"^model name\s*:\s*(.+)$", CPUINFO.read_text("utf-8"), re.MULTILINE)
    except (OSError, ValueError, subprocess.SubprocessError):
        found = None
    return found[1].strip() if found else platform.machine()


def _features() -> dict[str, bool]:
    """What NumPy found; nothing where it keeps that elsewhere than today."""
    try:
        from numpy._core._multiarray_umath import __cpu_features__  # type: ignore[import-not-found]
    except ImportError:
        return {}
    return dict(__cpu_features__)
