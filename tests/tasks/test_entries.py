"""Every public way into compiled code refuses arrays that do not fit, before anything is compiled on."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import realitygap as rg
from realitygap.errors import RealityGapError
from realitygap.evolution import make_algorithm
from realitygap.export import lived, on_board, table
from realitygap.kernels.params import Networks
from realitygap.simulation.body import SimulatedBody

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "follow_the_wall.py"
LAYOUT = rg.Layout()
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
    made = rg.decode(GENES, LAYOUT)
    for name, new in change.items():
        if isinstance(new, tuple):
            array = getattr(made, name).copy()
            array[new[0]] = new[1]
            new = array
        made = made._replace(**{name: new})
    return made


SCORES: dict[str, Callable[[rg.Simulation], object]] = {
    "more rows of streams than networks": lambda s: s.scores(nets(), np.zeros((5000, 2), np.uint64)),
    "fewer rows of streams": lambda s: s.scores(nets(), STREAMS[:1]),
    "streams in one dimension": lambda s: s.scores(nets(), STREAMS[0]),
    "streams of another type": lambda s: s.scores(nets(), np.zeros((2, 3))),
    "streams in a list": lambda s: s.scores(nets(), [[1], [2]]),  # type: ignore[arg-type]
    "streams in a matrix": lambda s: s.scores(nets(), np.matrix(STREAMS)),
    "streams behind a mask": lambda s: s.scores(nets(), np.ma.array(STREAMS, mask=STREAMS == 0)),
    "genes for networks": lambda s: s.scores(GENES, STREAMS),  # type: ignore[arg-type]
    "no networks": lambda s: s.scores(None, STREAMS),  # type: ignore[arg-type]
    "more inputs": lambda s: s.scores(nets(inputs=np.full(2, 12)), STREAMS),
    "other inputs than the task": lambda s: s.scores(
        rg.decode(rg.random_genotype(rg.Layout(inputs=4), np.uint64(1)), rg.Layout(inputs=4)), STREAMS[:1]
    ),
    "more neurons than there are": lambda s: s.scores(nets(neurons=(0, 23)), STREAMS),
    "no motors": lambda s: s.scores(nets(neurons=(1, 1)), STREAMS),
    "a link from nowhere": lambda s: s.scores(nets(links=((0, 0, 1), 20000)), STREAMS),
    "a link from below": lambda s: s.scores(nets(links=((0, 0, 1), -1)), STREAMS),
    "a link too late": lambda s: s.scores(nets(links=((0, 0, 3), 5)), STREAMS),
    "a link too heavy": lambda s: s.scores(nets(links=((0, 0, 2), 30000)), STREAMS),
    "links that end beyond": lambda s: s.scores(nets(link_start=((0, 1), 9999)), STREAMS),
    "links that end before they begin": lambda s: s.scores(nets(link_start=((0, 1), -1)), STREAMS),
    "a sensor's link to nowhere": lambda s: s.scores(nets(sensor_links=((0, 0, 0), 99)), STREAMS),
    "a sensor that is not there": lambda s: s.scores(nets(sensor_links=((0, 0, 1), 8)), STREAMS),
    "sensor links out of order": lambda s: s.scores(nets(sensor_links=((0, 0, 3), 4)), STREAMS),
    "too many sensor links": lambda s: s.scores(nets(sensor_count=(0, 10**6)), STREAMS),
    "a threshold beyond all": lambda s: s.scores(nets(thresholds=((0, 0), 99)), STREAMS),
    "weights as floats": lambda s: s.scores(nets(links=np.zeros((2, 176, 4))), STREAMS),
    "arrays of another size": lambda s: s.scores(nets(thresholds=np.zeros((2, 3), np.int16)), STREAMS),
    "arrays in a list": lambda s: s.scores(nets(neurons=[2, 2]), STREAMS),
    "arrays with gaps": lambda s: s.scores(nets(neurons=np.full(4, 2)[::2]), STREAMS),
    "two networks for one trajectory": lambda s: s.trajectory(nets(), stream=1),
    "a stream below 0": lambda s: s.trajectory(rg.decode(GENES[0], LAYOUT), stream=-1),
    "a stream of 65 bits": lambda s: s.start(2**64),
    "a stream in words": lambda s: s.probe(rg.Pose(x=25, y=25, heading=0), stream="one"),  # type: ignore[arg-type]
    "a pose in a tuple": lambda s: s.probe((25, 25, 0)),  # type: ignore[arg-type]
    "a pose of nothing": lambda s: s.probe(rg.Pose(x=None, y=25, heading=0)),  # type: ignore[arg-type]
    "a pose in words": lambda s: s.start(1) and s.require_free(rg.Pose(x=25, y="up", heading=0)),  # type: ignore[arg-type]
    "descriptors of nothing": lambda s: rg.describe(None, s.task, s.profile),  # type: ignore[arg-type]
    "no repetition": lambda s: s.probe(rg.Pose(x=25, y=25, heading=0), repeat=0),
    "repetitions without end": lambda s: s.probe(rg.Pose(x=25, y=25, heading=0), repeat=10**12),
    "seconds in words": lambda s: s.trajectory(rg.decode(GENES[0], LAYOUT), stream=1, seconds="long"),  # type: ignore[arg-type]
    "seconds without end": lambda s: s.trajectory(rg.decode(GENES[0], LAYOUT), stream=1, seconds=1e12),
    "a command beyond the robot's": lambda s: SimulatedBody(s).act(rg.Command(left=10**12, right=0)),
    "a command of nothing": lambda s: SimulatedBody(s).act(None),  # type: ignore[arg-type]
    "a command in a tuple": lambda s: SimulatedBody(s).act((5, 5)),  # type: ignore[arg-type]
    "a body on half a stream": lambda s: reset_on(s, 2.5),
    "a body on a stream below 0": lambda s: reset_on(s, -2),
    "a body on a stream in words": lambda s: reset_on(s, "x"),
    "an output between two": lambda s: s.profile.wheels.command(0.4),
    "an output beyond the ten": lambda s: s.profile.wheels.command(25),
    "an output that is no number": lambda s: s.profile.wheels.command(float("nan")),
    "outputs in an array": lambda s: s.profile.wheels.command(np.array([1, 2])),
    "an output in words": lambda s: s.profile.wheels.command("5"),
    "a drive in nothing": lambda s: rg.drive_simulated(None, lambda inputs: (1, 1)),  # type: ignore[arg-type]
    "a network's drive in a task": lambda s: rg.drive_simulated(s.task, rg.NetworkController(GENES[0])),  # type: ignore[arg-type]
    "a body of nothing": lambda s: SimulatedBody(None),  # type: ignore[arg-type]
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
    nobody = rg.decode(GENES[:0], LAYOUT)
    assert simulation.scores(nobody, STREAMS[:0]).shape == (0, 3)
    assert simulation.tracks(nobody, STREAMS[:0]).x.shape[:2] == (0, 3)


def genes(*place: object) -> np.ndarray:
    """A genotype with one value changed: place and value."""
    changed = GENES[0].copy()
    changed[place[:2]] = place[2]  # type: ignore[index]
    return changed


def torus() -> tuple[object, object]:
    """A torus of the paper's, and its first state."""
    algorithm = make_algorithm("torus", VARIATION, rows=3, columns=3)
    return algorithm, algorithm.init(np.uint64(1))


