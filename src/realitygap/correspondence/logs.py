"""Two logs of robots, compared by what they read and did: no study, no camera, no poses.

Means and deviations say little of behaviour: slow waves and white noise may share both. So the order in time
counts too: how much a channel changes from one row to the next, and for how long it stays alike. Both are
tested by windows, as short as they may be with neighbours that do not depend on each other.
"""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy.stats import wasserstein_distance

from realitygap.errors import TrackError
from realitygap.files import as_path, read_table
from realitygap.robots.drive import STEPS
from realitygap.track import COLUMNS
from realitygap.values import Floats
from realitygap.work.archive import STALLED, unpacked

__all__ = ["Log", "LogComparison", "compare_logs", "read_logs"]

NO_CHANNELS = {"t_s", "late_s", "read_s", "start", "unit", "trial", "kind", "quality", "repeat", *COLUMNS}
SPLITS = ("start", "trial")
"""Columns that separate several drives."""
LATE, GAP_STEPS, GAP_S = 1.5, 5.0, 1.0
"""A step of so many usual ones is late; a gap of so many, and so long, cuts a log in two."""
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
    """One drive: t [n] s; channels by name [n], NaN where nothing was read; places and speeds, if it has any,
    likewise; and whether it says where the robot `faces` there."""

    t: Floats
    channels: Mapping[str, Floats]
    places: Mapping[str, Floats] = field(default_factory=dict)
    faces: bool = False
    source: str = "log"


@dataclass(frozen=True)
class Pace:
    """How a log's rows follow each other: their number, steps in s, the share that took 1.5 usual ones and
    more, gaps that cut it in pieces."""

    rows: int
    usual_s: float
    longest_s: float
    late: float
    gaps: int


@dataclass(frozen=True)
class Channel:
    """A channel of both logs, A and B: mean, deviation, the median absolute change a step, and how long (s)
    it stays alike (its autocorrelation above 1/e); `distance`: Wasserstein's, in the common deviation."""

    name: str
    mean: tuple[float, float]
    deviation: tuple[float, float]
    step_noise: tuple[float, float]
    alike_s: tuple[float, float]
    distance: float


@dataclass(frozen=True)
class Test:
    """Of two logs' windows: p by permutation; None: each log needs `needed_s` for windows of this length."""

    p: float | None
    window_s: float
    needed_s: float


@dataclass(frozen=True)
class LogComparison:
    """Two logs, compared at steps of `step_s`: by a test of means and mean squares (`levels`), and of changes
    over several steps, to those over one (`order`). `notes` tell what was left out."""

    step_s: float
    pace: tuple[Pace, Pace]
    channels: tuple[Channel, ...]
    levels: Test
    order: Test
    notes: tuple[str, ...]


def read_logs(path: str | Path) -> list[Log]:
    """All logs of a file or a folder.

    A CSV file has a column t_s, and channels: of numbers, by any names. A JSON file is what `realitygap
    simulate --json` prints. In a folder every `steps.csv` is read, of drives and transfers; else every table
    with t_s.

    Raises:
        TrackError: names the file, the line and the column.
    """
    with unpacked(as_path(path, "log")) as place:
        if place.suffix.lower() == ".json":
            return [_from_json(place)]
        files = [place]
        if place.is_dir():
            files = [
                file for file in sorted(place.rglob("*.csv")) if STALLED not in file.relative_to(place).parts
            ]
            files = [file for file in files if file.name == STEPS] or files
        return [log for file in files for log in _from_csv(file)]


def _from_csv(path: Path) -> list[Log]:
    table = read_table(path, TrackError)
    if "t_s" not in table.columns:
        return []
    every = {"t_s": table.numbers("t_s")}
    for name in table.columns:
        with suppress(TrackError):  # words are no channel
            if np.isfinite(column := table.numbers(name, empty=True)).any():
                every[name] = column
    splits = [table.texts(name) for name in SPLITS if name in table.columns]
    keys = list(zip(*splits, strict=True)) if splits else [()] * len(table.rows)
    parts = ([key == one for key in keys] for one in dict.fromkeys(keys))
    return [_log({name: column[rows] for name, column in every.items()}, str(path)) for rows in parts]


