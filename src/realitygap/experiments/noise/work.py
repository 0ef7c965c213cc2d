"""The trials of a study of noise as jobs: one controller at a time, on the twin or in the simulations."""

from pathlib import Path
from typing import Any, NamedTuple

from realitygap import temporary
from realitygap.calibration.unit_folder import PROFILE
from realitygap.errors import ConfigError
from realitygap.evolution.algorithm import Genes
from realitygap.experiments.noise.config import NoiseConfig
from realitygap.experiments.noise.plan import Controller, calibration_folder, simulated_file, situated_file
from realitygap.experiments.noise.simulated import compare_all, to_json
from realitygap.experiments.noise.situated import Rigs, situate, to_npz
from realitygap.experiments.noise.stage import Stage
from realitygap.experiments.phases import Made
from realitygap.study.schema import told
from realitygap.work.pool import Pool, Tell
from realitygap.work.workers import far
from realitygap.world.arena import load_arena

__all__ = ["Bench", "Job", "bench_in", "words_for"]

ARENA = "arena.toml"
"""Name of the arena's file for workers that cannot see the study's folder."""


class Job(NamedTuple):
    """A controller to drive the twin's units, or to be compared with the simulations.

    `situated` is the content of its file of paths, for a comparison; b"" if the worker can see the file.
    """

    controller: Controller
    genes: Genes
    situated: bytes | None = None


class Bench:
    """Carries out jobs, and writes only the twin's cameras; created once in a worker.

    `home` is the stage's folder, if it is temporary.
    """

    def __init__(self, stage: Stage, home: temporary.Folder | None = None) -> None:
        self._stage, self._home = stage, home
        self._rigs = Rigs(stage)

    def carry_out(self, job: Job, tell: Tell) -> None:
        """Carry out a job; `tell` receives the share done since its last call, then the result."""
        stage, one = self._stage, job.controller
        stage.champions = {one: job.genes}
        with told(stage.folder):
            if job.situated is None:
                made = to_npz(situate(stage, self._rigs, one, tell))
                tell(Made(str(situated_file(Path(), one)), made))
                return
            if self._home is not None:
                file = situated_file(stage.folder, one)
                file.parent.mkdir(parents=True, exist_ok=True)
                file.write_bytes(job.situated)
            found = to_json(compare_all(stage, one, tell))
            tell(Made(str(simulated_file(Path(), one)), found.encode()))

    def close(self) -> None:
        """Release the twin's units, and remove a temporary folder."""
        self._rigs.close()
        if self._home is not None:
            self._home.cleanup()


Words = tuple[str, dict[str, Any], dict[str, bytes]]
"""What workers get of a study: its folder ("" if they cannot see it), its settings as in its file, and its
calibrations and arena by name."""


def words_for(folder: Path, config: NoiseConfig, pool: Pool) -> Words:
    """What a pool's workers are sent.

    Raises:
        ConfigError: a robot that only this machine has.
    """
    if not far(pool):
        return str(folder), {}, {}
    if config.base is not None:
        raise ConfigError(
            f"robot {config.robot}: expected one that the cluster's workers have too: its file is on this "
            "machine. Leave out --workers, or give a number."
        )
    profiles = [calibration_folder(folder, unit) / PROFILE for unit in config.every_unit]
    files = {str(file.relative_to(folder)): file.read_bytes() for file in profiles}
    table = config.to_dict()
    if config.arena is not None:
        files[ARENA], table["arena"] = load_arena(config.arena).to_toml().encode(), ARENA
    return "", table, files


def bench_in(folder: str, config: dict[str, Any], files: dict[str, bytes]) -> Bench:
    """A bench for a study, in any worker."""
    if folder:
        return Bench(Stage(Path(folder), NoiseConfig.from_folder(Path(folder))))
    home = temporary.Folder("noise")
    for name, content in files.items():
        file = Path(home.name, name)
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(content)
    own = {"arena": str(Path(home.name, ARENA))} if ARENA in files else {}
    return Bench(Stage(Path(home.name), NoiseConfig.from_dict({**config, **own})), home)
