"""The judges' page in a real browser: keys, marks that stay, nothing wrong in the console.

Skipped where there is no Chromium (in the PATH, or named by CHROMIUM).
"""

from pathlib import Path

from studies.correspondence.kinds import Behaviour
from studies.correspondence.ladders import setting_for

from realitygap.correspondence.judging import Pair, blind_pairs
from realitygap.report.player import judge_page
from tests.browser import Browser

ROBOT = Behaviour(task="obstacle-avoidance", kind="two way turner", seed=1)
TITLE, DONE, FRAME = '$("title").textContent', '$("done").textContent', 'Number($("time").value)'
MARK = 'document.querySelector("#marks :checked")?.value ?? null'
INK = 'new Set($("left").getContext("2d").getImageData(0, 0, 200, 200).data).size'
WIDE = "document.documentElement.scrollWidth > innerWidth"


def test_a_judge_needs_no_mouse_and_loses_no_mark(browser: Browser, tmp_path: Path) -> None:
    """Films run, keys mark and turn pages, marks are there again in a new visit, a phone shows all."""
    trials = ROBOT.trials(2)
    data, _ = blind_pairs([Pair(name=n, a=trials, b=trials, score=1) for n in "ab"], setting_for(ROBOT.task))
    path = tmp_path / "judge.html"
    path.write_text(judge_page(data, setting_for(ROBOT.task).arena, trials[0].radius_cm))

    browser.show(path)
    assert browser.run(TITLE) == "Pair 1 of 2" and browser.run(MARK) is None
    browser.until(f"{FRAME} > 0 && {INK} > 3")
    browser.press("7", "Digit7", 55, "7")
    assert browser.run(MARK) == "7" and browser.run(DONE) == "1 of 2 marked"
    browser.press("n", "KeyN", 78, "n")
    assert browser.run(TITLE) == "Pair 2 of 2" and browser.run(MARK) is None
    browser.press("t", "KeyT", 84, "t")
    browser.run('$("judge").focus()')
    browser.press("9", "Digit9", 57, "9")
    assert browser.run(MARK) == "10"  # a figure typed into the name marks nothing
    browser.run('$("judge").value = ""; $("judge").blur()')
    browser.press(" ", "Space", 32, " ")
    assert browser.run('$("play").textContent') == "Play"
    browser.press("p", "KeyP", 80, "p")
    assert browser.run(MARK) == "7"
    browser.run('$("save").click()')
    assert "name" in browser.run(DONE)

    for _ in range(20):  # Chromium may not have written yet what the last visit kept
        browser.show(path, wide=500)
        if browser.run(MARK):
            break
    assert browser.run(MARK) == "7" and browser.run(DONE) == "2 of 2 marked"
    assert not browser.run(WIDE)
    problems, browser.problems = browser.problems, []
    assert problems == []