def _from_json(path: Path) -> Log:
    """Its commands are a network's, of no unit that robots share: the wheels' speeds stand for them."""
    try:
        data = json.loads(path.read_text("utf-8"))
        every = {name: np.array(data[name], np.float64) for name in COLUMNS}
        for name in ("proximity", "ambient"):
            every |= {f"{name}_{i}": column for i, column in enumerate(np.array(data[name], np.float64).T)}
        every["speed_left"], every["speed_right"] = np.array(data["wheels"], np.float64).T
    except (OSError, KeyError, TypeError, ValueError, IndexError) as error:
        told = "expected JSON as `realitygap simulate --json` prints it"
        raise TrackError(f"{path}: {told} ({error})") from None
    return _log(every, str(path))


def _log(columns: Mapping[str, Floats], source: str) -> Log:
    t = columns["t_s"]
    if not (steps := np.diff(t) > 0).all():
        k = int(np.argmin(steps)) + 1
        told = f"expected t_s to grow from row to row, got {t[k]:g} after {t[k - 1]:g}"
        raise TrackError(f"{source}: {told}. Separate drives by a column start.")
    channels, placed = dict[str, Floats](), {"x_cm", "y_cm"} <= columns.keys()
    reads = any(name.startswith(("proximity", "ambient")) for name in columns)
    for name, column in columns.items():
        if name.startswith("counter"):
            channels[f"{name} (a second)"] = np.append(np.nan, np.diff(column) / np.diff(t))
        elif name not in NO_CHANNELS and not (name.startswith("input_") and reads):  # which inputs follow
            channels[name] = column
    places = {}
    if placed:
        x, y, speed = columns["x_cm"], columns["y_cm"], np.full(len(t), np.nan)
        seen = np.flatnonzero(np.isfinite(x + y))
        speed[seen[1:]] = np.hypot(np.diff(x[seen]), np.diff(y[seen])) / np.diff(t[seen])
        places = {"x_cm": x, "y_cm": y, "speed over ground (cm/s)": speed}
    faces = placed and "heading_deg" in columns
    return Log(t=t, channels=channels, places=places, faces=faces, source=source)


def compare_logs(a: Sequence[Log], b: Sequence[Log], *, poses: bool = False) -> LogComparison | None:
    """Two sets of logs of one kind each, compared by the channels that all have; None if they have none in
    common. With `poses`, places and speeds over ground are channels too."""
    if poses:
        a, b = ([replace(log, channels={**log.channels, **log.places}) for log in side] for side in (a, b))
    every, notes = [*a, *b], []
    names = [name for name in every[0].channels if all(name in log.channels for log in every)]
    only = sorted({name for log in every for name in log.channels} - set(names))
    empty = [name for name in names if any(np.isnan(log.channels[name]).mean() >= 0.5 for log in every)]
    kept = [name for name in names if name not in empty]
    if not kept:
        return None
    for why, left in (("mostly empty", empty), ("in one set only", only)):
        if left:
            notes.append(f"left out, {why}: {', '.join(left)}")
    paces = _pace(a), _pace(b)
    step_s = max(one.usual_s for one in paces)
    sides = [
        [piece for log in side for piece in _pieces(log, kept, step_s, one)]
        for side, one in zip((a, b), paces, strict=True)
    ]
    for side, logs in zip(sides, (a, b), strict=True):
        if not side:
            told = f"expected rows without gaps of more than {GAP_S:g} s, got none."
            raise TrackError(f"{logs[0].source}: {told}")
    rows = [np.concatenate(side) for side in sides]
    unit = np.concatenate(rows).std(axis=0)
    moves = unit > 0  # a channel that never changes tells nothing of order
    middle = (rows[0].mean(axis=0) + rows[1].mean(axis=0)) / 2
    scaled = [[((piece - middle)[:, moves] / unit[moves]) for piece in side] for side in sides]
    return LogComparison(
        step_s=step_s,
        pace=paces,
        channels=tuple(
            _channel(name, [[piece[:, c] for piece in side] for side in sides], step_s)
            for c, name in enumerate(kept)
        ),
        levels=_tested(scaled, _levels, step_s),
        order=_tested(scaled, _changes, step_s),
        notes=tuple(notes),
    )


