"""Refusals of recordings that are none of such a robot: a profile must never be silently wrong.

Problems of one sensor are warnings, problems of the whole table are errors.
"""

from collections.abc import Sequence

import numpy as np

from realitygap.calibration.readings import ASIDE_DEG, Readings, all_round, signal
from realitygap.calibration.recordings import Recording, SensorRecording, count_unit
from realitygap.errors import CalibrationError
from realitygap.values import Floats
from realitygap.world.robot import Profile

__all__ = ["refuse_mixed", "refuse_nonsense", "refuse_slips", "refuse_swapped", "refuse_twice"]

DARKEST = 10.0
"""Ambient readings stay above this however bright the light (counts of the paper's robot): sensors end at
about 50."""
MOST_ODD = 3
"""Sensors that answer to another side than they face, from which on columns or bearings are wrong."""
BLIND_CM, DAZZLED_CM, BRIGHT = 15.0, 1.0, 300.0
"""Beyond the first distance a Khepera's infrared sees nothing; within the second any object reads at least
`BRIGHT` (counts of the paper's robot)."""
FEWEST, EXPLAINED = 3, 0.5


def refuse_slips(recordings: Sequence[SensorRecording], top: float) -> None:
    """Refuse recordings of one kind by what is soonest seen: another kind's counts, distances in another
    unit, too few distances.

    Raises:
        CalibrationError: says what is wrong, and where.
    """
    for recording in recordings:
        _refuse_other_kind(recording, top)
        _refuse_units(recording, top)
    if all(recording.from_sensor is not None for recording in recordings):
        many = len(np.unique(np.concatenate([recording.distance_cm for recording in recordings])))
        if many < FEWEST:
            named = ", ".join(recording.source for recording in recordings)
            raise CalibrationError(
                f"{named}: expected readings at {FEWEST} distances or more, got {many}: how they fall with "
                "the distance cannot be told. Record more."
            )


def _refuse_other_kind(recording: SensorRecording, top: float) -> None:
    ends = ((recording.counts >= top) | (recording.counts < DARKEST * count_unit(top))).mean()
    if recording.kind == "ambient" and ends > 0.5:
        raise CalibrationError(
            f"{recording.source}: {ends:.0%} of the readings lie at the ends 0 and {top:g}, as proximity's "
            'do, and no ambient light\'s. Is its kind "infrared"?'
        )


def _refuse_units(recording: SensorRecording, top: float) -> None:
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


def refuse_swapped(recording: SensorRecording, profile: Profile, dead: dict[int, str]) -> tuple[str, ...]:
    """Warnings about sensors that answer to another side than they face.

    Raises:
        CalibrationError: several do: columns are swapped, or bearings run the other way round.
    """
    walls = recording.pose is not None and recording.arena is not None  # they reflect light
    if walls or not all_round(recording):
        return ()
    part = profile.channel(recording.kind)
    looks = np.array([sensor.direction_deg for sensor in part.sensors])
    bearing, lit = np.radians(recording.bearing_deg), np.clip(signal(recording, part.top), 0.0, 1.0)
    lit = np.where(lit > 0.1, lit, 0.0)
    total = lit.T @ np.exp(1j * bearing)
    answers = np.degrees(np.angle(total))
    sure = np.abs(total) > 0.2 * np.maximum(lit.sum(axis=0), 1e-9)
    live = sure & np.array([k not in dead for k in range(len(looks))])
    odd = live & (_apart(answers, looks) > ASIDE_DEG)
    if odd.sum() >= MOST_ODD:
        which = ", ".join(f"{k} at {answers[k]:.0f}° (looks to {looks[k]:.0f}°)" for k in np.flatnonzero(odd))
        mirrored = (_apart(-answers, looks) <= ASIDE_DEG)[live].all()
        cure = "The bearings seem to run the other way round." if mirrored else "Are columns swapped?"
        raise CalibrationError(
            f"{recording.source}: sensors answer to another side than they look: {which}. {cure}"
        )
    return tuple(
        f"{recording.source}: sensor {k} answers most at {answers[k]:.0f}° but looks to {looks[k]:.0f}°"
        for k in np.flatnonzero(odd)
    )


def _apart(a: Floats, b: Floats) -> Floats:
    """Degrees between directions, the shorter way round."""
    return np.abs((a - b + 180.0) % 360.0 - 180.0)


def refuse_nonsense(data: Readings, model: Floats) -> None:
    """Refuse a fit, with the model's readings [n, S], that explains less than half of the variation.

    Raises:
        CalibrationError: names the share, and the reading that is furthest off.
    """
    live = [k for k in range(data.counts.shape[1]) if k not in data.dead]
    counts = data.live()[:, live]
    errors = np.nan_to_num(counts - model[:, live]) ** 2
    explained = 1.0 - errors.sum() / np.nansum((counts - np.nanmean(counts, axis=0)) ** 2)
    if explained >= EXPLAINED:
        return
    row, sensor = np.unravel_index(errors.argmax(), errors.shape)
    places = [one.at(k) for one in data.recordings for k in range(len(one.counts))]
    where = ", ".join(one.source for one in data.recordings)
    raise CalibrationError(
        f"{where}: the fitted law explains only {max(0.0, explained):.0%} of how the readings change: "
        "this is no recording of such an object, or its distances (cm from the body's edge) and bearings "
        f"(degrees) are not those of its rows. The furthest off is {places[row]}: s{live[sensor]} is "
        f"{counts[row, sensor]:.0f}, by the law {model[row, live[sensor]]:.0f}."
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
