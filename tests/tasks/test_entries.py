"""Every public way into compiled code refuses arrays that do not fit, before anything is compiled on."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import realitygap as rg
from realitygap.control.encoding import check_networks
from realitygap.errors import RealityGapError, UsageError
from realitygap.evolution import make_algorithm
from realitygap.export import table
from realitygap.kernels.types import Networks
from realitygap.simulation.body import SimulatedBody

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "follow_the_wall.py"
VARIATION = rg.Variation(start_neurons=0.4)
GENES = np.stack([VARIATION.random(np.uint64(k)) for k in range(2)])
STREAMS = np.zeros((2, 3), np.uint64)


@pytest.fixture(scope="module")
def simulation() -> rg.Simulation:
    """The paper's robot avoiding obstacles for a second."""
    from dataclasses import replace

    return rg.Simulation(replace(rg.load_task("avoidance"), seconds=1.0), "paper")


def nets(**change: object) -> Networks:
    """Two networks with another array, or one value of an array changed: name=(place, value)."""
    made = rg.Genotype.decode(GENES, 8)
    for name, new in change.items():
        if isinstance(new, tuple):
            array = getattr(made, name).copy()
            array[new[0]] = new[1]
            new = array
        made = made._replace(**{name: new})
    return made


BROKEN: dict[str, Networks] = {
    "more neurons than there are": nets(neurons=(0, 23)),
    "no motors": nets(neurons=(1, 1)),
    "a link from nowhere": nets(links=((0, 0, 1), 20000)),
    "a link from below": nets(links=((0, 0, 1), -1)),
    "a link too late": nets(links=((0, 0, 3), 5)),
    "links that end beyond": nets(link_start=((0, 1), 9999)),
    "links that end before they begin": nets(link_start=((0, 1), -1)),
    "a sensor's link to nowhere": nets(sensor_links=((0, 0, 0), 99)),
    "a sensor that is not there": nets(sensor_links=((0, 0, 1), 8)),
    "too many sensor links": nets(sensor_count=(0, 10**6)),
    "weights as floats": nets(links=np.zeros((2, 176, 4))),
    "arrays of another size": nets(thresholds=np.zeros((2, 3), np.int16)),
}


@pytest.mark.parametrize("what", BROKEN)
def test_networks_that_lead_out_of_their_arrays_are_refused(what: str) -> None:
    """A user's encoding never makes compiled code read or write beyond an array."""
    check_networks(nets(), 8)
    with pytest.raises(UsageError, match="networks"):
        check_networks(BROKEN[what], 8)


SCORES: dict[str, Callable[[rg.Simulation], object]] = {
    "more rows of streams than networks": lambda s: s.scores(nets(), np.zeros((5000, 2), np.uint64)),
    "fewer rows of streams": lambda s: s.scores(nets(), STREAMS[:1]),
    "streams in one dimension": lambda s: s.scores(nets(), STREAMS[0]),
    "streams of another type": lambda s: s.scores(nets(), np.zeros((2, 3))),
    "streams in a matrix": lambda s: s.scores(nets(), np.matrix(STREAMS)),
    "streams behind a mask": lambda s: s.scores(nets(), np.ma.array(STREAMS, mask=STREAMS == 0)),
    "genes for networks": lambda s: s.scores(GENES, STREAMS),  # type: ignore[arg-type]
    "more inputs": lambda s: s.scores(nets(inputs=np.full(2, 12)), STREAMS),
    "other inputs than the task": lambda s: s.scores(rg.Genotype.random(1, inputs=4).networks(), STREAMS[:1]),
    "two networks for one trajectory": lambda s: s.trajectory(nets(), stream=1),
    "a stream below 0": lambda s: s.trajectory(rg.Genotype.decode(GENES[0], 8), stream=-1),
    "a stream of 65 bits": lambda s: s.start(2**64),
    "no repetition": lambda s: s.probe(rg.Pose(x=25, y=25, heading=0), repeat=0),
    "repetitions without end": lambda s: s.probe(rg.Pose(x=25, y=25, heading=0), repeat=10**12),
    "seconds without end": lambda s: s.trajectory(rg.Genotype.decode(GENES[0], 8), stream=1, seconds=1e12),
    "a command beyond the robot's": lambda s: SimulatedBody(s).act(rg.Command(left=10**12, right=0)),
    "a body on half a stream": lambda s: reset_on(s, 2.5),
    "a body on a stream below 0": lambda s: reset_on(s, -2),
    "an output between two": lambda s: s.profile.wheels.command(0.4),
    "an output beyond the ten": lambda s: s.profile.wheels.command(25),
    "an output that is no number": lambda s: s.profile.wheels.command(float("nan")),
}


