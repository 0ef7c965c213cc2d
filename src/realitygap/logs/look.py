"""What the columns of a log seem to be, each guess with its reason; and the MAP.toml that says so.

By their names first, then by what they do: a heading is where the place moves to, a counter turns when it
moves. What cannot be told is asked.
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

from realitygap.logs.cuts import gaps, jumps, repeats
from realitygap.logs.mapped import ASKED, SIDES, UNITS, quaternion_yaw
from realitygap.logs.table import Log, read_log
from realitygap.values import Floats

__all__ = ["Look", "findings", "look"]

WORDS = {
    "time": "t time times timestamp stamp sec secs seconds millis clock ms us".split(),
    "run": "trial run episode experiment session".split(),
    "command": "cmd command commanded commands set setpoint target desired pwm motor".split(),
    "counter": "tick ticks enc encoder encoders count counts counter counters pulse pulses odo".split(),
    "speed": "speed speeds vel velocity v".split(), "v": "v vx vel velocity speed linear lin".split(),
    "w": "w wz omega angular ang vtheta yawrate gyro".split(),
    "heading": "heading theta yaw phi psi orientation rot rotation angle th".split(),
    "distance": "distance dist range".split(), "bearing": ["bearing"],
    "sensor": "prox ir sensor s p ps d ds ground light".split(),
    "reading": "count counts reading readings value raw".split(), "repeat": ["repeat"],
    "other": "cov covariance std var acc accel mag status seq battery kind".split(),
}  # fmt: skip
LEFT, RIGHT = ({"left", "l", "lft", "lw"}, {"right", "r", "rgt", "rw"})
JOINED = {"vl": "speed l", "vr": "speed r", "encl": "enc l", "encr": "enc r", "ticksl": "ticks l",
          "ticksr": "ticks r", "lticks": "ticks l", "rticks": "ticks r", "lenc": "enc l", "renc": "enc r",
          "cmdl": "cmd l", "cmdr": "cmd r", "degs": "deg s", "rads": "rad s"}  # fmt: skip
UNIT_WORDS = {"s": "s", "sec": "s", "secs": "s", "seconds": "s", "ms": "ms", "millis": "ms", "us": "us",
              "ns": "ns", "cm": "cm", "mm": "mm", "m": "m", "rad": "rad", "radians": "rad", "deg": "deg",
              "degrees": "deg", "degree": "deg", "cms": "cm/s", "mms": "mm/s", "mps": "m/s"}  # fmt: skip
EPOCHS = {"s": 1e9, "ms": 1e12, "us": 1e15, "ns": 1e18}
"""Beginnings of clocks that count from 1970."""
SLOW, FAST, SMALL, LARGE = 1.0, 150.0, 15.0, 3000.0
"""cm/s and cm: what robots on a floor do, and over how much of it."""
SURE = 0.6
"""Agreement of a heading with the way, 0 to 1, from which they belong together."""
RIGHT_ANGLE, SQUARE = 90.0, 20.0


@dataclass
class Guess:
    """What one column, or the four of a quaternion, seems to be; `more` are further keys of its entry."""

    name: str
    columns: list[int]
    unit: str = ""
    why: str = "named so"
    sign: int = 1
    more: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True, eq=False)
class Look:
    """What a log seems to hold.

    Attributes:
        guesses: of its columns; the others seem to be nothing that is needed.
        kind: as in a MAP.toml, "?" where it holds too little.
        facts: further keys of the MAP.toml; asked: its keys that are asked for, with what they are.
        columns: [n] values by name in s, cm, rad, pulses; those whose unit is asked as they stand.
        findings: about times and places, in words.
    """

    log: Log
    guesses: tuple[Guess, ...]
    kind: str
    facts: Mapping[str, Any]
    asked: Mapping[str, str]
    columns: Mapping[str, Floats] = field(repr=False)
    run: NDArray[np.int64] = field(repr=False)
    findings: tuple[str, ...]

    def to_toml(self, target: Path) -> str:
        """The text of a MAP.toml at a path."""
        log = json.dumps(os.path.relpath(self.log.path, target.parent), ensure_ascii=False)
        answer = ', answer each "?"' if self.asked else ""
        lines = [f"# What the columns of {self.log.path.name} seem to be. Correct what is wrong{answer}.",
                 f"logs = [{log}]  # several: a run each", f'kind = "{self.kind}"']  # fmt: skip
        lines += [f"{key} = {json.dumps(value)}  # {self.asked.get(key, '')}".rstrip(" #")
                  for key, value in self.facts.items()]  # fmt: skip
        lines += ["", "[columns]"]
        for guess in self.guesses:
            of = [self._named(k) for k in guess.columns]
            told: dict[str, Any] = {"column": of[0] if len(of) == 1 else of}
            told |= {"unit": guess.unit} if guess.unit and guess.name != "y_cm" else {}
            told |= ({"sign": -1} if guess.sign < 0 else {}) | guess.more
            inner = ", ".join(f"{key} = {json.dumps(v, ensure_ascii=False)}" for key, v in told.items())
            lines.append(f"{guess.name} = {{ {inner} }}  # {guess.why}")
        return "\n".join(lines) + "\n"

    def _named(self, column: int) -> str | int:
        name = self.log.names[column]
        return column + 1 if name == str(column + 1) else name

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        return {
            "log": str(self.log.path), "rows": len(self.log.values), "separator": self.log.separator,
            "head": self.log.head, "kind": self.kind, "asked": dict(self.asked),
            "columns": [
                {"name": g.name, "column": [self._named(k) for k in g.columns], "unit": g.unit,
                 "sign": g.sign, "why": g.why, **g.more} for g in self.guesses
            ],
            "notes": [*self.log.notes, *self.findings],
        }  # fmt: skip


def look(path: str | Path) -> Look:
    """Look at a log.

    Raises:
        RecordingError: there is no table of numbers in it.
    """
    log = read_log(path)
    found = _by_name(log)
    _time(log, found)
    run = _run(log, found)
    seen = _Seen(log, found, run)
    _place(seen)
    _heading(seen)
    for name in ("counter", "speed"):
        _wheels(seen, name)
    _motion(seen)
    _commands(seen)
    return _told(seen)


# By their names


def _by_name(log: Log) -> dict[str, Guess]:
    """Guesses by name, the first column of each."""
    found: dict[str, Guess] = {}
    quaternion: dict[str, int] = {}
    for k, name in enumerate(log.names):
        words = _words(name)
        letter = re.fullmatch(r"q(?:uat)?([xyzw])", words[-1]) if words else None
        turned = {"q", "quat", "quaternion", "orientation", "rotation"} & set(words[:-1])
        if letter or (turned and words[-1] in "xyzw"):
            quaternion[letter[1] if letter else words[-1]] = k
            continue
        role, unit = _role(words)
        if role and role not in found and np.isfinite(log.values[:, k]).any():
            found[role] = Guess(role, [k], unit)
    if len(quaternion) == 4 or set(quaternion) == {"z", "w"}:
        of = [quaternion[letter] for letter in "xyzw" if letter in quaternion]
        norm = np.linalg.norm(log.values[:, of], axis=1)
        found["heading_deg"] = Guess(
            "heading_deg", of, "quaternion", f"a quaternion: its length is {np.nanmedian(norm):.3f}"
        )
    elif {"x_cm", "y_cm"} <= found.keys() and "heading_deg" not in found:
        third = found["y_cm"].columns[0] + 1  # a pose in the plane has one more number
        if third < len(log.names) and _words(log.names[third])[-1:] == ["z"]:
            found["heading_deg"] = Guess("heading_deg", [third], why="the third of a pose in the plane")
    if "reading" in found and "sensor" not in found:
        del found["reading"]
    return found


def _words(name: str) -> list[str]:
    name = re.sub(r"([a-z])([A-Z])", r"\1 \2", name).lower()
    return " ".join(JOINED.get(word, word) for word in re.findall(r"[a-z]+|\d+", name)).split()


def _role(words: list[str]) -> tuple[str, str]:
    """What a column is by its words, and its unit if they say one; "" for neither."""
    unit, said = "", list(words)
    if len(said) > 2 and said[-1] in ("s", "sec") and said[-2] in ("m", "cm", "mm", "rad", "deg"):
        unit, said = f"{said[-2]}/s", said[:-2]
    elif len(said) > 1 and said[-1] in UNIT_WORDS:
        unit, said = UNIT_WORDS[said[-1]], said[:-1]
    have = set(said)
    side = "left" if have & LEFT else "right" if have & RIGHT else ""
    is_ = {role: bool(have & set(some)) for role, some in WORDS.items()}
    number = said[-1] if said and said[-1].isdecimal() else ""
    if is_["other"]:
        return "", ""
    if side:
        kind = next((one for one in ("command", "counter", "speed") if is_[one]), "")
        return (f"{kind}_{side}" if kind else ""), unit
    if number:
        return (f"s{number}" if is_["sensor"] and len(said) == 2 else ""), unit
    moved = "command_" if is_["command"] else ""
    if is_["w"] or (is_["heading"] and "rate" in have):
        return f"{moved}w", unit
    if is_["v"] and not have & {"y", "z"}:
        return f"{moved}v", unit
    if moved:
        return "", ""
    last = said[-1] if said else ""
    for role, name in (("time", "t_s"), ("run", "run"), ("distance", "distance_cm"),
                       ("bearing", "bearing_deg"), ("heading", "heading_deg")):  # fmt: skip
        if is_[role]:
            return name, unit or (UNIT_WORDS.get(last, "") if role == "time" else "")
    if last in ("x", "y"):
        return f"{last}_cm", unit
    if said == ["sensor"] or (is_["reading"] and len(said) == 1):
        return ("sensor" if said == ["sensor"] else "reading"), ""
    return "", ""


# By what they do


def _time(log: Log, found: dict[str, Guess]) -> None:
    """The clock: named so, or the first column that grows from row to row."""
    forth = (np.diff(log.values, axis=0) >= 0).mean(axis=0)
    if "t_s" in found and forth[found["t_s"].columns[0]] < 0.9:
        del found["t_s"]
    grows = [k for k in range(len(log.names)) if (np.diff(log.values[:, k]) > 0).all()]
    if "t_s" not in found and grows and not log.head:
        found["t_s"] = Guess("t_s", [grows[0]], why="the first that grows from row to row")
    if "t_s" not in found or found["t_s"].unit:
        return
    guess = found["t_s"]
    t = log.values[:, guess.columns[0]]
    step = float(np.median(np.diff(t)[np.diff(t) > 0])) if (np.diff(t) > 0).any() else 1.0
    epoch = next((unit for unit, begin in EPOCHS.items() if begin < t[0] < 5 * begin), "")
    if epoch:
        guess.unit, guess.why = epoch, "counts from 1970"
        return
    could = [unit for unit, factor in UNITS["t_s"].items() if 1e-3 <= step * factor <= 2.0]
    could = [unit for unit in could if (unit == "s") == (step < 2.5)] if could != ["s"] else could
    guess.unit = could[0] if len(could) == 1 or "s" in could else ASKED
    if len(could) > 1 and guess.unit == ASKED:  # a millisecond's step, or a thousand microseconds
        guess.unit = "ms" if step < 2000 else "us"
    guess.why += f"; a row each {step:.3g}"


def _run(log: Log, found: dict[str, Guess]) -> NDArray[np.int64]:
    """[n] the run of each row, in blocks."""
    if "run" not in found:
        return np.zeros(len(log.values), np.int64)
    values = log.values[:, found["run"].columns[0]]
    blocks = int((np.diff(values) != 0).sum()) + 1
    found["run"].why += f": {blocks} blocks"
    return np.unique(values, return_inverse=True)[1].astype(np.int64)


class _Seen:
    """A log with its guesses, and where it moved: segments of a path, [m] from and to which row."""

    def __init__(self, log: Log, found: dict[str, Guess], run: NDArray[np.int64]) -> None:
        self.log, self.found, self.run = log, found, run
        self.begin = self.end = np.zeros(0, np.int64)
        self.way = self.to = self.turn = np.zeros(0)
        """cm or the place's unit, [m]; where to, rad; and how far it turned, rad, by the heading or the way."""

    def of(self, name: str) -> Floats:
        """A column as it stands."""
        return self.log.values[:, self.found[name].columns[0]]

    def has(self, *names: str) -> bool:
        return set(names) <= self.found.keys()

    @property
    def t(self) -> Floats:
        """[n] s; numbers of rows without a clock."""
        if not self.has("t_s"):
            return np.arange(len(self.run)) * 0.1
        return self.of("t_s") * UNITS["t_s"].get(self.found["t_s"].unit, 1.0)

    def segments(self, x: Floats, y: Floats) -> None:
        """Cut the path where it has gone on by a fortieth of its extent."""
        good = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
        step = max(np.ptp(x[good]), np.ptp(y[good])) / 40 if len(good) else 0.0
        pairs, a = [], int(good[0]) if len(good) else 0
        for b in good.tolist():
            if self.run[a] != self.run[b] or (far := math.hypot(x[b] - x[a], y[b] - y[a])) > 5 * step:
                a = b
            elif far >= step > 0:
                pairs.append((a, b))
                a = b
        self.begin, self.end = np.array(pairs, np.int64).reshape(-1, 2).T
        dx, dy = x[self.end] - x[self.begin], y[self.end] - y[self.begin]
        self.way, self.to = np.hypot(dx, dy), np.arctan2(dy, dx)
        follows = np.concatenate([[False], self.begin[1:] == self.end[:-1]])
        self.turn = np.where(follows, _half(np.diff(self.to, prepend=self.to[:1])), math.nan)

    def gone(self, name: str, *, rate: bool) -> Floats:
        """[m] how far a counter went in each segment, or a rate by its integral."""
        values = np.nan_to_num(self.of(name))
        if rate:
            step = np.diff(self.t, prepend=self.t[:1])
            values = np.cumsum(values * np.where(np.diff(self.run, prepend=0) != 0, 0.0, step))
        return np.asarray(values[self.end] - values[self.begin])


