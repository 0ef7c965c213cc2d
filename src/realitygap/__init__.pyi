"""The public names, each from the module that holds it; `__init__.py` reads them from here."""

from realitygap.api import calibrate as calibrate
from realitygap.api import evolve as evolve
from realitygap.api import merge as merge
from realitygap.api import reproduce as reproduce
from realitygap.calibration.load import load_recording as load_recording
from realitygap.calibration.unit import calibrated_unit as calibrated_unit
from realitygap.control.encoding import Variation as Variation
from realitygap.control.genotype import Genotype as Genotype
from realitygap.correspondence.descriptors import describe as describe
from realitygap.correspondence.names import namer as namer
from realitygap.correspondence.score import compare as compare
from realitygap.correspondence.setting import setting_of as setting_of
from realitygap.correspondence.trials import read_trials as read_trials
from realitygap.errors import RealityGapError as RealityGapError
from realitygap.errors import UsageError as UsageError
from realitygap.evolution import make_algorithm as make_algorithm
from realitygap.problem import Problem as Problem
from realitygap.report.build import build_report as build_report
from realitygap.simulation.body import SimulatedBody as SimulatedBody
from realitygap.simulation.body import drive_simulated as drive_simulated
from realitygap.simulation.simulation import Simulation as Simulation
from realitygap.study.config import StudyConfig as StudyConfig
from realitygap.study.load import load_study as load_study
from realitygap.study.runner import run_study as run_study
from realitygap.tasks import load_task as load_task
from realitygap.tasks.task import Start as Start
from realitygap.tasks.task import Task as Task
from realitygap.track import Track as Track
from realitygap.track import Trajectory as Trajectory
from realitygap.transfer.drive import drive as drive
from realitygap.transfer.options import Transfer as Transfer
from realitygap.transfer.record import load_transfers as load_transfers
from realitygap.transfer.run import run_transfer as run_transfer
from realitygap.transfer.scores import marks_of as marks_of
from realitygap.values import Command as Command
from realitygap.values import Pose as Pose
from realitygap.values import Readings as Readings
from realitygap.world.arena import Arena as Arena
from realitygap.world.arena import load_arena as load_arena
from realitygap.world.robot import Profile as Profile
from realitygap.world.robot import load_profile as load_profile
from realitygap.world.robot import noise_level as noise_level

__version__: str
