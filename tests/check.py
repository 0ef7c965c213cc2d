"""Everything that a change must pass, in order: style, types, import rules, tests.

Run from anywhere with the environment's own Python: `python tests/check.py`. Words after it go
to pytest, whose four workers keep two cores busy: some tests wait. Stops at the first that fails; the last
line is pytest's summary.
"""

import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

CHECKS = (
    ("ruff", ["-m", "ruff", "check", "."]),
    ("ruff format", ["-m", "ruff", "format", "--check", "-q", "."]),
    ("mypy", ["-m", "mypy"]),
    ("import-linter", ["-c", "from importlinter.cli import lint_imports_command as check; check()"]),
    ("pytest", ["-m", "pytest", "-n", "4", "--dist", "loadfile", "--no-loadscope-reorder", *sys.argv[1:]]),
)
PROJECT = Path(__file__).resolve().parent.parent


def main() -> int:
    """Run the checks; the first failure's exit code, or 0."""
    if sys.argv[1:]:  # some of the tests
        return checked()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as fresh:
        # Meanwhile the other core compiles what most tests need; tests/kernels/test_same_bits.py judges it.
        words = [sys.executable, "-m", "tests.kernels.child", fresh]
        compiler = subprocess.Popen(words, cwd=PROJECT, process_group=0)
        try:
            os.environ["COMPILED_AFRESH"] = fresh
            return checked(compiler)
        finally:
            if compiler.poll() is None:
                os.killpg(compiler.pid, signal.SIGKILL)
                compiler.wait()


def checked(compiler: subprocess.Popen[bytes] | None = None) -> int:
    """Each check in turn, the tests once the compiler is through."""
    for name, command in CHECKS:
        print(f"== {name}", flush=True)
        if name == "pytest" and compiler and compiler.wait():
            print(f"kernels were not compiled (exit code {compiler.returncode})", file=sys.stderr)
            return compiler.returncode
        code = subprocess.run([sys.executable, *command], cwd=PROJECT, check=False).returncode
        if code:
            print(f"{name} failed (exit code {code})", file=sys.stderr)
            return code
    return 0


if __name__ == "__main__":
    sys.exit(main())
