"""Contract tests for implementations of your own: subclass one in a test file and run pytest.

Each extension point is a small protocol with one class of tests here. Every implementation in the
package passes the same tests as yours:

    # test_my_robot.py
    from contextlib import nullcontext

    from realitygap.robots import RealClock
    from realitygap.testing import BodyContract

    class TestMyRobot(BodyContract):
        def opened(self):
            return nullcontext((MyRobot("/dev/ttyACM0"), RealClock()))

You override one method, which gives the contract what it tests; nothing here imports pytest.
`pytest.register_assert_rewrite("realitygap.testing")` in your `conftest.py` shows the values of a
failed assertion.
"""

import os
import signal
import tempfile
import threading
from collections.abc import Iterable
from contextlib import AbstractContextManager, closing, suppress
from pathlib import Path as FilePath
from typing import Any, NamedTuple
from unittest import SkipTest, TestCase

import numpy as np
from numpy.typing import NDArray

from realitygap.control.encoding import Encoding, Variation, check_networks, count_networks, genotype_of
from realitygap.correspondence.trials import SLOWEST_HZ
from realitygap.errors import ConfigError, RealityGapError, StudyError, UsageError
from realitygap.evolution.algorithm import Algorithm, Batch, State, check_batch, check_state
from realitygap.kernels.rng import substream
from realitygap.kernels.types import Networks, Path
from realitygap.robots.body import KINDS, Body, Clock
from realitygap.robots.drive import ConstantController, drive
from realitygap.simulation.simulation import Engine, Simulation, Streams
from realitygap.tasks.load import load_task
from realitygap.tasks.task import Task
from realitygap.track import Track, read_track
from realitygap.values import Command, Pose
from realitygap.work.pool import Pool, Setup, Tell
from realitygap.world.robot import Profile, load_profile

__all__ = [
    "AlgorithmContract", "BodyContract", "EncodingContract", "EngineContract", "PoolContract",
    "TrackContract",
]  # fmt: skip

STREAM = np.uint64(2**64 - 1995)
STREAMS = [np.uint64(k) for k in range(1, 9)]
NETWORKS, TRIALS = 5, 3
MIDDLE = Pose.from_degrees(25, 25, 90)
FARTHEST_CM = 1e4
"""No arena is so large: a track in millimetres or pixels is found out."""


