"""Trials, prepared for comparison: the robot's poses at 10 Hz, from any source.

They come from simulation or from files: CSV tables, JSON of `realitygap simulate`, folders of them. A track's
heading must agree with its movement: a robot with two wheels moves where it faces, or back.
"""

import json
import math
import re
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np

from realitygap.errors import ConfigError, TrackError
from realitygap.files import as_path, read_toml
from realitygap.logs.mapped import read_map
from realitygap.track import COLUMNS, Track, Trajectory, read_tracks
from realitygap.values import Floats
from realitygap.work.archive import SIMULATED, SITUATED, STALLED, TRIAL, unpacked
from realitygap.world.robot import load_profile

__all__ = [
    "RADIUS_CM", "SHORTEST_S", "SLOWEST_HZ", "STEP_S", "TooSlowError", "Trial", "doubt_of_disk",
    "doubts_of", "read_transfer", "read_trials", "resampled", "trial_of",
]  # fmt: skip

RADIUS_CM = 2.9
"""A Khepera's body (§3.1), as for the scale's exemplars."""
RATE_HZ = 10.0
"""Every track is resampled to the simulation's rate."""
STEP_S = 1.0 / RATE_HZ
SHORTEST_S = 2.0
"""Shorter tracks show too little behaviour to compare."""
LONGEST_GAP_S = 1.0
"""After a longer loss the robot may have done anything in between."""
FARTHEST_CM = 1e5
"""No robot is this far from its arena's corner: such a track is in other units."""
SLOWEST_HZ = 4.5
"""Tracks with fewer rows a second do not resolve turns."""
LARGEST_TURN = math.pi + 1e-6
"""From row to row, rad: an unwrapped heading's, but for rounding."""


