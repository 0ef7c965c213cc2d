"""What tests of several rooms need."""

import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

from tests.browser import NAMES, Browser, find_browser

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as in a shell's background: Ctrl-C is tried here
    signal.signal(signal.SIGINT, signal.default_int_handler)

pytest.register_assert_rewrite("realitygap.testing")

settings.register_profile("patient", deadline=None)  # a loaded machine is slow, and no test fails on that
settings.load_profile("patient")


@pytest.fixture(scope="session", autouse=True)
def state_home(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Where task files are trusted, for as long as the tests last: not in the user's own list."""
    with pytest.MonkeyPatch.context() as patch:
        home = tmp_path_factory.mktemp("state")
        patch.setenv("XDG_STATE_HOME", str(home))
        yield home


@pytest.fixture(scope="session")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    """One browser for all tests, each of which opens its page anew."""
    path = find_browser()
    if path is None:
        pytest.skip(f"no browser answers: neither CHROMIUM, in the environment, nor {', '.join(NAMES)}")
    with Browser(path, tmp_path_factory.mktemp("profile")) as one:
        yield one
