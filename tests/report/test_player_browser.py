"""The page in a real browser: it plays, obeys keys, sorts its tables and follows light and dark.

Skipped where there is no Chromium (in the PATH, or named by CHROMIUM).
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from realitygap.study.load import Study
from tests.browser import Browser

PICTURE = "document.getElementById('player-arena-0').toDataURL()"
STEP = "Number(document.getElementById('player-scrub').value)"
PLAYING = "document.getElementById('player-play').classList.contains('on')"
FOCUS = "document.getElementById('player-deck').focus({preventScroll: true})"
HOLD = "void (window.requestAnimationFrame = (next) => { window.next = next; return 0; })"
"""From here on the page's time stands still, but for the frames that a test gives it."""
FRAME = "void window.next((window.clock = (window.clock || performance.now()) + 200))"


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


def test_a_frame_is_as_much_time_as_has_gone(page: Browser) -> None:
    """0.2 s a frame at full speed, half as much at half; the picture changes; a pause holds it."""
    page.run(HOLD)
    page.run("document.getElementById('player-play').click()")
    assert page.run(STEP) == 0 and page.run(PLAYING)
    page.run(FRAME)
    before, first = page.run(PICTURE), page.run(STEP)
    page.run(FRAME)
    assert page.run(STEP) == first + 2 and page.run(PICTURE) != before
    page.run("document.getElementById('player-speed').value = '0.5'")
    page.run(FRAME)
    assert page.run(STEP) == first + 3
    page.run("document.getElementById('player-play').click()")
    page.run(FRAME)
    assert page.run(STEP) == first + 3 and not page.run(PLAYING)


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


def test_keys_need_no_focus_while_the_player_is_in_view(page: Browser) -> None:
    """They act, and bring the robots into sight; elsewhere on the page, and in a field, they are others'."""
    assert page.run("document.activeElement === document.body")
    page.press("Home", number=36)
    page.press("ArrowRight", number=39)
    assert page.run(STEP) == 1
    in_sight = "document.getElementById('player-play').getBoundingClientRect()"
    assert page.run(f"{in_sight}.top > 0 && {in_sight}.bottom < window.innerHeight + 1")
    page.press("ArrowRight", number=39)
    page.run(HOLD)
    page.press(" ", "Space", 32, " ")
    assert page.run(PLAYING)
    page.press(" ", "Space", 32, " ")
    assert not page.run(PLAYING)
    page.run(
        "(() => { const field = document.createElement('input'); field.id = 'field';"
        " document.getElementById('player').append(field); field.focus({preventScroll: true}); })()"
    )
    page.press("5", "Digit5", 53, "5")
    page.press("Home", number=36)
    assert page.run(STEP) == 2 and page.run("document.getElementById('field').value") == "5"
    page.run("document.activeElement.blur()")
    page.run("document.getElementById('made').scrollIntoView({behavior: 'instant'})")
    page.press("5", "Digit5", 53, "5")
    assert page.run(STEP) == 2


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


def test_a_step_of_another_length_has_a_time_and_a_link_of_its_own(
    page: Browser, played: Study, tmp_path: Path
) -> None:
    """Steps of 0.05 s are told from each other, and a link leads to its own."""
    copy = tmp_path / "index.html"
    words = (played.folder / "report" / "index.html").read_text()
    assert words.count('"step_s":0.1,') == 1
    copy.write_text(words.replace('"step_s":0.1,', '"step_s":0.05,'))
    page.show(copy, at="#run=obstacle-avoidance/zero/1&at=0.35")
    assert page.run(STEP) == 7 and page.run(text("time")) == "0.35 of 1.00 s"
    assert page.run("document.getElementById('player-link').hash").endswith("&at=0.35")


