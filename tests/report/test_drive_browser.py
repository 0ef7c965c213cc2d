"""The page's own simulation in a real browser: dragged, turned by keys, under another noise, forbidden.

Skipped where there is no Chromium (in the PATH, or named by CHROMIUM).
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from realitygap.control.genotype import Genotype
from realitygap.errors import RealityGapWarning
from realitygap.report.drive import Driven, drive_json
from realitygap.report.notebook import _player
from realitygap.report.player import replay_data
from realitygap.simulation import wasm
from realitygap.simulation.simulation import Simulation
from realitygap.values import Pose
from tests.browser import Browser

pytestmark = pytest.mark.skipif(bool(os.environ.get("NUMBA_DISABLE_JIT")), reason="the compiler is off")

POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; "
    "script-src 'unsafe-inline' 'wasm-unsafe-eval'; img-src data:"
)
ON = "document.getElementById('player').classList.contains('driving')"
LABEL = "document.getElementById('player-arena-0').getAttribute('aria-label')"
FINGERS = (25, 30), (40, 30), (35, 45)
PICTURE = "document.getElementById('player-arena-0').toDataURL()"


def drive(name: str) -> Driven:
    """A robot at a task under a network that avoids obstacles."""
    task = Simulation("obstacle-avoidance", "khepera").task
    return Driven(
        task=task, profile=Simulation(task, "khepera").profile, runs={name: Genotype.braitenberg("proximity")}
    )


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A page with one robot, recorded and to be driven."""
    simulation, name = Simulation("obstacle-avoidance", "khepera"), "avoider"
    genotype = Genotype.braitenberg("proximity")
    pose = Pose.from_degrees(25, 25, 90)
    driven = simulation.trajectory(genotype.networks(), stream=1, pose=pose, seconds=2)
    page = tmp_path_factory.mktemp("drive") / "page.html"
    _player(replay_data(simulation, genotype, driven, name), name, 900, drive_json([drive(name)])).save(page)
    return page


@pytest.fixture
def page(browser: Browser, file: Path) -> Iterator[Browser]:
    """The page, open and paused; afterwards nothing was complained of and nothing fetched."""
    browser.show(file, prefers_reduced_motion="reduce")
    browser.until(ON)
    browser.run(
        "document.getElementById('player-arena-0').scrollIntoView({block: 'center', behavior: 'instant'})"
    )
    yield browser
    problems, browser.problems = browser.problems, []
    assert problems == []


def place(page: Browser, x_cm: float, y_cm: float) -> dict[str, float]:
    """Where a place of the arena is, 50 cm wide: its walls are 22 and 12 pixels from the sides."""
    x, y, wide = page.run(
        "(() => { const box = document.getElementById('player-arena-0').getBoundingClientRect();"
        " return [box.x, box.y, box.width]; })()"
    )
    scale = (wide - 22 - 12) / 50
    return {"x": x + 22 + scale * x_cm, "y": y + 8 + scale * (50 - y_cm)}


def mouse(page: Browser, kind: str, x_cm: float, y_cm: float, modifiers: int = 0) -> None:
    """The pointer at a place of the arena."""
    where = place(page, x_cm, y_cm)
    page.call(
        "Input.dispatchMouseEvent",
        type=kind,
        button="left",
        buttons=1,
        clickCount=1,
        modifiers=modifiers,
        **where,
    )


def key(page: Browser, name: str, modifiers: int = 0) -> None:
    """A key, to the arena."""
    page.run("document.getElementById('player-deck').focus({preventScroll: true})")
    page.call("Input.dispatchKeyEvent", type="keyDown", key=name, code=name, modifiers=modifiers)
    page.call("Input.dispatchKeyEvent", type="keyUp", key=name, code=name, modifiers=modifiers)


def test_dragged_it_stays_where_its_body_fits(page: Browser) -> None:
    """It follows the pointer; in a cylinder there is no room, and there it goes back."""
    mouse(page, "mousePressed", 40, 25)  # not at the robot, which comes
    mouse(page, "mouseMoved", 25, 30)
    assert page.run(LABEL) == "Your robot at 25, 30 cm"
    free = page.run(PICTURE)
    mouse(page, "mouseMoved", 25, 30, modifiers=8)
    mouse(page, "mouseMoved", 20, 30, modifiers=8)  # with shift it turns
    assert page.run(LABEL) == "Your robot at 25, 30 cm" and page.run(PICTURE) != free
    mouse(page, "mouseReleased", 25, 30)
    assert page.run(LABEL) == "Your robot at 25, 30 cm"
    mouse(page, "mousePressed", 25, 30)
    mouse(page, "mouseMoved", 15, 15)
    assert page.run(LABEL) == "Your robot at 15, 15 cm: no room"
    assert page.run("document.getElementById('player-score-0').textContent") == "no room here"
    mouse(page, "mouseReleased", 15, 15)
    assert page.run(LABEL) == "Your robot at 25, 30 cm"


