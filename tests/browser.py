"""Headless Chromium for tests, driven through its DevTools pipe: nothing but the standard library.

Messages are JSON ended by a NUL byte, on file descriptors 3 (to the browser) and 4 (from it).
"""

from __future__ import annotations

import base64
import fcntl
import json
import os
import select
import shutil
import subprocess
import sys
import time
from pathlib import Path
from types import TracebackType
from typing import Any, Self

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
PATIENCE_S = 60.0
"""How long an answer may take: a loaded machine is slow, and a test never fails on that."""
FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync",
    "--disable-background-networking", "--disable-component-update", "--disable-extensions",
    "--disable-dev-shm-usage", "--hide-scrollbars", "--mute-audio", "--remote-debugging-pipe",
    "--disable-features=IsolateSandboxedIframes",
)  # fmt: skip
"""The last one keeps frames in the page's process: else nobody hears what they complain of."""
ONTO_3_AND_4 = """
import os, sys
os.dup2(int(sys.argv[1]), 3)
os.dup2(int(sys.argv[2]), 4)
os.execv(sys.argv[3], sys.argv[3:])
"""


def find_browser() -> str | None:
    """The path of a browser that answers: CHROMIUM in the environment, else one in the PATH."""
    named = [os.environ["CHROMIUM"]] if os.environ.get("CHROMIUM") else map(shutil.which, NAMES)
    return next((path for path in named if path and _answers(path)), None)


def _answers(path: str) -> bool:
    """Whether it says its version: some systems have but a stand-in that asks for an installation."""
    try:
        words = subprocess.run([path, "--version"], capture_output=True, timeout=PATIENCE_S, check=True)
    except (OSError, subprocess.SubprocessError):
        return False
    return b"Chrom" in words.stdout


class Browser:
    """One page in a browser of its own; `problems` are what its console and its network complained of."""

    def __init__(self, path: str, profile: Path) -> None:
        self.problems: list[str] = []
        self._buffer = b""
        self._count = 0
        pipes = [os.pipe(), os.pipe()]
        theirs = [fcntl.fcntl(fd, fcntl.F_DUPFD, 10) for fd in (pipes[0][0], pipes[1][1])]
        os.close(pipes[0][0])
        os.close(pipes[1][1])
        self._to, self._from = pipes[0][1], pipes[1][0]
        words = [path, *FLAGS, f"--user-data-dir={profile}", "about:blank"]
        self._process = subprocess.Popen(
            [sys.executable, "-c", ONTO_3_AND_4, *map(str, theirs), *words],
            pass_fds=theirs,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        for fd in theirs:
            os.close(fd)
        self._session: str | None = None
        targets = self.call("Target.getTargets")["targetInfos"]
        page = next(one["targetId"] for one in targets if one["type"] == "page")
        attached = self.call("Target.attachToTarget", targetId=page, flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        os.close(self._to)
        os.close(self._from)
        try:
            self._process.wait(5)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def call(self, method: str, **params: Any) -> dict[str, Any]:
        """One command; its result. Events that come meanwhile are noted."""
        self._count += 1
        message: dict[str, Any] = {"id": self._count, "method": method, "params": params}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._to, json.dumps(message).encode() + b"\0")
        while (answer := self._read()).get("id") != self._count:
            self._note(answer)
        assert "error" not in answer, f"{method}: {answer['error']}"
        return dict(answer["result"])

    def show(self, page: Path, *, wide: int = 1280, tall: int = 900, at: str = "", **media: str) -> None:
        """Open a page from disk, `at` a fragment; `media` are such as prefers_color_scheme="dark"."""
        features = [{"name": name.replace("_", "-"), "value": value} for name, value in media.items()]
        self.call("Emulation.setEmulatedMedia", features=features)
        self.call(
            "Emulation.setDeviceMetricsOverride", width=wide, height=tall, deviceScaleFactor=1, mobile=False
        )
        self.call("Page.navigate", url="about:blank")  # or another fragment would not load the page anew
        self.call("Page.navigate", url=page.resolve().as_uri() + at)
        # Until the new page is there, the blank one answers, and that is complete.
        self.until("location.protocol === 'file:' && document.readyState === 'complete'")

    def run(self, script: str) -> Any:
        """A JavaScript expression's value."""
        answer = self.call("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def until(self, script: str) -> None:
        """Wait for an expression to become true."""
        end = time.monotonic() + PATIENCE_S
        while not self.run(script):
            assert time.monotonic() < end, f"never came true: {script}"
            time.sleep(0.05)

    def press(self, key: str, code: str = "", number: int = 0, text: str = "") -> None:
        """A key, as from a keyboard, to what has the focus."""
        key_facts: dict[str, Any] = {"key": key, "code": code or key, "windowsVirtualKeyCode": number}
        words = {"text": text} if text else {}
        self.call("Input.dispatchKeyEvent", type="keyDown", **key_facts, **words)
        self.call("Input.dispatchKeyEvent", type="keyUp", **key_facts)

    def picture(self, file: Path) -> None:
        """What the window shows, as PNG."""
        answer = self.call("Page.captureScreenshot", format="png")
        file.write_bytes(base64.b64decode(answer["data"]))

    def _read(self) -> dict[str, Any]:
        end = time.monotonic() + PATIENCE_S
        while b"\0" not in self._buffer:
            ready, _, _ = select.select([self._from], [], [], max(0.0, end - time.monotonic()))
            more = os.read(self._from, 1 << 16) if ready else b""
            assert more, f"the browser said nothing for {PATIENCE_S:g} s, or is gone"
            self._buffer += more
        message, _, self._buffer = self._buffer.partition(b"\0")
        return dict(json.loads(message))

    def _note(self, event: dict[str, Any]) -> None:
        method, params = event.get("method"), event.get("params", {})
        if method == "Runtime.exceptionThrown":
            self.problems.append(str(params["exceptionDetails"]))
        elif method == "Runtime.consoleAPICalled" and params["type"] in ("error", "warning", "assert"):
            self.problems.append(str(params["args"]))
        elif method == "Log.entryAdded" and params["entry"]["level"] in ("error", "warning"):
            self.problems.append(str(params["entry"]))
        elif method == "Network.requestWillBeSent":
            url = str(params["request"]["url"])
            if not url.startswith(("file:", "data:", "about:")):
                self.problems.append(f"fetched {url}")