def _pace(logs: Sequence[Log]) -> Pace:
    steps = np.concatenate([np.diff(log.t) for log in logs])
    if not len(steps):
        raise TrackError(f"{logs[0].source}: expected two rows at least, got one.")
    usual = round(float(np.median(steps)), 6)
    gaps, late = int((steps > max(GAP_STEPS * usual, GAP_S)).sum()), float((steps > LATE * usual).mean())
    return Pace(sum(len(log.t) for log in logs), usual, float(steps.max()), late, gaps)


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


def _channel(name: str, sides: Sequence[Sequence[Floats]], step_s: float) -> Channel:
    """What two sets of pieces [rows] of a channel are like."""
    rows = [np.concatenate(side) for side in sides]
    changes = [np.abs(np.concatenate([*map(np.diff, side)])) for side in sides]
    deviation, mean, noise = (
        (float(of(some[0])), float(of(some[1])))
        for of, some in ((np.std, rows), (np.mean, rows), (np.median, changes))
    )
    common = math.hypot(*deviation) / math.sqrt(2) or float(np.concatenate(rows).std())
    distance = float(wasserstein_distance(*rows)) / common if common else 0.0
    alike = _alike_s(sides[0], step_s), _alike_s(sides[1], step_s)
    return Channel(name, mean, deviation, noise, alike, distance)


def _alike_s(pieces: Sequence[Floats], step_s: float) -> float:
    """How long a channel's autocorrelation stays above 1/e; at most as long as the longest piece."""
    total, mean = np.zeros(max(map(len, pieces))), np.concatenate(pieces).mean()
    for piece in pieces:
        power = np.abs(np.fft.rfft(piece - mean, 2 * len(piece))) ** 2
        total[: len(piece)] += np.fft.irfft(power)[: len(piece)]
    below = np.flatnonzero(total < total[0] / math.e)
    return float(below[0] if len(below) else len(total)) * step_s


def _levels(window: Floats) -> Floats:
    """Means and mean squares of windows [w, n, c]; deviations within them would tell of the order, too."""
    return np.hstack([window.mean(axis=1), (window**2).mean(axis=1)])


def _changes(window: Floats) -> Floats:
    """Log of mean squared changes over two steps and over half a window, to those over one: 0 of white noise,
    more the smoother, whatever the scale."""
    one, two, half = (
        ((window[:, k:] - window[:, :-k]) ** 2).mean(axis=1) + FINEST**2 for k in (1, 2, window.shape[1] // 2)
    )
    return np.asarray(np.log(np.hstack([two / one, half / one])))


def _tested(sides: Sequence[Sequence[Floats]], feature: Callable[[Floats], Floats], step_s: float) -> Test:
    """Whether windows of two sides differ in features: a permutation test of their means."""
    rows = max(6, round(SHORTEST_S / step_s))
    while True:
        told = [
            [feature(piece[: len(piece) // rows * rows].reshape(-1, rows, piece.shape[1])) for piece in side]
            for side in sides
        ]
        window_s, (n, m) = rows * step_s, [sum(map(len, side)) for side in told]
        if min(n, m) < LEAST or not sides[0][0].shape[1]:
            return Test(None, window_s, LEAST * window_s)
        if _neighbours(told) <= ALIKE:
            break
        rows *= 2
    values = np.concatenate([piece for side in told for piece in side])
    off = values - values.mean(axis=0)
    off /= np.maximum(off.std(axis=0), 1e-9)
    draw, total = np.random.default_rng(0), off.sum(axis=0)
    labels = np.array([np.arange(n + m) < n, *(draw.permutation(n + m) < n for _ in range(SHUFFLES))])
    first = labels @ off
    apart = ((first / n - (total - first) / m) ** 2).sum(axis=1)
    return Test(float((apart >= apart[0] - 1e-9).mean()), window_s, 0.0)


def _neighbours(told: Sequence[Sequence[Floats]]) -> float:
    """Correlation of neighbouring windows, in the mean of features."""
    off = [piece - np.concatenate(side).mean(axis=0) for side in told for piece in side]
    both = sum((piece[1:] * piece[:-1]).sum(axis=0) for piece in off)
    whole = sum((piece**2).sum(axis=0) for piece in off)
    return float(np.mean(both / np.maximum(whole, 1e-9)))