class AlgorithmContract:
    """Tests of an algorithm: override `made`, and `fitness` unless larger sums of genes will do."""

    pauses = (0, 1, 7, 40)
    """Evaluations before states are looked at."""

    def made(self) -> Algorithm[Any]:
        """The algorithm, with individuals of any encoding."""
        raise NotImplementedError("override made()")

    def fitness(self, genes: NDArray[Any]) -> float:
        """Of one individual: a finite number, the larger the fitter."""
        return float(np.abs(genes.astype(float)).sum())

    def test_it_starts_empty(self) -> None:
        """Before the first evaluation all cells are empty and there is no best."""
        algorithm = self.made()
        state = algorithm.init(STREAM)
        assert state.evaluations == 0 and state.best_number == -1
        assert len(state.genes) == len(state.numbers) == algorithm.cells
        assert (state.numbers == -1).all()

    def test_asking_changes_nothing(self) -> None:
        """Asking twice gives the same batch, and leaves the state as it was."""
        algorithm = self.made()
        for pause in self.pauses:
            state = self._after(algorithm, pause)
            kept = state.to_bytes()
            once, twice = ([*map(np.asarray, algorithm.ask(state, 5))] for _ in range(2))
            assert all(map(np.array_equal, once, twice)) and state.to_bytes() == kept

    def test_batches_are_as_large_as_they_may_be_at_most(self) -> None:
        """From one individual to as many as requested, numbered from those told, of one type."""
        algorithm = self.made()
        one = algorithm.ask(algorithm.init(STREAM), 1).genes[0]
        for pause in self.pauses:
            for n in (1, 2, 33):
                state = self._after(algorithm, pause)
                check_batch(algorithm.ask(state, n), state, n, one)

    def test_the_size_of_batches_changes_nothing(self) -> None:
        """Asking for one at a time gives the same individuals."""
        algorithm = self.made()
        runs = []
        for most in (1, 60):
            state, lived = algorithm.init(STREAM), []
            while state.evaluations < 60:
                batch = algorithm.ask(state, min(most, 60 - state.evaluations))
                state = self._told(algorithm, state, batch)
                lived += [one.tobytes() for one in batch.genes]
            runs.append((lived, state.to_bytes()))
        assert runs[0] == runs[1]

    def test_telling_leaves_the_old_state(self) -> None:
        """From the old state another future is possible."""
        algorithm = self.made()
        for pause in self.pauses:
            state = self._after(algorithm, pause)
            kept, batch = state.to_bytes(), algorithm.ask(state, 1)
            high, low = (algorithm.tell(state, batch, np.array([value])) for value in (9e9, -9e9))
            assert state.to_bytes() == kept and high.to_bytes() != low.to_bytes()
            assert high.evaluations == low.evaluations == pause + 1
            assert high.best_number == pause and np.array_equal(high.best_genes, batch.genes[0])

    def test_residents_are_who_they_say(self) -> None:
        """Parents are earlier; each resident was evaluated under its number."""
        algorithm, lived = self.made(), []
        state = algorithm.init(STREAM)
        while state.evaluations < 120:
            batch = algorithm.ask(state, 120 - state.evaluations)
            assert ((batch.parents >= -1) & (batch.parents < batch.number)).all()
            assert ((batch.cells >= 0) & (batch.cells < algorithm.cells)).all()
            lived += list(batch.genes)
            state = self._told(algorithm, state, batch)
        check_state(state, algorithm.cells, np.array([*map(self.fitness, lived)]), lived[0])
        for genes, number in zip(state.genes, state.numbers.tolist(), strict=True):
            assert number == -1 or np.array_equal(genes, lived[number])

    def test_the_best_is_kept(self) -> None:
        """The fittest ever told is remembered, the first of several equals."""
        algorithm, told = self.made(), []
        state = algorithm.init(STREAM)
        for number in range(60):
            told.append(float(number % 7))
            state = algorithm.tell(state, algorithm.ask(state, 1), np.array(told[-1:]))
        assert state.best_fitness == 6.0 and state.best_number == told.index(6.0)

    def test_resuming_continues_with_the_same_bits(self) -> None:
        """A run that was saved and read again ends in the same bytes."""
        algorithm = self.made()
        straight = self._after(algorithm, 90)
        for pause in self.pauses:
            again = self.made()
            read = again.from_bytes(self._after(algorithm, pause).to_bytes())
            assert self._after(again, 90 - pause, read).to_bytes() == straight.to_bytes()

    def test_streams_differ(self) -> None:
        """Another stream is another run."""
        algorithm = self.made()
        one, other = (algorithm.ask(algorithm.init(np.uint64(k)), 1).genes for k in (1, 2))
        assert not np.array_equal(one, other)

    def test_a_fitness_that_is_no_number_is_refused(self) -> None:
        """NaN and infinite fitness are refused, and nothing is lost."""
        algorithm = self.made()
        state = self._after(algorithm, 25)
        batch = algorithm.ask(state, 1)
        for wrong in (np.nan, np.inf, -np.inf):
            with TestCase().assertRaises(RealityGapError, msg=f"a fitness of {wrong} was accepted"):
                algorithm.tell(state, batch, np.array([wrong]))
        assert algorithm.tell(state, batch, np.zeros(1)).evaluations == 26

    def _after(self, algorithm: Algorithm[Any], n: int, state: State | None = None) -> State:
        """The state after n evaluations more."""
        state = algorithm.init(STREAM) if state is None else state
        end = state.evaluations + n
        while state.evaluations < end:
            state = self._told(algorithm, state, algorithm.ask(state, end - state.evaluations))
        return state

    def _told(self, algorithm: Algorithm[Any], state: State, batch: Batch) -> State:
        told: State = algorithm.tell(state, batch, np.array([self.fitness(one) for one in batch.genes]))
        return told


