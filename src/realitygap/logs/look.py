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
from realitygap.logs.mapped import ASKED, SENSOR, SIDES, UNITS, converted, cumulative, filled
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
TOGETHER = (
    ("x_cm", "y_cm"), ("v", "w"), ("command_v", "command_w"), ("sensor", "reading"),
    *([f"{what}_{side}" for side in SIDES] for what in ("counter", "speed", "command")),
)  # fmt: skip
"""None of these stands alone."""
NEAR = ("distance_cm", "bearing_deg", "sensor", "reading")
LEFT, RIGHT = r"\b(left|l|lft|lw)\b", r"\b(right|r|rgt|rw)\b"
NUMBERED = r"(?:prox|proximity|ir|sensor|s|p|ps) (\d+)"
UNIT = r" (?:(cm|mm|m|rad|deg) (?:per )?s|(s|ms|us|ns|cm|mm|m|rad|deg)(?:ec|ians?|rees?)?)$"
CLOCKS = (("s", 2.5), ("ms", 2.5e3), ("us", 2.5e6), ("ns", math.inf))
"""Units of a clock, and what is less from row to row."""
SLOW, FAST, SMALL, LARGE = 1.0, 150.0, 15.0, 3000.0
"""cm/s and cm: what robots on a floor do, and over how much of it."""
SURE, CLEAR, SQUARE_DEG = 0.6, 0.05, 20.0
"""A heading belongs to a way that agrees with it, 0 to 1; is reversed if that agrees so much better; and its
zero is off by more than so much."""
EACH, FEW = 0.02, 10
"""Share of its range by which a counter of each row goes from row to row; segments that tell nothing."""
NEARLY = 0.4
"""Logarithm of the way by a speed over the way that went, at most."""


@dataclass
class Guess:
    """What one column, or those of a quaternion, seem to be."""

    name: str
    columns: list[int]
    unit: str = ""
    why: str = "its name"
    sign: int = 1
    per_row: bool = False

    def values(self, log: Log) -> Floats:
        """[n] in s, cm, rad and so on; as they stand if the unit is not known."""
        return converted(self.name, log.values[:, self.columns], self.unit, self.sign)


@dataclass(frozen=True, kw_only=True, eq=False)
class Look:
    """What a log seems to hold: guesses of its columns, and its kind, as in a MAP.toml; keys that are asked
    for, with what they are; columns [n] by name and runs [n] so read; findings about times and places."""

    log: Log
    guesses: Sequence[Guess]
    kind: str
    asked: Mapping[str, str]
    columns: Mapping[str, Floats] = field(repr=False)
    run: NDArray[np.int64] = field(repr=False)
    findings: Sequence[str]

    @property
    def unused(self) -> list[str]:
        """Columns that seem to be nothing that is needed."""
        used = {k for guess in self.guesses for k in guess.columns}
        return [name for k, name in enumerate(self.log.names) if k not in used]

    def to_toml(self, target: Path) -> str:
        """The text of a MAP.toml at a path."""

        def shown(value: Any) -> str:
            return json.dumps(value, ensure_ascii=False)

        answer = ', answer each "?"' if self.asked else ""
        lines = [f"# What the columns of {self.log.path.name} seem to be. Correct what is wrong{answer}.",
                 f"logs = [{shown(os.path.relpath(self.log.path, target.parent))}]  # several: a run each",
                 f'kind = "{self.kind}"']  # fmt: skip
        facts = {key: what for key, what in self.asked.items() if key != "kind" and "." not in key}
        lines += [*(f'{key} = "{ASKED}"  # {what}' for key, what in facts.items()), "", "[columns]"]
        for guess in self.guesses:
            names = [self.log.names[k] for k in guess.columns]
            entry = f"column = {shown(names if names[1:] else names[0])}"
            entry += f', unit = "{guess.unit}"' if guess.unit and guess.name != "y_cm" else ""
            entry += ", sign = -1" * (guess.sign < 0) + ", per_row = true" * guess.per_row
            lines.append(f"{guess.name} = {{ {entry} }}  # {guess.why}")
        if self.kind == ASKED:
            lines.append(f"# Not told: {', '.join(self.unused)}. They may be: {', '.join(UNITS)}, s0, s1 …")
        return "\n".join(lines) + "\n"


