"""What the columns of a log seem to be, each guess with its reason; and the MAP.toml that says so.

By their names first, then by what they do: a robot goes where it faces, and counters turn when it goes. What
cannot be told is asked.
"""

import json
import math
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from realitygap.logs.cuts import gaps, jumps, many, repeats
from realitygap.logs.mapped import ASKED, SIDES, SPEED, UNITS, cumulative, filled, quaternion_yaw
from realitygap.logs.table import Log, read_log
from realitygap.values import Floats

__all__ = ["Guess", "Look", "findings", "look"]

NAMES = (
    ("", r"cov|covariance|std|var|acc|accel|mag|status|seq|battery|kind|quality"),
    ("t_s", r"t|time|times|timestamp|stamp|seconds|secs|millis|clock|ms|us"),
    ("run", r"trial|run|episode|experiment|session|start"),
    ("w", r"w|wz|omega|angular|vtheta|yawrate|yaw rate|gyro"),
    ("v", r"v|vx|vel|velocity|speed|linear|lin"),
    ("distance_cm", r"distance|dist|range"),
    ("bearing_deg", r"bearing"),
    ("heading_deg", r"heading|theta|yaw|phi|psi|orientation|rot|rotation|angle|th"),
    ("x_cm", r"x$"),
    ("y_cm", r"y$"),
    ("sensor", r"sensor$"),
    ("reading", r"(?:count|counts|reading|value)$"),
)
"""What is a column whose name has one of these words, the first that fits; at its end where that is said."""
OF_A_SIDE = (
    ("command", r"cmd|command|commands|set|setpoint|target|desired|pwm"),
    ("counter", r"tick|ticks|enc|encoder|encoders|count|counts|counter|pulses|odo"),
    ("speed", r"speed|vel|velocity|v"),
    ("command", r"motor|motors|wheel|u"),
)
LEFT, RIGHT = r"\b(left|l|lft|lw)\b", r"\b(right|r|rgt|rw)\b"
SENSOR = r"(?:prox|proximity|ir|sensor|s|p|ps) (\d+)"
UNIT = r" (?:(cm|mm|m|rad|deg) (?:per )?s|(s|sec|ms|us|ns|cm|mm|m|rad|radians?|deg|degrees?))$"
SHORT = {"sec": "s", "radian": "rad", "radians": "rad", "degree": "deg", "degrees": "deg"}
EPOCHS = {"s": 1e9, "ms": 1e12, "us": 1e15, "ns": 1e18}
"""Now, roughly, on clocks that count from 1970."""
SLOW, FAST, SMALL, LARGE = 1.0, 150.0, 15.0, 3000.0
"""cm/s and cm: what robots on a floor do, and over how much of it."""
SURE, CLEAR = 0.6, 0.05
"""Agreement, 0 to 1, of a heading with the way from which they belong together; and its lead over another."""
SQUARE_DEG = 20.0
"""How far a heading's zero may be off one of the axes."""
EVIDENT = 0.9
"""Agreement of columns without names from which on they are what they seem to be."""
EACH = 0.02
"""Share of its range that a counter goes from row to row, from which on it counts each row anew."""


