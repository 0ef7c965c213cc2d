"""§6.1 and §6.2: what a robot is to do: arena, starts, sensors fed, length and score."""

from realitygap.tasks.load import TASKS, copy_task, load_task
from realitygap.tasks.task import Start, Task

__all__ = ["TASKS", "Start", "Task", "copy_task", "load_task"]
