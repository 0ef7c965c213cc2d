"""realitygap: evolve controllers in a calibrated simulation of a Khepera, and measure the gap.

Public names are loaded when first used, so that `import realitygap` costs next to nothing:

    import realitygap

    study = realitygap.load_study("out/reproduce")
    study.runs[0].champion
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from realitygap.lazy import names_of

if TYPE_CHECKING:
    from realitygap.api import calibrate, evolve, merge, reproduce
    from realitygap.calibration.recordings import load_recording
    from realitygap.calibration.unit import calibrated_unit
    from realitygap.control.genotype import Layout, braitenberg, constant, load_genotype, save_genotype
    from realitygap.control.network import NetworkController, decode
    from realitygap.control.operators import Variation, random_genotype
    from realitygap.correspondence.descriptors import describe
    from realitygap.correspondence.names import namer
    from realitygap.correspondence.reading import read_trials
    from realitygap.correspondence.score import compare
    from realitygap.correspondence.setting import setting_of
    from realitygap.errors import RealityGapError, UsageError
    from realitygap.evolution import make_algorithm
    from realitygap.problem.problem import Problem
    from realitygap.report.build import build_report
    from realitygap.simulation.body import SimulatedBody, drive_simulated
    from realitygap.simulation.simulation import Simulation
    from realitygap.study.config import StudyConfig
    from realitygap.study.load import load_study
    from realitygap.study.runner import run_study
    from realitygap.tasks import load_task
    from realitygap.tasks.task import Start, Task
    from realitygap.track import Track, Trajectory
    from realitygap.transfer.drive import drive
    from realitygap.transfer.options import Transfer
    from realitygap.transfer.run import load_transfers, run_transfer
    from realitygap.transfer.score_rows import marks_of
    from realitygap.values import Command, Pose, Readings
    from realitygap.world.arena import Arena, load_arena
    from realitygap.world.robot import Profile, load_profile, noise_level

__version__ = "0.1.0"

__all__ = [
    "Arena", "Command", "Layout", "NetworkController", "Pose", "Problem", "Profile", "Readings",
    "RealityGapError", "SimulatedBody", "Simulation", "Start", "StudyConfig", "Task", "Track", "Trajectory",
    "Transfer", "UsageError", "Variation", "__version__", "braitenberg", "build_report", "calibrate",
    "calibrated_unit", "compare", "constant", "decode", "describe", "drive", "drive_simulated", "evolve",
    "load_arena", "load_genotype", "load_profile", "load_recording", "load_study", "load_task",
    "load_transfers", "make_algorithm", "marks_of", "merge", "namer", "noise_level", "random_genotype",
    "read_trials", "reproduce", "run_study", "run_transfer", "save_genotype", "setting_of",
]  # fmt: skip

_, __getattr__ = names_of(__name__, {
    "api": "calibrate evolve merge reproduce",
    "calibration.recordings": "load_recording",
    "calibration.unit": "calibrated_unit",
    "control.genotype": "Layout braitenberg constant load_genotype save_genotype",
    "control.network": "NetworkController decode",
    "control.operators": "Variation random_genotype",
    "correspondence.descriptors": "describe",
    "correspondence.names": "namer",
    "correspondence.reading": "read_trials",
    "correspondence.score": "compare",
    "correspondence.setting": "setting_of",
    "errors": "RealityGapError UsageError",
    "evolution": "make_algorithm",
    "problem.problem": "Problem",
    "report.build": "build_report",
    "study.config": "StudyConfig",
    "study.load": "load_study",
    "study.runner": "run_study",
    "tasks": "load_task",
    "simulation.body": "SimulatedBody drive_simulated",
    "simulation.simulation": "Simulation",
    "tasks.task": "Start Task",
    "track": "Track Trajectory",
    "transfer.drive": "drive",
    "transfer.options": "Transfer",
    "transfer.run": "load_transfers run_transfer",
    "transfer.score_rows": "marks_of",
    "values": "Command Pose Readings",
    "world.arena": "Arena load_arena",
    "world.robot": "Profile load_profile noise_level",
})  # fmt: skip


def __dir__() -> list[str]:
    return __all__
