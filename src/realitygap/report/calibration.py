"""The page of a calibration: one self-contained HTML file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from realitygap.calibration.judge import LIMITS
from realitygap.calibration.recordings import WheelRecording
from realitygap.report import calibration_figures as draw
from realitygap.report.page import Figures, OnProgress, Picture, Steps, Words, write_page

if TYPE_CHECKING:
    from realitygap.calibration.calibrate import Calibration, ChannelFit
    from realitygap.calibration.wheels import WheelFit

__all__ = ["REAL", "beside_real", "calibration_figures", "write_calibration_page"]

TITLES = {"infrared": "Infrared proximity", "ambient": "Ambient light"}
SHOWN = {
    "bearing": "measured dots over fitted curves, four distances from the nearest to the farthest at which "
    "the sensor answers, a kind of line for each recording",
    "distance": "measured dots over fitted curves, a colour for each recording",
    "poses": "modelled against measured, all over a room",
}
LEFT_OVER = "Residuals, over {}. A pattern is model error; speckle is noise."
NOISE = (
    "Left: noise against a normal distribution. Right: its deviation over the reading, in quarters of "
    "the data, and the 95 % interval of the whole."
)


class _Table(NamedTuple):
    title: str
    head: list[str]
    rows: list[list[str]]


@dataclass(kw_only=True)
class _Part:
    name: str
    title: str
    sentences: list[str] = field(default_factory=list)
    tables: list[_Table] = field(default_factory=list)
    cards: list[Picture] = field(default_factory=list)


def write_calibration_page(made: Calibration, target: Path, on_progress: OnProgress | None = None) -> Path:
    """Write the page of a calibration and return its path.

    Raises:
        OSError: it cannot be written.
    """
    figures = Figures()
    parts, profile = _parts(made, figures), made.profile
    facts = {"profile": profile, "where": profile.provenance, "warnings": made.warnings, "parts": parts}
    return write_page(target, "calibration.html.j2", figures, facts, Steps(on_progress, len(figures)))


def calibration_figures(made: Calibration) -> Figures:
    """All figures of a calibration's page by name, not yet drawn."""
    figures = Figures()
    _parts(made, figures)
    return figures


def _parts(made: Calibration, figures: Figures) -> list[_Part]:
    parts = [_sensors(fit, figures) for fit in made.channels]
    driven = [r for r in made.recordings if isinstance(r, WheelRecording)]
    if made.wheels is not None and driven:
        parts.append(_wheels(made.wheels, driven[0], figures))
    return parts


def _sensors(fit: ChannelFit, figures: Figures) -> _Part:
    limit = LIMITS[fit.kind]
    held_out = {m.sensor: m.lit_ratio for m in fit.judged}
    rows = [
        [
            str(m.sensor), f"{m.rmse:.1f}", f"{m.bias:+z.1f}".replace("-", "−"), f"{m.error:.1f}",
            f"{held_out[m.sensor]:.2f}" + (" ▲" if held_out[m.sensor] > limit else ""), f"{m.ratio:.2f}",
            f"{fit.span[m.sensor, 0]:.0f} to {fit.span[m.sensor, 1]:.0f}",
        ]
        for m in fit.sensors
    ]  # fmt: skip
    head = ["sensor", "RMSE", "bias", "model error", "over noise", "over all", "spans"]
    title = (
        f"Model minus measured, counts. ▲: model error over noise deviation above {limit:g}, where "
        f"model error exceeds noise: on places held out, where readings are neither dark nor saturated. "
        f"{beside_real(fit.kind)}Over all: on all readings, at the fitted places"
    )
    what, look = f"Sensors of {fit.source.split('/')[-1]}", draw.look_of(fit)
    over = "distance" if look == "distance" else "distance and bearing"
    told = {
        "curves": (draw.curves_figure, f"{what}: measured and fitted.", f"Readings: {SHOWN[look]}."),
        "maps": (draw.maps_figure, f"{what}: residuals.", LEFT_OVER.format(over)),
    }
    if fit.measured:
        told["noise"] = (draw.noise_figure, f"{what}: noise against a normal distribution.", NOISE)
    return _Part(
        name=fit.kind, title=TITLES[fit.kind], sentences=_read(fit),
        tables=[_forms(fit.by_form, fit.form, "counts", 1), _Table(title, head, rows)],
        cards=[
            figures.add(f"{fit.kind}-{name}", partial(figure, fit), Words(*words))
            for name, (figure, *words) in told.items()
        ],
    )  # fmt: skip


