"""An `OnBoard` written as source, and how much room it takes on small processors."""

import shutil
import subprocess
from pathlib import Path

from realitygap import temporary, whole
from realitygap.errors import UsageError
from realitygap.export.onboard import OnBoard

__all__ = ["LANGUAGES", "sizes", "write_source"]

LANGUAGES = {
    "c99": {"network.h.j2": "{}.h", "network.c.j2": "{}.c", "test.c.j2": "test_{}.c"},
    "micropython": {"network.py.j2": "{}.py", "test.py.j2": "test_{}.py"},
    "arduino": {"network.h.j2": "{}.h", "network.c.j2": "{}.c", "sketch.ino.j2": "{}.ino"},
}
"""Templates of each language, and what becomes of them."""
CHIPS = {
    "ATmega328P": ("avr-gcc", "-mmcu=atmega328p"),
    "Cortex-M0+": ("arm-none-eabi-gcc", "-mcpu=cortex-m0plus", "-mthumb"),
}
"""Compilers that a machine may have, and for what."""


def write_source(one: OnBoard, language: str, folder: Path) -> list[Path]:
    """Write a controller as source into a folder; of an Arduino sketch the folder has its name.

    Args:
        one: the controller.
        language: one of LANGUAGES.
        folder: where to; made if it is not there. Files of the same names are replaced.

    Returns:
        The files written.

    Raises:
        UsageError: another language.
        OSError: one cannot be written.
    """
    if language not in LANGUAGES:
        raise UsageError(f"language: expected {', '.join(LANGUAGES)}, got {language!r}.")
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("realitygap.export"), undefined=StrictUndefined, autoescape=False,
        trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True,
    )  # fmt: skip
    folder = folder / one.name if language == "arduino" else folder
    folder.mkdir(parents=True, exist_ok=True)
    facts = _facts(one)
    made = []
    for template, name in LANGUAGES[language].items():
        made.append(folder / name.format(one.name))
        whole.write(made[-1], environment.get_template(template).render(facts))
    return made


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
        "pins": [f"A{i}" for i in range(one.there)], "profile": one.profile,
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
