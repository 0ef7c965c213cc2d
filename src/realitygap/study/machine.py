"""The processor that a result was made on: some bits depend on it, as they do on versions."""

import platform
import re
import subprocess
from functools import cache
from pathlib import Path

__all__ = ["processor"]

CPUINFO = Path("/proc/cpuinfo")
DECISIVE = (
    "FMA3", "AVX2", "AVX512F", "AVX512_SKX", "AVX512_ICL", "AVX512_SPR", "ASIMD", "ASIMDFHM", "SVE",
)  # fmt: skip
"""Instruction sets for which NumPy and C libraries have code of their own, whose last bits may differ."""


@cache
def processor() -> str:
    """Its model, and its decisive instruction sets as NumPy uses them (NPY_DISABLE_CPU_FEATURES heeded)."""
    sets = ", ".join(name for name in DECISIVE if _features().get(name))
    return f"{_model()} ({sets})" if sets else _model()


def _model() -> str:
    """As its maker calls it, else the kind of machine."""
    try:
        if platform.system() == "Darwin":
            asked = ["/usr/sbin/sysctl", "-n", "machdep.cpu.brand_string"]
            return subprocess.run(asked, capture_output=True, text=True, check=True, timeout=5).stdout.strip()
        found = re.search(r"^model name\s*:\s*(.+)$", CPUINFO.read_text("utf-8"), re.MULTILINE)
    except (OSError, ValueError, subprocess.SubprocessError):
        found = None
    return found[1].strip() if found else platform.machine()


def _features() -> dict[str, bool]:
    """What NumPy found; nothing where it keeps that elsewhere than today."""
    try:
        from numpy._core._multiarray_umath import __cpu_features__  # type: ignore[import-not-found]
    except ImportError:
        return {}
    return dict(__cpu_features__)
