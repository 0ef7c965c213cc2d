"""What is loaded when, and what every command says of itself."""

import subprocess
import sys

import pytest

import realitygap as package
from realitygap.cli import realitygap

HEAVY = ("numba", "matplotlib", "mujoco", "cv2", "serial", "rich", "sqlite3", "jinja2", "av", "filelock")

COMMANDS = [
    *((name,) for name in realitygap.commands),
    ("profile", "show"),
    ("arena", "show"),
]


@pytest.mark.parametrize("module", ["realitygap", "realitygap.cli"])
def test_importing_loads_nothing_heavy(module):
    """`import realitygap` and the command line's start load no compiler, plots, database or NumPy."""
    code = f"import sys, {module}; print(sorted(set(sys.modules) & {{*{HEAVY!r}, 'numpy'}}))"
    made = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert made.stdout.strip() == "[]"


def test_help_loads_nothing_heavy():
    """`realitygap --help` starts as quickly as an import."""
    code = (
        "import sys; from realitygap.cli import realitygap\n"
        "try: realitygap(['--help'])\n"
        f"except SystemExit: print(sorted(set(sys.modules) & {{*{HEAVY!r}}}))"
    )
    made = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert made.stdout.splitlines()[-1] == "[]"


IN_COMPILED_CODE = """
import ctypes, os, signal, time
def work():
    press = ctypes.CFUNCTYPE(None)(lambda: os.kill(os.getpid(), signal.SIGINT))
    press()
    time.sleep(30)
"""
WITH_A_BUFFER_LENT_OUT = """
import io
def work():
    circle = {'buffer': io.BytesIO(b'message')}
    circle.update(view=circle['buffer'].getbuffer(), circle=circle)
    raise KeyboardInterrupt
"""


@pytest.mark.parametrize("work", [IN_COMPILED_CODE, WITH_A_BUFFER_LENT_OUT], ids=["compiled", "buffer"])
def test_ctrl_c_ends_a_command_in_one_line(work):
    """Compiled code drops what its callbacks raise, and Python 3.13 reports buffers left in circles."""
    code = (
        f"import sys\nimport realitygap.cli\nfrom realitygap.__main__ import main\n{work}"
        "from realitygap.cli.failure import guarded\n"
        "realitygap.cli.main = lambda: sys.exit(guarded(work))\n"
        "main()"
    )
    made = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert (made.stderr, made.returncode) == ("stopped\n", 130)


def test_ctrl_c_while_commands_are_loaded():
    """Ctrl-C before there is a command to end says so in one line, with the code of Ctrl-C."""
    code = (
        "import sys\n"
        "from realitygap.__main__ import main\n"
        "class Pressed:\n"
        "    def find_spec(self, name, *_):\n"
        "        if name == 'realitygap.cli.evolve': raise KeyboardInterrupt\n"
        "sys.meta_path.insert(0, Pressed())\n"
        "main()\n"
    )
    made = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (made.returncode, made.stdout, made.stderr) == (130, "", "stopped\n")


@pytest.mark.parametrize("name", package.__all__)
def test_every_public_name_is_there(name):
    """Every name of `realitygap.__all__` can be had."""
    assert getattr(package, name) is not None


def test_an_unknown_name_is_an_attribute_error():
    """A misspelt public name ends as in any module."""
    with pytest.raises(AttributeError, match="load_stuby"):
        _ = package.load_stuby


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_every_command_has_help_with_an_example(call, words):
    """`--help` says what the command does and shows an example that names the command."""
    result = call(*words, "--help")
    assert result.exit_code == 0
    assert "Example" in result.stdout
    assert f"realitygap {' '.join(words)}" in result.stdout.split("Example")[1]


def test_without_a_command_the_help_is_shown(call):
    """`realitygap` alone shows what there is."""
    result = call()
    assert result.exit_code == 0
    assert "reproduce" in result.stdout


def test_the_version(call):
    """`--version` tells the package's version."""
    assert package.__version__ in call("--version").stdout
