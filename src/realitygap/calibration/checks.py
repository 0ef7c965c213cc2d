"""Checks of sensor recordings: dead sensors, swapped columns, mirrored bearings.

A profile must never be silently wrong: problems of one sensor are warnings, problems of the whole table are
errors.
"""

import math
from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from realitygap.calibration.recordings import Recording, SensorRecording, count_unit
from realitygap.errors import CalibrationError
from realitygap.values import Floats
from realitygap.world.robot import Profile
from realitygap.world.sensors import Sensor

__all__ = [
    "dead_sensors", "recorded", "refuse_few", "refuse_mixed", "refuse_nonsense", "refuse_other_kind",
    "refuse_silent", "refuse_swapped", "refuse_twice", "refuse_units",
]  # fmt: skip

DARKEST = 10.0
"""Ambient readings stay above this however bright the light (counts of the paper's robot): sensors end at
about 50."""
STILL = 30.0
"""A sensor whose readings span less than this (counts of the paper's robot) counts as dead."""
SATURATED_SHARE = 0.8
ASIDE_DEG = 60.0
MOST_ODD = 3
NEIGHBOURS_DEG, LIKELY_DEG, LIKELY_SHARE, SURE_DEG, SURE_SHARE = 100.0, 5.0, 0.4, 8.0, 0.6
"""Largest angle between the directions of two sensors at which their answers tell which way round they are;
then the angle, and the share of it, by which it is the wrong way where an exchange is likely, and certain."""
BLIND_CM, DAZZLED_CM, BRIGHT = 15.0, 1.0, 300.0
"""Beyond the first distance a Khepera's infrared sees nothing; within the second any object reads at least
`BRIGHT` (counts of the paper's robot)."""
FEWEST_LIT, FEWEST = 40, 3
EXPLAINED = 0.5


def dead_sensors(recording: SensorRecording, top: float) -> dict[int, str]:
    """Sensors of a recording that give no information, and why; `top` is the converter's highest count."""
    dead = {}
    looks = "it looks dead" if _all_round(recording) else "it looks dead, or away from the object"
    for k in recorded(recording):
        values = recording.counts[np.isfinite(recording.counts[:, k]), k]
        low, high = np.percentile(values, [0.2, 99.8])
        if np.ptp(values) == 0:
            dead[k] = f"sensor {k} reads {values[0]:.4g} everywhere: {looks}"
        elif recording.kind == "infrared" and (values >= top).mean() > SATURATED_SHARE:
            dead[k] = f"sensor {k} is saturated in {(values >= top).mean():.0%} of its readings"
        elif high - low < STILL * count_unit(top):
            dead[k] = f"sensor {k} hardly changes ({values.min():.4g} to {values.max():.4g}): {looks}"
    return dead


def refuse_silent(
    recordings: Sequence[SensorRecording], dead: Sequence[dict[int, str]], top: float
) -> dict[int, str]:
    """Sensors that are `dead` in every one of the recordings of one kind that has them, and why; `top` is the
    converter's highest count.

    Raises:
        CalibrationError: most sensors are dead, or few readings lie between dark and saturated.
    """
    where = ", ".join(recording.source for recording in recordings)
    there = [set(recorded(recording)) for recording in recordings]
    lives = {k for has, gone in zip(there, dead, strict=True) for k in has - gone.keys()}
    silent = {k: why for gone in dead for k, why in gone.items() if k not in lives}
    if len(silent) > len(set().union(*there)) // 2:
        raise CalibrationError(
            f"{where}: most sensors tell nothing: {'; '.join(silent.values())}. Record again; "
            "of an object on one side, give the recordings of all sides at once."
        )
    middle = 0
    for recording, has, gone in zip(recordings, there, dead, strict=True):
        lit = _signal(recording, top)[:, sorted(has - gone.keys())]
        middle += int(((lit > 0.06) & (lit < 0.94)).sum())
    if middle < FEWEST_LIT:
        raise CalibrationError(
            f"{where}: only {middle} readings lie between dark and saturated, expected {FEWEST_LIT} or "
            "more. Are the distances right, and the object near enough? If so, record more places."
        )
    return silent


