"""The page in a real browser: it plays, obeys keys, sorts its tables and follows light and dark.

Skipped where there is no Chromium (in the PATH, or named by CHROMIUM).
"""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from realitygap.study.load import Study
from tests.browser import Browser

PICTURE = "document.getElementById('player-arena-0').toDataURL()"
STEP = "Number(document.getElementById('player-scrub').value)"
PLAYING = "document.getElementById('player-play').classList.contains('on')"
FOCUS = "document.getElementById('player-deck').focus({preventScroll: true})"
HOLD = "void (window.requestAnimationFrame = (next) => { window.next = next; return 0; })"
"""From here on the page's time stands still, but for the frames that a test gives it."""


def text(name: str) -> str:
    """The script for an element's words."""
    return f"document.getElementById('player-{name}').textContent"


@pytest.fixture
def page(browser: Browser, played: Study) -> Iterator[Browser]:
    """The page, open; afterwards nothing was complained of and nothing fetched."""
    browser.show(played.folder / "report" / "index.html", prefers_color_scheme="light")
    yield browser
    problems, browser.problems = browser.problems, []
    assert problems == []


def choose(page: Browser, name: str, index: int) -> None:
    """Choose from one of the player's lists."""
    page.run(
        f"(() => {{ const list = document.getElementById('player-{name}'); list.selectedIndex = {index};"
        " list.dispatchEvent(new Event('change')); })()"
    )


def test_the_player_plays_to_the_end_and_stops(page: Browser) -> None:
    """In the browser's own time."""
    page.run("document.getElementById('player-play').click()")
    page.until(f"{STEP} === 20 && !{PLAYING}")
    assert page.run(text("time")) == "2.0 of 2.0 s"


def test_keys_play_step_and_jump(page: Browser) -> None:
    """Space, arrows, Home, End and digits; a step changes both robots' pictures and what is inside them."""
    page.run(FOCUS)
    page.press("Home", number=36)
    assert page.run(STEP) == 0
    first = page.run(PICTURE)
    page.press("ArrowRight", number=39)
    assert page.run(STEP) == 1 and page.run(PICTURE) != first
    page.press("5", "Digit5", 53, "5")
    assert page.run(STEP) == 10 and page.run(text("said")).startswith("1.0 of 2.0 s: simulated robot at ")
    page.press("ArrowLeft", number=37)
    assert page.run(STEP) == 9
    page.press("End", number=35)
    assert page.run(STEP) == 20
    page.run(HOLD)
    page.press(" ", "Space", 32, " ")
    assert page.run(PLAYING) and page.run(STEP) == 0
    page.press(" ", "Space", 32, " ")
    assert not page.run(PLAYING)
    assert page.run("window.scrollY") == 0


def test_a_link_leads_to_one_run_trial_and_moment(page: Browser, played: Study) -> None:
    """The address follows what a person chooses; opened, or pasted into the page, it shows the same."""
    assert page.run("location.hash") == ""
    choose(page, "run", 0)
    choose(page, "trial", 1)
    page.run(FOCUS)
    page.press("5", "Digit5", 53, "5")
    wanted = "#run=obstacle-avoidance/zero/1&trial=twin-1/start-2&at=1.0"
    page.until(f"location.hash === '{wanted}'")
    assert page.run("document.getElementById('player-link').hash") == wanted
    picture = page.run(PICTURE)
    choose(page, "task", 1)
    page.until("location.hash.includes('light-seeking')")
    assert page.run(PICTURE) != picture
    page.run(f"location.hash = '{wanted}'")
    page.until(f"{PICTURE} === '{picture}'")
    page.show(played.folder / "report" / "index.html", at="")
    assert page.run(STEP) == 20
    page.show(played.folder / "report" / "index.html", at=wanted)
    assert page.run(PICTURE) == picture and page.run(STEP) == 10
    lists = "[...document.querySelectorAll('.choose select')].map(list => list.value)"
    chosen = page.run(lists)
    assert chosen == ["Obstacle avoidance", "zero noise", "#1", "twin unit 1, start 2"]
    assert page.run("document.getElementById('player-lost').hidden")
    page.run("location.hash = '#run=obstacle-avoidance/zero/9'")
    page.until("!document.getElementById('player-lost').hidden")
    assert page.run(lists) == chosen


def test_a_table_sorts_by_a_heading(page: Browser) -> None:
    """Up, down, and as it was; the average stays last, and the heading tells its order."""
    table = "document.querySelector('table[aria-labelledby=\"obstacle-avoidance-table\"]')"
    heading = f"{table}.querySelectorAll('th[aria-sort]')[0]"
    script = f"[...{table}.tBodies[0].rows].map(row => row.cells[0].textContent.trim())"
    start = page.run(script)
    assert start[1:] == ["1", "2", "average"]
    orders = []
    for _ in range(3):
        page.run(f"{heading}.querySelector('button').focus()")
        page.press("Enter", number=13, text="\r")
        orders.append((page.run(f"{heading}.getAttribute('aria-sort')"), page.run(script)))
    assert [state for state, _ in orders] == ["ascending", "descending", "none"]
    assert orders[0][1] == orders[2][1] == start
    assert orders[1][1] == [start[0], "2", "1", "average"]


def test_light_and_dark(page: Browser, played: Study) -> None:
    """As the system says, until a person says otherwise; the pictures follow."""
    background = "getComputedStyle(document.body).backgroundColor"
    light, picture = page.run(background), page.run(PICTURE)
    page.show(played.folder / "report" / "index.html", prefers_color_scheme="dark")
    dark = page.run(background)
    assert dark != light and page.run(PICTURE) != picture
    page.run("document.getElementById('theme').click()")
    assert page.run(background) == light
    page.run("document.getElementById('theme').click()")
    assert page.run(background) == dark
    page.run("document.getElementById('theme').click()")


def test_a_phone_needs_no_sideways_scrolling(page: Browser, played: Study) -> None:
    """At 360 px, both tasks; every button is large enough for a finger."""
    page.show(played.folder / "report" / "index.html", wide=360, tall=800)
    for task in (0, 1):
        choose(page, "task", task)
        assert page.run("document.documentElement.scrollWidth") <= 360
    sizes = "[...document.querySelectorAll('.controls button')].map(b => [b.offsetHeight, b.offsetWidth])"
    assert min(min(size) for size in page.run(sizes)) >= 40