class BodyContract:
    """Tests of a body: override `opened`, and `pulses_per_unit` if its wheels are known."""

    pulses_per_unit: float | None = None
    """Counter pulses a second at command `scale`, or the speeds then measured; None: only the ratio of the
    two wheels is tested."""
    scale: int = 1
    """So many of the robot's units are one of the test's, which drives at up to 5: 4 cm/s of a Khepera."""

    def opened(self) -> AbstractContextManager[tuple[Body, Clock]]:
        """A body in an arena of 50 by 50 cm that is free in the middle, and its clock."""
        raise NotImplementedError("override opened()")

    def test_a_reset_body_stands_with_counters_at_zero(self) -> None:
        """After a drive, too."""
        with self.opened() as (body, clock):
            body.act(self._command(5, 5))
            clock.sleep_until(clock.now() + 0.3)
            body.reset(MIDDLE)
            body.sense()
            assert np.abs(_counters(body)).max() <= 5

    def test_readings_are_whole_counts_in_range(self) -> None:
        """Of each kind as many as its channels say; none of a kind that it lacks."""
        with self.opened() as (body, _):
            body.attend(*(one.name for one in body.channels))
            body.reset(MIDDLE)
            readings, channels = body.sense(), {one.name: one for one in body.channels}
            for kind in KINDS:
                counts, one = np.asarray(getattr(readings, kind)), channels.get(kind)
                assert counts.shape == (one.sensors if one else 0,) and (counts == np.round(counts)).all()
                assert one is None or ((counts >= one.low) & (counts <= one.high)).all()

    def test_it_goes_where_its_wheels_take_it(self) -> None:
        """Ahead is where it faces, and a faster right wheel turns it to the left."""
        with self.opened() as (body, clock):
            if not body.knows_pose:
                raise SkipTest("this body does not know where it is")
            body.reset(MIDDLE)
            poses = [body.known_pose()]
            assert 0 < poses[0].x < 2 * MIDDLE.x and 0 < poses[0].y < 2 * MIDDLE.y, "cm, from a corner"
            off = np.hypot(poses[0].x - MIDDLE.x, poses[0].y - MIDDLE.y)
            assert off < 1 or not body.places_itself, "it is where it was set down"
            for left, right in ((5, 5), (-3, 3)):
                body.act(self._command(left, right))
                clock.sleep_until(clock.now() + 0.6)
                poses.append(body.known_pose())
            body.stop()
        begin, there, turned = poses
        way = (there.x - begin.x) + 1j * (there.y - begin.y)
        assert abs(way) > 0 and (way * np.exp(-1j * begin.heading)).real > 0.9 * abs(way)
        assert np.sin(turned.heading - there.heading) > 0

    def test_wheels_turn_as_they_are_told(self) -> None:
        """Two units ahead on the left, three back on the right, for two seconds."""
        with self.opened() as (body, clock):
            body.reset(MIDDLE)
            left, right = _pace(body, clock, self._command(2, -3), 2.0)
        unit = self.pulses_per_unit or (left - right) / 5
        assert unit > 0 and abs(left - 2 * unit) < 0.4 * unit and abs(right + 3 * unit) < 0.6 * unit

    def test_a_stopped_body_stands(self) -> None:
        """Its counters no longer change, or its pose, of a body without any; else its speeds are 0."""
        with self.opened() as (body, clock):
            body.reset(MIDDLE)
            body.act(self._command(4, -4))
            clock.sleep_until(clock.now() + 0.5)
            body.stop()
            clock.sleep_until(clock.now() + 0.3)
            body.sense()
            before = _place(body)
            clock.sleep_until(clock.now() + 0.5)
            body.sense()
            assert np.abs(_place(body) - before).max() <= 2
            assert body.counts_turns or np.abs(body.odometry.speeds or 0).max() <= 2 * self.scale

    def test_a_trial_is_repeatable_from_a_reset(self) -> None:
        """The same commands turn the wheels as fast, within 15 %."""
        gone = []
        with self.opened() as (body, clock):
            for _ in range(2):
                body.reset(MIDDLE)
                gone.append(_pace(body, clock, self._command(5, 5), 1.5))
        assert np.allclose(gone[0], gone[1], rtol=0.15)

    def _command(self, left: int, right: int) -> Command:
        return Command(left=self.scale * left, right=self.scale * right)


