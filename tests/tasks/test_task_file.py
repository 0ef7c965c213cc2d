"""A user's task file: it runs compiled, its machine code is kept, and its mistakes are named."""

import os
import pickle
import subprocess
import sys
from pathlib import Path

import numba
import pytest

from realitygap.errors import TaskError
from realitygap.tasks import copy_task, load_task
from realitygap.tasks.score import example
from realitygap.world.arena import load_arena
from realitygap.world.robot import load_profile

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
HEAD = "from realitygap import Start, Task\n"
SCORE = "def score(path, room):\n    return path.x[0] + room.radius\n"
TAIL = (
    "task = Task(name='mine', arena='light-seeking', feeds='ambient', start=Start(x_cm=15, y_cm=35), "
    "score=score)\n"
)
compiler = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="the compiler is off")


@pytest.fixture
def mine(tmp_path):
    """Write a task file and return its path."""

    def write(text: str) -> Path:
        file = tmp_path / "mine.py"
        file.write_text(text, encoding="utf-8")
        return file

    return write


def test_a_users_file(mine):
    """A file that defines `task` gives that task, with its path as source."""
    file = mine(HEAD + SCORE + TAIL)
    task = load_task(str(file))
    assert task.name == "mine" and task.title == "Mine" and task.source == str(file)
    path, room = example()
    assert task.compiled_score()(path, room) == 2.9


def test_what_a_file_prints_is_not_taken_for_the_answer(mine, capsys):
    """It goes to stderr: on stdout it would stand before a command's JSON."""
    load_task(str(mine("print('here')\n" + HEAD + SCORE + TAIL)))
    told = capsys.readouterr()
    assert not told.out and "here" in told.err


def test_an_edited_file_is_read_again(mine):
    """A file that changed gives its new score, in the same process."""
    path, room = example()
    for text in (SCORE, SCORE.replace("+ room", "- room")):
        score = load_task(mine(HEAD + text + TAIL)).compiled_score()
        assert score(path, room) == (2.9 if text == SCORE else -2.9)


@compiler
def test_machine_code_is_kept_across_processes(mine, tmp_path):
    """A second process loads the compiled score of a user's file instead of compiling it."""
    file = mine(HEAD + SCORE + TAIL)
    program = (
        "from realitygap.tasks import copy_task, load_task; import sys;"
        "stats = load_task(sys.argv[1]).compiled_score().compiled.stats;"
        "print(sum(stats.cache_hits.values()), sum(stats.cache_misses.values()))"
    )
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache")}
    environment.pop("NUMBA_CACHE_DIR", None)
    told = [
        subprocess.run(
            [sys.executable, "-c", program, str(file)],
            env=environment, capture_output=True, text=True, check=True, timeout=120,
        ).stdout.split()
        for _ in range(2)
    ]  # fmt: skip
    assert told == [["0", "1"], ["1", "0"]]


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("def score(path:\n    return 1\n", "mine.py, line 1: not valid Python"),
        (HEAD, "mine.py: expected a task, got no `task`"),
        ("task = 3\n", "mine.py: expected a task, got `task` = 3"),
        ("x = 1\n1 / 0\n", "mine.py, line 2: the file fails with ZeroDivisionError: division by zero"),
        ("import nowhere_at_all\n", "mine.py, line 1: the file fails with ModuleNotFoundError"),
        ("raise SystemExit(3)\n", "mine.py, line 1: the file fails with SystemExit: 3"),
        ("raise BaseException(3)\n", "mine.py, line 1: the file fails with BaseException: 3"),
        (HEAD + TAIL, "mine.py, line 2: the file fails with NameError: name 'score' is not defined"),
        (HEAD + SCORE + TAIL.replace("x_cm=15", "x_cm='15'"), "mine.py, line 4: x_cm: expected a number"),
        (HEAD + SCORE + TAIL.replace("'light-seeking'", "'gone.toml'"), "gone.toml: no such file"),
    ],
)
def test_mistakes_are_named(mine, text, told):
    """A mistake in a user's file is one message with the file, the line and the cure."""
    with pytest.raises(TaskError) as caught:
        load_task(mine(text))
    assert told in str(caught.value) and "\n" not in str(caught.value)


@compiler
@pytest.mark.parametrize(
    ("body", "told"),
    [
        ("    pass", "line 2: score: expected a function that returns a float, it returns none"),
        ("    return 1", "it returns Literal"),
        ("    return path.x", "it returns array"),
        ("    if room.radius > 3:\n        return 1.0", "it returns Opt"),
        (
            "    a = 1\n    return path.speed[0]",
            "line 4: the score cannot be compiled: there is no path.speed: path has x, y, heading, left,",
        ),
        ("    return elsewhere(path)", "line 3: the score cannot be compiled: NameError"),
        ("    return float(open('x').read())", "the score cannot be compiled: Untyped global name 'open'"),
        ("    import math\n    return math.pi", "the score cannot be compiled"),
        ("    return np.no_such_name(path.x)", "the score cannot be compiled"),
    ],
)
def test_a_score_that_cannot_be_compiled(mine, body, told):
    """A score that does not compile is refused in one line that names file, line and reason."""
    text = f"{HEAD}def score(path, room):\n{body}\nimport numpy as np\n{TAIL}"
    task = load_task(mine(text))
    with pytest.raises(TaskError) as caught:
        task.compiled_score()
    assert told in str(caught.value) and "mine.py" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_example_task():
    """The example follows walls in its own arena: near a wall and free counts, elsewhere does not."""
    task, paper = load_task(EXAMPLES / "follow_the_wall.py"), load_profile("paper")
    assert task.arena == load_arena(EXAMPLES / "two_rooms.toml") and len(task.arena.lamps) == 2
    path, room = example()
    room = task.room(paper)
    beside = path._replace(x=path.x + 5, y=path.y + 30, left=path.left + 8, right=path.right + 8)
    score = task.compiled_score()
    assert score(beside, room) == 1.0
    assert score(beside._replace(x=path.x + 25), room) == 0.0
    assert score(beside._replace(contact=path.contact + 1), room) == 0.0
    assert task.to_kernel(paper).steps == 200


