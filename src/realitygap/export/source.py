"""An `OnBoard` written as source, and how much room it takes on small processors."""

import shutil
import subprocess
from pathlib import Path

from realitygap import temporary, whole
from realitygap.errors import StudyError, UsageError
from realitygap.export.onboard import OnBoard
from realitygap.text import as_path

__all__ = ["LANGUAGES", "sizes", "write_source"]

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
        UsageError: another language; the name main for an e-puck2's project.
        StudyError: an e-puck2's project for another robot.
        OSError: one cannot be written.
    """
    if language not in LANGUAGES:
        raise UsageError(f"language: expected {', '.join(LANGUAGES)}, got {language!r}.")
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
    facts = _facts(one)
    made = []
    for template, name in LANGUAGES[language].items():
        made.append(folder / name.format(one.name))
        whole.write(made[-1], environment.get_template(template).render(facts))
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


def _facts(one: OnBoard) -> dict[str, object]:
    links = list(zip(one.sources, one.weights, one.delays, strict=True))
    begins = (0, *one.link_end[:-1])
    neurons = [
        (threshold, tuple(links[begin:end]))
        for threshold, begin, end in zip(one.thresholds, begins, one.link_end, strict=True)
    ]
    return {
        "one": one, "name": one.name, "NAME": one.name.upper(), "links": max(1, len(links)),
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
    with temporary.Folder("size") as folder:
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
