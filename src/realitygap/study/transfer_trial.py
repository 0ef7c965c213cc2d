"""One trial of a transfer: simulated, then driven on a robot from the same pose, and written down.

A trial is a function of its situation alone. It is made in a folder of its own beside the final
one, which appears when everything is in it.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from realitygap.controller.network import NetworkController, decode
from realitygap.errors import LineError, RobotError, RobotStoppedError
from realitygap.kernels.params import STEP_S
from realitygap.kernels.rng import substream
from realitygap.robot.body import SerialBody
from realitygap.robot.clock import VirtualClock
from realitygap.robot.facts import to_toml
from realitygap.robot.khepera import Khepera
from realitygap.robot.loop import drive
from realitygap.robot.protocol import PULSES_PER_MM
from realitygap.robot.recording import Recorder, Recording
from realitygap.study.folder import versions
from realitygap.study.load import Study
from realitygap.study.transfer_paths import Table, of_counters, of_track, of_trajectory, score, write_path
from realitygap.study.transfer_plan import FOLDER, Robot, Situation
from realitygap.tasks.simulation import Simulation
from realitygap.values import Pose, Readings

__all__ = ["TRIAL", "Carry", "Stage", "half_folder"]

TRIAL = "transfer.toml"
SIMULATED, SITUATED, SEALED = "simulated.csv", "situated.csv", "sealed.csv"

TWIN_NOISE = 2
"""Name of the stream that a twin unit's noise is drawn from, under the trial's."""

Carry = Callable[[Situation, Pose], None]
"""The person who carries a real robot to its start; returns when it stands there."""

Tell = Callable[[float], None]


class Driven(NamedTuple):
    """A drive on a robot: its recording and the wheels' counters at the steps, the end included."""

    recording: Recording
    counters: NDArray[np.float64]


