"""Two logs of robots, compared by what they read and did: no study, no camera, no poses.

Means and deviations say little of behaviour: slow waves and white noise may share both. So the order in time
counts too: how much a channel changes from one row to the next, and for how long it stays alike. Both are
tested by windows, as short as they may be with neighbours that do not depend on each other.
"""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from realitygap.errors import TrackError
from realitygap.files import as_path, read_table
from realitygap.robots.drive import STEPS
from realitygap.track import COLUMNS
from realitygap.values import Floats
from realitygap.work.archive import STALLED, unpacked

__all__ = ["Log", "LogComparison", "Pace", "compare_logs", "read_logs"]

NO_CHANNELS = {"t_s", "late_s", "read_s", "start", "unit", "trial", "kind", "quality", "repeat", *COLUMNS}
SPLITS = ("start", "trial")
"""Columns that separate several drives."""
GAP_STEPS, GAP_S = 5.0, 1.0
"""A gap of so many usual steps, and so long, cuts a log in two."""
LATE = 1.5
"""A step of so many usual ones is a missed one."""
SAME_PACE = 0.8
"""Logs whose steps' lengths have at least this ratio are compared row by row."""
SHORTEST_S, LEAST = 2.0, 5
"""The shortest window of a test, and how many each side needs."""
ALIKE = 0.1
"""Correlation of neighbouring windows up to which they count as independent."""
SHUFFLES, FINEST = 2000, 1e-3
"""Of a permutation test; a change below this share of a channel's deviation is none."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Log:
    """One drive: t [n] s; channels by name [n], NaN where nothing was read; places [n, 2] cm, if it has any,
    and whether it says where the robot `faces` there."""

    t: Floats
    channels: Mapping[str, Floats]
    poses: Floats | None = None
    faces: bool = False
    source: str = "log"


class Pace(NamedTuple):
    """How a log's rows follow each other: their number; steps in s, of which `late` (a share) took more than
    one and a half usual ones; where gaps cut it in pieces."""

    rows: int
    usual_s: float
    most_s: float
    longest_s: float
    late: float
    gaps: int


class Channel(NamedTuple):
    """A channel of both logs (A, B): mean, deviation, the median absolute change a step, and how long (s) it
    stays alike (its autocorrelation above 1/e); `distance`: Wasserstein's, in the common deviation."""

    name: str
    mean: tuple[float, float]
    deviation: tuple[float, float]
    step_noise: tuple[float, float]
    alike_s: tuple[float, float]
    distance: float


class Test(NamedTuple):
    """Of two logs' windows: p by permutation; None: each log needs `needed_s` for windows of this length."""

    p: float | None
    window_s: float
    needed_s: float


@dataclass(frozen=True, kw_only=True)
class LogComparison:
    """Two logs, compared.

    Attributes:
        step_s: at which rows were compared; pace: of both.
        channels: of both.
        levels: a test of means and mean squares; order: of changes over several steps, to those over one.
        notes: what was left out.
    """

    step_s: float
    pace: tuple[Pace, Pace]
    channels: tuple[Channel, ...]
    levels: Test
    order: Test
    notes: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        return {
            **asdict(self),
            "pace": [one._asdict() for one in self.pace],
            "channels": [one._asdict() for one in self.channels],
            "levels": self.levels._asdict(),
            "order": self.order._asdict(),
        }


# Reading


def read_logs(path: str | Path) -> list[Log]:
    """All logs of a file or a folder.

    A CSV file has a column t_s, and channels: of numbers, by any names. A JSON file is what `realitygap
    simulate --json` prints. In a folder every `steps.csv` is read, of drives and transfers; else every table
    with t_s.

    Raises:
        TrackError: names the file, the line and the column.
    """
    with unpacked(as_path(path, "log")) as place:
        if not place.is_dir():
            return _from_json(place) if place.suffix.lower() == ".json" else _from_csv(place)
        files = sorted(file for file in place.rglob(STEPS) if STALLED not in file.parts)
        if files:
            return [log for file in files for log in _from_csv(file)]
        tables = (file for file in sorted(place.rglob("*.csv")) if STALLED not in file.parts)
        return [
            log for file in tables if "t_s" in read_table(file, TrackError).columns for log in _from_csv(file)
        ]


def _from_csv(path: Path) -> list[Log]:
    table = read_table(path, TrackError, needs=("t_s",))
    if not table.rows:
        raise TrackError(f"{path}: expected rows below its first line, got none.")
    every = {"t_s": table.numbers("t_s")}
    for name in (*COLUMNS[1:], *(one for one in table.columns if one not in NO_CHANNELS)):
        if name in table.columns and any(map(_is_number, table.texts(name)[:3])):
            every[name] = table.numbers(name, empty=True)
    keys = list(zip(*(table.texts(name) for name in SPLITS if name in table.columns), strict=True))
    names = dict.fromkeys(keys or [()])
    parts = [np.array([key == name for key in keys] if keys else [True] * len(table.rows)) for name in names]
    return [_log({name: column[rows] for name, column in every.items()}, str(path)) for rows in parts]


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False


