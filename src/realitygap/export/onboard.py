"""A controller as source for a robot's own processor: C, MicroPython, Arduino."""

import hashlib
import re
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from keyword import iskeyword
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from realitygap import __version__
from realitygap.control.encoding import links_into
from realitygap.control.genotype import NetworkController
from realitygap.errors import StudyError, UsageError
from realitygap.evolution.algorithm import Genes
from realitygap.files import as_path, atomic_write, must_be
from realitygap.kernels.network import LIMIT
from realitygap.kernels.types import MAX_DELAY, UPDATES
from realitygap.study.load import Run, Study
from realitygap.world.robot import Profile

__all__ = ["LANGUAGES", "Fed", "OnBoard", "on_board", "sizes", "write_source"]


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
    controller = study.controller(run.task, genes)
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
    into = links_into(nets)
    thresholds = nets.thresholds[0, : len(into)].tolist()
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


LANGUAGES = {
    "c99": {"network.h.j2": "{}.h", "network.c.j2": "{}.c", "test.c.j2": "test_{}.c"},
    "micropython": {"network.py.j2": "{}.py", "test.py.j2": "test_{}.py"},
    "arduino": {"network.h.j2": "{}.h", "network.c.j2": "{}.c", "sketch.ino.j2": "{}.ino"},
    "e-puck2": {
        "network.h.j2": "{}.h", "network.c.j2": "{}.c", "test.c.j2": "test_{}.c", "epuck2.c.j2": "main.c",
        "epuck2.h.j2": "main.h", "epuck2.mk.j2": "makefile",
    },
}  # fmt: skip
"""Templates of each language, and the files that they become."""
CHIPS = {
    "ATmega328P": ("avr-gcc", "-mmcu=atmega328p"),
    "Cortex-M0+": ("arm-none-eabi-gcc", "-mcpu=cortex-m0plus", "-mthumb"),
}
"""Compilers that a machine may have, and for what."""
E_PUCK_STEPS_S = 1100
"""The e-puck2's library turns a wheel no faster."""


def write_source(one: OnBoard, language: str, folder: str | Path) -> list[Path]:
    """Write a controller as source into a folder; a sketch or an e-puck2's project has a folder of its name.

    Args:
        one: the controller.
        language: one of LANGUAGES.
        folder: where to; made if needed. Files of the same names are replaced.

    Returns:
        The files written.

    Raises:
        UsageError: the name main for an e-puck2's project.
        StudyError: an e-puck2's project for another robot.
        OSError: one cannot be written.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("realitygap.export"), undefined=StrictUndefined, autoescape=False,
        trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True,
    )  # fmt: skip
    if language == "e-puck2":
        _require_e_puck(one)
    folder = as_path(folder, "folder")
    folder = folder / one.name if language in ("arduino", "e-puck2") else folder
    folder.mkdir(parents=True, exist_ok=True)
    facts = _facts_of_source(one)
    made = []
    for template, name in LANGUAGES[language].items():
        made.append(folder / name.format(one.name))
        atomic_write(made[-1], environment.get_template(template).render(facts))
    return made


def _require_e_puck(one: OnBoard) -> None:
    """Refuse what that robot's library does not read, or does not command; and a name that its files have."""
    if one.name == "main":
        raise UsageError("name: expected another name than main, which the e-puck2's own file has.")
    read = all((fed.there, fed.top) == (8, 4095) for fed in one.channels)
    if not read or max(one.commands) > E_PUCK_STEPS_S:
        has = ", ".join(f"{fed.there} {fed.kind} sensors of counts up to {fed.top}" for fed in one.channels)
        raise StudyError(
            f"profile {one.profile!r}: expected an e-puck2's eight sensors of counts up to 4095 and commands "
            f"up to {E_PUCK_STEPS_S} steps/s, got {has}, commands up to {max(one.commands)}. Evolve with "
            "--profile e-puck, or with one calibrated from it."
        )


def _facts_of_source(one: OnBoard) -> dict[str, object]:
    links = list(zip(one.sources, one.weights, one.delays, strict=True))
    begins = (0, *one.link_end[:-1])
    neurons = [
        (threshold, tuple(links[begin:end]))
        for threshold, begin, end in zip(one.thresholds, begins, one.link_end, strict=True)
    ]
    return {
        "one": one, "rows": ROWS, "updates": UPDATES, "name": one.name, "NAME": one.name.upper(),
        "links": max(1, len(links)),
        "neurons": neurons, "period_ms": round(1000 * one.period_s),
        "pins": [f"A{i}" for i in range(one.there)], "profile": one.profile, "several": len(one.channels) > 1,
        "read": " and ".join(
            f"{fed.there} {fed.kind} sensors (counts 0 to {fed.top})" for fed in one.channels
        ),
    }  # fmt: skip


def sizes(source: Path) -> dict[str, int]:
    """Bytes of code and tables that a C file takes, for each of CHIPS whose compiler is installed.

    A compiler that cannot do it (one without its library) counts as not installed.
    """
    found = {}
    with tempfile.TemporaryDirectory(prefix="realitygap-") as folder:
        for chip, (compiler, *flags) in CHIPS.items():
            size = compiler.removesuffix("gcc") + "size"
            if not (shutil.which(compiler) and shutil.which(size)):
                continue
            target = Path(folder) / "one.o"
            made = _said(compiler, *flags, "-std=c99", "-Os", "-c", str(source), "-o", str(target))
            lines = (_said(size, str(target)) or "").splitlines() if made is not None else []
            if len(lines) > 1:
                text, data = lines[1].split()[:2]
                found[chip] = int(text) + int(data)
    return found


def _said(*words: str) -> str | None:
    """What a program prints; None if it fails, or takes a minute."""
    try:
        return subprocess.run(words, capture_output=True, text=True, timeout=60, check=True).stdout
    except subprocess.SubprocessError:
        return None
