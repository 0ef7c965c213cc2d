"""A job is a whole run, from its checkpoint to its tests, sent as messages to the process that writes.

Runs go one after the other, or side by side: then the trials that they request at one time form one batch.
"""

from collections.abc import Generator, Iterable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from queue import Empty, Queue
from threading import Event
from typing import Any, NamedTuple

import numpy as np

from realitygap.errors import UsageError
from realitygap.evolution.algorithm import State
from realitygap.plugins import blamed_on
from realitygap.study import batched
from realitygap.study.folder import Materials
from realitygap.study.plan import plans
from realitygap.study.run import ConditionRunner, TrialRequest, advance, begin, finish, tested_levels
from realitygap.study.store import WHO, Advanced, Finished, Message, Records
from realitygap.tasks.task import Task
from realitygap.work.pool import Tell

__all__ = ["Advanced", "Finished", "Job", "Message", "Rehearsal", "StudyExecutor"]

AMBIENT_COST = 2.5
"""Time of a step with ambient sensors over that with proximity sensors: a hint for the order of work."""


class Job(NamedTuple):
    """A run to continue from a checkpoint (None: from its beginning)."""

    run: int
    checkpoint: bytes | None


class Rehearsal(NamedTuple):
    """A half of what runs call, to be compiled (or loaded) in a worker while another has the other half."""

    breeding: bool


MOST = 128
"""Lists of messages that wait to be taken; then the threads wait."""
Steps = Generator[TrialRequest | Message, Any, None]