def _from_json(path: Path) -> list[Log]:
    """Its commands are a network's, of no unit that robots share: the wheels' speeds stand for them."""
    try:
        data = json.loads(path.read_text("utf-8"))
        every = {name: np.array(data[name], np.float64) for name in COLUMNS}
        for name in ("proximity", "ambient"):
            every |= {f"{name}_{i}": column for i, column in enumerate(np.array(data[name], np.float64).T)}
        wheels = np.array(data["wheels"], np.float64).T
        return [_log({**every, "speed_left": wheels[0], "speed_right": wheels[1]}, str(path))]
    except (OSError, KeyError, TypeError, ValueError, IndexError) as error:
        told = "expected JSON as `realitygap simulate --json` prints it"
        raise TrackError(f"{path}: {told} ({error})") from None


def _log(columns: dict[str, Floats], source: str) -> Log:
    t = columns["t_s"]
    if (np.diff(t) <= 0).any():
        k = int(np.argmax(np.diff(t) <= 0)) + 1
        raise TrackError(
            f"{source}: expected t_s to grow from row to row, got {t[k]:g} after {t[k - 1]:g}. Separate "
            "drives by a column start."
        )
    channels = {name: column for name, column in columns.items() if name not in NO_CHANNELS}
    if any(name.startswith(("proximity", "ambient")) for name in channels):  # inputs follow from them
        channels = {name: column for name, column in channels.items() if not name.startswith("input_")}
    for name in [one for one in channels if one.startswith("counter")]:
        counted = channels.pop(name)
        channels[f"{name} (a second)"] = np.append(np.nan, np.diff(counted) / np.diff(t))
    placed = {"x_cm", "y_cm"} <= columns.keys()
    poses = np.column_stack([columns["x_cm"], columns["y_cm"]]) if placed else None
    faces = placed and "heading_deg" in columns
    return Log(t=t, channels=channels, poses=poses, faces=faces, source=source)


# Comparing


def compare_logs(a: Sequence[Log], b: Sequence[Log], *, poses: bool = False) -> LogComparison | None:
    """Two sets of logs, compared by the channels that all have; None if they have none in common.

    Args:
        a, b: of one kind each.
        poses: whether places and speeds over ground are channels too.
    """
    sides = [[_with_poses(log) if poses else log for log in logs] for logs in (a, b)]
    every, notes = [log for side in sides for log in side], []
    names = [name for name in every[0].channels if all(name in log.channels for log in every)]
    only = {name for log in every for name in log.channels} - set(names)
    kept = [name for name in names if all(np.isfinite(log.channels[name]).mean() > 0.5 for log in every)]
    if len(kept) < len(names):
        notes.append(f"left out, mostly empty: {', '.join(name for name in names if name not in kept)}")
    if not kept:
        return None
    if only:
        notes.append(f"left out, in one set only: {', '.join(sorted(only))}")
    paces = [pace_of(side) for side in sides]
    step_s = max(one.usual_s for one in paces)
    pieces = [[piece for log in side for piece in _pieces(log, kept, step_s, one)]
              for side, one in zip(sides, paces, strict=True)]  # fmt: skip
    for side, logs in zip(pieces, (a, b), strict=True):
        if not side:
            raise TrackError(
                f"{logs[0].source}: expected rows without gaps of more than {GAP_S:g} s, got none."
            )
    rows = [np.concatenate(side) for side in pieces]
    deviation = np.concatenate(rows).std(axis=0)
    channels = tuple(
        _channel(name, [[piece[:, c] for piece in side] for side in pieces], step_s)
        for c, name in enumerate(kept)
    )
    moves = deviation > 0  # a channel that never changes tells nothing of order
    unit = deviation[moves]
    middle = ((rows[0].mean(axis=0) + rows[1].mean(axis=0)) / 2)[moves]
    scaled = [[(piece[:, moves] - middle) / unit for piece in side] for side in pieces]
    return LogComparison(
        step_s=step_s, pace=(paces[0], paces[1]), channels=channels,
        levels=_tested(scaled, _levels, step_s), order=_tested(scaled, _changes, step_s),
        notes=tuple(notes),
    )  # fmt: skip


def _channel(name: str, sides: Sequence[Sequence[Floats]], step_s: float) -> Channel:
    """What two sets of pieces [rows] of a channel are like."""
    from scipy.stats import wasserstein_distance

    def both(of: Callable[[Sequence[Floats]], Any]) -> tuple[float, float]:
        return float(of(sides[0])), float(of(sides[1]))

    spread = both(lambda side: np.concatenate(side).std())
    rows = [np.concatenate(side) for side in sides]
    common = math.hypot(*spread) / math.sqrt(2) or float(np.concatenate(rows).std())
    apart = float(wasserstein_distance(*rows))
    return Channel(
        name=name,
        mean=both(lambda side: np.concatenate(side).mean()),
        deviation=spread,
        step_noise=both(lambda side: np.median(np.abs(np.concatenate([np.diff(piece) for piece in side])))),
        alike_s=both(lambda side: _alike_s(side, step_s)),
        distance=apart / common if common else 0.0,
    )


