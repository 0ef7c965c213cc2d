"""The judges' page in headless Chromium: keys, marks that stay, nothing wrong in the console.

Skipped where no Chromium is. A script at the end of the page does what a judge does and writes what
came of it into the page, which the browser then prints.
"""

import html
import json
import re
import shutil
import subprocess

import pytest

from realitygap.correspondence.judging import Pair, blind_pairs, page
from realitygap.correspondence.ladders import Behaviour
from realitygap.correspondence.validation import setting_for

ROBOT = Behaviour(task="obstacle-avoidance", kind="two way turner", seed=1)
CHROMIUM = next(
    (p for name in ("chromium", "chromium-browser", "google-chrome") if (p := shutil.which(name))), None
)
FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync",
    "--disable-background-networking", "--disable-component-update", "--hide-scrollbars",
)  # fmt: skip
PROBE = """
<script>
const seen = { errors: [] };
addEventListener("error", e => seen.errors.push(e.message));
const key = (k, at) => (at || document.body).dispatchEvent(
  new KeyboardEvent("keydown", { key: k, bubbles: true }));
const look = () => ({ title: $("title").textContent, frame: +$("time").value, playing: $("play").textContent,
  mark: (document.querySelector("#marks :checked") || {}).value, done: $("done").textContent,
  wide: document.documentElement.scrollWidth > innerWidth });
seen.first = look();
setTimeout(() => {
  seen.later = look(); seen.ink = new Set($("left").getContext("2d").getImageData(0, 0, 200, 200).data).size;
  key("7"); seen.marked = look(); key("n"); seen.next = look(); key("t"); key("9", $("judge"));
  seen.ten = look(); key(" "); seen.paused = look(); key("p"); seen.back = look();
  $("save").click(); seen.nameless = look();
  const out = document.createElement("pre"); out.id = "probe"; out.textContent = JSON.stringify(seen);
  document.body.append(out);
}, 1500);
</script>
"""


def browse(path, profile, width):
    """What the probe saw, in a window of a width."""
    words = [CHROMIUM, *FLAGS, f"--user-data-dir={profile}", f"--window-size={width},900", "--dump-dom"]
    made = subprocess.run(
        [*words, "--virtual-time-budget=4000", path.as_uri()], capture_output=True, text=True, timeout=120
    )
    found = re.search(r'<pre id="probe">(.*?)</pre>', made.stdout, re.S)
    assert found, made.stdout[-500:] + made.stderr[-500:]
    return json.loads(html.unescape(found[1]))


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium")
def test_a_judge_needs_no_mouse_and_loses_no_mark(tmp_path):
    """Films run, keys mark and turn pages, marks are there again in a new visit, a phone shows all."""
    trials = ROBOT.trials(2)
    data, _ = blind_pairs([Pair(name=n, a=trials, b=trials, score=1) for n in "ab"], setting_for(ROBOT.task))
    path = tmp_path / "judge.html"
    path.write_text(page(data).replace("</body>", PROBE + "</body>"))
    seen = browse(path, tmp_path / "profile", 1000)
    assert seen["errors"] == [] and seen["ink"] > 3
    assert seen["first"]["title"] == "Pair 1 of 2" and "mark" not in seen["first"]
    assert seen["later"]["frame"] > 0
    assert seen["marked"]["mark"] == "7" and seen["marked"]["done"] == "1 of 2 marked"
    assert seen["next"]["title"] == "Pair 2 of 2" and "mark" not in seen["next"]
    assert seen["ten"]["mark"] == "10"  # a figure typed into the name marks nothing
    assert seen["paused"]["playing"] == "Play"
    assert seen["back"]["mark"] == "7" and "name" in seen["nameless"]["done"]
    again = browse(path, tmp_path / "profile", 500)
    assert again["first"]["mark"] == "7" and again["first"]["done"] == "2 of 2 marked"
    assert not again["first"]["wide"] and again["errors"] == []