def look(path: str | Path) -> Look:
    """Look at a log.

    Raises:
        RecordingError: there is no table of numbers in it.
    """
    log = read_log(path)
    found, run = _by_name(log), np.zeros(len(log.values), np.int64)
    if "run" in found:
        run = np.unique(found["run"].values(log), return_inverse=True)[1].astype(np.int64)
    for some in TOGETHER:
        for name in some if not set(some) <= found.keys() else ():
            found.pop(name, None)
    if "t_s" in found and found["t_s"].unit not in UNITS["t_s"]:
        clock = found["t_s"]
        step = np.diff(log.values[:, clock.columns[0]])
        usual = float(np.median(step[step > 0])) if (step > 0).any() else 1.0
        clock.unit = next(unit for unit, below in CLOCKS if usual < below)
        clock.why += f"; one row every {usual:.3g}"
    way = _Way(log, found, run)
    if "x_cm" in found:
        _place(way)
    if "heading_deg" in found:
        _heading(way, found["heading_deg"])
    for kind in ("counter", "speed"):
        if f"{kind}_left" in found:
            _wheels(way, kind)
    for name in found.keys() & {"v", "w", "command_v", "command_w"}:
        rate = found[name]
        gone = way.integral(rate)
        _unit_of_rates(way, [rate], gone)
        if name == "w" and (alike := way.turning(gone)) < -0.5:
            rate.sign, rate.why = -1, f"{rate.why}; reversed, or it would turn the other way ({alike:.2f})"
    return _told(log, found, run)


# By their names


def _by_name(log: Log) -> dict[str, Guess]:
    """Guesses by name, the first column of each."""
    found, turned = dict[str, Guess](), dict[str, int]()
    for k, name in enumerate(log.names):
        words = " ".join(re.findall(r"[a-z]+|\d+", re.sub(r"([a-z])([A-Z])", r"\1 \2", name).lower()))
        if part := re.fullmatch(r"(?:.* )?(?:q|quat|quaternion|orientation|rotation) ?([xyzw])", words):
            turned[part[1]] = k
            continue
        role, unit = _role(words)
        if role and role not in found and np.isfinite(log.values[:, k]).any():
            found[role] = Guess(role, [k], unit)
    if {"z", "w"} <= turned.keys():
        of = [turned[letter] for letter in ("xyzw" if len(turned) == 4 else "zw")]
        size = np.nanmedian(np.linalg.norm(log.values[:, of], axis=1))
        found["heading_deg"] = Guess("heading_deg", of, "quaternion", f"a quaternion, {size:.3f} long")
    third = found["y_cm"].columns[0] + 1 if "y_cm" in found else len(log.names)
    if "heading_deg" not in found and third < len(log.names) and log.names[third].lower().endswith("z"):
        found["heading_deg"] = Guess("heading_deg", [third], why="the third of a pose in the plane")
    return found


def _role(words: str) -> tuple[str, str]:
    """What a column is by its words, and its unit if they say one; "" for neither."""
    unit = ""
    if said := re.search(UNIT, words):
        unit = f"{said[1]}/s" if said[1] else said[2]
        words = words[: said.start()]
    if sensor := re.fullmatch(NUMBERED, words):
        return f"s{int(sensor[1])}", unit
    words = re.sub(r"\b(v|enc|ticks?|cmd|u)([lr])\b", r"\1 \2", words)  # vl is speed and left
    side = "left" if re.search(LEFT, words) else "right" if re.search(RIGHT, words) else ""
    for name, some in OF_A_SIDE if side else NAMES:
        if re.search(rf"\b(?:{some})(?:\b|$)", words):
            if side:
                return f"{name}_{side}", unit
            if re.search({"v": r" [yz]$", "w": r" [xy]$"}.get(name, "$^"), words):
                return "", unit  # sideways
            commanded = name in ("v", "w") and re.search(rf"\b(?:{OF_A_SIDE[0][1]})\b", words)
            return f"command_{name}" if commanded else name, unit
    return "", unit