def _counters(body: Body) -> NDArray[np.int64]:
    """[2] pulses, as read with the last `sense`; the test is skipped where a body does not count."""
    counters = body.odometry.counters
    if counters is None:
        raise SkipTest("this body does not count its wheels' turns")
    return np.asarray(counters)


def _place(body: Body) -> NDArray[Any]:
    """Its counters; else its pose, of which 2 are 5 mm or 2°; else the speeds that it measures."""
    if body.odometry.counters is None and body.knows_pose:
        at = body.known_pose()
        return np.array([4 * at.x, 4 * at.y, 57 * np.cos(at.heading), 57 * np.sin(at.heading)])
    counts = body.odometry.counters is not None or body.odometry.speeds is None
    return _counters(body) if counts else np.asarray(body.odometry.speeds)


def _pace(body: Body, clock: Clock, command: Command, seconds: float) -> tuple[float, float]:
    """Pulses a second, left and right: the median, so that one late step of the computer does not count. The
    measured speeds, of a body without counters."""
    body.sense()
    if body.odometry.speeds is None:
        _counters(body)
    recording = drive(
        body, ConstantController(command), seconds=seconds, clock=clock, inputs=lambda readings: []
    )
    paces = np.diff(recording.counters, axis=0) / np.diff(recording.t)[:, None]
    if np.isnan(recording.counters).all():
        paces = recording.speeds
    left, right = np.median(paces[1:], axis=0)
    return float(left), float(right)


class EncodingContract:
    """Tests of an encoding: override `made`."""

    def made(self, inputs: int) -> Encoding:
        """The encoding of networks with `inputs` inputs."""
        raise NotImplementedError("override made()")

    def test_genotypes_are_of_its_type_and_shape(self) -> None:
        """As it says, and the same for the same stream."""
        encoding = self.made(8)
        for stream in STREAMS:
            genes = encoding.random(stream)
            assert genes.dtype == np.dtype(encoding.dtype) and genes.shape == encoding.shape
            assert np.array_equal(genes, encoding.random(stream))

    def test_streams_differ(self) -> None:
        """Not every random genotype is the same."""
        encoding = self.made(8)
        assert len({encoding.random(stream).tobytes() for stream in STREAMS}) > 1

    def test_networks_can_be_carried_out(self) -> None:
        """Genotypes become networks of the task's number of inputs, in the ranges of §5.3."""
        for inputs in (2, 8):
            encoding = self.made(inputs)
            genes = np.stack([encoding.random(stream) for stream in STREAMS])
            networks = encoding.decode(genes)
            assert count_networks(networks, inputs) == len(genes)
            check_networks(networks, inputs)
            assert all(genotype_of(encoding, one).inputs == inputs for one in genes)

    def test_a_genotype_decodes_alone_as_among_others(self) -> None:
        """Row k of a batch is the network of genotype k, and decoding changes no gene."""
        encoding = self.made(8)
        genes = np.stack([encoding.random(stream) for stream in STREAMS])
        kept, together = genes.copy(), encoding.decode(genes)
        for k, one in enumerate(genes):
            alone = encoding.decode(one[np.newaxis])
            for name in Networks._fields:
                assert np.array_equal(getattr(alone, name)[0], getattr(together, name)[k])
        assert np.array_equal(genes, kept)

    def test_a_body_is_driven_as_in_simulation(self) -> None:
        """On the same inputs the robot's controller decides as the simulated network did."""
        encoding = self.made(8)
        simulation = Simulation("obstacle-avoidance", "paper")
        for stream in STREAMS[:4]:
            genes = encoding.random(stream)
            lived, _ = simulation.trajectory(encoding.decode(genes[np.newaxis]), stream=int(stream))
            controller = genotype_of(encoding, genes).controller()
            decided = [controller.decide(fed) for fed in lived.inputs.tolist()]
            assert [[one.left, one.right] for one in decided] == lived.commands.tolist()