def pace_of(logs: Sequence[Log]) -> Pace:
    """How the rows of some logs follow each other."""
    steps = np.concatenate([np.diff(log.t) for log in logs])
    if not len(steps):
        raise TrackError(f"{logs[0].source}: expected two rows at least, got one.")
    usual = round(float(np.median(steps)), 6)
    cuts = int((steps > max(GAP_STEPS * usual, GAP_S)).sum())
    most, longest = float(np.quantile(steps, 0.99)), float(steps.max())
    return Pace(
        sum(len(log.t) for log in logs), usual, most, longest, float((steps > LATE * usual).mean()), cuts
    )


def _with_poses(log: Log) -> Log:
    assert log.poses is not None
    seen = np.isfinite(log.poses).all(axis=1)
    t, places = log.t[seen], log.poses[seen]
    speed = np.append(np.nan, np.hypot(*np.diff(places, axis=0).T) / np.diff(t))
    own = {name: column[seen] for name, column in log.channels.items()}
    channels = {**own, "x_cm": places[:, 0], "y_cm": places[:, 1], "speed over ground (cm/s)": speed}
    return Log(t=t, channels=channels, source=log.source)


def _pieces(log: Log, names: Sequence[str], step_s: float, pace: Pace) -> list[Floats]:
    """Its rows [n, channels], cut at gaps; of a faster log those next before every step."""
    columns = np.column_stack([log.channels[name] for name in names])
    whole = np.isfinite(columns).all(axis=1)
    t, columns = log.t[whole], columns[whole]
    cuts = np.flatnonzero(np.diff(t) > max(GAP_STEPS * pace.usual_s, GAP_S)) + 1
    found = []
    for times, rows in zip(np.split(t, cuts), np.split(columns, cuts), strict=True):
        if len(times) and pace.usual_s < SAME_PACE * step_s:
            due = np.arange(times[0], times[-1] + 1e-6, step_s)
            rows = rows[np.searchsorted(times, due + 1e-6, side="right") - 1]
        if len(rows) > 1:
            found.append(rows)
    return found


def _alike_s(pieces: Sequence[Floats], step_s: float) -> float:
    """How long a channel's autocorrelation stays above 1/e; at most as long as the longest piece."""
    total, mean = np.zeros(max(map(len, pieces))), np.concatenate(pieces).mean()
    for piece in pieces:
        power = np.abs(np.fft.rfft(piece - mean, 2 * len(piece))) ** 2
        total[: len(piece)] += np.fft.irfft(power)[: len(piece)]
    below = np.flatnonzero(total < total[0] / math.e)
    return float(below[0] if len(below) else len(total)) * step_s


def _levels(window: Floats) -> Floats:
    """Means and mean squares of a window [n, channels]; deviations within it would tell of the order, too."""
    return np.concatenate([window.mean(axis=0), (window**2).mean(axis=0)])


def _changes(window: Floats) -> Floats:
    """Log of mean squared changes over two steps and over half a window, to those over one: 0 of white noise,
    more the smoother, whatever the scale."""
    square = [((window[k:] - window[:-k]) ** 2).mean(axis=0) + FINEST**2 for k in (1, 2, len(window) // 2)]
    return np.asarray(np.log(np.concatenate(square[1:]) / np.tile(square[0], 2)))


def _tested(sides: Sequence[Sequence[Floats]], feature: Callable[[Floats], Floats], step_s: float) -> Test:
    """Whether windows of two sides differ in features: a permutation test of their means."""
    rows = max(6, round(SHORTEST_S / step_s))
    while True:
        told = [
            [np.array([feature(w) for w in _windows(piece, rows)]) for piece in side if len(piece) >= rows]
            for side in sides
        ]
        window_s, counts = rows * step_s, [sum(map(len, side)) for side in told]
        if min(counts) < LEAST or not sides[0][0].shape[1]:
            return Test(None, window_s, LEAST * window_s)
        if _neighbours(told) <= ALIKE:
            break
        rows *= 2
    values, n = np.concatenate([np.concatenate(side) for side in told]), counts[0]
    off = values - values.mean(axis=0)
    off /= np.maximum(off.std(axis=0), 1e-9)
    draw, total = np.random.default_rng(0), off.sum(axis=0)
    labels = np.array([np.arange(len(off)) < n, *(draw.permutation(len(off)) < n for _ in range(SHUFFLES))])
    first = labels @ off
    apart = ((first / n - (total - first) / (len(off) - n)) ** 2).sum(axis=1)
    return Test(float((apart >= apart[0] - 1e-9).mean()), window_s, 0.0)


def _windows(piece: Floats, rows: int) -> list[Floats]:
    return [piece[k : k + rows] for k in range(0, len(piece) - rows + 1, rows)]


def _neighbours(told: Sequence[Sequence[Floats]]) -> float:
    """Correlation of neighbouring windows, in the mean of features."""
    both = whole = 0.0
    for side in told:
        mean = np.concatenate(side).mean(axis=0)
        for piece in side:
            off = piece - mean
            both, whole = both + (off[1:] * off[:-1]).sum(axis=0), whole + (off**2).sum(axis=0)
    return float(np.mean(both / np.maximum(whole, 1e-9)))
