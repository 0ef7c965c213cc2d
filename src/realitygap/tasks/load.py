"""Tasks by name, and tasks from a user's Python file."""

import copyreg
import shutil
from dataclasses import fields, replace
from difflib import get_close_matches
from os import PathLike
from os.path import isfile
from pathlib import Path
from typing import Any

from realitygap.errors import TaskError
from realitygap.plugins import run_file
from realitygap.tasks.task import Task

__all__ = ["TASKS", "copy_task", "load_task", "reference"]

TASKS = ("obstacle-avoidance", "light-seeking")
"""The paper's tasks (§6.1, §6.2)."""
NO_TASK = "task: expected a Task, a task's name or a .py file"


def load_task(name_or_file: str | PathLike[str] | Task) -> Task:
    """A task from its name or from a user's Python file.

    Args:
        name_or_file: one of TASKS, one word of such a name ("light"), or the path of a .py file
            that defines `task = Task(…)`. The file is run. A Task stays itself.

    Raises:
        TaskError: unknown name, or a file that cannot be used: names the file and the line.
    """
    if isinstance(name_or_file, Task):
        return name_or_file
    if not isinstance(name_or_file, str | PathLike):
        raise TaskError(f"{NO_TASK}, got {name_or_file!r}.")
    text = str(name_or_file).strip()
    tidy = text.lower().replace("_", "-").replace(" ", "-")
    for name in TASKS:
        if tidy == name or tidy in name.split("-"):
            from realitygap.tasks import paper

            task: Task = getattr(paper, name.replace("-", "_"))
            return task
    path = Path(text).expanduser()
    if path.suffix != ".py" and not isfile(path):
        near = get_close_matches(tidy, TASKS, n=1, cutoff=0.5)
        hint = f" Did you mean {near[0]!r}?" if near else ""
        raise TaskError(
            f"unknown task {text!r}.{hint} Known: {', '.join(TASKS)}; or give the path of a .py file "
            "that defines `task = Task(…)`."
        )
    return _from_file(path)


def reference(task: object) -> str:
    """The name or file that a task is loaded from again: what a study writes down.

    Raises:
        TaskError: a Task that no file holds, or that has been changed since it was loaded.
    """
    if isinstance(task, PathLike):
        return str(Path(task))
    if not isinstance(task, Task):
        if not isinstance(task, str):
            raise TaskError(f"{NO_TASK}, got {task!r}.")
        return task
    if task.source is None and task.name not in TASKS:
        cure = "A study keeps its task's file: write the task into one, and give that."
        raise TaskError(f"task {task.name!r}: expected one that was loaded from a file. {cure}")
    place = task.source or task.name
    there = load_task(place)
    if there.to_dict() != task.to_dict() or there.score.__code__ != task.score.__code__:
        cure = "Change it there, or give the study task.seconds, task.trials, task.sensors or arenas."
        raise TaskError(f"task {task.name!r} no longer matches {place}. {cure}")
    return place


def copy_task(task: Task, folder: Path) -> Path:
    """Copy a user's task file into `folder`, its arena's file beside it as the task names it.

    Returns:
        The copy's path, from which `load_task` gives an equal task.

    Raises:
        TaskError: the arena's file lies outside the task file's folder, so no copy could find it.
    """
    if task.source is None:
        raise TaskError(f"task {task.name!r} comes with the package: it has no file to copy.")
    source = Path(task.source)
    copies = [source.name]
    if task.arena_file is not None and not Path(task.arena_file).is_absolute():
        if ".." in Path(task.arena_file).parts or not (source.parent / task.arena_file).is_file():
            told = f"expected a file in the task file's own folder, got {task.arena_file!r}"
            raise TaskError(f"{source}: arena: {told}. Move it there, or give its whole path.")
        copies.append(task.arena_file)
    for name in copies:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source.parent / name, folder / name)
    return folder / source.name


def _from_file(path: Path) -> Task:
    if not isfile(path) or path.suffix != ".py":  # unlike Path.is_file, of too long a name, too
        found = "expected a Python file (.py)" if isfile(path) else "no such file"
        raise TaskError(f"{path}: {found}. Give the path of a .py file that defines `task = Task(…)`.")
    path = path.resolve()
    module = run_file(path, TaskError, anew=True)
    task = getattr(module, "task", None)
    if not isinstance(task, Task):
        got = "no `task`" if task is None else f"`task` = {task!r}"
        raise TaskError(
            f"{path}: expected a task, got {got}. Add `task = Task(name=…, arena=…, feeds=…, start=…, "
            "score=score)`, with Task from realitygap."
        )
    return replace(task, source=str(path))


def _pickled(task: Task) -> tuple[Any, ...]:
    """A task without a score that stands in its own file: another process has to run that file to have it."""
    state = {field.name: getattr(task, field.name) for field in fields(task)}
    code = task.score.__code__
    if task.source != code.co_filename:
        return _unpickled, (state, 0)
    return _unpickled, ({**state, "score": None}, code.co_firstlineno)


def _unpickled(state: dict[str, Any], line: int) -> Task:
    """That task again, its score from its file if it stands there in this line."""
    if line:
        state["score"] = load_task(state["source"]).score
        if state["score"].__code__.co_firstlineno != line:
            told = f"{state['source']}: expected the task's score in line {line}, as when it was loaded"
            raise TaskError(f"{told}. The file has changed: load the task again.")
    task = Task.__new__(Task)
    vars(task).update(state)
    return task


copyreg.pickle(Task, _pickled)
