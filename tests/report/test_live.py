"""The page of a study that is being evolved: it shows what is so far, and changes nothing."""

from __future__ import annotations

import re

import pytest
from click.testing import CliRunner

from realitygap.cli import realitygap
from realitygap.report import live
from realitygap.report.live import LivePage
from realitygap.study.load import load_study
from realitygap.study.runner import run_study
from realitygap.study.store import DATABASE
from realitygap.work.progress import Progress
from tests.study.helpers import small

WORDS = ("avoidance", "--evaluations", "6", "--workers", "1", "--set", "task.seconds=1", "--set",
         "retest_trials=2", "--set", "fresh_trials=2", "--set", "evolution.algorithm=random", "--set",
         "evolution.size=3", "--set", "checkpoint_every=2")  # fmt: skip


def evolve(*words: str) -> str:
    result = CliRunner().invoke(realitygap, ["evolve", *WORDS, *words])
    assert result.exit_code == 0, result.output
    return result.output


@pytest.mark.usefixtures("undrawn")
def test_watching_changes_no_bit(tmp_path, monkeypatch):
    """Genotypes, scores and tests are the same; the last page fetches nothing, and looks for no more."""
    monkeypatch.setattr(live, "EVERY_S", 0.0)
    told = evolve("--out", str(tmp_path / "seen"), "--watch")
    evolve("--out", str(tmp_path / "unseen"))
    assert f"watch {(tmp_path / 'seen' / 'watch.html').as_uri()}" in told
    seen, unseen = load_study(tmp_path / "seen"), load_study(tmp_path / "unseen")
    assert (seen.genotypes(1) == unseen.genotypes(1)).all() and seen.runs[0].champion is not None
    for key, column in seen.evaluations(1).items():
        assert (column == unseen.evaluations(1)[key]).all(), key
    assert not (tmp_path / "unseen" / "watch.html").exists()
    page = (tmp_path / "seen" / "watch.html").read_text("utf-8")
    assert "<dd>finished</dd>" in page and '<a href="report/index.html">' in page
    assert 'http-equiv="refresh"' not in page
    assert "src=" not in page and "http:" not in page and "https:" not in page
    assert "over 6 evaluations" in page and re.search(r"<dt>best during evolution</dt><dd>[0-9.]+ ", page)
    axis = re.findall(r'<text [^>]*text-anchor="end"[^>]*>([^<]+)</text>', page)
    assert axis[0] == "0" and len(axis) >= 6


def test_the_page_grows(tmp_path, monkeypatch):
    """While a run goes on it has a curve as far as it is, the best robot's path, and reads itself anew."""
    monkeypatch.setattr(live, "EVERY_S", 0.0)
    monkeypatch.setattr(live, "SHARE", 1e9)
    lengths, heard = [], []
    with LivePage(tmp_path / "study", heard.append) as seen:

        def on_progress(event: Progress) -> None:
            seen.show(event)
            page = seen.page.read_text("utf-8")
            assert 'http-equiv="refresh"' in page and event.phase in page
            curves = re.findall(r'<polyline class="curve" points="([^"]*)"', page)
            lengths.append(sum(len(curve.split()) for curve in curves))
            assert ("animateTransform" in page) == (lengths[-1] > 0)

        run_study(tmp_path / "study", small(), workers=1, on_progress=on_progress)
    assert lengths[0] == 0 and lengths[-1] > 0 and lengths == sorted(lengths) and len(heard) == len(lengths)


def test_a_stopped_study_says_so(tmp_path, monkeypatch):
    """After Ctrl-C the page is the last one, and does not look for more."""
    monkeypatch.setattr(live, "EVERY_S", 0.0)

    def stop(event: Progress) -> None:
        if event.done:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), LivePage(tmp_path / "study", stop) as seen:
        run_study(tmp_path / "study", small(), workers=1, on_progress=seen.show)
    page = seen.page.read_text("utf-8")
    assert "<dd>stopped</dd>" in page and 'http-equiv="refresh"' not in page
    assert (tmp_path / "study" / DATABASE).exists()
