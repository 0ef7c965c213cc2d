"""Films in and out."""

import os

import numpy as np
import pytest

from realitygap.film.disk import Disk
from realitygap.film.tracker import track_film
from realitygap.film.video import FilmReader, FilmWriter


def steps(count=30):
    """Grey pictures that grow brighter, one by one, under a little grain."""
    grain = np.random.default_rng(1).integers(-6, 7, (48, 64))
    return [np.clip(40 + 4 * i + grain, 0, 255).astype(np.uint8) for i in range(count)]


def write(path, pictures, **extra):
    """Pictures as a film."""
    with FilmWriter(path, rate=10, made_by="a test", notes=extra) as film:
        for picture in pictures:
            film.add(picture)
    return path


def test_film_comes_back(tmp_path):
    """Every frame comes back in order, at its time, nearly as bright; so do the notes."""
    path = write(tmp_path / "film.mp4", steps(), task="obstacle avoidance")
    with FilmReader(path) as film:
        assert film.notes == {"made_by": "a test", "task": "obstacle avoidance"}
        frames = [(f.t_s, float(f.grey.mean()), f.colour().shape) for f in film]
        assert film.frames_expected == len(frames) == 30
        assert film.trouble is None
    assert np.allclose([t for t, *_ in frames], np.arange(30) / 10, atol=1e-4)
    light = np.array([mean for _, mean, _ in frames])
    assert np.allclose(np.diff(light), light[-1] / 29 - light[0] / 29, atol=1.0)
    assert {shape for *_, shape in frames} == {(48, 64, 3)}


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="a process cannot be kept to one core here")
def test_a_film_is_the_same_on_any_number_of_cores(tmp_path):
    """With one core to run on, the file has the bytes that it has with all."""
    cores, draw = os.sched_getaffinity(0), np.random.default_rng(0)
    pictures = draw.normal(120, 20, (12, 240, 320)).clip(0, 255).astype(np.uint8)
    made = []
    try:
        for few in (cores, {min(cores)}):
            os.sched_setaffinity(0, few)
            made.append(write(tmp_path / f"{len(made)}.mp4", pictures).read_bytes())
    finally:
        os.sched_setaffinity(0, cores)
    same = made[0] == made[1]  # pytest would compare them for minutes
    assert same, [len(one) for one in made]


def test_failed_film_leaves_nothing(tmp_path):
    """A film whose making fails leaves no file, and a film that was there stays."""
    path = write(tmp_path / "film.mp4", steps(3))
    before = path.read_bytes()
    with pytest.raises(ZeroDivisionError), FilmWriter(path, rate=10, made_by="a test") as film:
        film.add(steps(1)[0])
        raise ZeroDivisionError
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_cut_off_film_is_kept_up_to_there(tmp_path, clean_film, camera, poses, errors_of):
    """Of a film that was cut off what can be read is tracked, and the cut is said."""
    data, path = clean_film.read_bytes(), tmp_path / "cut.mp4"
    path.write_bytes(data[: int(0.6 * len(data))])
    tracked = track_film(path, camera, Disk())
    count = len(tracked.track)
    assert 3 < count < len(poses)
    assert f"{count} of about {len(poses)} frames could be read" in tracked.trouble
    off, _ = errors_of(tracked.track, poses[:count])
    assert off.max() < 1.5


def test_garbled_film_is_never_guessed(tmp_path, clean_film, camera, poses, errors_of):
    """Where bytes of a film were changed a frame is lost or right, not wrong."""
    data = bytearray(clean_film.read_bytes())
    for place in np.random.default_rng(5).integers(len(data) // 3, len(data), 12):
        data[place] ^= 0x55
    path = tmp_path / "garbled.mp4"
    path.write_bytes(bytes(data))
    tracked = track_film(path, camera, Disk())
    assert tracked.trouble is not None
    truth = poses[np.rint(tracked.track.t * 25 / 4).astype(int)]
    off, _ = errors_of(tracked.track, truth)
    assert 5 < len(off) < len(poses)
    assert off.max() < 1.5
