"""Transfer to the twin: pairs, same bits, interruptions, films, lines that die."""

from __future__ import annotations

import os
import shutil
import signal
import threading
import time
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from realitygap.errors import (
    ConfigError,
    LineError,
    RobotStoppedError,
    StudyError,
    StudyInterruptedError,
    UsageError,
)
from realitygap.film.video import FilmReader
from realitygap.robots.drive import Recording
from realitygap.study.load import Study, load_study
from realitygap.track import read_track
from realitygap.transfer.options import Transfer
from realitygap.transfer.record import half_folder, load_transfers
from realitygap.transfer.replay import Replays
from realitygap.transfer.run import TransferredTrial, TrialWorker
from realitygap.transfer.spec import trial_specs
from realitygap.twin.camera import OverheadCamera
from realitygap.work.archive import unpacked
from tests.served import Served
from tests.transfer.helpers import transfer

SECONDS = 1.0


@pytest.fixture
def study(finished, tmp_path) -> Study:
    """A copy of the finished small study, of one's own."""
    return load_study(shutil.copytree(finished.folder, tmp_path / "copy"))


@pytest.fixture(scope="module")
def made(finished, tmp_path_factory) -> list[TransferredTrial]:
    """Two starts of both champions, made in this process."""
    copy = shutil.copytree(finished.folder, tmp_path_factory.mktemp("made") / "copy")
    return transfer(load_study(copy), starts=2, seconds=SECONDS, workers=1)


@pytest.fixture
def watched(study, made) -> Study:
    """The same, its cameras calibrated already."""
    for file in made[0].folder.parents[1].glob("camera-*.json"):
        place = study.folder / "transfer" / file.parent.name
        place.mkdir(parents=True, exist_ok=True)
        shutil.copy(file, place)
    return study


def files(folder: Path) -> dict[str, bytes]:
    """Every file of a transfer, in archives too."""
    with unpacked(folder / "transfer") as root:
        return {str(p.relative_to(root)): p.read_bytes() for p in sorted(root.rglob("*")) if p.is_file()}


def loose(one: TransferredTrial, place: Path) -> Path:
    """A folder with a trial's files."""
    with unpacked(one.folder) as here:
        return Path(shutil.copytree(here, place / one.folder.name))


def test_a_trial_begins_where_its_simulation_does(made, finished):
    """Both paths of a pair begin at the start that the task draws; no two starts are the same."""
    for one in made:
        assert one.situated.t.tolist() == one.simulated.t.tolist()
        assert len(one.simulated.t) == round(SECONDS / 0.1) + 1
        for path, near in ((one.simulated, 1e-5), (one.situated, 0.05)):
            assert path.x[0] == pytest.approx(one.pose.x, abs=near)
            assert path.y[0] == pytest.approx(one.pose.y, abs=near)
            assert abs((path.heading_deg[0] - one.pose.heading_deg + 180) % 360 - 180) < 10 * near
        assert finished.task(one.task).arena.obstacle_at(one.pose.x, one.pose.y, 2.9) is None
    assert len({(one.pose.x, one.pose.y, one.pose.heading) for one in made}) == 4


def test_the_number_of_workers_changes_no_bit(made, study):
    """Two processes write the same files as one, the camera's calibration too."""
    transfer(study, [1], starts=2, seconds=SECONDS, workers=2)
    whole = files(made[0].folder.parents[3])
    assert files(study.folder) == {name: whole[name] for name in whole if study.runs[0].task in name}