class StudyExecutor:
    """Carries out the runs of one study, with a runner for each condition, created when first needed."""

    def __init__(self, materials: Materials, engine: str = "cores", held: ExitStack | None = None) -> None:
        self._held = held or ExitStack()
        self.config, self.engine = materials.config, engine
        self._materials = materials
        self._plans = {plan.id: plan for plan in plans(materials)}
        self._runners: dict[int, ConditionRunner] = {}
        self._own = [file.resolve() for file in self.config.own_files().values()]

    @property
    def runs(self) -> list[int]:
        return list(self._plans)

    def compile(self) -> None:
        """Load or compile everything that the conditions' runs call."""
        for condition in range(len(self._materials.tasks)):
            with self._blamed():
                runner = self._runner(condition)
                runner.compile()
                if self.engine != "cores" and batched.supports(runner):
                    batched.prepare(runner)

    def carry_out(self, job: Job | Rehearsal, tell: Tell) -> None:
        """Carry out a run; `tell` receives its messages."""
        if isinstance(job, Rehearsal):
            for condition in range(len(self._materials.tasks)):
                with self._blamed():
                    runner = self._runner(condition)
                    runner.breed() if job.breeding else runner.simulation(runner.noise).compile()
            return
        plan = self._plans[job.run]
        for messages in self._rounds(plan.condition, {job.run: self._run(job.run, self._state(job))}):
            for message in messages:
                tell(message)

    def messages(self, jobs: Iterable[Job]) -> Generator[list[Message], None, None]:
        """Messages of runs that advance side by side, as they come: one for each checkpoint of each run, then
        its tests. Each condition has a thread: its runs breed while others' trials are carried out.

        An error in one ends all; when this ends or is closed, each thread is left at its next round.
        """
        conditions: dict[int, dict[int, State]] = {}
        for job in jobs:
            states = conditions.setdefault(self._plans[job.run].condition, {})
            states[job.run] = self._state(job)
        came, stop = Queue[list[Message] | BaseException | None](MOST), Event()

        def drive(condition: int, states: dict[int, State]) -> None:
            end = None
            try:
                for messages in self._side_by_side(condition, states):
                    came.put(messages)
                    if stop.is_set():
                        break
            except BaseException as error:
                end = error
            came.put(end)

        left, driven = len(conditions), list[Future[None]]()
        with ThreadPoolExecutor(max(1, left)) as threads:
            try:
                driven += [threads.submit(drive, *one) for one in conditions.items()]
                while left:
                    found = came.get()
                    left -= not isinstance(found, list)
                    if isinstance(found, BaseException):
                        raise found
                    if found:
                        yield found
            finally:
                stop.set()
                while not all(one.done() for one in driven):
                    with suppress(Empty):
                        came.get(timeout=0.05)

    def _side_by_side(self, condition: int, states: dict[int, State]) -> Iterator[list[Message]]:
        """Runs of one condition, from their states."""
        if batched.supports(self._runner(condition)):
            yield from self._rounds(condition, {0: self._batched(condition, states)})
            yield from self._rounds(condition, {run: self._finish(run, states[run]) for run in states})
        else:
            yield from self._rounds(condition, {run: self._run(run, states[run]) for run in states})

    def _rounds(self, condition: int, runs: dict[int, Steps]) -> Iterator[list[Message]]:
        """Messages of each round of some runs, after which they are sent the scores that they asked for."""
        scores: dict[int, Any] = {}
        while runs:
            asked: dict[int, TrialRequest] = {}
            messages: list[Message] = []
            for run, told in list(runs.items()):
                try:
                    while not isinstance(item := told.send(scores.pop(run, None)), TrialRequest):
                        messages.append(item)
                    asked[run] = item
                except StopIteration:
                    del runs[run]
            yield messages
            scores = self._scores(condition, asked)

    def _scores(self, condition: int, asked: Mapping[int, TrialRequest]) -> dict[int, Any]:
        """The scores that each of a condition's runs asked for; similar trials go in one batch."""
        like: dict[tuple[float, int], list[int]] = {}
        for run, one in asked.items():
            like.setdefault((one.noise, one.streams.shape[1]), []).append(run)
        scores: dict[int, Any] = {}
        for (noise, _), runs in like.items():
            with self._blamed():
                runner = self._runner(condition)
                if len(runs) == 1:
                    scores[runs[0]] = runner.scores(asked[runs[0]])
                    continue
                genes = [asked[run].genes for run in runs]
                streams = np.concatenate([asked[run].streams for run in runs])
                found = runner.scores(TrialRequest(noise, np.concatenate(genes), streams))
            ends = np.cumsum([len(one) for one in genes])
            scores |= dict(zip(runs, np.split(found, ends[:-1]), strict=True))
        return scores

    def close(self) -> None:
        """Remove files that came in messages."""
        self._held.close()

    def _state(self, job: Job) -> State:
        """The state that a run goes on from."""
        plan = self._plans[job.run]
        with self._blamed():
            if job.checkpoint is not None:
                return self.read(job.run, job.checkpoint)
            return begin(self._runner(plan.condition), plan)

    def _run(self, run: int, state: State) -> Steps:
        """A run: yields requests, which are sent the scores, and its messages."""
        plan = self._plans[run]
        runner = self._runner(plan.condition)
        while (left := self.config.evaluations - state.evaluations) > 0:
            with self._blamed():
                some = min(left, self.config.checkpoint_every)
                state, records = yield from advance(runner, plan, state, some)
                message = _advanced(run, state, records)
            yield message
        yield from self._finish(run, state)

    def _batched(self, condition: int, states: dict[int, State]) -> Steps:
        """The evaluations of all of a condition's runs, as arrays; leaves their last states in `states`."""
        runner, total = self._runner(condition), self.config.evaluations
        for state in states.values():
            if state.evaluations < total:
                runner.ask(state, 1)  # refuses what is not the algorithm's
        while (start := min(state.evaluations for state in states.values())) < total:
            runs = [run for run, state in states.items() if state.evaluations == start]
            some = min(total - start, self.config.checkpoint_every)
            behind = [(self._plans[run].stream, states[run]) for run in runs]
            for run, (state, records) in zip(
                runs, (yield from batched.advance(runner, behind, some)), strict=True
            ):
                states[run] = state
                yield _advanced(run, state, records)

    def _finish(self, run: int, state: State) -> Steps:
        plan = self._plans[run]
        with self._blamed():
            results = yield from finish(self._runner(plan.condition), plan, state)
        yield Finished(run, state.evaluations, results)

    def read(self, run: int, checkpoint: bytes) -> State:
        """The state that a run continues from.

        Raises:
            StudyError: the checkpoint is damaged.
        """
        state: State = self._runner(self._plans[run].condition).algorithm.from_bytes(checkpoint)
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
        cells = min(self._runner(self._plans[run].condition).algorithm.cells, config.evaluations)
        levels = tested_levels(config.conditions[self._plans[run].condition].noise)
        trials = cells * config.retest_trials + len(WHO) * len(levels) * config.fresh_trials
        return trials * _step_cost(task)

    def _task(self, run: int) -> Task:
        return self._materials.tasks[self._plans[run].condition]

    def _runner(self, condition: int) -> ConditionRunner:
        if condition not in self._runners:
            self._runners[condition] = ConditionRunner(self._materials, condition, self.engine)
        return self._runners[condition]


def _advanced(run: int, state: State, records: Records) -> Advanced:
    best, number = float(state.best_fitness), int(state.best_number)
    return Advanced(run, records, state.evaluations, best, number, state.to_bytes())


def _step_cost(task: Task) -> float:
    return task.steps * (AMBIENT_COST if "ambient" in task.kinds else 1.0)
