"""The column "differences": a judge's words, from signed numbers (tables 1 and 2)."""

import math
from collections.abc import Sequence

from realitygap.correspondence.descriptors import describe_all
from realitygap.correspondence.scale import EDGE
from realitygap.correspondence.trials import Trial
from realitygap.values import Floats

__all__ = ["ANOTHER", "differences", "noisiness", "signed"]

Told = dict[str, Floats]
"""Descriptors of a set's trials, by name (`describe_all`)."""

QUIET_DEG_S = 2.0
"""Invisible jitter; added to both sides, so that a robot without noise can be compared."""
CLOSE_CM, ASKEW_DEG = 0.5, 10.0
"""Invisible distance and angle; added likewise."""
NOISE_STEPS, RESPONSE_STEPS = (0.4, 1.0, 1.6), (0.06, 0.2, 0.5)
"""|log2 ratio| from which a difference is small, clear, large."""
LOOPS = 0.15
"""Difference in the share of time from which more or less looping is visible."""
ALIKE = ((9.7, "observably identical"), (8.8, "very similar"))
"""Scores from which no difference is mentioned."""
ANOTHER = "another behaviour"

_NOISE = {
    1: ("a little noisier", "noisier", "much noisier"),
    -1: ("slightly less noisy", "less noisy", "much less noisy"),
}
_RESPONSE = {
    1: ("a little more responsive", "more responsive", "much more responsive"),
    -1: ("a little less responsive", "less responsive", "much less responsive"),
}


def noisiness(a: Sequence[Trial], b: Sequence[Trial]) -> float:
    """log2 of the ratio of b's jitter in turning to a's."""
    return signed(describe_all(a, None), describe_all(b, None))[0]


def signed(a: Told, b: Told) -> tuple[float, float | None, float]:
    """Noisiness, responsiveness and looping of b relative to a, from both sets' descriptors.

    Responsiveness is the log2 ratio of how early b responds: the distance at which it turns from a surface
        ahead, or with a lamp how directly it faces the lamp; None without an arena. Looping is the difference
        in the share of time spent going round in loops.
    """
    response = None
    if "light bearing" in a:
        response = -_ratio(a, b, "light bearing", ASKEW_DEG)
    elif "turning clearance" in a:
        response = _ratio(a, b, "turning clearance", CLOSE_CM)
    loops = float(b["looping"].mean() - a["looping"].mean())
    return _ratio(a, b, "jitter", QUIET_DEG_S), response, loops


def differences(score: float, behaviour: float, noisy: float, responsive: float | None, loops: float) -> str:
    """Differences of b from a in the paper's words, the largest first.

    A behaviour beyond the scale's ceiling is another one, whatever else differs.

    Args:
        score, behaviour: 0 to 10.
        noisy, responsive, loops: signed, as above.
    """
    for least, phrase in ALIKE:
        if score >= least:
            return phrase
    found = [_word(noisy, _NOISE, NOISE_STEPS), _word(responsive, _RESPONSE, RESPONSE_STEPS)]
    if abs(loops) >= LOOPS:
        found.append((abs(loops) / LOOPS, "loops more" if loops > 0 else "loops less"))
    said = [phrase for _, phrase in sorted((f for f in found if f), key=lambda f: -f[0])]
    if behaviour <= EDGE:
        said.insert(0, ANOTHER)
    if said:
        return ", ".join(said)
    return "similar" if score >= 7 else "qualitatively similar" if score >= 4 else "different"


def _word(
    value: float | None, phrases: dict[int, tuple[str, str, str]], steps: tuple[float, float, float]
) -> tuple[float, str] | None:
    """Size of a difference relative to its first step, and its phrase; None if it is not noticeable."""
    if value is None or abs(value) < steps[0]:
        return None
    size = sum(abs(value) >= step for step in steps) - 1
    return abs(value) / steps[0], phrases[1 if value > 0 else -1][size]


def _ratio(a: Told, b: Told, name: str, unseen: float) -> float:
    ours, theirs = float(a[name].mean()), float(b[name].mean())
    return math.log2((max(theirs, 0.0) + unseen) / (max(ours, 0.0) + unseen))
