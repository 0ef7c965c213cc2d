"""One trial of a transfer: simulated, driven on a robot from the same pose, seen, and saved.

A trial on the twin is a function of its situation alone.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from realitygap.evolution.algorithm import Genes
from realitygap.files import atomic_write, to_toml, written_together
from realitygap.robots.address import Address
from realitygap.robots.body import Body
from realitygap.robots.drive import Controller, Recorder
from realitygap.simulation.body import drive_simulated
from realitygap.simulation.simulation import Simulation
from realitygap.study.load import Study
from realitygap.study.provenance import versions
from realitygap.track import Track
from realitygap.transfer.driven import Driven, driven
from realitygap.transfer.film import TRACK, film_and_track
from realitygap.transfer.folder import made
from realitygap.transfer.overhead import Overhead
from realitygap.transfer.paths import of_track, score
from realitygap.transfer.plan import FOLDER, Situation, controller_for
from realitygap.transfer.rig import Rig
from realitygap.values import Pose

if TYPE_CHECKING:
    from realitygap.twin.camera import OverheadCamera

__all__ = ["TRIAL", "Carry", "Stage"]

TRIAL = "transfer.toml"
SIMULATED, SITUATED, SEALED = "simulated.csv", "situated.csv", "sealed.csv"

Carry = Callable[[Situation, Pose], None]
"""The person who carries a real robot to its start; returns when it is there."""

Tell = Callable[[float], None]


class Stage:
    """What trials of one study need, loaded once in a process; files go to `place` or the study's folder."""

    def __init__(self, study: Study, place: Path | None = None) -> None:
        self.study, self.place = study, place or study.folder
        self.simulation = cache(lambda task, noise: Simulation(study.task(task), study.profile, noise))
        self._versions = cache(versions)  # finding the commit takes three programs
        self._rigs: dict[tuple[str, Address, float, int | None], Rig] = {}

    def camera_file(self, one: Situation) -> Path:
        """The file of the calibration of the camera over a unit's arena."""
        worn = "" if one.marker is None else "-" + re.sub(r"[^\w.-]+", "-", str(one.marker))
        return self.place / FOLDER / one.robot.folder(one.twin_noise) / f"camera-{one.task}{worn}.json"

    def rig(self, one: Situation) -> Rig:
        """The robot that places itself in a trial's arena; one rig for all trials of both."""
        key = (one.task, one.robot, one.twin_noise, one.baud)
        if key not in self._rigs:
            task, profile = self.study.task(one.task), self.study.profile
            rig = Rig(task, profile, robot=one.robot, twin_noise=one.twin_noise, baud=one.baud)
            rig.camera_file, rig.marker = self.camera_file(one), one.marker
            self._rigs[key] = rig
        return self._rigs[key]

    def close(self) -> None:
        """Release the robots."""
        for rig in self._rigs.values():
            rig.close()
        self._rigs.clear()

    def genes(self, one: Situation) -> Genes:
        """Genes of the individual that drives; empty for a controller of your own."""
        if one.evaluation is None:
            return np.zeros(0, np.int8)
        return self.study.genotype(one.run, one.evaluation)

    def _driver(self, one: Situation, genes: Genes) -> Controller:
        if one.controller is not None:
            return controller_for(self.study, one.task, one.controller)
        return self.study.controller(one.task, genes)

    def by_itself(self, one: Situation, genes: Genes, folder: Path, tell: Tell) -> None:
        """A whole trial on a robot that places itself.

        Args:
            one: the trial.
            genes: of the driver, as from `genes`.
            folder: of the trial's files.
            tell: called with the share of the film that is done.
        """
        with written_together(folder):
            pose = self.simulation(one.task, one.noise).start(one.stream)
            facts = self._simulate(one, genes, pose, folder)
            sealed = folder / SEALED if one.source in ("camera", "film") else None
            driven = self.rig(one).trial(
                self._driver(one, genes), one.stream, pose, one.seconds,
                recorder=Recorder(folder, facts=one.facts()), sealed=sealed,
            )  # fmt: skip
            if sealed is not None:
                period_s = self.study.profile.period_s
                seen = self._seen(one, folder, facts, tell)
                path = of_track(seen, round(one.seconds / period_s), period_s=period_s)
            else:
                path = self._own_path(one, driven, pose)
            self._write(one, folder, facts, path, driven)

    def by_hand(self, one: Situation, body: Body, carry: Carry, overhead: Overhead | None) -> None:
        """A whole trial on a robot that a person carries to its start.

        Args:
            one: the trial.
            body: the robot.
            carry: the person who carries it.
            overhead: the camera above, if there is one.
        """
        genes = self.genes(one)
        with made(self.place / one.folder, one.robot) as folder:
            pose = requested = self.simulation(one.task, one.noise).start(one.stream)
            body.attend(*self.study.task(one.task).kinds)  # refuses a line that is too slow
            body.stop()
            carry(one, requested)
            body.reset()
            if overhead is not None:
                pose = overhead.start(one, requested)
                body.reset()  # moving it again has turned its wheels
            facts = self._simulate(one, genes, pose, folder)
            facts["wished"] = None if overhead is None else requested.to_dict()
            if overhead is None or one.source not in ("camera", "film"):
                driven = self._drive(one, genes, body, folder, facts)
                path = self._own_path(one, driven, pose)
            else:
                with overhead.filming(one, folder, self.study.profile.period_s) as film:
                    driven = self._drive(one, genes, body, folder, facts)
                path = film.path(facts)
            self._write(one, folder, facts, path, driven)

    def _simulate(self, one: Situation, genes: Genes, pose: Pose, folder: Path) -> dict[str, Any]:
        """The paired trial in simulation; returns the facts known before the other."""
        simulation, driver = self.simulation(one.task, one.noise), self._driver(one, genes)
        trajectory, fitness = drive_simulated(
            simulation, driver, stream=one.stream, pose=pose, seconds=one.seconds
        )
        trajectory.track.write_csv(folder / SIMULATED)
        return {**one.facts(), "pose": pose.to_dict(), "fitness": {"simulated": fitness}}

    def _drive(self, one: Situation, genes: Genes, body: Body, folder: Path, facts: dict[str, Any]) -> Driven:
        return driven(
            body,
            self._driver(one, genes),
            task=self.study.task(one.task),
            profile=self.study.profile,
            seconds=one.seconds,
            recorder=Recorder(folder, facts=facts),
        )

    def _own_path(self, one: Situation, driven: Driven, pose: Pose) -> Track:
        """The path as reported by the robot, or by its wheels' counters."""
        if one.source == "robot":
            return driven.known(self.study.task(one.task), self.study.profile)
        return driven.counted(pose, self.study.profile)

    def _seen(self, one: Situation, folder: Path, facts: dict[str, Any], tell: Tell) -> Track:
        """The track of a trial on the twin by the camera above it, which films or only watches."""
        rig = self.rig(one)
        truth = rig.truth(folder / SEALED, one.seconds)
        if one.film:
            with self._camera(one) as camera:
                facts["view"] = camera.metadata["view"]
                about = {"run": one.name, "start": one.start}
                return film_and_track(
                    folder, truth, rig.watcher, overhead=camera, first=one.stream, facts=about, tell=tell
                )
        track = rig.watcher.track(truth, one.stream)
        facts["view"] = rig.watcher.view
        track.write_csv(folder / TRACK)
        (folder / SEALED).unlink()  # kept with a film, to test the tracker
        return track

    def _camera(self, one: Situation) -> OverheadCamera:
        """The camera that films a trial."""
        from realitygap.calibration.record import plate_of
        from realitygap.twin.camera import OverheadCamera

        arena, unit, noise = self.study.task(one.task).arena.plain(), one.robot.unit, one.twin_noise
        assert unit is not None
        return OverheadCamera(arena, unit=unit, noise=noise, view=one.view, plate=plate_of(one.marker))

    def _write(
        self, one: Situation, folder: Path, facts: dict[str, Any], path: Track, driven: Driven
    ) -> None:
        path.write_csv(folder / SITUATED)
        kept = driven.recording
        facts["timing"] = kept.timing
        fitness = score(path, self.study.task(one.task), self.study.profile)
        facts["fitness"]["situated"] = fitness if kept.timing is None else math.nan
        facts["film"] = one.film
        facts["situated_from"] = one.source
        facts["late_steps"] = kept.late_steps
        facts["missed_steps"] = None if np.isnan(kept.read).all() else kept.missed_steps
        facts["lost_steps"] = path.lost
        facts["versions"] = self._versions()
        atomic_write(folder / TRIAL, to_toml(facts))
