"""A job is a whole run, from its checkpoint to its tests, told in messages to whoever writes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import NamedTuple

from realitygap.errors import UsageError
from realitygap.evolution.algorithm import State
from realitygap.study.materials import Materials
from realitygap.study.plan import Plan, plans
from realitygap.study.run import WHO, Bench, Records, Results, advance, begin, bench_for, finish
from realitygap.tasks.task import Task
from realitygap.user_code import blamed_on
from realitygap.values import Closing
from realitygap.work.pool import Tell
from realitygap.world.noise import NOISE_LEVELS

__all__ = ["Advanced", "Finished", "Job", "Message", "Workshop"]

AMBIENT_COST = 2.5
"""Time of a step that senses light, by that of one that senses walls: a hint for the order of work."""


class Job(NamedTuple):
    """A run to be carried on from a checkpoint (None: from its beginning)."""

    run: int
    checkpoint: bytes | None


class Kept(NamedTuple):
    """What the store keeps of a run's state."""

    evaluations: int
    best_fitness: float
    best_number: int
    state: bytes


class Advanced(NamedTuple):
    """Evaluations of a run, and its state after them."""

    run: int
    records: Records
    kept: Kept


class Finished(NamedTuple):
    """A run's tests: there is nothing more to do on it."""

    run: int
    results: Results


Message = Advanced | Finished


class Workshop:
    """Carries out the runs of one study, with a bench for each condition made when first needed."""

    home: Closing | None = None
    """Of the files, where they came in messages."""

    def __init__(self, materials: Materials) -> None:
        self.config = materials.config
        self._materials = materials
        self._plans = {plan.id: plan for plan in plans(materials)}
        self._benches: dict[int, Bench] = {}

    @property
    def runs(self) -> list[int]:
        """Ids of all runs."""
        return list(self._plans)

    def plan(self, run: int) -> Plan:
        """The plan of a run."""
        return self._plans[run]

    def compile(self) -> None:
        """Load or compile once all that the conditions' runs call."""
        for condition in range(len(self._materials.tasks)):
            with self._blamed():
                self._bench(condition).compile()

    def carry_out(self, job: Job, tell: Tell) -> None:
        """A run; `tell` hears its messages."""
        for message in self.messages(job):
            tell(message)

    def close(self) -> None:
        """Remove files that came in messages."""
        if self.home is not None:
            self.home.close()

    def messages(self, job: Job) -> Iterator[Message]:
        """A run's messages, one for each checkpoint, then its tests."""
        plan = self._plans[job.run]
        bench = self._bench(plan.condition)
        with self._blamed():
            state = begin(bench, plan) if job.checkpoint is None else self.read(job.run, job.checkpoint)
        while (left := self.config.evaluations - state.evaluations) > 0:
            with self._blamed():
                state, records = advance(bench, plan, state, min(left, self.config.checkpoint_every))
                kept = Kept(
                    state.evaluations, float(state.best_fitness), int(state.best_number), state.to_bytes()
                )
            yield Advanced(job.run, records, kept)
        with self._blamed():
            results = finish(bench, plan, state)
        yield Finished(job.run, results)

    def read(self, run: int, checkpoint: bytes) -> State:
        """The state that a run goes on from.

        Raises:
            StudyError: the checkpoint is damaged.
        """
        state: State = self._bench(self._plans[run].condition).algorithm.from_bytes(checkpoint)
        return state

    @contextmanager
    def _blamed(self) -> Iterator[None]:
        """What goes wrong in a user's algorithm or encoding is told by their file and line."""
        with ExitStack() as stack:
            for file in self.config.own_files().values():
                stack.enter_context(blamed_on(file.resolve(), UsageError, own=True))
            yield

    def cost(self, run: int, evaluations: int) -> float:
        """About what that many evaluations of a run cost, in steps of obstacle avoidance."""
        task = self._task(run)
        return evaluations * task.trials * _step_cost(task)

    def tests_cost(self, run: int) -> float:
        """About what a run's tests cost, in the same unit."""
        task, config = self._task(run), self.config
        cells = min(self._bench(self._plans[run].condition).algorithm.cells, config.evaluations)
        trials = cells * config.retest_trials + len(WHO) * len(NOISE_LEVELS) * config.fresh_trials
        return trials * _step_cost(task)

    def _task(self, run: int) -> Task:
        return self._materials.tasks[self._plans[run].condition]

    def _bench(self, condition: int) -> Bench:
        if condition not in self._benches:
            self._benches[condition] = bench_for(self._materials, condition)
        return self._benches[condition]


def _step_cost(task: Task) -> float:
    return task.steps * (AMBIENT_COST if task.feeds == "ambient" else 1.0)