# By what they do


class _Way:
    """Where a log went on: segments [m] from row `begin` to row `end`, each a fortieth of the path's extent.

    `gone` [m]: how far, in the unit of the place, backwards negative where the heading tells it; `to`: where
    to, rad; `turn`: how far it turned meanwhile, rad, by its heading, or by the way; NaN if unknown.
    """

    def __init__(self, log: Log, found: Mapping[str, Guess], run: NDArray[np.int64]) -> None:
        self.log, self.found, self.run, self.faced, self.measured = log, found, run, False, False
        self.t = found["t_s"].values(log) if "t_s" in found else np.arange(0.0, len(run)) / 10
        x, y = (found[n].values(log) if n in found else np.full(len(run), math.nan) for n in ("x_cm", "y_cm"))
        good = np.flatnonzero(np.isfinite(x + y)).tolist()
        self.extent = max(float(np.ptp(x[good])), float(np.ptp(y[good]))) if good else 0.0
        picked, step = good[:1], self.extent / 40
        for b in good:
            a = picked[-1]
            if run[a] != run[b] or math.hypot(x[b] - x[a], y[b] - y[a]) >= step:
                picked.append(b)
        dx, dy, at = np.diff(x[picked]), np.diff(y[picked]), np.array(picked, np.int64)
        gone = np.hypot(dx, dy)
        near = (np.diff(run[at]) == 0) & (gone > 0) & (gone <= 5 * step)
        self.begin, self.end = at[:-1][near], at[1:][near]
        self.gone, self.to = gone[near], np.arctan2(dy, dx)[near]
        follows = np.append(False, self.begin[1:] == self.end[:-1])[: len(self.to)]
        self.turn = np.where(follows, _half(np.diff(self.to, prepend=self.to[:1])), math.nan)

    def over(self, total: Floats) -> Floats:
        """[m] how much a sum [n] grows in each, 0 where that is unknown."""
        return np.asarray(np.nan_to_num(total[self.end] - total[self.begin]))

    def integral(self, rate: Guess) -> Floats:
        """[m] of a rate over the time of each."""
        step = np.diff(self.t, prepend=self.t[:1]) * (np.diff(self.run, prepend=self.run[:1]) == 0)
        return self.over(np.cumsum(np.nan_to_num(filled(rate.values(self.log), self.t, self.run)) * step))

    def turning(self, apart: Floats) -> float:
        """Correlation of the turns with something [m]; 0 if there are too few."""
        known = np.isfinite(self.turn)
        told = known.sum() > 5 and np.ptp(apart[known]) > 0 and np.ptp(self.turn[known]) > 0
        return float(np.corrcoef(apart[known], self.turn[known])[0, 1]) if told else 0.0


def _half(angle: Floats) -> Floats:
    """From −π to π."""
    return np.asarray((angle + math.pi) % math.tau - math.pi)


def _place(way: _Way) -> None:
    """The unit of the place, by how fast and how far it goes."""
    guess, units = way.found["x_cm"], UNITS["x_cm"]
    if guess.unit not in units:
        time = np.maximum(way.t[way.end] - way.t[way.begin], 1e-9)
        speed = float(np.median(way.gone / time)) if len(time) else 0.0
        could = [unit for unit, to in units.items()
                 if SLOW <= speed * to <= FAST and SMALL <= way.extent * to <= LARGE]  # fmt: skip
        guess.unit = could[0] if len(could) == 1 else ASKED
        guess.why += f"; {speed:.2g} a second over {way.extent:.3g}: {' or '.join(could) or 'no robot does'}"
        way.gone = way.gone * units.get(guess.unit, 1.0)
    way.found["y_cm"].unit, way.measured = guess.unit, guess.unit != ASKED