def reset_on(simulation: rg.Simulation, stream: object) -> None:
    """A simulated body that is put on another stream."""
    body = SimulatedBody(simulation)
    body.stream = stream  # type: ignore[assignment]
    body.reset()


@pytest.mark.parametrize("call", SCORES.values(), ids=SCORES.keys())
def test_a_simulation_refuses_what_does_not_fit(simulation, call):
    """Each wrong array, stream, pose or length is a UsageError, not a crash and not a score."""
    with pytest.raises(rg.UsageError):
        call(simulation)


def test_what_fits_is_scored(simulation):
    """The networks that the table spoils are scored as they are; none at all have no scores."""
    assert np.isfinite(simulation.scores(nets(), STREAMS)).all()
    nobody = rg.Genotype.decode(GENES[:0], 8)
    assert simulation.scores(nobody, STREAMS[:0]).shape == (0, 3)
    assert simulation.tracks(nobody, STREAMS[:0]).x.shape[:2] == (0, 3)


def genes(*place: object) -> np.ndarray:
    """A genotype with one value changed: place and value."""
    changed = GENES[0].copy()
    changed[place[:2]] = place[2]  # type: ignore[index]
    return changed


OTHERS: dict[str, Callable[[], object]] = {
    "genes of another layout": lambda: rg.Genotype.decode(np.zeros((1, 40, 14), np.int8), 8),
    "genes as floats": lambda: rg.Genotype.decode(GENES.astype(float), 8),
    "genes in a list": lambda: rg.Genotype.decode(GENES.tolist(), 8),
    "a source that is no slot": lambda: rg.Genotype.decode(genes(8, 3, 120), 8),
    "a source below 0": lambda: rg.Genotype.decode(genes(8, 3, -1), 8),
    "a delay beyond the longest": lambda: rg.Genotype.decode(genes(8, 5, 100), 8),
    "a motor left out": lambda: rg.Genotype.decode(genes(8, 0, 0), 8),
    "inputs beyond the ten": lambda: rg.Genotype(GENES[0], 8).controller().decide([11] * 8),
    "inputs that are no numbers": lambda: rg.Genotype(GENES[0], 8).controller().decide([float("nan")] * 8),
    "a parent of another layout": lambda: VARIATION.offspring(GENES[0], GENES[0, :20], np.uint64(1)),
    "a stream of breeding below 0": lambda: VARIATION.random(-1),
    "a population beyond all memory": lambda: make_algorithm("torus", VARIATION, rows=10**6, columns=10**6),
    "a size beyond all memory": lambda: make_algorithm("random", VARIATION, size=10**9),
    "a simulation of nothing": lambda: rg.Simulation(None, None),
    "a study of nothing": lambda: rg.run_study("nowhere", 3),
    "transfers of no folder": lambda: rg.load_transfers("nowhere"),
    "no robots": lambda: rg.Transfer(robots=[]),
    "starts drawn by half a seed": lambda: rg.Transfer(seed=2.5),
    "starts drawn by a seed below 0": lambda: rg.Transfer(seed=-1),
    "a transfer's noise beyond the largest": lambda: rg.Transfer(twin_noise=11),
    "runs by half their numbers": lambda: rg.Transfer(runs=[1.5]),
    "a genotype's place with a NUL": lambda: rg.Genotype(GENES[0], 8).save("\0"),
    "a setting of no kind": lambda: rg.evolve("light", settings={"evolution.rows": np.int64(10)}),
    "a study's engine by another name": lambda: rg.evolve("light", engine="gpu"),
    "a reproduction's engine by another name": lambda: rg.reproduce("nowhere", engine="gpu"),
    "a calibration of paths": lambda: rg.calibrate(["unit-1"], "paper"),
    "a calibration of no known form": lambda: rg.calibrate([], "paper", form="best"),
    "a unit in words": lambda: rg.calibrated_unit("nowhere", unit="one", noise=1.0, seed=0),
    "a setting of no trials": lambda: rg.setting_of([]),
    "a body of no size": lambda: rg.namer(rg.setting_of([], "light"), float("nan")),
    "a task of a long name": lambda: rg.load_task("a" * 5000 + ".py"),
    "a table of no study": lambda: table("nowhere", "runs"),
}


