"""Everything that a change must pass, in order: style, types, import rules, tests.

Run from anywhere with the environment's own Python: `python tests/check.py`. Words after it go
to pytest, which runs on two cores. Stops at the first that fails; the last line is pytest's summary.
"""

import subprocess
import sys
from pathlib import Path

CHECKS = (
    ("ruff", ["-m", "ruff", "check", "."]),
    ("ruff format", ["-m", "ruff", "format", "--check", "-q", "."]),
    ("mypy", ["-m", "mypy"]),
    ("import-linter", ["-c", "from importlinter.cli import lint_imports_command as check; check()"]),
    ("pytest", ["-m", "pytest", "-n", "2", "--dist", "loadfile", *sys.argv[1:]]),
)


def main() -> int:
    """Run the checks; the first failure's exit code, or 0."""
    project = Path(__file__).resolve().parent.parent
    for name, command in CHECKS:
        print(f"== {name}", flush=True)
        code = subprocess.run([sys.executable, *command], cwd=project, check=False).returncode
        if code:
            print(f"{name} failed (exit code {code})", file=sys.stderr)
            return code
    return 0


if __name__ == "__main__":
    sys.exit(main())