def _heading(way: _Way, guess: Guess) -> None:
    """The heading's unit and sign: those with which it goes, or backs, where it faces."""
    units, tried = [guess.unit] if guess.unit in UNITS["heading_deg"] else ["rad", "deg"], []
    for unit, sign in ((unit, sign) for unit in units for sign in (1, -1)):
        heading = converted("heading_deg", way.log.values[:, guess.columns], unit, sign)
        turn = _half(heading[way.end] - heading[way.begin])
        apart, weight = way.to - heading[way.begin] - turn / 2, way.gone * np.exp(-((turn / 0.2) ** 2))
        known = np.isfinite(apart)
        mean = (weight * np.exp(2j * apart))[known].sum() / max(weight[known].sum(), 1e-12)
        zero = math.degrees(math.remainder(float(np.angle(mean)) / 2, math.pi))
        tried.append((float(abs(mean)), sign, unit, zero, turn, np.where(np.cos(apart) < 0, -1, 1)))
    share, sign, unit, zero, turn, backs = max(tried, key=lambda one: one[0] + CLEAR * (one[1] > 0))
    other = next(one[0] for one in tried if one[1:3] == (-sign, unit))
    guess.why += f"; the path agrees by {share:.2f}, reversed by {other:.2f}"
    if share < SURE:
        guess.unit, guess.why = ASKED if units[1:] else unit, f"{guess.why}: check it"
        return
    guess.unit, guess.sign = unit, sign
    if abs(zero) > SQUARE_DEG:
        guess.why += f", if turned by {zero:.0f}°"
    else:
        way.faced, way.turn, way.gone = True, turn, way.gone * backs


def _wheels(way: _Way, kind: str) -> None:
    """Counters or speeds of both wheels: of each row or cumulative, signs, exchanged or not, units."""
    left, right = pair = [way.found[f"{kind}_{side}"] for side in SIDES]
    gone = _counted(way, pair) if kind == "counter" else np.stack([*map(way.integral, pair)], 1)
    if len(gone) > FEW:
        ahead = np.linalg.lstsq(gone, way.gone, rcond=None)[0]
        told = way.faced and np.abs(ahead).min() > 0.2 * np.abs(ahead).max()
        signs = np.where((ahead if told else gone.sum(axis=0)) < 0, -1, 1)
        why = f"; reversed, so that it {'drives where it faces' if told else 'mostly drives forwards'}"
        for guess, sign in zip(pair, signs.tolist(), strict=True):
            guess.sign, guess.why = sign, guess.why + why * (sign < 0)
        if (alike := way.turning(gone @ (signs * [-1, 1]))) < -0.5:
            left.columns, right.columns = right.columns, left.columns
            left.sign, right.sign = right.sign, left.sign
            for guess in pair:
                guess.why = f"exchanged, or it would turn the other way ({alike:.2f}); {guess.why}"
    if kind == "speed":
        _unit_of_rates(way, pair, gone @ [guess.sign / 2 for guess in pair])


def _counted(way: _Way, pair: Sequence[Guess]) -> Floats:
    """[m, 2] pulses of two counters that count each row anew or not, by the way that they explain; else by
    how far they go from row to row."""
    totals = [
        [
            filled(cumulative(guess.values(way.log), way.run, per_row=each)[0], way.t, way.run)
            for guess in pair
        ]
        for each in (False, True)
    ]
    gone = [np.stack([*map(way.over, some)], 1) for some in totals]
    left = [way.gone - one @ np.linalg.lstsq(one, way.gone, rcond=None)[0] for one in gone]
    shares = [1 - float(one @ one) / max(float(way.gone @ way.gone), 1e-12) for one in left]
    per_row, why = shares[1] > shares[0], f"explains {max(shares):.2f} of the path, else {min(shares):.2f}"
    if len(way.gone) <= FEW:
        step = min(float(np.abs(np.diff(one)).mean() / max(np.ptp(one), 1)) for one in totals[0])
        per_row, why = step > EACH, f"{step:.1%} of its range a row"
    for guess in pair:
        guess.unit, guess.per_row = "pulses", per_row
        guess.why += f"; {'of each row' if per_row else 'cumulative'}: {why}"
    return gone[per_row]