class EngineContract:
    """Tests of an engine: override `made`, and set `exact` unless its bits are those of the kernels."""

    exact = True
    tasks = ("obstacle-avoidance", "light-seeking")

    def made(self, task: Task, profile: Profile, noise: float) -> Engine:
        """The engine."""
        raise NotImplementedError("override made()")

    def test_scores_have_the_shape_of_their_streams(self) -> None:
        """A finite score for each trial, the same for the same streams."""
        for engine, networks, streams in self._engines():
            engine.compile()
            scores = engine.scores(networks, streams)
            assert scores.shape == streams.shape and scores.dtype == np.float64
            assert np.isfinite(scores).all() and np.array_equal(scores, engine.scores(networks, streams))

    def test_a_trial_is_a_function_of_its_network_and_stream(self) -> None:
        """Neither its place in a batch nor what else is in it changes a bit."""
        for engine, networks, streams in self._engines():
            together = engine.scores(networks, streams)
            turned = _some(networks, slice(None, None, -1))
            assert np.array_equal(engine.scores(turned, streams[::-1])[::-1], together)
            for k in range(NETWORKS):
                alone = _some(networks, slice(k, k + 1))
                assert np.array_equal(engine.scores(alone, streams[k : k + 1, :1])[0], together[k, :1])

    def test_scores_are_of_the_tracks(self) -> None:
        """The task's score, as plain Python, of each track."""
        for name, (engine, networks, streams) in zip(self.tasks, self._engines(), strict=True):
            task, robot = load_task(name), load_profile("paper")
            scores, tracks = engine.scores(networks, streams), engine.tracks(networks, streams)
            assert tracks.x.shape == (*streams.shape, task.steps)
            for k in np.ndindex(*streams.shape):
                path = Path(*(np.ascontiguousarray(rows[k]) for rows in tracks))
                assert np.isclose(task.score(path, task.room(robot)), scores[k], rtol=1e-12, atol=0.0)

    def test_robots_stay_in_their_arena(self) -> None:
        """No robot is ever in a wall."""
        for name, (engine, networks, streams) in zip(self.tasks, self._engines(), strict=True):
            size, radius = load_task(name).arena.size_cm, load_profile("paper").body.radius_cm
            tracks = engine.tracks(networks, streams)
            for places, length in ((tracks.x, size[0]), (tracks.y, size[1])):
                assert (places > radius - 1e-9).all() and (places < length - radius + 1e-9).all()

    def test_wrong_batches_are_refused(self) -> None:
        """Streams that are not a row for each network end in a message, not in a result."""
        for engine, networks, streams in self._engines():
            mistakes: list[Any] = [streams[1:], streams.astype(np.float64), streams[..., np.newaxis]]
            for wrong in mistakes:
                accepted = f"streams {wrong.dtype}{list(wrong.shape)} were accepted"
                with TestCase().assertRaises(UsageError, msg=accepted):
                    engine.scores(networks, wrong)

    def test_it_agrees_with_the_kernels(self) -> None:
        """The scores are those of the processor's cores, to the bit if the engine is `exact`."""
        for name, (engine, networks, streams) in zip(self.tasks, self._engines(), strict=True):
            cores = Simulation(name, "paper", 1.0).scores(networks, streams)
            scores = engine.scores(networks, streams)
            same = np.array_equal(scores, cores)
            assert same if self.exact else np.isclose(scores.mean(), cores.mean(), rtol=0.25)

    def _networks(self) -> Networks:
        variation = Variation(start_neurons=0.3)
        return variation.decode(np.stack([variation.random(np.uint64(k)) for k in range(NETWORKS)]))

    def _engines(self) -> list[tuple[Engine, Networks, Streams]]:
        """The engine at each task, with the same networks and streams."""
        networks = self._networks()
        names = [[substream(np.uint64(k), t) for t in range(TRIALS)] for k in range(NETWORKS)]
        streams = np.array(names, np.uint64)
        robot = load_profile("paper")
        return [(self.made(load_task(name), robot, 1.0), networks, streams) for name in self.tasks]