@pytest.mark.parametrize("depth", ["50.0", "500.0"])
def test_a_deep_room_fits_with_its_ticks(page: Browser, played: Study, tmp_path: Path, depth: str) -> None:
    """It is at most half as high again as wide; ticks of three digits are whole: at the left is nothing."""
    copy = tmp_path / "index.html"
    words = (played.folder / "report" / "index.html").read_text()
    assert '"size_cm":[50.0,50.0]' in words
    copy.write_text(words.replace('"size_cm":[50.0,50.0]', f'"size_cm":[50.0,{depth}]'))
    page.show(copy)
    canvas = "document.getElementById('player-arena-0')"
    edge = f"{canvas}.getContext('2d').getImageData(0, 0, 2, {canvas}.height - 30).data"
    assert page.run(f"[...{edge}].every(value => value === 0)")
    assert page.run(f"{canvas}.height < 1.6 * {canvas}.width")


def test_paper_keeps_a_picture_of_the_player(page: Browser, played: Study) -> None:
    """Light, with words for what it shows instead of its controls; afterwards the page is as it was."""
    page.show(played.folder / "report" / "index.html", prefers_color_scheme="light")
    choose(page, "run", 0)
    light = page.run(PICTURE)
    page.show(played.folder / "report" / "index.html", prefers_color_scheme="dark")
    choose(page, "run", 0)
    assert page.run(PICTURE) != light
    page.run("dispatchEvent(new Event('beforeprint'))")
    assert page.run(PICTURE) == light
    said = page.run(text("still"))
    assert said == "Obstacle avoidance, zero noise, #1, twin unit 1, start 1, after 2.0 of 2.0 s."
    page.call("Emulation.setEmulatedMedia", media="print")
    shown = "(name) => document.querySelector(name).getBoundingClientRect().height > 0"
    seen = page.run(f"['#player-arena-0', '#player-arena-1', '#player-still'].every({shown})")
    assert seen and not page.run(f"['.controls', '.choose', '#theme'].some({shown})")
    assert page.run("getComputedStyle(document.querySelector('h2')).breakAfter") == "avoid"
    assert page.run("getComputedStyle(document.body).backgroundColor") != "rgb(19, 21, 24)"
    page.call("Emulation.setEmulatedMedia", media="")
    page.run("dispatchEvent(new Event('afterprint'))")
    assert page.run("document.documentElement.dataset.theme === undefined")


def test_a_table_keeps_its_headings_on_every_sheet_of_paper(page: Browser) -> None:
    """Buttons are not repeated with a table's head, so on paper a heading is text; on the screen it sorts."""
    is_text = "(one) => getComputedStyle(one).display === 'contents'"
    shown = f"[...document.querySelectorAll('th .sort')].map({is_text})"
    assert not any(page.run(shown))
    page.call("Emulation.setEmulatedMedia", media="print")
    assert all(page.run(shown))
    page.call("Emulation.setEmulatedMedia", media="")


def test_paper_has_no_heading_without_what_it_heads(page: Browser) -> None:
    """Neither above a fold that is closed, which is not printed, nor a table's on the sheet before."""
    words = "<section id=it><h2>Constants</h2><details><summary>All</summary>many</details></section>"
    page.run(f"document.querySelector('main').insertAdjacentHTML('beforeend', '{words}')")
    height = "document.getElementById('it').offsetHeight"
    assert page.run(height) > 0
    page.call("Emulation.setEmulatedMedia", media="print")
    assert page.run(height) == 0
    page.run("document.querySelector('#it details').open = true")
    assert page.run(height) > 0
    assert page.run("getComputedStyle(document.querySelector('thead')).breakAfter") == "avoid"
    page.call("Emulation.setEmulatedMedia", media="")


def test_readings_and_neurons_follow_the_time(page: Browser) -> None:
    """Both sides show numbers of their own; the motor neurons show the commands at every step."""
    page.run(FOCUS)
    for key, code in (("Home", 36), ("End", 35)):
        page.press(key, number=code)
        for side in (0, 1):
            inside = f"#player-network-{side} .neuron.output .value"
            neurons = page.run(f"[...document.querySelectorAll('{inside}')].map(v => v.textContent)")
            wheels = page.run(
                f"[...document.querySelectorAll('#player-commands-{side} b')].map(v => v.textContent)"
            )
            assert neurons == wheels and len(wheels) == 2
            bars = f"[...document.querySelectorAll('#player-readings-{side} b')].map(v => v.textContent)"
            counts = page.run(bars)
            assert len(counts) == 8 and all(count.isdigit() for count in counts)