def _unit_of_rates(way: _Way, some: Sequence[Guess], gone: Floats) -> None:
    """The unit of speeds, of turning or ahead, by how the way went while their integral was `gone` [m]."""
    units, turning = UNITS[some[0].name], some[0].name.endswith("w")
    went = way.turn if turning else way.gone if way.measured else np.zeros(len(gone))
    known = np.isfinite(went)
    if some[0].unit not in units and went[known].any() and gone[known].any():
        factor = float(np.abs(went[known]).sum() / np.abs(gone[known]).sum())
        could = [one for one, to in units.items() if one != "own" and abs(math.log(factor / to)) < NEARLY]
        for guess in some:
            guess.unit = "".join(could)
            guess.why += f"; {factor:.3g} {'rad' if turning else 'cm'} of the path per unit"


# What is made of it


def _told(log: Log, found: dict[str, Guess], run: NDArray[np.int64]) -> Look:
    sensors = [name for name in found if SENSOR.fullmatch(name)]
    near, asked = "distance_cm" in found and bool(sensors or "reading" in found), dict[str, str]()
    moves = found.keys() & {"counter_left", "speed_left", "v", "command_left", "command_v"}
    path = {"t_s", "x_cm", "y_cm", "heading_deg"} <= found.keys()
    kind = "infrared" if near else "wheels" if moves and "t_s" in found else "track" if path else ASKED
    if kind == ASKED:
        asked["kind"] = "wheels, infrared, ambient or track; name its columns below"
    if near:
        asked["object"] = 'what they saw: "wall" or "cylinder:RADIUS_CM" (or "lamp": kind = "ambient")'
    if near and "bearing_deg" not in found:
        asked["bearing_deg"] = "of it, counter-clockwise from the front: a number, or one for each sensor"
    if kind == "wheels" and "x_cm" not in found and "counter_left" in found:
        asked["pulses_per_mm"] = "of the counters, since no poses measure them"
    if kind == "wheels" and ("command_v" in found or ("v" in found and "counter_left" not in found)):
        asked["track_cm"] = "between the wheels, with which the robot makes v and w from their speeds"
    wanted = [*NEAR, *sensors] if near else [name for name in UNITS if name not in NEAR]
    guesses = [found[name] for name in wanted if name in found]
    for guess in guesses:
        units = [*UNITS.get(guess.name, [""])]
        if guess.unit not in units:
            guess.unit = ASKED if units[1:] else units[0]
        if guess.unit == ASKED and guess.name != "y_cm":
            asked[f"{guess.name}.unit"] = f"one of {', '.join(units)}"
    columns = {guess.name: guess.values(log) for guess in guesses}
    told = tuple(findings(columns, run, [f"line {k}" for k in log.lines]))
    return Look(log=log, guesses=guesses, kind=kind, asked=asked, columns=columns, run=run, findings=told)


def findings(columns: Mapping[str, Floats], run: NDArray[np.int64], lines: Sequence[str]) -> Iterator[str]:
    """Rate, gaps, and poses that repeat or jump, in words."""
    t = columns.get("t_s", np.zeros(len(run)))
    step = np.diff(t)[np.diff(run) == 0]
    step = step[np.isfinite(step)]
    if not (step > 0).any():
        return
    usual, (low, high) = np.median(step[step > 0]), np.quantile(step, (0.05, 0.95))
    again = f", {n} not after the row before" if (n := int((step <= 0).sum())) else ""
    yield f"rows {usual:.3g} s apart (90 %: {low:.3g} to {high:.3g} s, longest {step.max():.3g} s){again}"
    found = [(gaps(t, run), "gap", "")]
    if {"x_cm", "y_cm"} <= columns.keys():
        place = np.stack([columns["x_cm"], columns["y_cm"]], 1)
        counted = [columns[f"counter_{side}"] for side in SIDES if f"counter_{side}" in columns]
        moved = np.append(False, (np.diff(counted) != 0).any(axis=0)) if counted else np.full(len(t), True)
        cut, alone = jumps(t, place, run)
        how = " though the wheels turned" if counted else ""
        found += [
            (repeats(place, moved), "pose", f" of {len(t)} repeated{how}: not measured anew"),
            (cut | alone, "jump", f" out of reach ({alone.sum()} of one row)"),
        ]
    for rows, noun, what in found:
        if rows.any():
            yield f"{many(rows.sum(), noun)}{what}, first in {lines[int(rows.argmax())]}"