def _half(angle: Floats) -> Floats:
    """From −π to π."""
    return np.asarray((angle + math.pi) % math.tau - math.pi)


def _place(seen: _Seen) -> None:
    """The path, its unit by how fast and how far it goes."""
    if not seen.has("x_cm", "y_cm"):
        for name in ("x_cm", "y_cm"):
            seen.found.pop(name, None)
        return
    x, y = seen.of("x_cm"), seen.of("y_cm")
    seen.segments(x, y)
    guess = seen.found["x_cm"]
    if not guess.unit and len(seen.way):
        time = seen.t[seen.end] - seen.t[seen.begin]
        speed = float(np.median((seen.way / np.maximum(time, 1e-9))))
        extent = max(float(np.nanmax(c) - np.nanmin(c)) for c in (x, y))
        could = [unit for unit, to in UNITS["x_cm"].items()
                 if SLOW <= speed * to <= FAST and SMALL <= extent * to <= LARGE]  # fmt: skip
        guess.unit = could[0] if len(could) == 1 else ASKED
        tells = "no other is a robot's" if len(could) == 1 else f"{' or '.join(could) or 'none'} would do"
        guess.why += f"; {speed:.2g} a second over {extent:.3g}: {tells}"
    seen.found["y_cm"].unit = guess.unit


