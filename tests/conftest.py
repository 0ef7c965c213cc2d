"""What tests of several rooms need."""

import gc
import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

from tests.browser import NAMES, Browser, find_browser

# Before NumPy is imported: on small matrices its threads only wait for each other, at twice the cost.
for threads in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(threads, "1")

gc.disable()  # until all tests are collected: what they import lives to the end

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as in a shell's background: Ctrl-C is tried here
    signal.signal(signal.SIGINT, signal.default_int_handler)

pytest.register_assert_rewrite("realitygap.testing")

settings.register_profile("patient", deadline=None)  # a loaded machine is slow, and no test fails on that
settings.load_profile("patient")

LONGEST = (
    "kernels/test_same_bits", "experiments/test_noise", "calibration/test_measured", "robots/test_epuck",
    "test_site",
    "test_examples", "transfer/test_transfer_live", "transfer/test_transfer",
    "calibration/test_fits", "robots/test_thymio", "study/test_killed", "cli/test_transfer",
    "film/test_tag", "studies/test_correspondence", "studies/test_noise_level_2",
    "robots/test_faults", "simulation/test_cuda",
    "work/test_dask", "export/test_export", "correspondence/test_score", "film/test_tracker",
    "calibration/test_record", "kernels/test_together",
    "kernels/test_trials", "transfer/test_rig",
    "report/test_build", "twin/test_camera", "test_compiled", "twin/test_arithmetic",
    "report/test_situated",
    "calibration/test_room", "correspondence/test_names", "report/test_notebook",
    "kernels/test_ambient",
    "report/test_player_browser",
)  # fmt: skip
"""Files of eight seconds and more; the first compiles what others load."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What takes longest begins first: so that at the end no core waits for the other."""
    places = {f"tests/{name}.py": place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: places.get(item.nodeid.partition("::")[0], len(places)))


def pytest_collection_finish() -> None:
    """From here on garbage is looked for among what tests make, not in half a million objects that stay."""
    gc.freeze()
    gc.enable()


@pytest.fixture(scope="session", autouse=True)
def state_home(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Where task files are trusted, for as long as the tests last: not in the user's own list."""
    with pytest.MonkeyPatch.context() as patch:
        home = tmp_path_factory.mktemp("state")
        patch.setenv("XDG_STATE_HOME", str(home))
        yield home


@pytest.fixture(scope="session", autouse=True)
def patient_guard() -> Iterator[None]:
    """A robot's guard may take its time to answer: tests share their processors, and none fails on that."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("realitygap.robots.guard.UNGUARDED_S", 5.0)
        yield


FIGURE = '<svg width="72pt" viewBox="0 0 72 72" xmlns="http://www.w3.org/2000/svg"></svg>'


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pages have an empty figure for each of theirs: for tests that look at everything else."""
    draw_nothing(monkeypatch)


def draw_nothing(patch: pytest.MonkeyPatch) -> None:
    """The same for a fixture of a module."""
    patch.setattr("realitygap.report.page.Picture.save", lambda *_, **__: FIGURE)


@pytest.fixture(scope="session")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    """One browser for all tests, each of which opens its page anew."""
    path = find_browser()
    if path is None:
        pytest.skip(f"no browser answers: neither CHROMIUM, in the environment, nor {', '.join(NAMES)}")
    with Browser(path, tmp_path_factory.mktemp("profile")) as one:
        yield one