def asked(**change: object) -> object:
    """The first candidate of a torus, changed and told."""
    algorithm, state = torus()
    candidate = algorithm.ask(state, 1)._replace(**change)  # type: ignore[attr-defined]
    return algorithm.tell(state, candidate, [0.0])  # type: ignore[attr-defined]


OTHERS: dict[str, Callable[[], object]] = {
    "genes of another layout": lambda: rg.decode(np.zeros((1, 40, 14), np.int8), LAYOUT),
    "genes as floats": lambda: rg.decode(GENES.astype(float), LAYOUT),
    "genes in a list": lambda: rg.decode(GENES.tolist(), LAYOUT),
    "a source that is no slot": lambda: rg.decode(genes(8, 3, 120), LAYOUT),
    "a source below 0": lambda: rg.decode(genes(8, 3, -1), LAYOUT),
    "a delay beyond the longest": lambda: rg.decode(genes(8, 5, 100), LAYOUT),
    "a motor left out": lambda: rg.decode(genes(8, 0, 0), LAYOUT),
    "no layout": lambda: rg.decode(GENES, None),
    "a controller of another layout": lambda: rg.NetworkController(GENES[0], rg.Layout(slots=12)),
    "a controller of a list": lambda: rg.NetworkController([1, 2]),
    "inputs beyond the ten": lambda: rg.NetworkController(GENES[0]).decide([11] * 8),
    "inputs of nothing": lambda: rg.NetworkController(GENES[0]).decide(None),
    "inputs in words": lambda: rg.NetworkController(GENES[0]).decide("straight"),
    "degrees of nothing": lambda: rg.Pose.from_degrees(None, 25, 90),
    "degrees in words": lambda: rg.Pose.from_degrees(25, 25, "north"),
    "inputs that are no numbers": lambda: rg.NetworkController(GENES[0]).decide([float("nan")] * 8),
    "a parent of another layout": lambda: VARIATION.offspring(GENES[0], GENES[0, :20], np.uint64(1)),
    "a parent in a list": lambda: VARIATION.offspring(GENES[0].tolist(), GENES[1], np.uint64(1)),
    "a stream of breeding below 0": lambda: VARIATION.random(-1),
    "a layout in words": lambda: rg.Variation(layout="large"),
    "a candidate for no cell": lambda: asked(cells=np.array([9])),
    "a candidate for a cell below 0": lambda: asked(cells=np.array([-1])),
    "a candidate of another layout": lambda: asked(genes=np.zeros((1, 3, 6), np.int8)),
    "a fitness in words": lambda: torus()[0].tell(torus()[1], torus()[0].ask(torus()[1], 1), "high"),
    "a population beyond all memory": lambda: make_algorithm("torus", VARIATION, rows=10**6, columns=10**6),
    "a size beyond all memory": lambda: make_algorithm("random", VARIATION, size=10**9),
    "a task in numbers": lambda: rg.load_task(3),
    "a profile in numbers": lambda: rg.load_profile(3),
    "an arena of nothing": lambda: rg.load_arena(None),
    "a simulation of nothing": lambda: rg.Simulation(None, None),
    "a study in numbers": lambda: rg.load_study(3),
    "a study of nothing": lambda: rg.run_study("nowhere", 3),
    "a folder in a list": lambda: rg.run_study([1]),
    "marks of a list": lambda: rg.marks_of([1]),
    "transfers of no folder": lambda: rg.load_transfers("nowhere"),
    "robots in a word": lambda: rg.Transfer(robots="twin"),
    "robots in numbers": lambda: rg.Transfer(robots=[3]),
    "robots of nothing": lambda: rg.Transfer(robots=None),
    "no robots": lambda: rg.Transfer(robots=[]),
    "runs in a number": lambda: rg.Transfer(runs=1),
    "films in a number": lambda: rg.Transfer(film=1),
    "films of nothing": lambda: rg.Transfer(film=None),
    "films in a word": lambda: rg.Transfer(film="1"),
    "films of words": lambda: rg.Transfer(film=["1"]),
    "films of three numbers": lambda: rg.Transfer(film=[(1, 1, 1)]),
    "starts drawn by half a seed": lambda: rg.Transfer(seed=2.5),
    "starts drawn by a seed below 0": lambda: rg.Transfer(seed=-1),
    "a transfer's noise in words": lambda: rg.Transfer(twin_noise="double"),
    "a transfer's noise beyond the largest": lambda: rg.Transfer(twin_noise=11),
    "a transfer's length in words": lambda: rg.Transfer(seconds="3"),
    "a line's rate in words": lambda: rg.Transfer(baud="fast"),
    "a marker in numbers": lambda: rg.Transfer(marker=3),
    "a camera that watches in words": lambda: rg.Transfer(watch="no"),
    "trials packed in words": lambda: rg.Transfer(pack="no"),
    "runs in a word": lambda: rg.Transfer(runs="12"),
    "runs by half their numbers": lambda: rg.Transfer(runs=[1.5]),
    "runs that are true": lambda: rg.Transfer(runs=[True]),
    "a calibration of nothing": lambda: rg.calibrate(None),
    "a calibration of numbers": lambda: rg.calibrate([3]),
    "a calibration of a generator": lambda: rg.calibrate(Path(name) for name in ["unit-1"]),
    "a genotype's place of nothing": lambda: rg.save_genotype(None, GENES[0]),
    "a genotype's place with a NUL": lambda: rg.save_genotype("\0", GENES[0]),
    "a study's place in numbers": lambda: rg.evolve("light", out=3),
    "a study's noise of nothing": lambda: rg.evolve("light", noise=None),
    "a study's spread in an object": lambda: rg.evolve("light", spread=object()),
    "a study's configuration in numbers": lambda: rg.evolve("light", config=3),
    "settings in a list": lambda: rg.evolve("light", settings=["evolution.rows=10"]),
    "a setting of no kind": lambda: rg.evolve("light", settings={"evolution.rows": np.int64(10)}),
    "a study's engine in an array": lambda: rg.evolve("light", engine=np.zeros(3)),
    "a study's engine by another name": lambda: rg.evolve("light", engine="gpu"),
    "a reproduction's engine by another name": lambda: rg.reproduce("nowhere", engine="gpu"),
    "a simulation's engine in an array": lambda: rg.Simulation("light", "paper", engine=np.zeros(3)),
    "a problem's controller in an array": lambda: rg.Problem("avoidance", np.zeros(3)),
    "a reproduction's place in numbers": lambda: rg.reproduce(3),
    "a calibration's place in numbers": lambda: rg.calibrate([], "paper", out=3),
    "transfers of nothing": lambda: rg.load_transfers(None),
    "a transfer of nothing": lambda: rg.run_transfer(None),
    "a report on nothing": lambda: rg.build_report(None),
    "a recording in numbers": lambda: rg.load_recording(3),
    "a calibration of paths": lambda: rg.calibrate(["unit-1"], "paper"),
    "a calibration of no known form": lambda: rg.calibrate([], "paper", form="best"),
    "a unit in words": lambda: rg.calibrated_unit("nowhere", unit="one", noise=1.0, seed=0),
    "tracks in numbers": lambda: rg.read_trials(3),
    "trials that are none": lambda: rg.setting_of([1]),
    "a setting of no trials": lambda: rg.setting_of([]),
    "names for numbers": lambda: rg.namer(rg.setting_of([], "light")).name([1], rg.setting_of([], "light")),
    "a task that is none": lambda: rg.setting_of([], 3),
    "a setting that is none": lambda: rg.namer("light"),
    "a body in words": lambda: rg.namer(rg.setting_of([], "light"), "2"),
    "a body of no size": lambda: rg.namer(rg.setting_of([], "light"), float("nan")),
    "a comparison of numbers": lambda: rg.compare([1], [2], None),
    "a genotype's file in numbers": lambda: rg.load_genotype(3),
    "no readings as inputs": lambda: rg.load_profile("paper").inputs(None, "proximity", range(8)),
    "readings that are no numbers": lambda: rg.load_profile("paper").inputs(
        [float("nan")] * 8, "proximity", range(8)
    ),
    "readings in words": lambda: rg.load_profile("paper").inputs(["near"] * 8, "proximity", range(8)),
    "inputs of one sensor's number": lambda: rg.load_profile("paper").inputs([0] * 8, "proximity", 3),
    "inputs of a sensor in words": lambda: rg.load_profile("paper").inputs([0] * 8, "proximity", ["left"]),
    "a controller without a layout": lambda: rg.constant(1, 1, None),
    "a vehicle without a layout": lambda: rg.braitenberg("ambient", 8),
    "a variation that is none": lambda: make_algorithm("torus", 3),
    "an algorithm in a list": lambda: make_algorithm(["torus"], VARIATION),
    "a study of a task in numbers": lambda: rg.StudyConfig.single(3),
    "a configuration of nothing": lambda: rg.StudyConfig.from_dict(None),
    "a configuration's file of nothing": lambda: rg.StudyConfig.from_toml(None),
    "a task of a long name": lambda: rg.load_task("a" * 5000 + ".py"),
    "a processor's run in numbers": lambda: on_board(1, "champion", GENES[0]),
    "a table of nothing": lambda: table(None, "runs"),
    "a table of no study": lambda: table("nowhere", "runs"),
    "a trial of nothing": lambda: lived(None),
    "a level in a list": lambda: rg.StudyConfig.single("light", [1, 2]),
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
    assert study.layout(task) == study.layout(task.name) and study.task(task) == task
    assert rg.marks_of(study.folder) == rg.marks_of(study)
    assert rg.run_study(study, resume=True, workers=1).runs == study.runs
    assert rg.build_report(study) == study.folder / "report" / "index.html"
