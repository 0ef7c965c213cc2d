"""The page in a real browser: it plays, obeys keys and links, sorts its tables, follows light and dark.

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


def test_the_player_plays_and_obeys_keys(page: Browser) -> None:
    """To the end, in the browser's own time; Home, End, arrows and digits; both sides tell what is inside."""
    page.run("document.getElementById('player-play').click()")
    page.until(f"{STEP} === 20 && !{PLAYING}")
    assert page.run("document.getElementById('player-time').textContent") == "2.0 of 2.0 s"
    page.run(FOCUS)
    page.press("Home", number=36)
    first = page.run(PICTURE)
    page.press("ArrowRight", number=39)
    assert page.run(STEP) == 1 and page.run(PICTURE) != first
    page.press("5", "Digit5", 53, "5")
    assert page.run(STEP) == 10
    for side in (0, 1):
        inside = f"#player-network-{side} .neuron.output .value"
        neurons = page.run(f"[...document.querySelectorAll('{inside}')].map(v => v.textContent)")
        bars = f"#player-commands-{side} b"
        assert neurons == page.run(f"[...document.querySelectorAll('{bars}')].map(v => v.textContent)")
    page.run("void (window.requestAnimationFrame = () => 0)")
    page.press(" ", "Space", 32, " ")
    assert page.run(PLAYING)


def test_a_link_leads_to_one_run_trial_and_moment(page: Browser, played: Study) -> None:
    """The address follows what a person chooses; opened, or pasted into the page, it shows the same."""
    choose(page, "run", 0)
    choose(page, "trial", 1)
    page.run(FOCUS)
    page.press("5", "Digit5", 53, "5")
    wanted = "#run=obstacle-avoidance/zero/1&trial=twin-1/start-2&at=1.0"
    page.until(f"location.hash === '{wanted}'")
    picture = page.run(PICTURE)
    choose(page, "task", 1)
    assert page.run(PICTURE) != picture and not page.run("document.getElementById('player-alone').hidden")
    page.show(played.folder / "report" / "index.html", at=wanted)
    assert page.run(PICTURE) == picture and page.run(STEP) == 10
    page.run("location.hash = '#run=obstacle-avoidance/zero/9'")
    page.until("!document.getElementById('player-lost').hidden")


def test_a_table_sorts_by_a_heading(page: Browser) -> None:
    """Up, down, and as it was; the average stays last, and the heading tells its order."""
    table = "document.querySelector('table[aria-labelledby=\"obstacle-avoidance-table\"]')"
    heading = f"{table}.querySelectorAll('th[aria-sort]')[0]"
    script = f"[...{table}.tBodies[0].rows].map(row => row.cells[0].textContent.trim())"
    start = page.run(script)
    orders = []
    for _ in range(3):
        page.run(f"{heading}.querySelector('button').focus()")
        page.press("Enter", number=13, text="\r")
        orders.append((page.run(f"{heading}.getAttribute('aria-sort')"), page.run(script)))
    assert [state for state, _ in orders] == ["ascending", "descending", "none"]
    assert orders[0][1] == orders[2][1] == start == [start[0], "1", "2", "average"]
    assert orders[1][1] == [start[0], "2", "1", "average"]


def test_light_dark_and_a_phone(page: Browser, played: Study) -> None:
    """As the system says, until a person says otherwise; at 360 px nothing scrolls sideways."""
    background = "getComputedStyle(document.body).backgroundColor"
    light, picture = page.run(background), page.run(PICTURE)
    page.show(played.folder / "report" / "index.html", prefers_color_scheme="dark", wide=360, tall=800)
    dark = page.run(background)
    assert dark != light and page.run(PICTURE) != picture
    page.run("document.getElementById('theme').click()")
    assert page.run(background) == light
    for task in (0, 1):
        choose(page, "task", task)
        assert page.run("document.documentElement.scrollWidth") <= 360
    page.run("document.getElementById('theme').click(); document.getElementById('theme').click()")
