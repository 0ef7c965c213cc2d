"""The documentation site."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SHORTER = (("generations=30", "generations=2"), ("trials=200", "trials=20"))
"""In the notebook that takes most of the time, what makes it long."""


def test_the_site_is_built_without_a_warning(tmp_path: Path) -> None:
    """Every notebook runs, every page is in the contents, every link within leads somewhere."""
    for beside in ROOT.iterdir():
        if beside.name != "docs":
            (tmp_path / beside.name).symlink_to(beside)
    docs = Path(shutil.copytree(ROOT / "docs", tmp_path / "docs"))
    notebook = docs / "tutorial" / "measure_or_randomise.py"
    text = notebook.read_text("utf-8")
    for long, short in SHORTER:
        assert len(re.findall(rf"\b{long}\b", text)) == 1
        text = text.replace(long, short)
    notebook.write_text(text, "utf-8")
    words = ["-W", "--keep-going", "-n", "-q", "-D", "smartquotes=0", "-d", tmp_path / "read", docs]
    built = subprocess.run(
        [sys.executable, "-m", "sphinx", *words, tmp_path / "site"], stderr=subprocess.PIPE, check=False
    )
    assert built.returncode == 0, built.stderr.decode()
    assert (tmp_path / "site" / "index.html").is_file()