def _some(networks: Networks, which: slice) -> Networks:
    """Rows of a batch of networks."""
    arrays: Any = [np.ascontiguousarray(array[which]) for array in networks]
    return Networks(*arrays)


MESSAGES = 3
"""Of each job."""


class _Job(NamedTuple):
    """A job: what goes wrong with it before its second message, and where that is noted."""

    number: int
    trouble: str = ""
    note: str = ""


class _Bench:
    """Carries them out."""

    def __init__(self, name: str) -> None:
        self._name = name

    def carry_out(self, job: _Job, tell: Tell) -> None:
        """Its messages: the bench's name, the job's number, and their own."""
        for k in range(MESSAGES):
            tell((self._name, job.number, k))
            if job.trouble == "refused":
                raise ConfigError(f"job {job.number} is refused")
            if job.trouble == "lost" or (job.trouble == "lost once" and not FilePath(job.note).exists()):
                if job.note:
                    FilePath(job.note).touch()
                os.kill(os.getpid(), signal.SIGKILL)

    def close(self) -> None:
        """Nothing to release."""


class PoolContract:
    """Tests of a pool: override `opened`, and `loses` if its workers are processes that may be killed."""

    loses = False
    """Whether a worker is a process of this machine that can be lost without this one."""

    def opened(self) -> Pool:
        """A pool of two workers or more, where it can have so many."""
        raise NotImplementedError("override opened()")

    def test_every_job_is_answered_once(self) -> None:
        """Each job's messages come once and in order; which job comes first is up to the pool."""
        with closing(self.opened()) as pool:
            _complete(_heard(pool, map(_Job, range(20))), 20)

    def test_a_pool_takes_more_work(self) -> None:
        """None at all, and work with another bench."""
        with closing(self.opened()) as pool:
            assert _heard(pool, []) == []
            _complete(_heard(pool, map(_Job, range(3)), "one"), 3)
            _complete(_heard(pool, map(_Job, range(4)), "two"), 4)

    def test_an_error_arrives_as_itself(self) -> None:
        """With its message; the pool can then be closed."""
        with closing(self.opened()) as pool, TestCase().assertRaises(ConfigError) as met:
            _heard(pool, [_Job(0), _Job(1, "refused"), _Job(2)])
        assert str(met.exception) == "job 1 is refused"

    def test_whoever_listens_may_stop_the_work(self) -> None:
        """Messages are heard in the thread that asked; what is raised there ends the work."""
        threads = []

        def stop(message: object) -> None:
            threads.append(threading.current_thread())
            raise KeyboardInterrupt

        with closing(self.opened()) as pool, TestCase().assertRaises(KeyboardInterrupt):
            pool.work(Setup(_Bench, ("stopped",)), map(_Job, range(5)), stop)
        assert threads == [threading.current_thread()]

    def test_a_lost_worker_is_replaced(self) -> None:
        """Another does its job again, and no message comes twice."""
        if not self.loses:
            raise SkipTest("its workers are not lost without this process")
        with tempfile.TemporaryDirectory() as folder, closing(self.opened()) as pool:
            jobs = [_Job(k, "lost once" if k % 3 else "", f"{folder}/{k}") for k in range(9)]
            _complete(_heard(pool, jobs), 9)
            assert len(list(FilePath(folder).iterdir())) == 6

    def test_a_job_may_not_lose_workers_for_ever(self) -> None:
        """It ends in one error that says how the worker died."""
        if not self.loses:
            raise SkipTest("its workers are not lost without this process")
        with closing(self.opened()) as pool, TestCase().assertRaises(StudyError) as met:
            _heard(pool, [_Job(0), _Job(1, "lost")])
        assert "a worker process died (signal 9). What was saved is kept" in str(met.exception)

    def test_a_closed_pool_leaves_nothing_behind(self) -> None:
        """No process and no thread; closing once more does nothing."""
        if not FilePath("/proc/self/stat").exists():
            raise SkipTest("looks at processes in /proc")
        left, pools = [], []
        for _ in range(2):  # Python's own helpers start with the first
            pool = self.opened()
            pools.append(pool)  # what only ends with its pool is left behind, too
            _heard(pool, map(_Job, range(4)))
            pool.close()
            pool.close()
            left.append((_children(), threading.active_count()))
        assert left[0] == left[1]