def refuse_swapped(recording: SensorRecording, profile: Profile, dead: dict[int, str]) -> tuple[str, ...]:
    """Warnings about sensors that respond to another side than they face.

    Raises:
        CalibrationError: several do: columns are swapped, or bearings run the other way round.
    """
    part = profile.channel(recording.kind)
    looks = np.array([sensor.direction_deg for sensor in part.sensors])
    answers, sure = _answers(recording, part.top)
    live = np.array([k not in dead for k in range(len(looks))]) & sure
    known = recording.pose is not None and recording.arena is not None  # walls reflect light
    odd = live & (not known) & (_apart(answers, looks) > ASIDE_DEG)
    mirrored = live & (_apart(-answers, looks) <= ASIDE_DEG)
    if odd.sum() >= MOST_ODD:
        which = ", ".join(f"{k} at {answers[k]:.0f}° (looks to {looks[k]:.0f}°)" for k in np.flatnonzero(odd))
        turned = "The bearings seem to run the other way round."
        cure = turned if mirrored[live].all() else "Are columns swapped?"
        raise CalibrationError(
            f"{recording.source}: sensors answer to another side than they look: {which}. {cure}"
        )
    expected = looks if known else _expected(part.sensors)  # a lamp is too far off for places to matter
    crossed = _refuse_exchanged(recording, answers, expected, live)
    return crossed + tuple(
        f"{recording.source}: sensor {k} answers most at {answers[k]:.0f}° but looks to {looks[k]:.0f}°"
        for k in np.flatnonzero(odd)
    )


def _expected(sensors: Sequence[Sensor]) -> Floats:
    """[S] bearing to which each sensor should respond, degrees: between its direction and its place's."""
    there = np.array([math.degrees(math.atan2(s.y_cm, s.x_cm)) for s in sensors])
    looks = np.array([s.direction_deg for s in sensors])
    return np.asarray(looks + _turn(there - looks) / 2)


def _refuse_exchanged(
    recording: SensorRecording, answers: Floats, expected: Floats, live: NDArray[np.bool_]
) -> tuple[str, ...]:
    """Warnings about two sensors that seem exchanged: each responds on the other's side.

    Raises:
        CalibrationError: two certainly are.
    """
    pairs, told = [], []
    for i, j in combinations(np.flatnonzero(live).tolist(), 2):
        pair, other = [i, j], [j, i]
        gap, seen = (float(_turn(of[i] - of[j])) for of in (expected, answers))
        own, crossed = (float(_apart(answers[pair], expected[of]).sum()) for of in (pair, other))
        wrong, least = seen * gap < 0 or abs(gap) > NEIGHBOURS_DEG, LIKELY_SHARE * abs(gap)
        if wrong and own - crossed > least and abs(seen) >= max(LIKELY_DEG, least):
            pairs.append((own - crossed, i, j, gap, seen))
    # Beside the exchanged pair others may look so, but explain less.
    for _, i, j, gap, seen in sorted(pairs, reverse=True):
        said = (
            f"{recording.source}: sensors {i} and {j} seem to be exchanged: they answer most at "
            f"{answers[i]:.0f}° and {answers[j]:.0f}°, where {expected[i]:.0f}° and {expected[j]:.0f}° are "
            f"expected. Exchange columns s{i} and s{j}, or these sensors in --base"
        )
        if abs(seen) > max(SURE_DEG, SURE_SHARE * abs(gap)):
            raise CalibrationError(f"{said}.")
        told.append(said)
    return tuple(told)


def refuse_units(recording: SensorRecording, top: float) -> None:
    """Refuse distances at which a Khepera's infrared cannot have been recorded.

    Raises:
        CalibrationError: readings are bright out of range, or dark next to the object.
    """
    if recording.kind != "infrared" or (recording.pose is not None and recording.from_sensor is None):
        return
    distance, brightest = recording.distance_cm, np.nan_to_num(recording.counts).max(axis=1)
    last, bright = float(distance.max()), BRIGHT * count_unit(top)
    far = brightest[distance > BLIND_CM]
    if len(far) and (seen := float(np.percentile(far, 90))) > bright:
        raise CalibrationError(
            f"{recording.source}: {seen:.0f} counts beyond {BLIND_CM:g} cm, where infrared sees nothing: the "
            f"distances, up to {last:g} cm, are too large. Are units mixed up?"
        )
    if last < DAZZLED_CM and np.percentile(brightest[distance == last], 90) < bright:
        raise CalibrationError(
            f"{recording.source}: hardly anything is seen at {last:g} cm, where an object dazzles: the "
            "distances are too small. Are units mixed up?"
        )


def refuse_few(recordings: Sequence[SensorRecording]) -> None:
    """Refuse series of one sensor facing a wall at so few distances that nothing tells how readings fall.

    Raises:
        CalibrationError: says how many there are.
    """
    if any(recording.from_sensor is None for recording in recordings):
        return
    many = len(np.unique(np.concatenate([recording.distance_cm for recording in recordings])))
    if many < FEWEST:
        named = ", ".join(recording.source for recording in recordings)
        raise CalibrationError(
            f"{named}: expected readings at {FEWEST} distances or more, got {many}: how they fall with the "
            "distance cannot be told. Record more."
        )