class TooSlowError(TrackError):
    """Rows too far apart to show turns: a track that can be compared by its places and speeds only."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Trial:
    """One trial at 10 Hz, arrays [n]; x and y in cm, heading in rad, unwrapped.

    Not a Track: it has neither times nor gaps, and a name to compare it with others row by row.

    Attributes:
        start: name of its start; trials of two sets with the same name and pose are a pair.
        unit: the robot unit, "" if unknown.
        radius_cm: of its body, a Khepera's if unknown.
        source: the file, for messages.
        bridged_s: time lost and interpolated.
        rate_hz: rows a second of its source, at most 10.
        doubt: a warning; "" for none.

    Raises:
        TrackError: arrays that are not finite, or a heading that is not in radians or not unwrapped.
    """

    x: Floats
    y: Floats
    heading: Floats
    start: str = "1"
    unit: str = ""
    radius_cm: float = RADIUS_CM
    source: str = "track"
    bridged_s: float = 0.0
    rate_hz: float = RATE_HZ
    doubt: str = ""

    def __post_init__(self) -> None:
        turn = float(np.abs(np.diff(self.heading)).max(initial=0.0))
        if not (turn <= LARGEST_TURN and np.isfinite((self.x, self.y)).all()):
            raise TrackError(
                f"{self.source}, start {self.start}: expected finite x and y, and a heading in rad that "
                f"turns by at most π from row to row, got {turn:.3g}. Unwrap it: "
                "np.unwrap(np.radians(degrees)), or np.unwrap(radians)."
            )

    def __len__(self) -> int:
        return len(self.x)

    @property
    def seconds(self) -> float:
        """Time from the first row to the last."""
        return (len(self) - 1) * STEP_S

    def cut(self, seconds: float) -> Self:
        """Its first `seconds`."""
        n = round(seconds * RATE_HZ) + 1
        if n == len(self):
            return self
        return replace(self, x=self.x[:n], y=self.y[:n], heading=self.heading[:n])

    def pieces(self, count: int) -> list[Self]:
        """The trial cut into `count` pieces of one length."""
        n = len(self) // count
        return [
            replace(self, x=self.x[a : a + n], y=self.y[a : a + n], heading=self.heading[a : a + n],
                    start=f"{self.start}.{i + 1}")
            for i, a in enumerate(range(0, n * count, n))
        ]  # fmt: skip


def trial_of(
    trajectory: Trajectory, *, start: str = "1", unit: str = "", radius_cm: float = RADIUS_CM
) -> Trial:
    """A simulated trajectory as a trial, its last pose included; the other arguments as of `Trial`."""
    track = trajectory.track
    if len(track) > 1 and track.t[1] != STEP_S:
        return resampled(track, start=start, unit=unit, radius_cm=radius_cm)
    return Trial(
        x=track.x, y=track.y, heading=np.unwrap(track.heading), start=start, unit=unit,
        radius_cm=radius_cm, source=track.seen_by,
    )  # fmt: skip


def resampled(
    track: Track, *, start: str = "1", unit: str = "", source: str = "", radius_cm: float = RADIUS_CM
) -> Trial:
    """A track of any rate as a trial.

    Short losses are interpolated; rows before the robot was first and after it was last seen are dropped.

    Args:
        track: NaN where the robot was lost.
        start, unit, radius_cm: as of `Trial`.
        source: for messages, by default the track's source.

    Raises:
        TrackError: too short, too slow, lost for too long, or time that does not increase.
    """
    source = source or track.seen_by or "track"
    where = f"{source}, start {start}"
    rows = np.array([track.t, track.x, track.y, track.heading])
    if (np.abs(rows[1:3]) > FARTHEST_CM).any():
        raise TrackError(f"{where}: expected x_cm and y_cm in cm, got {np.nanmax(np.abs(rows[1:3])):.3g}.")
    if (np.diff(rows[0]) <= 0).any():
        at = float(rows[0][int(np.argmax(np.diff(rows[0]) <= 0)) + 1])
        raise TrackError(
            f"{where}: expected t_s to grow from row to row, got {at:g} after a time as late. "
            "Separate trials by a column start."
        )
    rows = rows[:, np.isfinite(rows).all(axis=0)]
    t = rows[0]
    seconds = float(t[-1] - t[0]) if len(t) > 1 else 0.0
    if seconds < SHORTEST_S - 1e-6:
        raise TrackError(
            f"{where}: expected at least {SHORTEST_S:g} s with the robot in sight, got {seconds:g} s. "
            "Leave this start out, or film longer."
        )
    steps = np.diff(t)
    usual = float(np.median(steps))
    if usual > 1 / SLOWEST_HZ:
        raise TooSlowError(
            f"{where}: expected at least 5 rows a second, got {1 / usual:.2g}. Turns would not show."
        )
    worst = int(np.argmax(steps))
    if steps[worst] > LONGEST_GAP_S + usual + 1e-6:
        raise TrackError(
            f"{where}: the robot is lost from {t[worst]:.2f} to {t[worst + 1]:.2f} s; at most "
            f"{LONGEST_GAP_S:g} s can be bridged. Leave this start out, or cut it there."
        )
    gaps = steps[steps > 1.5 * usual]
    if (lost := float(gaps[gaps > 1 / SLOWEST_HZ].sum())) > seconds / 4:  # shorter ones show every turn
        raise TrackError(
            f"{where}: the robot is lost for {lost:.1f} of {seconds:.1f} s; expected at most a quarter. "
            "Leave this start out."
        )
    grid = t[0] + np.arange(math.floor(seconds * RATE_HZ + 1e-6) + 1) * STEP_S
    x, y, heading = (np.interp(grid, t, values) for values in (rows[1], rows[2], np.unwrap(rows[3])))
    return Trial(
        x=x, y=y, heading=np.unwrap(heading), start=start, unit=unit, radius_cm=radius_cm, source=source,
        bridged_s=float((gaps - usual).sum()), rate_hz=min(RATE_HZ, 1 / usual),
        doubt=_jumps(track, where),
    )  # fmt: skip


JUMP_CM, JUMP_CM_S, JUMP_TIMES = 2.0, 20.0, 4.0
"""From row to row: farther than this, and so fast and so many times as fast as nine tenths of the track."""


def _jumps(track: Track, where: str) -> str:
    """A warning where a robot jumps from row to row; "" for none."""
    rows = np.flatnonzero(track.found)
    ways, steps = np.hypot(np.diff(track.x[rows]), np.diff(track.y[rows])), np.diff(track.t[rows])
    speeds = ways / steps
    most = max(JUMP_CM_S, JUMP_TIMES * float(np.quantile(speeds, 0.9)))
    far = np.flatnonzero((ways > JUMP_CM) & (speeds > most))
    if not len(far):
        return ""
    k = int(far[np.argmax(ways[far])])
    there = f"row {rows[k + 1] + 1} (t_s {track.t[rows[k + 1]]:g}): {ways[k]:.1f} cm in {steps[k]:.2g} s"
    return (
        f"{where}: jumps {len(far)} × from row to row, the farthest to {there}. Did the tracker "
        "take something else for the robot, or was it lifted? Cut the track there, or leave the place empty."
    )


# From files

MOVES_CM, ENOUGH_CM = 0.5, 20.0
"""Movement over two steps that shows a direction, and the sum of it that is needed."""
CONTRADICTS, EXPLAINS, BETTER = 0.3, 0.9, 0.1
"""Agreement below which a heading is doubted; the agreement of another reading of the heading at which that
is believed, and the improvement that is needed. Of 132 tracks, simulated and filmed on the twin, the lowest
agreement is 0.45 (a robot that slid along walls), and no other reading with such agreement was better."""
READINGS: dict[str, Callable[[Floats], Floats]] = {
    "is it in radians? Convert it to degrees": np.degrees,
    "does y run downwards, or heading_deg clockwise? Turn the sign of one of them": np.negative,
    "is heading_deg 0 where the robot looks along y? Subtract it from 90": lambda h: np.pi / 2 - h,
    "is heading_deg that of the axle? Turn it by 90": lambda h: h + np.pi / 2,
}
"""Mistakes, named by their cure, and the corrected heading (rad)."""


def read_trials(path: str | Path) -> list[Trial]:
    """All trials of a file or a folder, in order.

    A CSV file has columns t_s, x_cm, y_cm, heading_deg (empty or NaN where the robot was lost) and may
    have start (separates several trials), unit (which robot) and quality (0: lost), as `realitygap
    camera track` writes them. A JSON file is what `realitygap simulate --json` prints. In a folder every
    such file is read and its name is the start; subfolders are units. Of any other log a
    MAP.toml (`realitygap look`) names the columns; each of its runs is a trial. From a trial of
    `realitygap transfer` the robot's track is read, and its folder's name is the start; archived trials are
    read like others.

    Raises:
        TrackError: names the file, the line and the column.
    """
    with unpacked(as_path(path, "tracks")) as place:
        return _read(place, path)


def _read(place: Path, path: str | Path) -> list[Trial]:
    """The same, of a place without archives; `path` is for messages."""
    if not place.exists():
        raise TrackError(f"{path}: no such file or folder. Give a CSV file of tracks, or a folder of them.")
    if not place.is_dir():
        return _read_file(place, start="1", unit="")
    found = sorted(p for p in place.rglob("*") if p.suffix.lower() in (".csv", ".json") and _is_track(p))
    found = [p for p in found if STALLED not in p.relative_to(place).parts]
    found = [p for p in found if p.name == SITUATED or not (p.parent / TRIAL).exists()]
    if not found:
        raise TrackError(
            f"{path}: expected CSV files with columns {', '.join(COLUMNS)} in this folder, got none."
        )
    read = [(file, _read_in(place, file)) for file in found]
    keys = [(t.unit, t.start) for _, trials in read for t in trials]
    if len(set(keys)) == len(keys):
        return [t for _, trials in read for t in trials]
    return [replace(t, start=f"{file.name}:{t.start}") for file, trials in read for t in trials]


def read_transfer(path: str | Path) -> tuple[list[Trial], list[Trial]]:
    """The trials in simulation and on the robot of a folder made by `realitygap transfer`.

    Raises:
        TrackError: no such folder, or several controllers in it; names the file, the line and the column.
    """
    with unpacked(as_path(path, "tracks")) as place:
        folders = sorted(file.parent for file in place.rglob(TRIAL)) if place.is_dir() else []
        if not folders:
            raise TrackError(
                f"{path}: expected a folder of trials that `realitygap transfer` made, since there is no "
                "second set of tracks. Give one."
            )
        _require_one_controller(place, folders)
        simulated, situated = (
            [t for folder in folders for t in _read_in(place, folder / name)]
            for name in (SIMULATED, SITUATED)
        )
    return simulated, situated


def doubts_of(trials: Iterable[Trial]) -> list[str]:
    """Warnings about trials, each once."""
    return list(dict.fromkeys(trial.doubt for trial in trials if trial.doubt))


def doubt_of_disk(trial: Trial) -> tuple[str, ...]:
    """A question where a tracker's own heading contradicts the movement that it saw."""
    if agreement([trial]) >= CONTRADICTS:
        return ()
    return (
        f"{trial.source}: heading_deg contradicts the way from row to row: is the disk turned on the "
        "robot, or was the camera calibrated with other headings?",
    )