@pytest.mark.parametrize("call", OTHERS.values(), ids=OTHERS.keys())
def test_everything_else_refuses_what_does_not_fit(call, monkeypatch, tmp_path: Path):
    """Decoding, breeding, algorithms, loaders raise the package's own errors, before they make anything."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(RealityGapError):
        call()
    assert not list(tmp_path.iterdir())


def test_a_number_of_few_bits_is_a_number():
    """NumPy's float32 too, without a warning, however strictly NumPy is set."""
    with np.errstate(all="raise"):
        assert rg.Start(x_cm=np.float32(25), y_cm=25).x_cm == 25
    with np.errstate(all="raise"), pytest.raises(rg.UsageError, match="x_cm: expected a finite number"):
        rg.Start(x_cm=np.float32("inf"), y_cm=25)


def test_values_go_where_their_names_go(tmp_path: Path):
    """A Task, a Profile, an Arena are taken wherever their names or files are."""
    task, profile, arena = rg.load_task("light"), rg.load_profile("paper"), rg.load_arena("light-seeking")
    assert rg.load_task(task) is task and rg.load_profile(profile) is profile
    assert rg.load_arena(arena) is arena
    assert rg.Simulation("light", "paper", "zero", arena="light-seeking").task.name == task.name
    assert rg.StudyConfig.single(task) == rg.StudyConfig.single("light-seeking")
    assert rg.setting_of([], task) == rg.setting_of([], "light")


def test_a_transfer_keeps_its_lists():
    """What was given may be used up, or changed later."""
    runs = [1, "light-seeking-1"]
    made = rg.Transfer(runs=iter(runs), robots=(f"twin:{unit}" for unit in (1, 2)))
    other = rg.Transfer(runs=runs, robots=["twin:1", "twin:2"])
    runs.append(3)
    assert made == other and made.runs == (1, "light-seeking-1") and len(made.bodies) == 2


@pytest.mark.parametrize("what", ["profile", "arena"])
def test_a_study_takes_a_profile_or_an_arena_by_its_path(tmp_path: Path, what: str):
    """A Path is read as its text is: this one leads nowhere."""
    with pytest.raises(RealityGapError, match=r"nowhere\.toml: no such file"):
        rg.evolve("light", **{what: tmp_path / "nowhere.toml"}, out=tmp_path / "study", workers=1)


def test_a_task_of_a_file_is_named_by_its_file():
    """A Task stands for the file that it came from; one that was changed in Python is refused."""
    from dataclasses import replace

    task = rg.load_task(EXAMPLE)
    assert rg.StudyConfig.single(task).conditions[0].task == str(EXAMPLE)
    for changed in (replace(task, seconds=3.0), replace(task, score=lambda path, room: 1.0)):
        with pytest.raises(rg.UsageError, match=r"no longer matches .*follow_the_wall\.py"):
            rg.StudyConfig.single(changed)
    with pytest.raises(rg.UsageError, match="loaded from a file"):
        rg.StudyConfig.single(replace(task, source=None))


def test_a_study_goes_where_its_folder_goes(tmp_path: Path):
    """Whoever wants a study's path takes a Study, and whoever wants a Study its path."""
    small = {"retest_trials": 1, "fresh_trials": 1, "evaluations": 2}
    config = rg.StudyConfig.single(rg.load_task("light"), **small)
    study = rg.run_study(tmp_path / "study", config.with_settings(["task.seconds=0.5"]), workers=1)
    task = study.task("light-seeking")
    assert rg.load_study(study).folder == study.folder and rg.load_transfers(study) == []
    assert study.task(task) == task
    assert rg.marks_of(study.folder) == rg.marks_of(study)
    assert rg.run_study(study, resume=True, workers=1).runs == study.runs
    assert rg.build_report(study) == study.folder / "report" / "index.html"