def _heading(seen: _Seen) -> None:
    """The heading's unit, sign and zero: those with which the place moves where it faces."""
    if not seen.has("heading_deg"):
        return
    guess, scale = seen.found["heading_deg"], {"rad": 1.0, "deg": math.pi / 180}
    if guess.unit == "quaternion":
        raw, units = quaternion_yaw(seen.log.values[:, guess.columns]), {"quaternion": 1.0}
    else:
        raw = seen.of("heading_deg")
        most = float(np.nanmax(np.abs(raw)))
        units = {guess.unit: scale[guess.unit]} if guess.unit in scale else scale
        if not guess.unit and most > 2 * math.tau:
            units = {"deg": scale["deg"]}
    if not len(seen.way):
        guess.unit = guess.unit or ("rad" if most <= math.tau + 0.1 else "deg")
        return
    tried = sorted((_agreement(seen, sign * factor * raw), unit, sign)
                   for unit, factor in units.items() for sign in (1, -1))  # fmt: skip
    (share, zero), unit, sign = tried[-1]
    other = max((a[0] for a, u, s in tried if u == unit and s == -sign), default=0.0)
    guess.unit = unit
    if share < SURE:
        guess.why += f"; it agrees with the way by {share:.2f} only: look at it"
        return
    if share - other < 0.05:  # it hardly turned
        sign, zero = 1, 0.0
    guess.sign = sign
    guess.why += f"; with it the way agrees ({share:.2f}; {other:.2f} with the other sign)"
    degrees = math.degrees(zero)
    if SQUARE < abs(degrees) < 180 - SQUARE:
        near = math.copysign(RIGHT_ANGLE, degrees)
        guess.more["offset_deg"] = near if abs(degrees - near) < SQUARE else round(degrees)
        guess.why += f", turned by {degrees:.0f}°"
    face = sign * units[unit] * raw + math.radians(guess.more.get("offset_deg", 0.0))
    seen.turn = _half(face[seen.end] - face[seen.begin])
    seen.way = seen.way * np.sign(np.cos(seen.to - face[(seen.begin + seen.end) // 2]))


def _agreement(seen: _Seen, heading: Floats) -> tuple[float, float]:
    """How well the way goes where a heading [n] faces, or back, 0 to 1; and the angle that lies between."""
    a, b = heading[seen.begin], heading[seen.end]
    apart = seen.to - (a + _half(b - a) / 2)
    weight = seen.way * np.exp(-((_half(b - a) / 0.2) ** 2))
    use = np.isfinite(apart)
    if not weight[use].sum() > 0:
        return 0.0, 0.0
    mean = complex((weight * np.exp(2j * apart))[use].sum() / weight[use].sum())
    return abs(mean), math.remainder(np.angle(mean) / 2, math.pi)


def _wheels(seen: _Seen, kind: str) -> None:
    """Counters or speeds of both wheels: cumulative or not, signs, exchanged or not, by the path or by
    themselves."""
    names = [f"{kind}_{side}" for side in SIDES]
    if not seen.has(*names):
        for name in names:
            seen.found.pop(name, None)
        return
    guesses = [seen.found[name] for name in names]
    if kind == "counter":
        values = np.stack([seen.of(name) for name in names], 1)
        shares = np.nanmean(np.abs(np.diff(values, axis=0)), axis=0) / np.maximum(np.ptp(values, axis=0), 1e-9)
        each = bool((shares > 0.02).all())
        for guess, share in zip(guesses, shares.tolist(), strict=True):
            guess.unit = "pulses"
            guess.why += f"; {'of each row' if each else 'cumulative'}: a step is {share:.1%} of its range"
            guess.more |= {"per_row": True} if each else {}
    rate = kind == "speed" or bool(guesses[0].more)
    gone = np.stack([seen.gone(name, rate=kind == "speed") for name in names], 1)
    if kind == "counter" and rate:
        total = np.cumsum(np.nan_to_num(values), axis=0)
        gone = total[seen.end] - total[seen.begin]
    _signs(seen, guesses, gone)
    if kind == "speed":
        mean = np.abs((gone * [g.sign for g in guesses]).mean(axis=1))
        for guess in guesses:
            _speed_unit(seen, guess, mean)


def _signs(seen: _Seen, guesses: Sequence[Guess], gone: Floats) -> None:
    """Signs of both wheels, and whether left is right; `gone` [m, 2]."""
    if len(gone) < 10:
        for guess in guesses:
            values = np.nan_to_num(seen.log.values[:, guess.columns[0]])
            net = values[-1] - values[0] if guess.name.startswith("counter") else values.sum()
            if net < 0 and not guess.more:
                guess.why += "; it mostly runs backwards: sign -1?"
        return
    straight = np.linalg.lstsq(gone, seen.way, rcond=None)[0]
    if seen.has("heading_deg") and np.abs(straight).min() > 0.2 * np.abs(straight).max():
        signs, why = np.sign(straight), "with it both turn forwards where it goes"
    else:
        signs, why = np.sign(gone.sum(axis=0)), "it mostly goes forwards"
    for guess, sign in zip(guesses, signs.tolist(), strict=True):
        guess.sign = -1 if sign < 0 else 1
        guess.why += f"; {why}" if sign < 0 else ""
    apart, known = gone @ (signs * [-1, 1]), np.isfinite(seen.turn)
    if known.sum() > 5 and np.ptp(apart[known]) > 0:
        alike = float(np.corrcoef(apart[known], seen.turn[known])[0, 1])
        if alike < -0.5:
            left, right = guesses
            left.columns, right.columns = right.columns, left.columns
            left.sign, right.sign = right.sign, left.sign
            for guess in guesses:
                guess.why = f"left and right are exchanged: else it turns the other way ({alike:.2f}); {guess.why}"


def _motion(seen: _Seen) -> None:
    """v and w as the robot measured them: units by the path, or by their sizes; the sign of w by the turns."""
    if not seen.has("v", "w"):
        for name in ("v", "w"):
            seen.found.pop(name, None)
        return
    v, w = seen.found["v"], seen.found["w"]
    _speed_unit(seen, v, np.abs(seen.gone("v", rate=True)) if len(seen.way) else np.zeros(0))
    turned, known = seen.gone("w", rate=True), np.isfinite(seen.turn)
    if not w.unit:
        ratio = float(np.median(np.abs(seen.turn[known & (turned != 0)] / turned[known & (turned != 0)])))
        w.unit = "deg/s" if ratio < 0.1 or np.nanmax(np.abs(seen.of("w"))) > 30 else "rad/s"
        w.why += f"; the way turns by {ratio:.3g} of it" if math.isfinite(ratio) else "; by its size"
    if known.sum() > 5 and np.ptp(turned[known]) > 0:
        alike = float(np.corrcoef(turned[known], seen.turn[known])[0, 1])
        w.sign = -1 if alike < -0.5 else 1
        w.why += f"; it turns the other way than the path ({alike:.2f})" if w.sign < 0 else ""


def _speed_unit(seen: _Seen, guess: Guess, gone: Floats) -> None:
    """A speed's unit by the way [m] that its integral `gone` [m] went; or by its size."""
    if guess.unit in UNITS[guess.name]:
        return
    place = seen.found.get("x_cm")
    if place and place.unit in UNITS["x_cm"] and gone.sum() > 0:
        factor = UNITS["x_cm"][place.unit] * np.abs(seen.way).sum() / gone.sum()
        near = [unit for unit, to in UNITS["v"].items() if abs(math.log(factor / to)) < 0.4]
        guess.unit = near[0] if near else "own" if "own" in UNITS[guess.name] else ASKED
        guess.why += f"; the way is {factor:.3g} cm for each of it"
        return
    top = float(np.nanquantile(np.abs(seen.of(guess.name)), 0.95))
    could = [unit for unit, to in UNITS["v"].items() if 3 * SLOW <= top * to <= FAST]
    guess.unit = could[0] if len(could) == 1 else "own" if "own" in UNITS[guess.name] else ASKED
    guess.why += f"; up to {top:.3g}: {' or '.join(could) or 'none'} would do"


def _commands(seen: _Seen) -> None:
    """Commands of both wheels, in the robot's own unit; or v and w, in cm/s."""
    for pair in ([f"command_{side}" for side in SIDES], ["command_v", "command_w"]):
        if not seen.has(*pair):
            for name in pair:
                seen.found.pop(name, None)
    for guess in seen.found.values():
        if guess.name.startswith("command"):
            said = guess.unit if guess.unit in UNITS[guess.name] else ""
            if guess.name == "command_v":
                _speed_unit(seen, guess, np.zeros(0))
            else:
                guess.unit = said or next(iter(UNITS[guess.name]))
                guess.why += "" if said else f"; {guess.unit} is supposed"


# What is made of it


def _told(seen: _Seen) -> Look:
    found = seen.found
    sensors = [name for name in found if re.fullmatch(r"s\d+", name)]
    wheels = any(name in found for name in ("counter_left", "speed_left", "v", "command_left", "command_v"))
    near = "distance_cm" in found and (sensors or seen.has("sensor", "reading"))
    path = seen.has("t_s", "x_cm", "y_cm", "heading_deg")
    kind = "infrared" if near else "wheels" if wheels and "t_s" in found else "track" if path else ASKED
    facts: dict[str, Any] = {}
    asked: dict[str, str] = {}
    if kind == ASKED:
        asked["kind"] = "wheels, infrared, ambient or track: name its columns below"
    if near:
        asked["object"] = 'what they faced: "wall", "cylinder:RADIUS_CM" (or "lamp": kind = "ambient")'
        if "bearing_deg" not in found:
            asked["bearing_deg"] = "where it stood, counter-clockwise from the front: a number, or one a sensor"
        names = [*sensors, "sensor", "reading", "distance_cm", "bearing_deg", "speed_cm_s"]
    else:
        names = [name for name in UNITS if name not in ("sensor", "reading", "distance_cm", "bearing_deg")]
        counted = seen.has("counter_left") or (seen.has("speed_left") and found["speed_left"].unit == "own")
        if kind == "wheels" and counted and "x_cm" not in found:
            asked["pulses_per_mm"] = "of the counters: no poses measure them"
        if ("v" in found and "counter_left" not in found) or ("command_v" in found):
            asked["track_cm"] = "between the wheels, with which the robot makes v and w from them"
    facts |= dict.fromkeys((key for key in asked if key != "kind"), ASKED)
    guesses = tuple(found[name] for name in names if name in found)
    for guess in guesses:
        default = next(iter(UNITS.get(guess.name, {"": 1.0})))
        if guess.unit not in (UNITS.get(guess.name, {"": 1.0}) | {ASKED: 1.0}):
            guess.unit = default
        if guess.unit == ASKED and guess.name != "y_cm":
            asked[f"{guess.name}.unit"] = f"one of {', '.join(UNITS[guess.name])}"
    columns = {guess.name: _values(seen.log, guess) for guess in guesses}
    return Look(
        log=seen.log, guesses=guesses, kind=kind, facts=facts, asked=asked, columns=columns, run=seen.run,
        findings=tuple(findings(columns, seen.run, seen.log.lines)),
    )  # fmt: skip


def _values(log: Log, guess: Guess) -> Floats:
    """A guess's column [n] in s, cm, rad; as it stands if its unit is asked."""
    if guess.unit == "quaternion":
        values = quaternion_yaw(log.values[:, guess.columns])
    else:
        values = log.values[:, guess.columns[0]]
    factor = guess.sign * UNITS.get(guess.name, {}).get(guess.unit, 1.0)
    return np.asarray(values * factor + math.radians(guess.more.get("offset_deg", 0.0)))


def findings(columns: Mapping[str, Floats], run: NDArray[np.int64], lines: Sequence[Any]) -> Iterator[str]:
    """Rate, gaps, and poses that repeat or jump, in words."""
    within = np.diff(run) == 0
    if "t_s" in columns:
        t = columns["t_s"]
        step = np.diff(t)[within]
        yield (
            f"rows {np.median(step[step > 0]):.3g} s apart (90 %: {np.quantile(step, 0.05):.3g} to "
            f"{np.quantile(step, 0.95):.3g}, longest {step.max():.3g}), {(step <= 0).sum()} of a time before"
        )
        if (cut := gaps(t, run)).any():
            yield f"{cut.sum()} gaps, the first before line {lines[int(cut.argmax())]}"
    if {"t_s", "x_cm", "y_cm"} <= columns.keys():
        place = np.stack([columns["x_cm"], columns["y_cm"]], 1)
        counted = [columns[name] for name in ("counter_left", "counter_right") if name in columns]
        moved = np.full(len(t), True)
        if counted:
            moved = np.concatenate([[False], (np.diff(counted) != 0).any(axis=0)])
        if (again := repeats(place, moved)).any():
            what = "though the wheels turned" if counted else "to the digit"
            yield f"{again.sum()} of {len(t)} poses are the row before's {what}: not measured anew"
        cut, alone = jumps(t, place, run)
        if (off := cut | alone).any():
            first = lines[int(off.argmax())]
            yield f"{off.sum()} poses jump out of reach, the first in line {first} ({alone.sum()} alone)"
