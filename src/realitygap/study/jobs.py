"""A job is a whole run, from its checkpoint to its tests, told in messages to whoever writes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from realitygap.evolution.algorithm import State
from realitygap.study.materials import Materials
from realitygap.study.plan import Plan, plans
from realitygap.study.run import WHO, Bench, Records, Results, advance, begin, bench_for, finish
from realitygap.tasks.task import Task
from realitygap.world.noise import NOISE_LEVELS

__all__ = ["Advanced", "Finished", "Job", "Message", "Workshop"]

AMBIENT_COST = 2.5
"""Time of a step that senses light, by that of one that senses walls: a hint for the order of work."""


class Job(NamedTuple):
    """A run to be carried on from a checkpoint (None: from its beginning)."""

    run: int
    checkpoint: bytes | None


class Advanced(NamedTuple):
    """Evaluations of a run, and its state after them."""

    run: int
    records: Records
    state: State


class Finished(NamedTuple):
    """A run's tests: there is nothing more to do on it."""

    run: int
    results: Results


Message = Advanced | Finished


class Workshop:
    """Carries out the runs of one study, with a bench for each condition made when first needed."""

    def __init__(self, materials: Materials) -> None:
        self.config = materials.config
        self._materials = materials
        self._plans = {plan.id: plan for plan in plans(materials)}
        self._benches: dict[int, Bench] = {}

    def plan(self, run: int) -> Plan:
        """The plan of a run."""
        return self._plans[run]

    def compile(self) -> None:
        """Load or compile once all that the conditions' runs call."""
        for condition in range(len(self._materials.tasks)):
            self._bench(condition).compile()

    def carry_out(self, job: Job) -> Iterator[Message]:
        """A run's messages, one for each checkpoint, then its tests."""
        plan = self._plans[job.run]
        bench = self._bench(plan.condition)
        state = begin(bench, plan) if job.checkpoint is None else State.from_bytes(job.checkpoint)
        while (left := self.config.evaluations - state.evaluations) > 0:
            state, records = advance(bench, plan, state, min(left, self.config.checkpoint_every))
            yield Advanced(job.run, records, state)
        yield Finished(job.run, finish(bench, plan, state))

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