def test_an_interrupted_transfer_goes_on_to_the_same_bits(made, watched, monkeypatch):
    """Ctrl-C keeps finished trials; only the others, a half one included, are made then."""
    monkeypatch.setattr("realitygap.work.progress.EVERY_S", 0.0)  # each trial is told, however fast

    def stop(event):
        if event.done == 2:
            raise KeyboardInterrupt

    with pytest.raises(StudyInterruptedError, match="kept"):
        transfer(watched, starts=2, seconds=SECONDS, workers=1, on_progress=stop)
    kept = load_transfers(watched.folder)
    assert len(kept) == 2
    half = half_folder(watched.folder / "transfer/twin-1/light-seeking-double-1/start-2")
    half.mkdir(parents=True, exist_ok=True)
    (half / "steps.csv").write_text("half a")
    done = [TrialWorker.by_itself]
    monkeypatch.setattr(TrialWorker, "by_itself", lambda *some: done.append(some) or done[0](*some))
    transfer(watched, starts=2, seconds=SECONDS, workers=1)
    assert len(done) == 1 + 4 - len(kept)
    assert files(watched.folder) == files(made[0].folder.parents[3])


def test_units_and_noise_and_seeds_are_different_robots(study):
    """Another unit, noise scale or seed: another path; each has a folder of its own, or is refused."""
    settings = {"seconds": SECONDS, "workers": 1, "path_from": "wheels"}
    both = transfer(study, [1], robots=("twin:1", "twin:2"), **settings)
    loud = transfer(study, [1], twin_noise=2.0, **settings)
    fittest = transfer(study, [1], individual="fittest", **settings)
    assert [one.robot for one in both + loud] == ["twin-1", "twin-2", "twin-1-noise-2"]
    ends = [one.situated.heading_deg.tolist() for one in both + loud]
    assert ends[0] != ends[1] != ends[2] != ends[0]
    assert both[0].pose == both[1].pose == loud[0].pose
    assert len(load_transfers(study.folder)) == len({one.folder for one in both + loud + fittest}) == 4
    with pytest.raises(StudyError, match=r"seed = 7, not 8.*move the folder"):
        transfer(study, [1], seed=8, **settings)
    with pytest.raises(StudyError, match=r"seconds = 1.0, not 2.0"):
        transfer(study, [1], seconds=2.0, workers=1)


@pytest.mark.parametrize("view", ["drawn", "mujoco"])
def test_a_film_is_tracked_to_the_truth(watched, view, monkeypatch):
    """Mean error below 0.4 mm and 0.5°; a trial is made again to be filmed. A drawing needs no renderer."""
    if view == "drawn":
        monkeypatch.setenv("MUJOCO_GL", "glory")
    else:
        try:
            OverheadCamera({"size_cm": [60.0, 60.0]}, unit=1, view=view).close()
        except ConfigError as error:
            pytest.skip(str(error))
    before = transfer(watched, [2], seconds=SECONDS, workers=1, path_from="wheels")[0]
    one = transfer(watched, [2], seconds=SECONDS, workers=1, film=True, view=view)[0]
    assert before.situated_from == "counters" and one.situated_from == "film" and one.filmed
    assert transfer(watched, [2], seconds=SECONDS, workers=1)[0].situated_from == "film"  # kept
    assert one.view is not None and one.view.lower().startswith(view)
    track, truth = read_track(one.folder / "track.csv"), read_track(one.folder / "sealed.csv")
    with FilmReader(one.folder / "film.mp4") as film:
        assert film.notes["view"] == one.view
    assert len(track) == round(25 * SECONDS) + 1 and track.lost == 0
    shown = np.searchsorted(truth.t - truth.t[0], track.t + 1e-6, side="right") - 1
    off = np.hypot(track.x - truth.x[shown], track.y - truth.y[shown])
    turned = (track.heading_deg - truth.heading_deg[shown] + 180) % 360 - 180
    assert off.mean() < 0.04 and off.max() < 0.15
    assert np.abs(turned).mean() < 0.5
    assert (one.folder / "tails.png").read_bytes()[:4] == b"\x89PNG"
    assert (one.folder / "camera.json").is_file()
    for name in ("x", "y"):
        path = getattr(one.situated, name)
        assert path == pytest.approx(np.interp(one.situated.t, track.t, getattr(track, name)), abs=1e-3)
        assert path == pytest.approx(
            getattr(before.situated, name), abs=1.0
        )  # the same drive, by the counters
    assert Recording.from_folder(one.folder).ended == "finished"


