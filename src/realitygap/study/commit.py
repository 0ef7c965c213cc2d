"""Which commit of the project is at work, as far as anybody can know."""

import filecmp
import json
import os
import subprocess
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit
from urllib.request import url2pathname

__all__ = ["UNKNOWN", "project_commit"]

UNKNOWN = "not known"
PACKAGE = Path(__file__).resolve().parent.parent


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
