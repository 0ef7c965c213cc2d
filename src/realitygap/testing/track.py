"""What every track says, whoever saw the robot."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from realitygap.correspondence.trials import SLOWEST_HZ
from realitygap.track import Track, read_track

__all__ = ["TrackContract"]

FARTHEST_CM = 1e4
"""No arena is so large: a track in millimetres or pixels is found out."""


class TrackContract:
    """Tests of whatever makes tracks (a tracker, a motion capture, another simulator): override `track`.

    Example:
        class TestMyTracker(TrackContract):
            def track(self):
                return my_tracker("film.mp4")
    """

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
        with TemporaryDirectory() as folder:
            track.write_csv(Path(folder) / "track.csv")
            again = read_track(Path(folder) / "track.csv")
        assert np.array_equal(again.found, track.found) and np.allclose(again.t, track.t, atol=0.06)
        seen = track.found
        assert np.allclose(again.x[seen], track.x[seen], atol=1e-4)
        assert np.allclose(again.y[seen], track.y[seen], atol=1e-4)
        assert np.abs(np.sin((again.heading - track.heading)[seen] / 2)).max() < 1e-4