def test_a_watched_trial_is_seen_ten_times_a_second(made, watched, tmp_path):
    """By default the camera above sees the twin: sub-millimetre, a frame a step, no film, any library."""
    one = made[0]
    assert one.situated_from == "camera" and not one.filmed and one.view.startswith("drawn")
    folder = loose(one, tmp_path / "one")
    assert not (folder / "film.mp4").exists() and one.lost_steps == 0
    assert not (folder / "sealed.csv").exists()
    with closing(
        TrialWorker(watched, watched.folder, watched.folder)
    ) as stage:  # the same drive, the truth of it kept
        again = next(trial_specs(watched, Transfer(runs=[one.run], robots=["twin:1"], seconds=SECONDS)))
        driver = watched.controller(one.task, watched.runs[one.run - 1].champion)
        pose, sealed = stage.simulation(again.task, again.noise).start(again.stream), tmp_path / "sealed.csv"
        stage.rig(again).trial(driver, again.stream, pose, SECONDS, sealed=sealed)
    track, truth = read_track(folder / "track.csv"), read_track(sealed)
    shown = np.searchsorted(truth.t - truth.t[0], one.situated.t + 1e-6, "right") - 1
    path = one.situated
    off = np.hypot(path.x - truth.x[shown], path.y - truth.y[shown])
    assert len(track) == len(path.t) and off.mean() < 0.03 and off.max() < 0.1
    counted = transfer(watched, [one.run], seconds=SECONDS, workers=1, path_from="wheels")[0]
    assert counted.situated_from == "counters" and counted.view is None
    again = loose(counted, tmp_path / "counted")
    assert not (again / "sealed.csv").exists()
    assert counted.situated.x == pytest.approx(path.x, abs=1.0)  # the same drive
    assert (again / "steps.csv").read_bytes() == (folder / "steps.csv").read_bytes()
    assert transfer(watched, [one.run], seconds=SECONDS, workers=1)[0].situated_from == "camera"  # made again


def test_a_robot_that_pushes_a_wall_is_seen_to_stand(watched, monkeypatch):
    """The counters leave the arena where wheels slip against a wall; the camera does not."""
    from realitygap.control.genotype import Genotype

    task = watched.task("obstacle-avoidance")
    genes = Genotype.constant(8, 8).genes
    monkeypatch.setattr(Study, "genotype", lambda self, run, number: genes)
    width, depth = task.arena.size_cm
    for path_from in ("wheels", "camera"):
        path = transfer(watched, [1], seconds=8.0, workers=1, path_from=path_from)[0].situated
        outside = max(path.x.max() - width, path.y.max() - depth, -path.x.min(),
                      -path.y.min())  # fmt: skip
        assert bool(outside < 0.0) is (path_from == "camera")


def after_rows(study, one, then):
    """Do something once the recording of a drive has two rows."""
    steps = half_folder(study.folder / one.folder) / "steps.csv"

    def wait():
        while not steps.is_file() or steps.read_text().count("\n") < 3:
            time.sleep(0.01)
        then()

    threading.Thread(target=wait, daemon=True).start()


def test_a_line_that_dies_keeps_its_recording(study):
    """One clear message, a readable recording, and the next try does not throw it away."""
    arena = study.task("obstacle-avoidance").arena.plain()
    with Served(arena, unit=1) as twin:

        def carry(one, pose):
            twin.place(pose)
            after_rows(study, one, lambda: os.kill(twin.pid, signal.SIGKILL))

        with pytest.raises(LineError, match="recording is kept in") as told:
            transfer(study, [1], robots=(f"serial:{twin.device}",), seconds=4.0, carry=carry)
    assert "\n" not in str(told.value)
    half = next((study.folder / "transfer").glob("serial-*/*/start-1.half"))
    recording = Recording.from_folder(half)
    assert 2 <= len(recording.t) < 40 and recording.ended.startswith("LineError")
    assert load_transfers(study.folder) == []


