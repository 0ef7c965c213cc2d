"""What a robot's own processor needs of an evolved controller: whole numbers only.

A reading becomes an input by counting the edges that it has passed, found by trying every reading, so that
it is the input that the simulation's own arithmetic gives; the network is §5.3's; an output becomes a
command by a table.
"""

import hashlib
import re
from dataclasses import dataclass
from keyword import iskeyword

import numpy as np
from numpy.typing import NDArray

from realitygap import __version__
from realitygap.controller.encoding import controller_of, links_into
from realitygap.controller.network import NetworkController
from realitygap.errors import StudyError, UsageError
from realitygap.evolution.algorithm import Genes
from realitygap.kernels.network import LIMIT
from realitygap.kernels.params import MAX_DELAY, UPDATES
from realitygap.study.load import Run, Study
from realitygap.text import must_be
from realitygap.world.profile import Profile

__all__ = ["Fed", "OnBoard", "Vectors", "on_board"]

ROWS = 1 << (MAX_DELAY + 1).bit_length()
"""Rows of outputs that are kept, a power of two: those that the longest delay reaches, and the next one."""
INT16 = 32767
NAME = re.compile(r"[a-z][a-z0-9_]{0,39}")


@dataclass(frozen=True, kw_only=True, eq=False)
class Vectors:
    """What the controller does from its reset on: readings [steps, sensors], commands [steps, 2]."""

    readings: NDArray[np.int64]
    commands: NDArray[np.int64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Fed:
    """The sensors of one kind that a robot has, and how their readings become inputs.

    Attributes:
        kind: "proximity" or "ambient"; there: how many; top: the highest count that one reads.
        edges: a reading from an edge on (`rising`), or up to it, is one more than −10.
    """

    kind: str
    there: int
    top: int
    edges: tuple[int, ...]
    rising: bool


@dataclass(frozen=True, kw_only=True, eq=False)
class OnBoard:
    """A controller in whole numbers.

    Attributes:
        name: prefix of files and functions: lower-case letters, digits, underscores.
        facts: what it is and where it came from, a line each; profile: the robot's name.
        channels: the kinds of sensors that are read, proximity before ambient; sensors: those that the
            inputs are made of, numbered through all kinds.
        thresholds: of each neuron, the left and the right motor first; link_end: behind its last link.
        sources: neuron of each link, the inputs first; weights; delays, in updates.
        commands: of the outputs −10 … 10, in the robot's units.
        period_s: length of a step; speeds: cm/s of one unit, left and right.
        vectors: to test it with.
    """

    name: str
    facts: tuple[str, ...]
    profile: str
    channels: tuple[Fed, ...]
    sensors: tuple[int, ...]
    thresholds: tuple[int, ...]
    link_end: tuple[int, ...]
    sources: tuple[int, ...]
    weights: tuple[int, ...]
    delays: tuple[int, ...]
    commands: tuple[int, ...]
    period_s: float
    speeds: tuple[float, float]
    vectors: Vectors

    @property
    def there(self) -> int:
        """How many sensors are read."""
        return sum(channel.there for channel in self.channels)

    @property
    def rows(self) -> int:
        """Rows of outputs that are kept."""
        return ROWS

    @property
    def updates(self) -> int:
        """Updates of the network in a step."""
        return UPDATES

    @property
    def state_bytes(self) -> int:
        """Of a controller's memory in C."""
        return ROWS * (len(self.sensors) + len(self.thresholds)) + 1


def on_board(run: Run, who: str, genes: Genes, *, name: str = "controller", steps: int = 200) -> OnBoard:
    """A run's individual for a robot's own processor.

    Args:
        run: where it evolved; its study's profile says how readings become inputs and outputs commands.
        who: the individual in words: champion, fittest, evaluation 12.
        genes: its genotype.
        name: prefix of files and functions.
        steps: length of its test vectors.

    Raises:
        UsageError: a name that is not valid in C and Python.
        StudyError: a network or a range too large for 16 bits, or a period that is not whole milliseconds.
    """
    must_be(run, Run, "run", "study.run(1) is one.")
    study, profile, task = run.study, run.study.profile, run.study.facts(run.task)
    feeds, sensors = str(task["feeds"]), tuple(task["sensors"])
    if not NAME.fullmatch(name) or iskeyword(name):
        raise UsageError(
            "name: expected a lower-case letter, then letters, digits and underscores (40 at most), not a "
            f"Python keyword, got {name!r}."
        )
    channels = tuple(_fed(profile, kind) for kind in feeds.split("+"))
    commands = tuple(profile.wheels.command(value) for value in range(-LIMIT, LIMIT + 1))
    _require_small(study, max(channel.top for channel in channels), commands)
    controller = controller_of(study.encoding(run.task), genes)
    return OnBoard(
        name=name, facts=_facts(run, who, genes), profile=_plain(profile.name), channels=channels,
        sensors=sensors, **_network(run, genes), commands=commands, period_s=profile.period_s,
        speeds=profile.wheels.speed_per_unit_cm_s,
        vectors=_vectors(controller, profile, channels, sensors, commands, steps),
    )  # fmt: skip


def _require_small(study: Study, top: int, commands: tuple[int, ...]) -> None:
    """Refuse what a small processor cannot keep to."""
    where, period_ms = f"{study.folder}: profile {study.profile.name!r}", 1000 * study.profile.period_s
    largest = max(map(abs, commands))
    if max(top, largest) > INT16 - 1:
        raise StudyError(
            f"{where}: expected readings and commands up to {INT16 - 1} (int16_t), got readings up to {top} "
            f"and commands up to {largest}. Evolve with a profile in coarser units."
        )
    if abs(period_ms - round(period_ms)) > 1e-6:
        raise StudyError(
            f"{where}: expected a period of whole milliseconds, which chips count in, got {period_ms:g} ms."
        )


def _fed(profile: Profile, kind: str) -> Fed:
    """Where an input grows by one, by trying every reading; an edge that none reaches lies beyond all."""
    channel = profile.channel(kind)
    top, one = int(channel.top), [0]
    blank = [0.0] * len(channel.sensors)
    inputs = np.array([profile.inputs([reading, *blank[1:]], kind, one)[0] for reading in range(top + 1)])
    rising = channel.bands[0] < channel.bands[1]
    edges = []
    for value in range(1 - LIMIT, LIMIT + 1):
        reached = np.flatnonzero(inputs >= value)
        if rising:
            edges.append(int(reached[0]) if len(reached) else top + 1)
        else:
            edges.append(int(reached[-1]) if len(reached) else -1)
    return Fed(kind=kind, there=len(channel.sensors), top=top, edges=tuple(edges), rising=rising)


def _network(run: Run, genes: Genes) -> dict[str, tuple[int, ...]]:
    """Thresholds and links of the neurons that count, in the order of slots."""
    nets = run.study.networks(run.task, genes)
    inputs, into = int(nets.inputs[0]), links_into(nets)
    neurons = len(into)
    thresholds = nets.thresholds[0, :neurons].tolist()
    most = max(LIMIT * sum(abs(w) for _, w, _ in links) + LIMIT for links in into)
    if most > INT16 or inputs + neurons > 255:
        raise StudyError(f"{run.study.folder}: run {run.id}: its network is too large to add up in 16 bits.")
    links = [link for part in into for link in part]
    return {
        "thresholds": tuple(thresholds), "link_end": tuple(np.cumsum([len(part) for part in into]).tolist()),
        "sources": tuple(s for s, _, _ in links), "weights": tuple(w for _, w, _ in links),
        "delays": tuple(d for _, _, d in links),
    }  # fmt: skip


def _facts(run: Run, who: str, genes: Genes) -> tuple[str, ...]:
    digest = hashlib.sha256(genes.tobytes()).hexdigest()[:16]
    study = run.study
    folder, robot = _plain(study.folder.resolve().name), _plain(study.profile.name)
    return (
        f"{run.task}, evolved at noise {run.noise:g}: {who} of run {run.id}.",
        f"Study {folder}, seed {run.seed}; robot's profile {robot}; genotype sha256 {digest}.",
        f"Made by realitygap {__version__}.",
    )


def _plain(text: str) -> str:
    """A name without what would end a comment or a text."""
    return re.sub(r"[^\w .-]", "_", text)


def _vectors(
    controller: NetworkController, profile: Profile, channels: tuple[Fed, ...], sensors: tuple[int, ...],
    commands: tuple[int, ...], steps: int,
) -> Vectors:  # fmt: skip
    """A walk through readings: some hold, some drift, some jump, all within the sensors' range."""
    top = np.repeat([one.top for one in channels], [one.there for one in channels])
    feeds, there = "+".join(one.kind for one in channels), len(top)
    random, now = np.random.default_rng(1995), np.zeros(there)
    readings, made = np.empty((steps, there), np.int64), np.empty((steps, 2), np.int64)
    controller.reset()
    for i in range(steps):
        jump = random.random(there) < 0.1
        now = np.where(jump, random.uniform(0, top, there), now + random.normal(0, 0.03 * top, there))
        now = np.clip(now, 0, top)
        readings[i] = np.rint(now)
        given = controller.decide(profile.inputs(readings[i].tolist(), feeds, sensors))
        made[i] = commands[given.left + LIMIT], commands[given.right + LIMIT]
    return Vectors(readings=readings, commands=made)
