"""`realitygap calibrate`: from recordings of a robot to a profile, and a profile's judge."""

from __future__ import annotations

from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

import click

from realitygap.cli import options
from realitygap.cli.console import link, shown, table, tell, warn

if TYPE_CHECKING:
    from collections.abc import Iterator

    from realitygap.calibration.calibrate import Calibration, ChannelFit
    from realitygap.calibration.judge import Judgement
    from realitygap.work.pool import Workers

__all__ = ["calibrate"]

FORMS = ("paper", "individual", "extended", "measured", "lookup", "auto")


@click.command()
@click.argument("recordings", nargs=-1, required=True, metavar="RECORDING...", type=click.Path())
@click.option(
    "--form",
    type=click.Choice(FORMS),
    default="auto",
    help="Which constants are free; auto: extended or measured, whichever errs less on places held out.",
)
@click.option(
    "--object",
    "objects",
    multiple=True,
    metavar="O",
    help="What .sam tables show: wall, cylinder:RADIUS_CM or lamp; once for all tables, or once for each.",
)
@click.option(
    "--base",
    metavar="P",
    help="Profile that supplies what the recordings do not cover; the form paper uses the printed laws "
    "[default: what the recorded robot names, or paper].",
)
@click.option(
    "--out",
    type=options.OutFile(".toml"),
    help="The profile to write; its report, an HTML page, is saved beside it.",
)
@click.option("--no-report", is_flag=True, help="Write no report.")
@click.option("--check", metavar="P", help="Fit nothing: judge this profile by the recordings.")
@options.workers
@options.as_json
def calibrate(
    recordings: tuple[str, ...],
    form: str,
    objects: tuple[str, ...],
    base: str | None,
    out: Path | None,
    no_report: bool,
    check: str | None,
    workers: Workers,
) -> None:
    """Fit a robot's constants to recordings.

    Writes a profile for --profile. A RECORDING is a folder made by `realitygap record` (or a folder of
    several), a .sam table, a Thymio's series (sensor02_light.csv), or a MAP.toml of other logs (`realitygap
    look`). Forms: paper has the paper's laws with
    common constants and its printed gains; individual has constants for each sensor, linear light, and
    refitted gains; extended adds directions, distance offset, exponents, Lambertian surfaces and the lamp's
    height; measured has no law but rays, a lobe, a curve and noise for each sensor; lookup replays the
    recorded readings.

    \b
    Examples: a profile from two tables; judged on a third
        realitygap calibrate wall.sam light.sam --out robot.toml
        realitygap calibrate round.sam --object cylinder:2.7 --check robot.toml
    """
    if check is not None:
        _check(recordings, objects, check)
        return
    if out is None:
        raise click.UsageError("--out: missing: say where to write the profile, as in --out robot.toml.")
    from realitygap import api

    page = None if no_report else out.with_suffix(".html")
    made = api.calibrate(recordings, base, objects=objects, form=form, out=out, workers=workers)
    if page is not None:
        from realitygap.report.calibration import write_calibration_page

        write_calibration_page(made, page)
    facts = {"profile": str(out), "report": None if page is None else str(page), **_facts(made)}
    tell(facts, *_lines(made), f"profile {out}", *([] if page is None else [f"report {link(page)}"]))
    warn(made.warnings)


