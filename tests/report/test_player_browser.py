"""The page in a real browser: it plays, obeys keys and links, sorts its tables, follows light and dark.

Skipped where there is no Chromium (in the PATH, or named by CHROMIUM).
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import pytest

from realitygap.study.load import Study
from tests.browser import Browser

PICTURE = "document.getElementById('player-arena-0').toDataURL()"
STEP = "Number(document.getElementById('player-scrub').value)"
PLAYING = "document.getElementById('player-play').classList.contains('on')"
FOCUS = "document.getElementById('player-deck').focus({preventScroll: true})"


@pytest.fixture
def page(browser: Browser, played: Study) -> Iterator[Browser]:
    """The page, open and still; afterwards nothing was complained of and nothing fetched."""
    show(browser, played, prefers_color_scheme="light")
    yield browser
    problems, browser.problems = browser.problems, []
    assert problems == []


def show(browser: Browser, study: Study, **how: Any) -> None:
    """The study's page to a reader who wants nothing to move by itself."""
    browser.show(study.folder / "report" / "index.html", **{"prefers_reduced_motion": "reduce", **how})


def test_the_first_screen_answers(page: Browser) -> None:
    """At 1280 by 900 the answer, its interval and the caveat are read without scrolling; one note is
    coloured, the word "situated" is not on the page, and the bar stays when the page scrolls."""
    low = "Math.max(...[...document.querySelectorAll('%s')].map(e => e.getBoundingClientRect().bottom))"
    assert 0 < page.run(low % ".answer p") < page.run(low % ".answer figure") < 900
    assert page.run(low % "#caveat") < 900
    text = "[...document.querySelectorAll('.answer p')].map(e => e.textContent).join('|')"
    first, second = page.run(text).split("|")
    assert re.search(r"correspondence score \d+\.\d on the twin", first) and "±" in second
    assert "test score in simulation at observed noise" in second and "Games–Howell" in second
    assert page.run("[...document.querySelectorAll('.notice')].filter(e => e.checkVisibility()).length") == 1
    assert "situated" not in page.run("document.body.innerText").lower()
    page.run("scrollTo({top: 1500, behavior: 'instant'})")
    assert page.run("document.querySelector('.top').getBoundingClientRect().top") == 0


@pytest.mark.parametrize(("wide", "tall", "screens"), [(1280, 900, 6), (390, 844, 10)])
def test_the_page_is_short(page: Browser, played: Study, wide: int, tall: int, screens: int) -> None:
    """Folded, as it opens; opened, a wide table scrolls in its own box and not the page."""
    show(page, played, wide=wide, tall=tall)
    assert page.run("document.documentElement.scrollHeight") <= screens * tall
    page.run("document.querySelectorAll('details').forEach(one => one.open = true)")
    assert page.run("document.documentElement.scrollWidth") <= wide


def test_the_player_opens_at_the_start_and_plays_once(browser: Browser, played: Study) -> None:
    """With a mark over the picture; by itself when it is first seen, and never where nothing shall move."""
    mark = "document.getElementById('player-mark').checkVisibility()"
    seen = "document.querySelector('.controls').scrollIntoView({block: 'end', behavior: 'instant'})"
    show(browser, played)
    browser.run(seen)
    browser.run("new Promise(done => setTimeout(done, 300))")
    assert browser.run(STEP) == 0 and browser.run(mark) and not browser.run(PLAYING)
    show(browser, played, prefers_reduced_motion="no-preference")
    assert browser.run(STEP) == 0 and browser.run(mark)
    browser.run(seen)
    browser.until(f"{STEP} === 20 && !{PLAYING} && !{mark}")
    assert browser.problems == []


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
    show(page, played, at=wanted)
    assert page.run(PICTURE) == picture and page.run(STEP) == 10
    page.run("location.hash = '#run=obstacle-avoidance/zero/9'")
    page.until("!document.getElementById('player-lost').hidden")


def test_a_table_sorts_by_a_heading(page: Browser) -> None:
    """Up, down, and as it was; the average stays last, and the heading tells its order."""
    table = "document.querySelector('table[aria-labelledby=\"obstacle-avoidance-table\"]')"
    heading = f"{table}.querySelectorAll('th[aria-sort]')[0]"
    script = f"[...{table}.tBodies[0].rows].map(row => row.cells[0].textContent.trim())"
    start = page.run(script)
    page.run(f"{table}.closest('details').open = true")
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
    show(page, played, prefers_color_scheme="dark", wide=360, tall=800)
    dark = page.run(background)
    assert dark != light and page.run(PICTURE) != picture
    page.run("document.getElementById('theme').click()")
    assert page.run(background) == light
    for task in (0, 1):
        choose(page, "task", task)
        assert page.run("document.documentElement.scrollWidth") <= 360
    page.run("document.getElementById('theme').click(); document.getElementById('theme').click()")


def test_the_reports_own_champions_can_be_driven(page: Browser) -> None:
    """On their robot, with the twin's recorded course faintly beside; then they are watched as before."""
    picture = page.run(PICTURE)
    page.run("document.getElementById('drive-open').click()")
    page.until("document.getElementById('player').classList.contains('driving')")
    assert page.run("document.getElementById('drive-ghost').textContent").startswith("Faint: the twin")
    choose(page, "task", 1)
    assert page.run("document.getElementById('drive-ghost').textContent") == ""
    assert page.run("document.getElementById('player-who-0').textContent") == "yours to drive"
    choose(page, "task", 0)
    page.run("document.getElementById('drive-open').click()")
    assert page.run("document.getElementById('player-who-0').textContent") == "simulated"
    assert page.run(PICTURE) == picture