@dataclass
class Guess:
    """What one column, or those of a quaternion, seem to be; `more` are further keys of its entry."""

    name: str
    columns: list[int]
    unit: str = ""
    why: str = "its name"
    sign: int = 1
    more: dict[str, Any] = field(default_factory=dict)

    def values(self, log: Log) -> Floats:
        """[n] in s, cm, rad and so on; as they stand if the unit is not known."""
        made = log.values[:, self.columns]
        values = quaternion_yaw(made) if self.unit == "quaternion" else made[:, 0]
        factor = self.sign * UNITS.get(self.name, {}).get(self.unit, 1.0)
        return np.asarray(values * factor + math.radians(self.more.get("offset_deg", 0.0)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Look:
    """What a log seems to hold.

    Attributes:
        guesses: of its columns; the others seem to be nothing that is needed.
        kind: as in a MAP.toml, "?" where it holds too little.
        asked: keys of the MAP.toml that are asked for, with what they are.
        columns: [n] by name as of `Guess.values`; run: [n] the run of each row.
        findings: about times and places, in words.
    """

    log: Log
    guesses: tuple[Guess, ...]
    kind: str
    asked: Mapping[str, str]
    columns: Mapping[str, Floats] = field(repr=False)
    run: NDArray[np.int64] = field(repr=False)
    findings: tuple[str, ...]

    def to_toml(self, target: Path) -> str:
        """The text of a MAP.toml at a path."""
        answer = ', answer each "?"' if self.asked else ""
        log = os.path.relpath(self.log.path, target.parent)
        lines = [f"# What the columns of {self.log.path.name} seem to be. Correct what is wrong{answer}.",
                 f"logs = [{json.dumps(log, ensure_ascii=False)}]  # several: a run each",
                 f'kind = "{self.kind}"']  # fmt: skip
        facts = {key: what for key, what in self.asked.items() if key != "kind" and "." not in key}
        lines += [f'{key} = "{ASKED}"  # {what}' for key, what in facts.items()]
        lines += ["", "[columns]"]
        for guess in self.guesses:
            of = [column + 1 if (name := self.log.names[column]) == str(column + 1) else name
                  for column in guess.columns]  # fmt: skip
            told: dict[str, Any] = {"column": of if of[1:] else of[0]}
            told |= {"unit": guess.unit} if guess.unit and guess.name != "y_cm" else {}
            told |= ({"sign": -1} if guess.sign < 0 else {}) | guess.more
            inner = ", ".join(f"{key} = {json.dumps(v, ensure_ascii=False)}" for key, v in told.items())
            lines.append(f"{guess.name} = {{ {inner} }}  # {guess.why}")
        if self.kind == ASKED:
            names = ", ".join(self.log.names[k] for k in self.unused)
            lines += [f"# Not told: {names}. They may be: {', '.join(UNITS)}, s0, s1 …"]
        return "\n".join(lines) + "\n"

    @property
    def unused(self) -> list[int]:
        """Columns that seem to be nothing that is needed."""
        return [
            k for k in range(len(self.log.names)) if all(k not in guess.columns for guess in self.guesses)
        ]

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        columns = [
            {"name": g.name, "column": [self.log.names[k] for k in g.columns], "unit": g.unit, "sign": g.sign,
             "why": g.why, **g.more} for g in self.guesses
        ]  # fmt: skip
        return {
            "log": str(self.log.path), "rows": len(self.log.values), "separator": self.log.separator,
            "head": self.log.head, "kind": self.kind, "asked": dict(self.asked), "columns": columns,
            "notes": [*self.log.notes, *self.findings],
        }  # fmt: skip


def look(path: str | Path) -> Look:
    """Look at a log.

    Raises:
        RecordingError: there is no table of numbers in it.
    """
    log = read_log(path)
    found = _by_name(log)
    run = np.zeros(len(log.values), np.int64)
    if "run" in found:
        run = np.unique(found["run"].values(log), return_inverse=True)[1].astype(np.int64)
    _clock(log, found)
    pairs = [[f"{what}_{side}" for side in SIDES] for what in ("counter", "speed", "command")]
    for some in (["x_cm", "y_cm"], ["v", "w"], ["command_v", "command_w"], ["sensor", "reading"], *pairs):
        if not set(some) <= found.keys():
            for name in some:
                found.pop(name, None)
    if not log.head:
        _without_names(log, found, run)
    way = _Way(log, found, run)
    if "x_cm" in found:
        _place(log, found, way)
    if "heading_deg" in found:
        _heading(log, found["heading_deg"], way)
    _wheels(log, found, way, run)
    _rates(log, found, way)
    return _told(log, found, run)


# By their names


def _by_name(log: Log) -> dict[str, Guess]:
    """Guesses by name, the first column of each."""
    found: dict[str, Guess] = {}
    turned: dict[str, int] = {}
    for k, name in enumerate(log.names):
        words = " ".join(re.findall(r"[a-z]+|\d+", re.sub(r"([a-z])([A-Z])", r"\1 \2", name).lower()))
        if part := re.fullmatch(r"(?:.* )?(?:q|quat|quaternion|orientation|rotation) ?([xyzw])", words):
            turned[part[1]] = k
            continue
        role, unit = _role(words)
        if role and role not in found and np.isfinite(log.values[:, k]).any():
            found[role] = Guess(role, [k], unit)
    letters = "xyzw" if len(turned) == 4 else "zw"
    if set(letters) <= turned.keys():
        of = [turned[letter] for letter in letters]
        size = np.linalg.norm(log.values[:, of], axis=1)
        if np.isfinite(size).any():
            told = f"a quaternion, {np.nanmedian(size):.3f} long"
            found["heading_deg"] = Guess("heading_deg", of, "quaternion", told)
    third = found["y_cm"].columns[0] + 1 if "y_cm" in found else len(log.names)
    if "heading_deg" not in found and third < len(log.names) and log.names[third].lower().endswith("z"):
        found["heading_deg"] = Guess("heading_deg", [third], why="the third of a pose in the plane")
    return found


def _role(words: str) -> tuple[str, str]:
    """What a column is by its words, and its unit if they say one; "" for neither."""
    unit = ""
    if (said := re.search(UNIT, words)) is not None:
        unit = f"{said[1]}/s" if said[1] else SHORT.get(said[2], said[2])
        words = words[: said.start()]
    if sensor := re.fullmatch(SENSOR, words):
        return f"s{int(sensor[1])}", unit
    # Two letters such as vl are speed and left.
    words = re.sub(r"\b(v|enc|ticks?|cmd|u)([lr])\b", r"\1 \2", words)
    side = "left" if re.search(LEFT, words) else "right" if re.search(RIGHT, words) else ""
    for name, some in OF_A_SIDE if side else NAMES:
        if re.search(rf"\b(?:{some})(?:\b|$)", words):
            commanded = re.search(rf"\b(?:{OF_A_SIDE[0][1]})\b", words) and name in ("v", "w")
            beside = re.search({"v": r" [yz]$", "w": r" [xy]$"}.get(name, "$^"), words)
            return ("" if beside else f"{name}_{side}" if side else "command_" * bool(commanded) + name), unit
    return "", unit


# By what they do


def _clock(log: Log, found: dict[str, Guess]) -> None:
    """The clock, named so or the first column that grows from row to row, and its unit."""
    step = np.diff(log.values, axis=0)
    grows = [k for k in range(len(log.names)) if (step[:, k] > 0).all()]
    if "t_s" in found and (step[:, found["t_s"].columns[0]] >= 0).mean() < 0.9:
        del found["t_s"]
    if "t_s" not in found and grows and not log.head:
        found["t_s"] = Guess("t_s", grows[:1], why="the first that grows from row to row")
    if "t_s" not in found or found["t_s"].unit in UNITS["t_s"]:
        return
    guess = found["t_s"]
    begin, forth = log.values[0, guess.columns[0]], step[step[:, guess.columns[0]] > 0, guess.columns[0]]
    usual = float(np.median(forth)) if len(forth) else 1.0
    epoch = [unit for unit, now in EPOCHS.items() if now < begin < 5 * now]
    guess.unit = epoch[0] if epoch else "s" if usual < 2.5 else "ms" if usual < 2500 else "us"
    guess.why += "; it counts from 1970" if epoch else f"; one row every {usual:.3g}"


class _Way:
    """Where a log went on: segments [m] from row `begin` to row `end`, each a fortieth of the path's extent.

    `gone` [m]: how far, in the unit of the place, backwards negative where the heading tells it; `to`: where
    to, rad; `turn`: how far it turned meanwhile, rad, by its heading, or by the way; NaN if unknown.
    """

    def __init__(self, log: Log, found: Mapping[str, Guess], run: NDArray[np.int64]) -> None:
        self.t = found["t_s"].values(log) if "t_s" in found else np.arange(0.0, len(run)) / 10
        self.run, self.faced, pairs = run, False, list[tuple[int, int]]()
        x, y = (found[n].values(log) if n in found else np.full(len(run), math.nan) for n in ("x_cm", "y_cm"))
        good = np.flatnonzero(np.isfinite(x + y)).tolist()
        self.extent = max(float(np.ptp(x[good])), float(np.ptp(y[good]))) if good else 0.0
        a, step = good[0] if good else 0, self.extent / 40
        for b in good:
            far = math.hypot(x[b] - x[a], y[b] - y[a])
            if self.run[a] != self.run[b] or far > 5 * step:
                a = b
            elif far >= step > 0:
                pairs.append((a, b))
                a = b
        self.begin, self.end = np.array(pairs, np.int64).reshape(-1, 2).T
        dx, dy = x[self.end] - x[self.begin], y[self.end] - y[self.begin]
        self.gone, self.to = np.hypot(dx, dy), np.arctan2(dy, dx)
        follows = np.append(False, self.begin[1:] == self.end[:-1])[: len(dx)]
        self.turn = np.where(follows, _half(np.diff(self.to, prepend=self.to[:1])), math.nan)

    def face(self, heading: Floats) -> None:
        """Take turns and the sense of the way from headings [n], rad."""
        self.faced, self.turn = True, _half(heading[self.end] - heading[self.begin])
        self.gone = np.copysign(self.gone, np.cos(self.to - heading[self.begin] - self.turn / 2))

    def over(self, total: Floats) -> Floats:
        """[m] how much a sum [n] grows in each, 0 where that is unknown."""
        return np.nan_to_num(total[self.end] - total[self.begin])

    def integral(self, rate: Floats) -> Floats:
        """[m] of a rate [n] over the time of each."""
        step = np.diff(self.t, prepend=self.t[:1]) * (np.diff(self.run, prepend=self.run[:1]) == 0)
        return self.over(np.cumsum(np.nan_to_num(filled(rate, self.t, self.run)) * step))

    def turning(self, apart: Floats) -> float:
        """Correlation of the turns with something [m]; 0 if there are too few."""
        known = np.isfinite(self.turn)
        told = known.sum() > 5 and np.ptp(apart[known]) > 0 and np.ptp(self.turn[known]) > 0
        return float(np.corrcoef(apart[known], self.turn[known])[0, 1]) if told else 0.0


def _half(angle: Floats) -> Floats:
    """From −π to π."""
    return np.asarray((angle + math.pi) % math.tau - math.pi)


def _place(log: Log, found: dict[str, Guess], way: _Way) -> None:
    """The unit of the place, by how fast and how far it goes."""
    guess = found["x_cm"]
    if guess.unit not in UNITS["x_cm"]:
        time = np.maximum(way.t[way.end] - way.t[way.begin], 1e-9)
        speed = float(np.median(way.gone / time)) if len(time) else 0.0
        could = [unit for unit, to in UNITS["x_cm"].items()
                 if SLOW <= speed * to <= FAST and SMALL <= way.extent * to <= LARGE]  # fmt: skip
        guess.unit = could[0] if len(could) == 1 else ASKED
        guess.why += f"; {speed:.2g} a second over {way.extent:.3g}: {' or '.join(could) or 'no robot does'}"
        way.gone = way.gone * UNITS["x_cm"].get(guess.unit, 1.0)
    found["y_cm"].unit = guess.unit


def _faced(log: Log, columns: list[int], unit: str, sign: int, way: _Way) -> tuple[float, int, float]:
    """How well it goes, or backs, where a heading so read faces, 0 to 1; the sign; and degrees in between."""
    heading = Guess("heading_deg", columns, unit, sign=sign).values(log)
    a, b = heading[way.begin], heading[way.end]
    apart, weight = way.to - (a + _half(b - a) / 2), way.gone * np.exp(-((_half(b - a) / 0.2) ** 2))
    known = np.isfinite(apart)
    mean = complex((weight * np.exp(2j * apart))[known].sum()) / max(float(weight[known].sum()), 1e-12)
    return abs(mean), sign, math.degrees(math.remainder(np.angle(mean) / 2, math.pi))


def _without_names(log: Log, found: dict[str, Guess], run: NDArray[np.int64]) -> None:
    """Of columns without names: two neighbours that go where a third faces, and two that turn meanwhile."""
    rest = [k for k in range(len(log.names)) if all(k not in guess.columns for guess in found.values())]
    pairs, best = [(k, k + 1) for k in rest if k + 1 in rest], (0.0, (0, 0), 0)
    for pair in pairs:
        place = {name: Guess(name, [k]) for name, k in zip(("x_cm", "y_cm"), pair, strict=True)}
        way = _Way(log, found | place, run)
        for k in (k for k in rest if k not in pair and len(way.gone) > 10):
            shares = [_faced(log, [k], unit, sign, way)[0] for unit in ("rad", "deg") for sign in (1, -1)]
            best = max(best, (max(shares), pair, k))
    share, (x, y), heading = best
    if share < EVIDENT:
        return
    why = f"columns {x + 1} and {y + 1} go where column {heading + 1} faces"
    for name, k in (("x_cm", x), ("y_cm", y), ("heading_deg", heading)):
        found[name] = Guess(name, [k], why=why)
    way = _Way(log, found, run)
    told = [
        (max(_explained(way, [log.values[:, k] for k in pair], run)), pair)
        for pair in pairs if not {x, y, heading} & set(pair)
    ]  # fmt: skip
    if told and max(told)[0] > EVIDENT:
        for side, k in zip(SIDES, max(told)[1], strict=True):
            found[f"counter_{side}"] = Guess(f"counter_{side}", [k], why="it turns when the place moves")


def _explained(way: _Way, counts: Sequence[Floats], run: NDArray[np.int64]) -> list[float]:
    """Shares of the way that two counters explain: if they are cumulative, if they count each row anew."""
    total, left = float(np.sum(way.gone**2)), []
    for each in (False, True):
        gone = np.stack([way.over(cumulative(one, run, per_row=each)[0]) for one in counts], 1)
        fitted = gone @ np.linalg.lstsq(gone, way.gone, rcond=None)[0]
        left.append(1 - float(np.sum((fitted - way.gone) ** 2)) / total)
    return left


def _heading(log: Log, guess: Guess, way: _Way) -> None:
    """The heading's unit, sign and zero: those with which it goes where it faces."""
    units = [guess.unit] if guess.unit in UNITS["heading_deg"] else ["rad", "deg"]
    tried = [(*_faced(log, guess.columns, unit, sign, way), unit) for unit in units for sign in (1, -1)]
    share, sign, zero, guess.unit = max(tried)
    other = max(one for one, s, _, unit in tried if (s, unit) == (-sign, guess.unit))
    if share < SURE:
        whole_turn = float(np.abs(np.nan_to_num(log.values[:, guess.columns])).max()) < 2 * math.tau
        guess.unit = units[0] if whole_turn else units[-1]
        guess.why += f"; unit by its size; the path agrees with it by {share:.2f} only: check it"
        return
    if share - other < CLEAR:  # it hardly turned
        sign, zero = 1, 0.0
    guess.sign, guess.why = sign, f"{guess.why}; the path agrees by {share:.2f}, reversed by {other:.2f}"
    if abs(zero) > SQUARE_DEG:
        near = math.copysign(90.0, zero)
        guess.more["offset_deg"] = near if abs(zero - near) < SQUARE_DEG else float(round(zero))
        guess.why += f", if turned by {zero:.0f}°"
    way.face(guess.values(log))


def _wheels(log: Log, found: dict[str, Guess], way: _Way, run: NDArray[np.int64]) -> None:
    """Counters and speeds of both wheels: of each row or cumulative, signs, exchanged or not, units."""
    for kind in ("counter", "speed"):
        if f"{kind}_left" not in found:
            continue
        pair = [found[f"{kind}_{side}"] for side in SIDES]
        if kind == "speed":
            gone = np.stack([way.integral(guess.values(log)) for guess in pair], 1)
        else:
            counts = [filled(guess.values(log), way.t, run) for guess in pair]
            each, why = _of_each_row(way, counts, run)
            gone = np.stack([way.over(cumulative(one, run, per_row=each)[0]) for one in counts], 1)
            for guess in pair:
                guess.unit, guess.more = "pulses", {"per_row": True} if each else {}
                guess.why += f"; {'of each row' if each else 'cumulative'}: {why}"
        if len(gone) > 10:
            _signs(pair, gone, way)
        if kind == "speed":
            _speed_unit(log, found, pair, way, gone @ [guess.sign / 2 for guess in pair])


def _of_each_row(way: _Way, counts: Sequence[Floats], run: NDArray[np.int64]) -> tuple[bool, str]:
    """Whether counters count each row anew, by the way that they explain; else by how far they go from row to
    row. And why."""
    if len(way.gone) > 10:
        sums, rows = _explained(way, counts, run)
        return rows > sums, f"explains {max(sums, rows):.2f} of the path, else {min(sums, rows):.2f}"
    shares = []
    for one in counts:
        total = np.nan_to_num(cumulative(one, run, per_row=False)[0])
        shares.append(float(np.abs(np.diff(total)).mean() / max(np.ptp(total), 1)))
    return min(shares) > EACH, f"{min(shares):.1%} of its range a row"


def _signs(pair: Sequence[Guess], gone: Floats, way: _Way) -> None:
    """Signs of wheels that have `gone` [m, 2], and whether left is right."""
    ahead = np.linalg.lstsq(gone, way.gone, rcond=None)[0]
    told = way.faced and np.abs(ahead).min() > 0.2 * np.abs(ahead).max()
    signs = np.where((ahead if told else gone.sum(axis=0)) < 0, -1, 1)
    why = f"reversed, so that it {'drives where it faces' if told else 'mostly drives forwards'}"
    for guess, sign in zip(pair, signs.tolist(), strict=True):
        guess.sign, guess.why = sign, guess.why + f"; {why}" * (sign < 0)
    if (alike := way.turning(gone @ (signs * [-1, 1]))) < -0.5:
        left, right = pair
        left.columns, right.columns, left.sign, right.sign = (
            right.columns,
            left.columns,
            right.sign,
            left.sign,
        )
        for guess in pair:
            guess.why = f"exchanged, or it would turn the other way ({alike:.2f}); {guess.why}"


def _rates(log: Log, found: dict[str, Guess], way: _Way) -> None:
    """v and w as they were measured, and commands: units and the sense of w."""
    if "v" in found:
        w = found["w"]
        _speed_unit(log, found, [found["v"]], way, way.integral(found["v"].values(log)))
        turned, known = way.integral(w.values(log)), np.isfinite(way.turn)
        if w.unit not in UNITS["w"]:
            ratio = float(np.abs(way.turn[known]).sum() / max(np.abs(turned[known]).sum(), 1e-12))
            fast = float(np.nanmax(np.abs(w.values(log)))) > 30
            w.unit = "deg/s" if (ratio < 0.1 if known.any() else fast) else "rad/s"
            w.why += f"; the path turns {ratio:.3g} rad per unit" if known.any() else "; by its size"
        if (alike := way.turning(turned)) < -0.5:
            w.sign, w.why = -1, f"{w.why}; reversed, or it would turn the other way ({alike:.2f})"
    for name, guess in found.items():
        if name == "command_v":
            _speed_unit(log, {}, [guess], way, np.zeros(0))
        elif name.startswith("command") and guess.unit not in UNITS[name]:
            guess.unit = next(iter(UNITS[name]))
            guess.why += "; its unit is assumed"


def _speed_unit(log: Log, found: Mapping[str, Guess], some: Sequence[Guess], way: _Way, gone: Floats) -> None:
    """The unit of speeds by the way that their integral `gone` [m] went, or by their size."""
    if some[0].unit in UNITS[some[0].name]:
        return
    own = "own" if "own" in UNITS[some[0].name] else ASKED
    if "x_cm" in found and found["x_cm"].unit != ASKED and np.abs(gone).sum() > 0:
        factor = float(np.abs(way.gone).sum() / np.abs(gone).sum())
        could = [unit for unit, to in SPEED.items() if abs(math.log(factor / to)) < 0.4]
        why = f"the path goes {factor:.3g} cm per unit"
    else:
        top = max(float(np.nanquantile(np.abs(guess.values(log)), 0.95)) for guess in some)
        could = [unit for unit, to in SPEED.items() if 3 * SLOW <= top * to <= FAST]
        could, why = (could if len(could) == 1 and own == ASKED else []), f"values up to {top:.3g}"
    for guess in some:
        guess.unit, guess.why = could[0] if could else own, f"{guess.why}; {why}"


# What is made of it


def _told(log: Log, found: dict[str, Guess], run: NDArray[np.int64]) -> Look:
    readings = [name for name in found if re.fullmatch(r"s\d+|reading", name)]
    near, asked = readings and "distance_cm" in found, dict[str, str]()
    moves = found.keys() & {"counter_left", "speed_left", "v", "command_left", "command_v"}
    path = {"t_s", "x_cm", "y_cm", "heading_deg"} <= found.keys()
    kind = "infrared" if near else "wheels" if moves and "t_s" in found else "track" if path else ASKED
    if kind == ASKED:
        asked["kind"] = "wheels, infrared, ambient or track; name its columns below"
    if near:
        if "heading_deg" in found and "x_cm" not in found:
            turned = found["heading_deg"]
            why = "an angle beside a distance; unit by its size or name"
            found.setdefault("bearing_deg", Guess("bearing_deg", turned.columns, turned.unit, why))
        asked["object"] = 'what they saw: "wall" or "cylinder:RADIUS_CM" (or "lamp": kind = "ambient")'
        if "bearing_deg" not in found:
            asked["bearing_deg"] = "of it, counter-clockwise from the front: a number, or one for each sensor"
    elif kind == "wheels":
        own = found["speed_left"].unit == "own" if "speed_left" in found else False
        if "x_cm" not in found and ("counter_left" in found or own):
            asked["pulses_per_mm"] = "of the counters, since no poses measure them"
        if "command_v" in found or ("v" in found and "counter_left" not in found):
            asked["track_cm"] = "between the wheels, with which the robot makes v and w from their speeds"
    of_readings = ("distance_cm", "bearing_deg", "speed_cm_s", "sensor", "reading")
    names = [*of_readings, *(name for name in readings if name != "reading")]
    if not near:
        names = [name for name in UNITS if name not in of_readings]
    guesses = tuple(found[name] for name in names if name in found)
    for guess in guesses:
        units = UNITS.get(guess.name, {"": 1.0})
        if guess.unit == ASKED and guess.name != "y_cm":
            asked[f"{guess.name}.unit"] = f"one of {', '.join(units)}"
        elif guess.unit not in units and guess.unit != ASKED:
            guess.unit = next(iter(units))
    columns = {guess.name: guess.values(log) for guess in guesses}
    return Look(
        log=log, guesses=guesses, kind=kind, asked=asked, columns=columns, run=run,
        findings=tuple(findings(columns, run, log.lines.tolist())),
    )  # fmt: skip


def findings(columns: Mapping[str, Floats], run: NDArray[np.int64], lines: Sequence[Any]) -> Iterator[str]:
    """Rate, gaps, and poses that repeat or jump, in words."""
    if "t_s" not in columns:
        return
    t = columns["t_s"]
    step = np.diff(t)[np.diff(run) == 0]
    if not (step > 0).any():
        return
    usual, (low, high) = np.median(step[step > 0]), np.quantile(step, (0.05, 0.95))
    again = f", {n} not after the row before" if (n := int((step <= 0).sum())) else ""
    yield f"rows {usual:.3g} s apart (90 %: {low:.3g} to {high:.3g} s, longest {step.max():.3g} s){again}"
    if (cut := gaps(t, run)).any():
        yield f"{many(cut.sum(), 'gap')}, the first before line {lines[int(cut.argmax())]}"
    if not {"x_cm", "y_cm"} <= columns.keys():
        return
    place = np.stack([columns["x_cm"], columns["y_cm"]], 1)
    counted = [columns[name] for name in ("counter_left", "counter_right") if name in columns]
    moved = np.append(False, (np.diff(counted) != 0).any(axis=0)) if counted else np.full(len(t), True)
    if (same := repeats(place, moved)).any():
        what = " though the wheels turned" if counted else ""
        yield f"{many(same.sum(), 'pose')} of {len(t)} repeated from the row before{what}: not measured anew"
    cut, alone = jumps(t, place, run)
    if (off := cut | alone).any():
        where = lines[int(off.argmax())]
        yield f"{many(off.sum(), 'jump')} out of reach ({alone.sum()} of one row), the first in line {where}"