def _require_one_controller(place: Path, folders: Sequence[Path]) -> None:
    """Refuse trials of several: as one set they are no behaviour, and would all be scored in one arena."""
    facts = [read_toml(folder / TRIAL, TrackError, "Transfer again.") for folder in folders]
    whose = [tuple(one.get(key) for key in ("task", "name", "individual", "controller")) for one in facts]
    if len(set(whose)) > 1:
        last = folders[-1] if folders[-1].parent == place else folders[-1].parent
        raise TrackError(
            f"tracks: expected the trials of one controller, got those of {len(set(whose))}. Give the folder "
            f"of one of them, such as {last.relative_to(place)} in this one."
        )


def _read_in(place: Path, file: Path) -> list[Trial]:
    """A file's trials, named after its place in the folder."""
    own = (file.parent / TRIAL).exists()
    start, above = (file.parent.name, file.parent.parent) if own else (file.stem, file.parent)
    inside = above != place and above.is_relative_to(place)
    unit = str(above.relative_to(place)) if inside else ""
    trials = _read_file(file, start=start, unit=unit)
    return [replace(t, radius_cm=_radius_cm(file.parent)) for t in trials] if own else trials


def _radius_cm(folder: Path) -> float:
    """Body radius of a trial of `realitygap transfer`, from its study's profile, cm."""
    with suppress(ConfigError):
        return load_profile(folder.joinpath(*[".."] * 4, "profile.toml")).body.radius_cm
    return RADIUS_CM