def refuse_other_kind(recording: SensorRecording, top: float) -> None:
    """Refuse ambient readings at the converter's ends, where only proximity readings lie.

    Raises:
        CalibrationError: says how many do.
    """
    ends = ((recording.counts >= top) | (recording.counts < DARKEST * count_unit(top))).mean()
    if recording.kind == "ambient" and ends > 0.5:
        raise CalibrationError(
            f"{recording.source}: {ends:.0%} of the readings lie at the ends 0 and {top:g}, as proximity's "
            'do, and no ambient light\'s. Is its kind "infrared"?'
        )


def refuse_nonsense(
    recordings: Sequence[SensorRecording], counts: Floats, model: Floats, dead: dict[int, str]
) -> None:
    """Refuse a fit that explains less than half of the readings' variation.

    Args:
        recordings: one after another, for the message.
        counts, model: [n, S] of all; NaN where a reading does not count.
        dead: sensors without information, and why.

    Raises:
        CalibrationError: names the share.
    """
    live = [k for k in range(counts.shape[1]) if k not in dead]
    errors = np.nan_to_num(counts - model)[:, live] ** 2
    off = errors.sum()
    spread = np.nansum((counts[:, live] - np.nanmean(counts[:, live], axis=0)) ** 2)
    if off > (1.0 - EXPLAINED) * spread:
        row, sensor = np.unravel_index(errors.argmax(), errors.shape)
        places = [one.at(k) for one in recordings for k in range(len(one.counts))]
        where = ", ".join(one.source for one in recordings)
        read, by_law = (float(table[row, live[sensor]]) for table in (counts, model))
        raise CalibrationError(
            f"{where}: the fitted law explains only {max(0.0, 1 - off / spread):.0%} of how the readings "
            "change: this is no recording of such an object, or its distances (cm from the body's edge) and "
            f"bearings (degrees) are not those of its rows. The furthest off is {places[row]}: "
            f"s{live[sensor]} is {read:.0f}, by the law {by_law:.0f}."
        )


def refuse_twice(recordings: Sequence[Recording]) -> None:
    """Refuse one recording given twice, under whatever names; the error says both."""
    by_hash: dict[str, str] = {}
    for recording in recordings:
        if recording.hash in by_hash:
            other = by_hash[recording.hash]
            raise CalibrationError(f"{recording.source}: the same recording as {other}. Give it once.")
        if recording.hash:
            by_hash[recording.hash] = recording.source


def refuse_mixed(recordings: Sequence[Recording]) -> None:
    """Refuse recordings of several robots, or one recording given twice.

    Raises:
        CalibrationError: names both.
    """
    refuse_twice(recordings)
    for key in ("unit", "port"):
        said = {str(r.facts[key]): r.source for r in recordings if key in r.facts}
        if len(said) > 1:
            (one, here), (two, there) = list(said.items())[:2]
            raise CalibrationError(
                f"recordings of several robots: {here} has {key} {one}, {there} has {key} {two}. Calibrate "
                f"each robot by itself, or correct {key} in recording.toml if it is the same."
            )


def recorded(recording: SensorRecording) -> list[int]:
    """Numbers of the sensors that a recording has readings of."""
    return [int(k) for k in np.flatnonzero(np.isfinite(recording.counts).any(axis=0))]


def _all_round(recording: SensorRecording) -> bool:
    turned = np.unique(np.round(recording.bearing_deg % 360.0, 3))
    return len(turned) >= 4 and float(np.diff(np.append(turned, turned[0] + 360.0)).max()) <= 100.0


def _signal(recording: SensorRecording, top: float) -> Floats:
    """[n, S] readings scaled to 0 (dark) to 1 (saturated)."""
    if recording.kind == "infrared":
        return np.nan_to_num(recording.counts) / top
    low, high = np.percentile(recording.counts, [0.5, 99.5])
    return np.asarray((high - recording.counts) / max(high - low, 1.0))


def _answers(recording: SensorRecording, top: float) -> tuple[Floats, NDArray[np.bool_]]:
    """[S] bearing to which each sensor responds, degrees, and whether it is certain."""
    bearing, signal = np.radians(recording.bearing_deg), np.clip(_signal(recording, top), 0.0, 1.0)
    signal = np.where(signal > 0.1, signal, 0.0)
    if not _all_round(recording):
        return np.zeros(recording.sensors), np.zeros(recording.sensors, bool)
    total = signal.T @ np.exp(1j * bearing)
    sure = np.abs(total) > 0.2 * np.maximum(signal.sum(axis=0), 1e-9)
    return np.degrees(np.angle(total)), np.asarray(sure)


def _turn(degrees: Floats) -> Floats:
    """Degrees, wrapped to the shorter way round."""
    return np.asarray((degrees + 180.0) % 360.0 - 180.0)


def _apart(a: Floats, b: Floats) -> Floats:
    return np.abs(_turn(a - b))
