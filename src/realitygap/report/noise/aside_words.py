"""What nobody had planned to ask, in plain words: the diagonal's parts, the calibration unit, ends, falls."""

from __future__ import annotations

from collections.abc import Sequence

from realitygap.experiments.noise.claims import Contrast
from realitygap.report.noise.facts import FAILED, SATURATED, Fall, NoiseFacts, Scope, Span
from realitygap.report.noise.figures import titled
from realitygap.report.noise.results import Misfit, real_misfits
from realitygap.report.noise.tables import Number, effect_spans

__all__ = [
    "CHANNELS", "effect_words", "ends_words", "falls_words", "home_words", "nearness_words", "shown",
    "split_words",
]  # fmt: skip

CHANNELS = {"infrared": "proximity", "ambient": "light"}


def shown(span: Span, *, signed: bool = False) -> str:
    """A figure with its interval, as the tables have it."""
    return str(Number(span=span, signed=signed))


def effect_words(contrast: Contrast) -> str:
    sign = f"delta {contrast.effect.delta:+.2f}".replace("-", "−")
    return sign if contrast.found != "open" else f"{sign}, open"


def split_words(scope: Scope, coarse: Sequence[float]) -> str:
    """What the diagonal's difference is made of, in both orders."""
    said = []
    for split in scope.split:
        if split.other in coarse:
            whole, *steps = (
                shown(effect_spans(step)[1], signed=True)
                for step in (split.diagonal, split.evolved_first, split.comparison_after,
                             split.evolved_after, split.comparison_first)
            )  # fmt: skip
            said.append(
                f"against {split.other:g}: {whole.partition(' ')[0]} = {steps[0]} by evolved level and "
                f"{steps[1]} by comparison level, or, the comparison level first, {steps[2]} and {steps[3]}"
            )
    if not said:
        return ""
    return f"The diagonal's difference of means can be split in two orders: {'; '.join(said)}."


def home_words(scope: Scope) -> str:
    """Claim (c) as it was stated: against the simulation that a controller was evolved in."""
    if not scope.home:
        return ""
    robot = scope.home[0]
    means = ", ".join(f"{c.means[1]:.1f} at {c.other:g} ({effect_words(c)})" for c in scope.home)
    return (
        "On the calibration unit alone, against the very simulation that a controller was evolved in (not "
        f"planned; the scale is wider): {robot.means[0]:.1f} at {robot.level:g}, {means}."
    )


def ends_words(facts: NoiseFacts) -> str:
    """Why means and ranks may disagree."""
    scores = facts.data.at(facts.data.robot)
    high, low = (100 * float(share.mean()) for share in (scores >= SATURATED, scores < FAILED))
    return (
        f"Means and ranks may disagree: of the scores in (b) {high:.0f} % are {SATURATED:g} or more, where "
        f"ranks are mostly chance, and {low:.0f} % are below {FAILED:g}, on which means hang."
    )


def falls_words(falls: Sequence[Fall]) -> str:
    """How fitness falls from the calibration unit to the others; nobody had planned to ask."""
    said = []
    for fall in falls:
        rho, task = f"rho {shown(fall.rho, signed=True)}", titled(fall.task).lower()
        way = "shrinks" if fall.rho.value < 0 else "grows"
        said.append(
            f"in {task} its fall {way} with evolved noise, {rho}" if fall.shown
            else f"in {task} no change of its fall with evolved noise is shown, {rho}"
        )  # fmt: skip
    if not said:
        return ""
    return (
        f"Not planned: fitness on the twin falls from the calibration unit to the others; {'; '.join(said)}."
    )


def nearness_words(calibration: Sequence[Misfit]) -> str:
    """How near the simulations come to the twin, beside how near they come to a robot."""
    said = []
    for real in real_misfits():
        ratios = sorted(m.ratio for m in calibration if m.channel == real.channel)
        if ratios:
            low, high = f"{ratios[0]:.2f}", f"{ratios[-1]:.2f}"
            ours = low if low == high else f"{low} to {high}"
            said.append(f"in {CHANNELS[real.channel]} {ours} (a real robot's tables: {real.ratio:.2f})")
    if not said:
        return ""
    return f"Model error over noise is {', '.join(said)}: the twin is easier to model than a robot."
