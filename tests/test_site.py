"""The documentation site."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

DOCS = Path(__file__).resolve().parents[1] / "docs"


def test_the_site_is_built_without_a_warning(tmp_path: Path) -> None:
    """Every notebook runs, every page is in the contents, every link within leads somewhere."""
    words = ["-j", "2", "-W", "--keep-going", "-n", "-q", "-d", tmp_path / "read", DOCS, tmp_path / "site"]
    built = subprocess.run([sys.executable, "-m", "sphinx", *words], stderr=subprocess.PIPE, check=False)
    assert built.returncode == 0, built.stderr.decode()
    assert (tmp_path / "site" / "index.html").is_file()
