"""Where a network evolved: one that is fed something else drives, but means nothing, and is warned about."""

import re
import warnings
import weakref
from typing import NamedTuple, Self

from realitygap.errors import RealityGapWarning
from realitygap.kernels.types import Networks

__all__ = ["Origin", "origin_of", "remember"]

LINE = re.compile(r"# run \d+, ([^/,\s]+)/[^,\n]*, seed \d+(?:, fed ([a-z+]+))?\s*$", re.MULTILINE)


class Origin(NamedTuple):
    """The task that a network evolved at, and the sensors that fed it ("" where that is unknown)."""

    task: str
    feeds: str

    @classmethod
    def told(cls, text: str) -> Self | None:
        """That of the text of a champion, as `realitygap show STUDY RUN` prints it."""
        found = LINE.match(text)
        return None if found is None else cls(found[1], found[2] or "")

    def warn(self, task: str, feeds: str) -> None:
        """Warn if it is to drive at another task, or on other sensors."""
        if self.feeds and self.feeds != feeds:
            said = f"at {self.task} with {self.feeds} sensors; here it is fed {feeds}"
        elif _plain(self.task) != _plain(task):
            said = f"at {self.task}; here it drives at {task}"
        else:
            return
        warnings.warn(f"this controller evolved {said}.", RealityGapWarning, stacklevel=4)


def _plain(task: str) -> str:
    """Without the spread that a task's name tells."""
    return re.sub(r"-spread-.*", "", task)


_origins: dict[int, Origin] = {}
"""By the identity of an array of the networks, for as long as that lives."""


def remember(networks: Networks, origin: Origin) -> Networks:
    """The same networks, of which it is known where they evolved."""
    key = id(networks.thresholds)
    _origins[key] = origin
    weakref.finalize(networks.thresholds, _origins.pop, key, None)
    return networks


def origin_of(networks: Networks) -> Origin | None:
    """Where networks evolved, if that is known."""
    return _origins.get(id(networks.thresholds))