def _heard(pool: Pool, jobs: Iterable[_Job], name: str = "") -> list[tuple[str, int, int]]:
    heard: list[tuple[str, int, int]] = []
    pool.work(Setup(_Bench, (name,)), jobs, heard.append)
    assert {who for who, _, _ in heard} <= {name}
    return heard


def _complete(heard: list[tuple[str, int, int]], jobs: int) -> None:
    """All of them, and each job's in order."""
    assert sorted(job for _, job, _ in heard) == [job for job in range(jobs) for _ in range(MESSAGES)]
    for number in range(jobs):
        assert [k for _, job, k in heard if job == number] == list(range(MESSAGES))


def _children() -> set[str]:
    """Processes that this one started and that still run."""
    found = set()
    for stat in FilePath("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            state, parent = stat.read_text().rsplit(")", 1)[1].split()[:2]
            if parent == str(os.getpid()) and state != "Z":
                found.add(stat.parent.name)
    return found


class TrackContract:
    """Tests of whatever makes tracks (a tracker, a motion capture, another simulator): override `track`."""

    def track(self) -> Track:
        """A track of a robot that drives, and does not turn on the spot alone, for a second at least."""
        raise NotImplementedError("override track()")

    def test_time_runs_forward(self) -> None:
        """A row a time, s, for a second at least; so many a second that turns show: not ms, nor frames."""
        track = self.track()
        assert np.median(np.diff(track.t)) <= 1 / SLOWEST_HZ
        assert np.isfinite(track.t).all() and (np.diff(track.t) > 0).all() and np.ptp(track.t) >= 1.0 - 1e-9

    def test_a_lost_robot_is_nowhere(self) -> None:
        """Place and heading are NaN together, and numbers elsewhere."""
        track = self.track()
        assert track.found.any() and len(track.found) == len(track)
        for column in (track.x, track.y, track.heading):
            assert np.array_equal(np.isfinite(column), track.found)
        if track.quality is not None:
            assert np.array_equal(track.quality > 0, track.found) and (track.quality <= 1).all()

    def test_places_are_centimetres(self) -> None:
        """And the robot moves."""
        seen = self.track().only(self.track().found)
        assert max(np.abs(seen.x).max(), np.abs(seen.y).max()) < FARTHEST_CM
        assert np.ptp(seen.x) + np.ptp(seen.y) + np.ptp(seen.heading) > 0

    def test_headings_are_radians(self) -> None:
        """A robot drives where it looks, ahead or back; short ways, where it shakes, do not count."""
        seen = self.track().only(self.track().found)
        way, turn = np.diff(seen.x) + 1j * np.diff(seen.y), np.diff(seen.heading)
        along = way * np.exp(-1j * (seen.heading[:-1] + np.arctan2(np.sin(turn), np.cos(turn)) / 2))
        far = (np.diff(seen.t) <= 0.1 + 1e-9) & (np.abs(way) > np.abs(way).max() / 2)
        assert np.abs(along.real)[far].sum() >= 0.95 * np.abs(way)[far].sum()

    def test_its_file_says_the_same(self) -> None:
        """Written as CSV and read again: the same rows, to the digits that are written."""
        track = self.track()
        with tempfile.TemporaryDirectory() as folder:
            track.write_csv(FilePath(folder) / "track.csv")
            again = read_track(FilePath(folder) / "track.csv")
        assert np.array_equal(again.found, track.found) and np.allclose(again.t, track.t, atol=0.06)
        seen = track.found
        assert np.allclose(again.x[seen], track.x[seen], atol=1e-4)
        assert np.allclose(again.y[seen], track.y[seen], atol=1e-4)
        assert np.abs(np.sin((again.heading - track.heading)[seen] / 2)).max() < 1e-4
