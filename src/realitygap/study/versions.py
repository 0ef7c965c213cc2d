"""What is in use: versions, the commit as far as it is known, and the processor."""

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
    """The commit that the package was made from, with " + changes" if files differ from it.

    Sources, in this order: the git checkout that contains the package; pip's record of an installation from a
        repository (PEP 610); the checkout that pip installed from, if its package has the same bytes.
        Otherwise `UNKNOWN`.
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
    """The commit of the checkout that contains a package's folder; changes elsewhere in it do not matter."""
    commit, changed = _git(folder, "rev-parse", "HEAD"), _git(folder, "status", "--porcelain", "--", ".")
    if not commit or changed is None:
        return UNKNOWN
    return f"{commit} + changes" if changed else commit


def _git(folder: Path, *words: str) -> str | None:
    """Git's answer about a folder; None without git, or if it refuses."""
    own = {key: value for key, value in os.environ.items() if not key.startswith("GIT_")}
    try:
        command = ["git", "-C", str(folder), *words]
        said = subprocess.run(command, env=own, capture_output=True, text=True, timeout=20, check=True)
    except (OSError, subprocess.SubprocessError, UnicodeDecodeError):
        return None
    return said.stdout.strip()


def _pip_record() -> dict[str, Any]:
    """Pip's record of where the package came from."""
    try:
        found = json.loads(distribution("realitygap").read_text("direct_url.json") or "{}")
    except (PackageNotFoundError, OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def _same(package: Path, source: Path) -> bool:
    """Whether two folders hold the same files, apart from compiled Python."""
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
    "FMA3", "AVX2", "X86_V3", "X86_V4", "AVX512F", "AVX512_SKX", "AVX512_ICL", "AVX512_SPR",
    "ASIMD", "ASIMDFHM", "SVE",
)  # fmt: skip
"""Instruction sets for which NumPy and C libraries have separate code, whose last bits may differ."""


@cache
def processor() -> str:
    """The model, and its relevant instruction sets as NumPy uses them (respects NPY_DISABLE_CPU_FEATURES)."""
    sets = ", ".join(name for name in DECISIVE if _features().get(name))
    return f"{_model()} ({sets})" if sets else _model()


def _model() -> str:
    """The manufacturer's name of the processor, or the kind of machine."""
    try:
        if platform.system() == "Darwin":
            asked = ["/usr/sbin/sysctl", "-n", "machdep.cpu.brand_string"]
            return subprocess.run(asked, capture_output=True, text=True, check=True, timeout=5).stdout.strip()
        found = re.search(r"^model name\s*:\s*(.+)$", CPUINFO.read_text("utf-8"), re.MULTILINE)
    except (OSError, ValueError, subprocess.SubprocessError):
        found = None
    return found[1].strip() if found else platform.machine()


def _features() -> dict[str, bool]:
    """Instruction sets that NumPy found; empty if NumPy does not expose them as today."""
    try:
        from numpy._core._multiarray_umath import __cpu_features__  # type: ignore[import-not-found]
    except ImportError:
        return {}
    return dict(__cpu_features__)