def _facts(made: Calibration) -> dict[str, object]:
    return {
        "channels": {
            fit.kind: {
                "form": fit.form,
                "rmse": fit.rmse,
                "rmse_by_form": fit.by_form,
                "held_out_rmse": fit.held_out[fit.form],
                "noise": {
                    e.channel: {
                        "deviation": e.deviation, "low": e.low, "high": e.high,
                        "depends_on_reading": e.depends, "by_reading": e.bins, "heavy_tails": e.heavy,
                    }
                    for e in fit.noise
                },
                "model_error_over_noise": {str(m.sensor): m.ratio for m in fit.sensors},
                "model_error_over_noise_lit_held_out": {str(m.sensor): m.lit_ratio for m in fit.judged},
                "noise_between": fit.between,
                "explained_by_places_1_mm_off": fit.misplaced,
                "model_error_over_noise_without_them": fit.ratio_placed,
                "cannot_tell_apart": [{"a": a, "b": b, "correlation": r} for a, b, r in fit.fit.alike],
            }
            for fit in made.channels
        },
        "wheels": {
            "form": made.wheels.form,
            "rmse": made.wheels.rmse,
            "held_out_speeds": {key: getattr(made.wheels.law, key) for key in ("constant", "curve", "chosen")}
            if made.wheels.law else None,
            "held_out_ends": made.wheels.odometry.held_out if made.wheels.odometry else None,
            "base_ends": made.wheels.odometry.by_base if made.wheels.odometry else None,
            "cannot_tell_apart": [{"a": a, "b": b, "correlation": r} for a, b, r in made.wheels.alike],
        } if made.wheels else None,
        "constants": [c.to_dict() for c in made.profile.provenance.constants],
        "warnings": list(made.warnings),
    }  # fmt: skip


def _lines(made: Calibration) -> Iterator[str]:
    from realitygap.calibration.calibrate import with_hints

    for fit in made.channels:
        forms = ", ".join(f"{name} {value:.1f}" for name, value in fit.by_form.items())
        yield f"{fit.kind}: RMSE by form, counts: {forms}"
        yield f"  {fit.form}: {fit.held_out[fit.form]:.1f} counts on places held out"
        for e in fit.noise:
            tail = ", heavier tails than normal" if e.heavy else ""
            by_reading = ", ".join(f"{size:.2f} at {reading:.0f}" for reading, size in e.bins)
            tail += f", depends on the reading: {by_reading}" if e.depends else ""
            tail += (
                f"; between recordings {fit.between:.2f}"
                if e is fit.noise[0] and isfinite(fit.between)
                else ""
            )
            yield f"  noise, {e.channel}: {e.deviation:.2f} counts ({e.low:.2f} to {e.high:.2f}){tail}"
        if not fit.noise and isfinite(fit.between):
            yield f"  noise: not measured; between recordings {fit.between:.2f} counts"
        ratios = ", ".join(f"{m.sensor} {shown(m.lit_ratio, '.2f')}" for m in fit.judged)
        share = fit.ratio * fit.deviation / made.profile.channel(fit.kind).top
        whole = f"{fit.ratio:.2f} ({ratios}), {share:.1%} of the full scale"
        whole = whole if isfinite(fit.ratio) else f"too little is lit to say ({ratios})"
        yield f"  model error over noise, held out, neither dark nor saturated: {whole}"
        yield from _misplaced(fit)
        yield from _alike(fit.fit.alike)
    if made.wheels:
        forms = ", ".join(f"{name} {value:.3f}" for name, value in made.wheels.rmse.items())
        yield f"wheels: RMSE by form, cm/s: {forms}" if forms else "wheels: odometry only, without commands"
        found = {c.key: f"{c.value:.3g} ({c.low:.3g} to {c.high:.3g})" for c in made.wheels.constants}
        track = found.get("track_cm", f"{made.profile.wheels.track_cm:.3g}")
        lag = f", lag {found['lag']} steps" if "lag" in found else ""
        if (law := made.wheels.law) is not None:
            speeds = f"{found['speed_left']} and {found['speed_right']}"
            yield f"  speed per unit {speeds} cm/s, track {track} cm{lag}"
        else:
            pulses = " and ".join(f"{value:.4g}" for value in made.wheels.pulses_per_mm)
            yield f"  {f'{pulses} pulses a mm, ' * bool(pulses)}track {track} cm"
        if law is not None and law.curves:
            yield (
                f"  by curves of command to speed ({law.told()}), which on runs held out err "
                f"{law.chosen:.2g} cm/s where a constant errs {law.constant:.2g}"
            )
        if (seen := made.wheels.odometry) is not None and isfinite(seen.held_out[0]):
            ends, base = (
                f"{place:.2g} cm and {angle:.2g}°" for place, angle in (seen.held_out, seen.by_base)
            )
            yield f"  runs held out end {ends} off (with the base profile's constants: {base})"
        if vague := [c.key for c in made.wheels.constants if not c.told]:
            yield f"  not identifiable from these recordings: {with_hints(vague)}"
        yield from _alike(made.wheels.alike)
    yield from made.surfaces