class Stage:
    """What trials of one study need, loaded once in a process."""

    def __init__(self, study: Study) -> None:
        self.study = study
        self._simulations: dict[tuple[str, float], Simulation] = {}

    def simulation(self, one: Situation) -> Simulation:
        """The run's own: its task, its robot, its noise."""
        key = (one.task, one.noise)
        if key not in self._simulations:
            self._simulations[key] = Simulation(self.study.task(one.task), self.study.profile, one.noise)
        return self._simulations[key]

    def camera_file(self, one: Situation) -> Path:
        """Where the calibration of the camera over a unit's arena is kept."""
        return self.study.folder / FOLDER / one.robot.folder(one.twin_noise) / f"camera-{one.task}.json"

    def calibrate(self, one: Situation) -> Any:
        """The camera over the arena of a trial on the twin."""
        from realitygap.study.transfer_film import calibrated

        assert one.robot.unit is not None
        return calibrated(
            self.camera_file(one),
            self.study.task(one.task).arena,
            unit=one.robot.unit,
            noise=one.twin_noise,
            radius_cm=self.study.profile.body.radius_cm,
        )

    def on_twin(self, one: Situation, tell: Tell) -> None:
        """A whole trial on a unit of the twin; `tell` hears the share of the film that is done."""
        with self._written(one) as (folder, pose, facts):
            driven = self._drive_twin(one, pose, folder)
            path = self._filmed(one, folder, facts, tell) if one.film else self._counted(driven, pose)
            self._write(one, folder, facts, path, driven)

    def on_serial(self, one: Situation, khepera: Khepera, carry: Carry) -> None:
        """A whole trial on a real robot, which a person carries to its start."""
        with self._written(one) as (folder, pose, facts):
            task = self.study.task(one.task)
            body = SerialBody(khepera, kinds=(task.feeds,), carry=lambda start: carry(one, start))
            body.reset(pose)
            driven = self._drive(one, body, folder, facts)
            self._write(one, folder, facts, self._counted(driven, pose), driven)

    @contextmanager
    def _written(self, one: Situation) -> Iterator[tuple[Path, Pose, dict[str, Any]]]:
        """The folder that a trial is made in, its start, its facts; the final folder at the end."""
        final = self.study.folder / one.folder
        half = half_folder(final)
        _put_aside(half, one.robot)
        half.mkdir(parents=True)
        pose, facts = self._simulate(one, half)
        try:
            yield half, pose, facts
        except RobotStoppedError as error:
            raise RobotStoppedError(f"{error}; its recording is kept in {half}") from None
        except LineError as error:
            raise LineError(f"{one.robot}: {error}; its recording is kept in {half}") from None
        except RobotError as error:
            raise RobotError(f"{one.robot}: {error}") from None
        if final.exists():
            shutil.rmtree(final)
        half.rename(final)

    def _simulate(self, one: Situation, folder: Path) -> tuple[Pose, dict[str, Any]]:
        """The paired trial in simulation, and what is known of the trial before the other."""
        simulation = self.simulation(one)
        pose = simulation.start(one.stream)
        networks = decode(self._genes(one), self.study.layout(one.task))
        trajectory, fitness = simulation.trajectory(
            networks, stream=one.stream, pose=pose, seconds=one.seconds
        )
        write_path(folder / SIMULATED, of_trajectory(trajectory))
        place = {"x_cm": pose.x, "y_cm": pose.y, "heading_deg": pose.heading_deg}
        return pose, {**one.facts(), "pose": place, "fitness": {"simulated": fitness}}

    def _genes(self, one: Situation) -> Any:
        return self.study.genotype(one.run, one.evaluation)

    def _drive_twin(self, one: Situation, pose: Pose, folder: Path) -> Driven:
        """Drive a unit in a process of its own, made for this trial: no trial leaves it a trace."""
        from contextlib import closing

        from realitygap.twin.process import start_twin

        assert one.robot.unit is not None
        task = self.study.task(one.task)
        seed = int(substream(np.uint64(one.stream), np.uint64(TWIN_NOISE)))
        settings: dict[str, Any] = {"unit": one.robot.unit, "noise": one.twin_noise, "seed": seed}
        with (
            start_twin(task.arena.plain(), baud=one.baud, **settings) as twin,
            closing(VirtualClock(twin.channel)) as clock,
        ):
            khepera = Khepera.connect(twin.device, baud=one.baud, clock=clock)
            try:
                body = SerialBody(khepera, kinds=(task.feeds,), carry=twin.place)
                body.reset(pose)
                clock.settle()
                if one.film:
                    twin.film(folder / SEALED)
                driven = self._drive(one, body, folder, one.facts())
                clock.settle()
                if one.film:
                    twin.film(None)
            finally:
                khepera.abandon()
        return driven

    def _drive(self, one: Situation, body: SerialBody, folder: Path, facts: dict[str, Any]) -> Driven:
        task, profile = self.study.task(one.task), self.study.profile

        def inputs(readings: Readings) -> list[int]:
            fed = readings.proximity if task.feeds == "proximity" else readings.ambient
            return profile.inputs(fed.tolist(), task.feeds, task.sensors)

        recording = drive(
            body,
            NetworkController(self._genes(one), self.study.layout(one.task)),
            seconds=one.seconds,
            clock=body.khepera.clock,
            inputs=inputs,
            recorder=Recorder(folder, facts=facts),
        )
        counters = np.vstack([recording.counters, body.khepera.counters()])
        return Driven(recording, counters)

    def _counted(self, driven: Driven, pose: Pose) -> Table:
        """The path by the wheels' counters."""
        axle = self.study.profile.wheels.track_cm
        return of_counters(driven.counters, pose, cm_per_pulse=0.1 / PULSES_PER_MM, axle_cm=axle)

    def _filmed(self, one: Situation, folder: Path, facts: dict[str, Any], tell: Tell) -> Table:
        """The path by the film: rendered, then tracked."""
        from realitygap.study.transfer_film import film_and_track
        from realitygap.twin.camera import OverheadCamera
        from realitygap.twin.states import States

        assert one.robot.unit is not None
        camera = self.calibrate(one)
        states = States.from_file(folder / SEALED)
        in_time = states.time_ms <= states.time_ms[0] + round(one.seconds * 1000)
        states = States(states.time_ms[in_time], states.pose[in_time])
        arena = self.study.task(one.task).arena.plain()
        seed = one.stream >> 1
        with OverheadCamera(arena, unit=one.robot.unit, noise=one.twin_noise, seed=seed) as eye:
            facts["view"] = eye.metadata["view"]
            about = {"run": one.name, "start": one.start}
            track = film_and_track(folder, states, camera, eye=eye, facts=about, tell=tell)
        return of_track(track, round(one.seconds / STEP_S))

    def _write(
        self, one: Situation, folder: Path, facts: dict[str, Any], path: Table, driven: Driven
    ) -> None:
        write_path(folder / SITUATED, path)
        facts["fitness"]["situated"] = score(path, self.study.task(one.task), self.study.profile)
        facts["film"] = one.film
        facts["situated_from"] = "film" if one.film else "counters"
        facts["late_steps"] = driven.recording.late_steps
        facts["versions"] = _versions(one.robot)
        (folder / TRIAL).write_text(to_toml(facts), encoding="utf-8")


def half_folder(final: Path) -> Path:
    """Where a trial is while it is being made."""
    return final.with_name(f"{final.name}.half")


def _put_aside(half: Path, robot: Robot) -> None:
    """Make room for another try; what a real robot recorded is never thrown away."""
    if not half.exists():
        return
    if robot.port is None:
        shutil.rmtree(half)
        return
    k = 1
    while (aside := half.with_name(f"{half.stem}.stopped-{k}")).exists():
        k += 1
    half.rename(aside)


def _versions(robot: Robot) -> dict[str, str]:
    """What the bits depend on besides the study."""
    from importlib.metadata import version

    return versions() if robot.port is not None else {**versions(), "mujoco": version("mujoco")}