def _is_track(path: Path) -> bool:
    """Whether a file is meant to be a track; a broken one is refused when it is read."""
    if path.suffix.lower() == ".json":
        found = _json(path)
        return found is None or (isinstance(found, dict) and all(name in found for name in COLUMNS))
    with suppress(OSError, UnicodeDecodeError), path.open(newline="", encoding="utf-8-sig") as file:
        head = next((line for line in file if line.strip() and not line.startswith("#")), "")
        cells = [cell.strip(' "\r\n').lower() for cell in re.split("[,;\t]", head)]
        return not head or sum(name in cells for name in COLUMNS) >= 2
    return True


def _read_file(path: Path, *, start: str, unit: str) -> list[Trial]:
    if path.suffix.lower() == ".json":
        return _with_doubts([_from_json(path, start, unit)])
    by_map = path.suffix.lower() == ".toml"
    tracks = read_map(path).tracks() if by_map else read_tracks(path, start=start, unit=unit)
    if not tracks:
        raise TrackError(f"{path}: expected rows below its first line, got none. Film again.")
    return _with_doubts([
        resampled(track, start=start, unit=unit, source=str(path)) for (start, unit), track in tracks.items()
    ])  # fmt: skip


def _from_json(path: Path, start: str, unit: str) -> Trial:
    data = _json(path)
    try:
        columns = [[math.nan if v is None else float(v) for v in data[name]] for name in COLUMNS]
    except (KeyError, TypeError, ValueError, OverflowError):
        raise TrackError(
            f"{path}: expected JSON with lists {', '.join(COLUMNS)}, as `realitygap simulate --json` prints."
        ) from None
    if len({len(column) for column in columns}) != 1:
        raise TrackError(f"{path}: expected lists of one length, got {[len(c) for c in columns]}.")
    return resampled(Track.from_degrees(*columns), start=start, unit=unit, source=str(path))


def _json(path: Path) -> Any:
    """A file's JSON; None if it cannot be read."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, ValueError, RecursionError):
        return None


def _with_doubts(trials: Sequence[Trial]) -> list[Trial]:
    """The trials of one file, with a warning if the heading seems wrong.

    Raises:
        TrackError: the heading contradicts the movement, and another reading of it does not.
    """
    as_is = agreement(trials)
    best, cure = max((agreement(trials, other), cure) for cure, other in READINGS.items())
    found = f"{trials[0].source}: heading_deg contradicts the way from row to row"
    if best > EXPLAINS and best > as_is + BETTER:
        raise TrackError(f"{found}: {cure}.")
    far = max(float(np.abs((trial.x, trial.y)).max()) for trial in trials)
    doubt = ""
    if as_is < CONTRADICTS:
        doubt = f"{found}: is it the robot's, in degrees?"
    elif far < min(trial.radius_cm for trial in trials):
        reach = f"x_cm and y_cm reach {far:.2g} cm, less than the robot's radius"
        doubt = f"{trials[0].source}: {reach}: are they in metres?"
    return [replace(t, doubt="; ".join(filter(None, (doubt, t.doubt)))) for t in trials]


def agreement(trials: Sequence[Trial], read: Callable[[Floats], Floats] = np.asarray) -> float:
    """Agreement of headings, so read, with movements, weighted by distance: 1 along them, −1 across; 1 where
    there is hardly any."""
    total = way = 0.0
    for trial in trials:
        dx, dy = trial.x[2:] - trial.x[:-2], trial.y[2:] - trial.y[:-2]
        length = np.hypot(dx, dy)
        apart = np.arctan2(dy, dx) - read(trial.heading[1:-1])
        seen = length > MOVES_CM
        total += float((length * np.cos(2.0 * apart))[seen].sum())
        way += float(length[seen].sum())
    return total / way if way >= 2 * ENOUGH_CM else 1.0