def _misplaced(found: ChannelFit | Judgement) -> Iterator[str]:
    """How much of a model error over noise a millimetre's error of each place explains, where set by hand."""
    if isfinite(found.ratio_placed):
        share = f"{found.misplaced:.2f} of it and leave {found.ratio_placed:.2f}"
        all_of_it = f"all of it: alone they would make {found.misplaced:.2f}"
        said = share if found.ratio_placed else all_of_it
        yield f"  places set by hand, if each is a millimetre off, explain {said}"


def _alike(alike: tuple[tuple[str, str, float], ...]) -> Iterator[str]:
    """Pairs of constants that the data hardly tell apart, the first four."""
    if alike:
        pairs = "; ".join(f"{a} and {b} (ρ = {r:.2f})" for a, b, r in alike[:4])
        more = f"; {len(alike) - 4} more" if len(alike) > 4 else ""
        yield f"  hard to tell apart: {pairs}{more}"


def _check(recordings: tuple[str, ...], objects: tuple[str, ...], name: str) -> None:
    """Judge a profile by recordings."""
    from realitygap.api import load_recordings
    from realitygap.calibration.calibrate import refuse_twice
    from realitygap.calibration.judge import judge_all
    from realitygap.world.robot import load_profile

    profile, read = load_profile(name), load_recordings(recordings, objects)
    refuse_twice(read)
    found = judge_all(read, profile)
    warnings = list(dict.fromkeys(warning for one in found for warning in one.warnings))
    every = [one.to_dict() for one in found]
    facts = {**every[0], "profile": profile.name, "warnings": warnings, "recordings": every}
    tell(facts, *(line for one in found for line in _judgement(one)))
    warn(warnings)


def _judgement(one: Judgement) -> Iterator[str]:
    what, unit, used = ("wheel", "cm/s", 3) if one.kind == "wheels" else ("sensor", "counts", 5)
    off = f"RMSE {one.rmse:.3g} {unit}, bias {one.bias:+.3g} (model minus measured)"
    yield f"{one.source}: {one.kind}, {off if isfinite(one.rmse) else 'without commands'}"
    if one.ends is not None:
        yield f"  runs end {one.ends[0]:.2g} cm and {one.ends[1]:.2g}° off by its track and pulses"
    for what_differs in one.fitted_out:
        yield f"  {what_differs}: fitted out"
    head = [what, "rmse", "bias", "error/noise where lit", "over all"]
    keys = (("rmse", 3), ("bias", 3), ("lit_ratio", 2), ("ratio", 2))[: used - 1]
    rows = [[m.sensor, *(shown(round(getattr(m, k), n), "") for k, n in keys)] for m in one.per_sensor]
    if isfinite(one.rmse):
        yield table(head[:used], rows)
    if isfinite(one.ratio):
        within = f"{one.within:.0%} of places err by two deviations at most"
        yield f"  model error over noise, neither dark nor saturated: {one.ratio:.2f}; {within}"
        yield from _misplaced(one)
    elif one.kind != "wheels":
        yield "  model error over noise, neither dark nor saturated: too little is lit to say"
    if isfinite(one.covered):
        between = f" and between recordings ({one.between:.3g} counts)" if one.between else ""
        yield f"  {one.covered:.0%} of the readings lie within 95 % of the profile's noise{between}"
    for channel, (measured, stated) in one.noise.items():
        yield f"  noise, {channel}: measured {measured:.3g}, profile {stated:.3g}"
    if one.noise_fits is not None:
        yield f"  the profile's noise {'fits' if one.noise_fits else 'does not fit'}"