def test_a_second_finger_turns_it(page: Browser) -> None:
    """The first one holds it where it is."""
    first, second, third = ({"id": min(i, 1), **place(page, x, y)} for i, (x, y) in enumerate(FINGERS))
    page.call("Input.dispatchTouchEvent", type="touchStart", touchPoints=[first])
    picture = page.run(PICTURE)
    page.call("Input.dispatchTouchEvent", type="touchStart", touchPoints=[first, second])
    page.call("Input.dispatchTouchEvent", type="touchMove", touchPoints=[first, third])
    assert page.run(LABEL) == "Your robot at 25, 30 cm" and page.run(PICTURE) != picture
    page.call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
    assert page.run(LABEL) == "Your robot at 25, 30 cm"


def test_noise_widens_the_fan(page: Browser) -> None:
    """Another picture under more noise, and the first one again under the first noise."""

    def at(level: float) -> str:
        page.run(
            f"(() => {{ const range = document.getElementById('drive-noise'); range.value = {level};"
            " range.dispatchEvent(new Event('input')); })()"
        )
        assert page.run("document.getElementById('drive-level').textContent") == f"{level:.1f}"
        return str(page.run(PICTURE))

    still, wild = at(0), at(4)
    assert still != wild and at(0) == still


def test_keys_place_turn_and_play(page: Browser) -> None:
    """Arrows move it by 1 cm, with shift they turn it; space plays; the recorded drives stay as they are."""
    mouse(page, "mousePressed", 40, 25)
    mouse(page, "mouseMoved", 25, 25)
    mouse(page, "mouseReleased", 25, 25)
    first = page.run(PICTURE)
    for _ in range(3):
        key(page, "ArrowRight")
    assert page.run(LABEL) == "Your robot at 28, 25 cm"
    for _ in range(3):
        key(page, "ArrowLeft")
    page.until(f"{PICTURE} !== '' && document.getElementById('player-said').textContent !== ''")
    assert page.run(PICTURE) == first
    key(page, "ArrowLeft", modifiers=8)
    assert page.run(LABEL) == "Your robot at 25, 25 cm" and page.run(PICTURE) != first
    page.until("document.getElementById('drive-play').textContent === 'Play'")
    key(page, " ")
    assert page.run("document.getElementById('drive-play').textContent") == "Pause"
    page.until("document.getElementById('player-score-0').textContent.startsWith('1.')")
    page.run("document.getElementById('drive-open').click()")
    assert not page.run(ON) and page.run("document.getElementById('player-who-0').textContent") == "simulated"


def test_the_policy_allows_wasm_alone_and_without_it_there_are_recorded_drives(
    browser: Browser, file: Path, tmp_path: Path
) -> None:
    """A line says why."""
    text = file.read_text("utf-8")
    assert text.count(POLICY) == 1
    (tmp_path / "page.html").write_text(text.replace(" 'wasm-unsafe-eval'", ""), "utf-8")
    browser.show(tmp_path / "page.html")
    browser.until("!document.getElementById('drive-lost').hidden")
    assert "the recorded drives remain" in browser.run("document.getElementById('drive-lost').textContent")
    assert not browser.run(ON)
    browser.run("document.getElementById('player-on').click()")
    assert browser.run("Number(document.getElementById('player-scrub').value)") >= 1
    problems, browser.problems = browser.problems, []
    assert all("Content Security Policy" in one or "wasm" in one.lower() for one in problems)


def test_where_nothing_can_be_compiled_the_page_and_a_warning_say_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """Another Numba: the recorded drives remain."""
    monkeypatch.setattr(wasm, "kept", lambda home, name, text, make: make())
    monkeypatch.setattr(wasm, "_in_a_child", refuse)
    with pytest.warns(
        RealityGapWarning, match=r"was not compiled: why\. The page shows recorded drives only"
    ):
        assert drive_json([drive("avoider")]) is None


def refuse(functions: object) -> bytes:
    raise wasm.WasmError("was not compiled: why")