def _forms(rmse: Mapping[str, float], fitted: str, unit: str, places: int) -> _Table:
    rows = [[name, f"{value:.{places}f}", "fitted" if name == fitted else ""] for name, value in rmse.items()]
    return _Table("All forms side by side", ["form", f"RMSE, {unit}", ""], rows)


REAL = {"infrared": "3.4 to 3.7", "ambient": "3.9"}
"""Model error over noise of fits to a real Khepera's tables of a wall and a lamp, in either form
(`python benchmarks/real_khepera.py`); what simulated robots' errors are to be read beside."""


def beside_real(kind: str) -> str:
    """The same figure for a real robot's tables, since a twin is easier to model."""
    return f"On the tables of a real Khepera it is {REAL[kind]}. " if kind in REAL else ""


def _read(fit: ChannelFit) -> list[str]:
    out = [
        f"The form “{fit.form}” has an RMSE of {fit.rmse:.1f} counts, and of {fit.held_out[fit.form]:.1f} "
        f"on places held out of the fit."
    ]
    for e in fit.noise:
        shape = "heavier tails than normal" if e.heavy else "tails about normal"
        tied = "" if e.channel == "proximity_dark" else (
            ", and depends on the reading" if e.depends else ", about the same at every reading"
        )  # fmt: skip
        out.append(
            f"Noise, {e.channel.replace('_', ' ')}: {e.deviation:.2f} counts ({e.low:.2f} to "
            f"{e.high:.2f}), {shape}{tied}."
        )
    if fit.fit.alike:
        pairs = "; ".join(f"{a} and {b} (ρ = {r:+.2f})" for a, b, r in fit.fit.alike[:3])
        out.append(
            f"Hard to tell apart from these data: {pairs}"
            + ("; and others." if len(fit.fit.alike) > 3 else ".")
        )
    if isfinite(fit.misplaced):
        share = f"{fit.misplaced:.2f} of it and leave {fit.ratio_placed:.2f}"
        all_of_it = f"all of it: alone they would make {fit.misplaced:.2f}"
        out.append(
            f"Model error over noise on places held out is {fit.ratio:.2f}; places set by hand, if each is a "
            f"millimetre off, explain {share if fit.ratio_placed else all_of_it}."
        )
    turns = [c for c in fit.fit.constants if c.key.startswith("turn_")]
    if turns:
        said = ", ".join(f"{c.value:+.1f}° ({c.low:+.1f} to {c.high:+.1f})" for c in turns)
        out.append(f"The rig was turned by {said}; this was fitted, and is not part of the profile.")
    return out


def _wheels(fit: WheelFit, recording: WheelRecording, figures: Figures) -> _Part:
    part = _Part(name="wheels", title="Wheels")
    part.tables.append(_forms(fit.rmse, fit.form, "cm/s", 3))
    rows = [
        [c.key, *(text.replace("-", "−") for text in (f"{c.value:.5g}", f"{c.low:.5g} to {c.high:.5g}"))]
        for c in fit.constants
    ]
    part.tables.append(_Table("Constants", ["constant", "value", "95 % interval"], rows))
    if fit.friction is not None:
        part.sentences.append(
            f"From {fit.friction.starts} standing starts, the threshold of friction lies between "
            f"{fit.friction.low:.1f} and {fit.friction.high:.1f} cm/s²."
        )
    if fit.odometry is not None:
        part.sentences += [
            f"When commanded to drive straight, it drifts {fit.odometry.drift_deg_per_m:+.1f}° a metre.",
            f"Slip, which counters cannot see, is {fit.odometry.slip:.1%} of the way of a step.",
        ]
    told = Words(
        "Speed steps, measured and modelled.",
        "Steps of the left wheel: mean speed of each 100 ms by its counter, and the model's.",
    )
    part.cards.append(figures.add("wheels-steps", partial(draw.steps_figure, fit, recording), told))
    if fit.odometry is not None:
        further = "How much further each wheel went than its counter says, between two pictures."
        told = Words("Camera minus counters.", further)
        part.cards.append(figures.add("wheels-slip", partial(draw.slip_figure, fit), told))
    return part