def test_a_robot_on_a_port_is_carried_to_its_starts(study):
    """Each start is asked for; Ctrl-C stops the robot first; a second try keeps what was recorded."""
    arena = study.task("obstacle-avoidance").arena.plain()
    asked = []
    with Served(arena, unit=1) as twin:
        settings = {"robots": (f"serial:{twin.device}",), "seconds": SECONDS, "starts": 2}

        def carry(one, pose):
            asked.append(one.start)
            twin.place(pose)
            if len(asked) == 2:
                after_rows(study, one, lambda: os.kill(os.getpid(), signal.SIGINT))

        with pytest.raises(RobotStoppedError, match="told to stop first; its recording is kept"):
            transfer(study, [1], carry=carry, **settings)
        both = transfer(study, [1], carry=carry, **settings)
    assert asked == [1, 2, 2]
    assert [one.situated_from for one in both] == ["counters", "counters"] and both[0].unit is None
    assert [one.start for one in load_transfers(study.folder)] == [1, 2]
    assert (both[1].folder.parent / "start-2.stopped-1" / "steps.csv").is_file()


def test_what_cannot_be_done_is_refused(study):
    """Runs, ports, films of real robots, broken files: each by its name."""
    port = ("serial:/dev/no-such-port",)
    with pytest.raises(StudyError, match="expected a run"):
        transfer(study, [9])
    with pytest.raises(UsageError, match="film"):
        transfer(study, robots=port, carry=lambda one, pose: None, film=True)
    with pytest.raises(UsageError, match="operator"):
        transfer(study, robots=port)
    with pytest.raises(UsageError, match=r"film: expected runs that drive \(1\), starts 1 to 1, got"):
        transfer(study, [1], film=[(1, 2)])


def test_a_broken_trial_file_is_named(made, study):
    """`load_transfers` says which file cannot be read."""
    shutil.copytree(made[0].folder.parents[2], study.folder / "transfer")
    assert [one.run for one in load_transfers(study.folder)] == [1, 1, 2, 2]
    run = study.folder / "transfer/twin-1/obstacle-avoidance-observed-1"
    shutil.move(loose(made[0], run), run / "start-1")
    file = run / "start-1" / "transfer.toml"
    file.write_text("run = 1\n")
    with pytest.raises(StudyError, match=r"start-1/transfer\.toml"):
        load_transfers(study.folder)
    shutil.rmtree(run)
    packed = run.with_name(f"{run.name}.zip")
    data = bytearray(packed.read_bytes())
    data[len(data) // 3] ^= 4
    packed.write_bytes(data)
    with pytest.raises(StudyError, match=r"observed-1\.zip: .*Restore the file from a copy"):
        [one.situated for one in load_transfers(study.folder) if one.run == 1 and one.simulated]


def test_a_transfer_can_be_lived_once_more(made, finished):
    """Simulated again to the path on file, with the individual's genes; the recording beside it."""
    replays = Replays(load_study(finished.folder))
    for one in made:
        genes, simulated, situated = replays.of(one.folder)
        assert np.array_equal(genes.genes, finished.run(one.run).champion)
        assert np.abs(np.append(simulated.x, simulated.end.x) - one.simulated.x).max() < 1e-5
        assert len(situated.t) == len(simulated.t) == round(10 * SECONDS)


def test_another_path_on_file_is_not_passed_off_as_the_simulations(made, finished, tmp_path):
    """As of another version: what it read is then not known."""
    folder = loose(made[0], tmp_path / "robot" / "run")
    lines = (folder / "simulated.csv").read_text("utf-8").splitlines()
    last = lines[-1].split(",")
    lines[-1] = ",".join([last[0], f"{float(last[1]) + 0.01:.6f}", *last[2:]])
    (folder / "simulated.csv").write_text("\n".join(lines) + "\n", "utf-8")
    genes, simulated, situated = Replays(load_study(finished.folder)).of(folder)
    assert genes is not None and simulated is None and situated is not None