def test_another_choice_is_another_picture(page: Browser) -> None:
    """Noise level, run and trial; lists of trials stand only where there are several."""
    shown = []
    for name, index in (("run", 0), ("run", 1), ("noise", 1)):
        choose(page, name, index)
        shown.append(page.run(PICTURE))
    assert len(set(shown)) == 3
    choose(page, "noise", 0)
    choose(page, "run", 0)
    assert page.run("document.getElementById('player-trial').length") == 2
    assert not page.run("document.getElementById('player-trial-label').hidden")


def test_who_drove_no_robot_is_shown_alone_and_it_says_so(page: Browser) -> None:
    """Light seeking was not transferred here."""
    assert page.run("document.getElementById('player-alone').hidden")
    choose(page, "task", 1)
    assert not page.run("document.getElementById('player-alone').hidden")
    assert page.run("[...document.querySelectorAll('[data-side=\"1\"]')].every(box => box.hidden)")
    assert page.run(text("who-0")) == "simulated"


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


def test_sensors_of_two_kinds_stand_in_rows_of_eight(page: Browser, played: Study) -> None:
    """Sixteen bars make no phone scroll sideways, and are as wide as eight."""
    page.show(played.folder / "report" / "index.html", wide=360, tall=800)
    wide = page.run("document.querySelector('.bar').offsetWidth")
    twice = "box.append(...[...box.children].map(bar => bar.cloneNode(true)))"
    page.run(f"document.querySelectorAll('.bars').forEach(box => {twice})")
    widths = page.run("[...document.querySelectorAll('.bar')].map(bar => bar.offsetWidth)")
    assert len(widths) == 32 and all(abs(one - wide) <= 1 for one in widths)
    assert page.run("document.documentElement.scrollWidth") <= 360


def test_a_wide_tables_caption_fits_a_phone(page: Browser, played: Study) -> None:
    """It is read without the sideways scrolling that the table needs."""
    page.show(played.folder / "report" / "index.html", wide=360, tall=800)
    words = "<caption class=caption>' + 'word '.repeat(60) + '</caption><tr><td>' + 'wide'.repeat(50) + '"
    table = f"'<div class=scroll id=it><table>{words}</table></div>'"
    page.run(f"document.querySelector('main').insertAdjacentHTML('beforeend', {table})")
    box = "document.getElementById('it')"
    assert page.run(f"{box}.scrollWidth > {box}.clientWidth")
    assert page.run(f"{box}.querySelector('caption').getBoundingClientRect().right") <= 360 - 20


@pytest.mark.parametrize("wide", [360, 1200])
def test_a_long_title_makes_no_page_wider_than_its_window(page: Browser, played: Study, wide: int) -> None:
    """Neither a study's title nor a task's, in its heading, its link and the player's list, is too wide."""
    page.show(played.folder / "report" / "index.html", wide=wide, tall=800)
    long = "title.textContent = 'Longword'.repeat(30)"
    page.run(f"document.querySelectorAll('h1, h2, nav a, #player-task option').forEach(title => {long})")
    assert page.run("document.documentElement.scrollWidth") <= wide


@pytest.mark.parametrize(("motion", "between"), [("reduce", False), ("no-preference", True)])
def test_less_motion_is_whole_steps(page: Browser, played: Study, motion: str, between: bool) -> None:
    """Who asks for less motion sees the robots at their steps only, others also in between."""
    page.show(played.folder / "report" / "index.html", prefers_reduced_motion=motion)
    assert not page.run(PLAYING)
    page.run(HOLD)
    page.run("document.getElementById('player-speed').value = '0.25'")
    page.run("document.getElementById('player-play').click()")
    at_step = page.run(PICTURE)
    page.run(FRAME)
    assert page.run(STEP) == 0 and (page.run(PICTURE) != at_step) == between
