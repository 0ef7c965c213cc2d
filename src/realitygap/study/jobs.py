"""A job is a whole run, from its checkpoint to its tests, sent as messages to the process that writes.

Runs go one after the other, or side by side: then the trials that they request at one time form one batch.
"""

from collections.abc import Generator, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from typing import Any, NamedTuple

import numpy as np

from realitygap.errors import UsageError
from realitygap.evolution.algorithm import State
from realitygap.study.materials import Materials
from realitygap.study.plan import plans
from realitygap.study.run import WHO, Asked, Bench, Records, Results, advance, begin, finish
from realitygap.tasks.task import Task
from realitygap.user_code import blamed_on
from realitygap.values import Closing
from realitygap.work.pool import Tell
from realitygap.world.noise import NOISE_LEVELS

__all__ = ["Advanced", "Finished", "Job", "Message", "Workshop"]

AMBIENT_COST = 2.5
"""Time of a step with ambient sensors over that with proximity sensors: a hint for the order of work."""


class Job(NamedTuple):
    """A run to continue from a checkpoint (None: from its beginning)."""

    run: int
    checkpoint: bytes | None


class Advanced(NamedTuple):
    """Evaluations of a run, and the state after them."""

    run: int
    records: Records
    evaluations: int
    best_fitness: float
    best_number: int
    state: bytes


class Finished(NamedTuple):
    """A run's tests: the run is complete."""

    run: int
    results: Results


Message = Advanced | Finished


class Workshop:
    """Carries out the runs of one study, with a bench for each condition, created when first needed."""

    home: Closing | None = None
    """Of the files, if they came in messages."""

    def __init__(self, materials: Materials, engine: str = "cores") -> None:
        self.config, self.engine = materials.config, engine
        self._materials = materials
        self._plans = {plan.id: plan for plan in plans(materials)}
        self._benches: dict[int, Bench] = {}
        self._own = [file.resolve() for file in self.config.own_files().values()]

    @property
    def runs(self) -> list[int]:
        return list(self._plans)

    def compile(self) -> None:
        """Load or compile everything that the conditions' runs call."""
        for condition in range(len(self._materials.tasks)):
            with self._blamed():
                self._bench(condition).compile()

    def carry_out(self, job: Job, tell: Tell) -> None:
        """Carry out a run; `tell` receives its messages."""
        for message in self.messages([job]):
            tell(message)

    def messages(self, jobs: Iterable[Job]) -> Iterator[Message]:
        """Messages of runs that advance side by side: one for each checkpoint of each run, then its tests."""
        runs = {job.run: self._run(job) for job in jobs}
        scores: dict[int, Any] = dict.fromkeys(runs)
        while runs:
            asked: dict[int, Asked] = {}
            for run, told in list(runs.items()):
                try:
                    while not isinstance(item := told.send(scores.pop(run, None)), Asked):
                        yield item
                    asked[run] = item
                except StopIteration:
                    del runs[run]
            scores = self._scores(asked)

    def _scores(self, asked: Mapping[int, Asked]) -> dict[int, Any]:
        """The scores that each run asked for; similar trials of one condition go in one batch."""
        like: dict[tuple[int, float, int], list[int]] = {}
        for run, one in asked.items():
            like.setdefault((self._plans[run].condition, one.noise, one.streams.shape[1]), []).append(run)
        scores: dict[int, Any] = {}
        for (condition, noise, _), runs in like.items():
            with self._blamed():
                bench = self._bench(condition)
                if len(runs) == 1:
                    scores[runs[0]] = bench.scores(asked[runs[0]])
                    continue
                genes = [asked[run].genes for run in runs]
                streams = np.concatenate([asked[run].streams for run in runs])
                found = bench.scores(Asked(noise, np.concatenate(genes), streams))
            ends = np.cumsum([len(one) for one in genes])
            scores |= dict(zip(runs, np.split(found, ends[:-1]), strict=True))
        return scores

    def close(self) -> None:
        """Remove files that came in messages."""
        if self.home is not None:
            self.home.close()

    def _run(self, job: Job) -> Generator[Asked | Message, Any, None]:
        """A run: yields requests, which are sent the scores, and its messages."""
        plan = self._plans[job.run]
        bench = self._bench(plan.condition)
        with self._blamed():
            state = begin(bench, plan) if job.checkpoint is None else self.read(job.run, job.checkpoint)
        while (left := self.config.evaluations - state.evaluations) > 0:
            with self._blamed():
                some = min(left, self.config.checkpoint_every)
                state, records = yield from advance(bench, plan, state, some)
                best, number = float(state.best_fitness), int(state.best_number)
                message = Advanced(job.run, records, state.evaluations, best, number, state.to_bytes())
            yield message
        with self._blamed():
            results = yield from finish(bench, plan, state)
        yield Finished(job.run, results)

    def read(self, run: int, checkpoint: bytes) -> State:
        """The state that a run continues from.

        Raises:
            StudyError: the checkpoint is damaged.
        """
        state: State = self._bench(self._plans[run].condition).algorithm.from_bytes(checkpoint)
        return state

    @contextmanager
    def _blamed(self) -> Iterator[None]:
        """Report errors in a user's algorithm or encoding with their file and line."""
        with ExitStack() as stack:
            for file in self._own:
                stack.enter_context(blamed_on(file, UsageError, own=True))
            yield

    def cost(self, run: int, evaluations: int) -> float:
        """Approximate cost of that many evaluations of a run, in steps of obstacle avoidance."""
        task = self._task(run)
        return evaluations * task.trials * _step_cost(task)

    def tests_cost(self, run: int) -> float:
        """Approximate cost of a run's tests, in the same unit."""
        task, config = self._task(run), self.config
        cells = min(self._bench(self._plans[run].condition).algorithm.cells, config.evaluations)
        trials = cells * config.retest_trials + len(WHO) * len(NOISE_LEVELS) * config.fresh_trials
        return trials * _step_cost(task)

    def _task(self, run: int) -> Task:
        return self._materials.tasks[self._plans[run].condition]

    def _bench(self, condition: int) -> Bench:
        if condition not in self._benches:
            self._benches[condition] = Bench(self._materials, condition, self.engine)
        return self._benches[condition]


def _step_cost(task: Task) -> float:
    return task.steps * (AMBIENT_COST if "ambient" in task.kinds else 1.0)