def test_another_process_has_a_tasks_score_from_its_file(mine):
    """A pickled task brings no function that only this process could import, as a report's workers found."""
    task = load_task(mine(HEAD + SCORE + TAIL))
    told, paper = pickle.dumps(task), load_task("light-seeking")
    del sys.modules[task.score.__module__]
    again = pickle.loads(told)
    assert again.to_dict() == task.to_dict() and again.source == task.source
    assert again.score.__code__ == task.score.__code__
    assert pickle.loads(pickle.dumps(paper)) == paper
    mine("# a line more\n" + HEAD + SCORE + TAIL)
    with pytest.raises(TaskError, match=r"mine.py: expected the task's score in line \d+"):
        pickle.loads(told)


def test_a_copied_task_finds_its_arena(mine, tmp_path):
    """A task file and the arena beside it are copied together; an arena elsewhere is refused."""
    task = load_task(EXAMPLES / "follow_the_wall.py")
    copy = load_task(copy_task(task, tmp_path / "study"))
    assert copy.to_dict() == task.to_dict() and copy.source != task.source
    (tmp_path.parent / "far.toml").write_text(task.arena.to_toml(), encoding="utf-8")
    far = load_task(mine(HEAD + SCORE + TAIL.replace("'light-seeking'", "'../far.toml'")))
    with pytest.raises(TaskError, match=r"arena: expected a file in the task file's own folder"):
        copy_task(far, tmp_path / "study")


@pytest.mark.parametrize(
    ("body", "told"),
    [
        (
            "    a = 0.0\n    for i in range(path.x.size):\n        a += path.x[i + 1]\n    return a",
            "line 5: the score fails with IndexError: index 200 is out of bounds",
        ),
        ("    return path.x[-201]", "line 3: the score fails with IndexError"),
        ("    return room.lamps[1, 0]", "line 3: the score fails with IndexError"),
        ("    return 1.0 + BIG[int(path.x.max()) - 1]", "line 3: the score fails with IndexError"),
        ("    return random.random()", "line 3: a score draws nothing at random: remove `random`"),
        ("    return np.random.rand() + path.x[0]", "line 3: a score draws nothing at random"),
        ("    return path.x[0] + draw()", "line 3: a score draws nothing at random: remove `draw`"),
        ("    path.x[0] = 3.0\n    return path.x.mean()", "line 2: the score changes the path"),
        (
            "    lamp = room.lamps[0]\n    lamp[0] -= path.x[0]\n    return lamp[0]",
            "line 2: the score changes the room that it is given. Work on a copy, as in room.lamps.copy()",
        ),
        (
            "    n = 1\n    for i in range(70):\n        n = n * 2\n    return float(n)",
            "line 2: the score gives 0.0 compiled and 1.1805916207174113e+21 as plain Python",
        ),
        ("    n = path.x.size\n    return float(7 // (n - 200))", "line 2: the score gives "),
    ],
)
def test_a_score_that_cannot_be_believed(mine, body, told):
    """An index out of range, chance and what compiles to something else are refused by line."""
    head = "import random; import numpy as np; from random import random as draw; BIG = np.zeros(100)\n"
    if numba.config.DISABLE_JIT and ("compiled" in told or "gives " in told):
        pytest.skip("nothing is compiled that could differ")
    text = head + f"def score(path, room):\n{body}\n" + HEAD + TAIL
    with pytest.raises(TaskError) as caught:
        load_task(mine(text)).compiled_score()
    assert f"mine.py, {told}" in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "body",
    [
        "    return path.x[199] - path.x[0]",  # right for a trial of 200 steps
        "    return room.lamps[0, 0] + room.lamps[:, 1].sum()",
        "    return np.hypot(path.x - room.lamps[0, 0], path.y).mean() / path.contact.sum()",
        "    return math.sqrt(path.x.sum() - 1e6)",
    ],
)
def test_a_score_that_suits_its_task_is_taken(mine, body):
    """What is right at the task's own length and in its own room is no fault, nor is a bad value."""
    head = "import math; import numpy as np\n"
    load_task(mine(head + f"def score(path, room):\n{body}\n" + HEAD + TAIL)).compiled_score()


@compiler
def test_an_index_out_of_range_is_never_read(mine):
    """An index that no example reaches is refused where it happens: a shorter trial, a rare value."""
    from realitygap import Genotype, Simulation

    text = "def score(path, room):\n    return path.x[150]\n"
    simulation = Simulation(load_task(mine(text + HEAD + TAIL)), "paper")
    still = Genotype.constant(0, 0).networks()
    assert simulation.trajectory(still, stream=1)[1] > 0
    with pytest.raises(TaskError, match=r"mine.py, line 2: .*IndexError.* This path has 10 rows"):
        simulation.trajectory(still, stream=1, seconds=1.0)
