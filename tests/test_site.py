"""The documentation site."""

from __future__ import annotations

import importlib.util
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from realitygap import Genotype, Simulation
from tests.browser import Browser

ROOT = Path(__file__).resolve().parents[1]
STUDY = ("evaluations=400", "evaluations=110, retest_trials=2")
SHORTER = {
    "first_study": (STUDY, ("fresh_trials=100", "fresh_trials=10")),
    "measure_or_randomise": (
        ("_ in range(6)", "_ in range(2)"), ("generations=30", "generations=2"), ("trials=200", "trials=20")
    ),
    "own_optimiser": (("problem, 40,", "problem, 4,"), ("trials=200", "trials=20")),
    "own_robot": (STUDY, ("fresh_trials=50", "fresh_trials=5")),
    "own_task": (STUDY, ("fresh_trials=50", "fresh_trials=5")),
}  # fmt: skip
"""In each notebook, what makes it long."""
PLAINER = (
    "drive_evaluations=64",
    "smartquotes=0",
    "autodoc_preserve_defaults=0",
    "python_use_unqualified_type_names=0",
)
"""Without what takes long and decides only how a text looks."""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, built without a warning from smaller studies."""
    tmp_path = tmp_path_factory.mktemp("site")
    for beside in ROOT.iterdir():
        if beside.is_file():
            shutil.copy(beside, tmp_path)  # links in README.md lead to what lies beside it
        elif beside.name != "docs":
            (tmp_path / beside.name).symlink_to(beside)
    docs = Path(shutil.copytree(ROOT / "docs", tmp_path / "docs"))
    for name, changes in SHORTER.items():
        notebook = docs / "tutorial" / f"{name}.py"
        text = notebook.read_text("utf-8")
        for long, short in changes:
            assert text.count(long) == 1, long
            text = text.replace(long, short)
        notebook.write_text(text, "utf-8")
    words = ["-W", "--keep-going", "-n", "-q", "-d", tmp_path / "read", docs]
    plainer = [word for setting in PLAINER for word in ("-D", setting)]
    built = subprocess.run(
        [sys.executable, "-m", "sphinx", *plainer, *words, tmp_path / "site"],
        stderr=subprocess.PIPE,
        check=False,
    )
    assert built.returncode == 0, built.stderr.decode()
    return tmp_path / "site"


def test_the_site_is_built_without_a_warning(site: Path) -> None:
    """Every notebook runs, every page is in the contents, every link within leads somewhere."""
    front = (site / "index.html").read_text("utf-8")
    assert front.count('<div class="picture"><svg') == 7  # three tasks, four robots
    for link in re.findall(r'(?:href|src|srcset)="([^":#?]+)["#?]', front):
        assert (site / link).exists(), link
    for name in ("drive-it", "evolve-by-hand"):  # each in one file, that fetches nothing
        page = (site / f"{name}.html").read_bytes()
        assert len(page) < 150_000 and b"default-src 'none'" in page


def test_notebooks_and_guides_can_be_taken_away(site: Path) -> None:
    """Each notebook with its output; `llms.txt` names every guide's text."""
    for name in SHORTER:
        assert f'href="{name}.ipynb"' in (site / "tutorial" / f"{name}.html").read_text("utf-8")
        assert '"output_type"' in (site / "tutorial" / f"{name}.ipynb").read_text("utf-8")
    named = re.findall(r"^- \[.+?\]\((.+?)\)", (site / "llms.txt").read_text("utf-8"), re.M)
    assert all((site / file).is_file() for file in named)
    guides = {f"_sources/{page.name}.txt" for page in (ROOT / "docs").glob("how-to-*.md")}
    assert guides and guides <= set(named)


def test_a_search_finds_guides_first_and_no_code_is_cut(site: Path, browser: Browser) -> None:
    """What a task's author looks for leads to how it is written, on a page with all of its code in sight."""
    browser.show(site / "search.html", at="?q=fitness+function")
    browser.until("document.querySelectorAll('#search-results li').length > 5")
    links = "[...document.querySelectorAll('#search-results li a')].map(link => link.textContent)"
    hits = browser.run(links)
    assert "How to add your own parts" in hits[0] and any("fitness function" in hit for hit in hits[:2])
    for wide in (390, 1280):
        browser.show(site / "how-to-own-parts.html", wide=wide)
        assert browser.run("document.querySelectorAll('pre').length") > 5
        cut = "[...document.querySelectorAll('pre')].every(one => one.scrollWidth <= one.clientWidth)"
        assert browser.run(f"{cut} && document.documentElement.scrollWidth <= innerWidth")
    browser.problems = []  # from disk, a search gets no excerpts


def test_twelve_numbers_by_hand(tmp_path: Path, browser: Browser) -> None:
    """Without any the robot stands; the evolved ones score as they did; a slider changes only one's own."""
    found = importlib.util.spec_from_file_location("live", ROOT / "docs" / "live.py")
    assert found is not None and found.loader is not None
    live = importlib.util.module_from_spec(found)
    found.loader.exec_module(live)
    live.write_by_hand(tmp_path / "page.html", 400)
    browser.show(tmp_path / "page.html", prefers_reduced_motion="reduce")
    scores = "['yours', 'evolved'].map((one) => document.getElementById(`fitness-${one}`).textContent)"
    browser.until(f"{scores}.every((one) => one !== '')")
    yours, evolved = browser.run(scores)
    simulation = Simulation("obstacle-avoidance", ROOT / "examples" / "five_eyes.toml")
    networks = Genotype.decode(live._genes(live._evolved(simulation, 400)[np.newaxis]), 5)
    scores_there = simulation.scores(networks, np.arange(1001, 1021, dtype=np.uint64)[np.newaxis])
    assert float(yours) == 0 and evolved == f"{scores_there.mean():.3f}"
    browser.run("document.getElementById('by-hand-copy').click()")
    assert browser.run(scores) == [evolved, evolved]
    browser.run(
        "(() => { const slider = document.querySelector('#by-hand input'); slider.value = 10;"
        " slider.dispatchEvent(new Event('input')); })()"
    )
    changed, same = browser.run(scores)
    assert changed != evolved and same == evolved
    problems, browser.problems = browser.problems, []
    assert problems == []
