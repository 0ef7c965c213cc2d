"""`realitygap track`: where the robot was in each frame of a film."""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from realitygap.cli import option
from realitygap.cli.kinds import FileToWrite
from realitygap.cli.output import print_json, warn
from realitygap.errors import TrackError
from realitygap.work.progress import FILM_AFTER_S, ProgressLine

if TYPE_CHECKING:
    from realitygap.film.tracker import Tracked

__all__ = ["track"]


@click.command()
@click.argument("film", type=click.Path())
@click.option("--camera", required=True, metavar="FILE", help="Calibration of the camera (camera.json).")
@option.marker
@option.disk
@click.option("--out", type=FileToWrite(".csv"), required=True, help="Write the track there (.csv).")
@click.option("--tails", type=FileToWrite(".png"), help="Draw tails over the last frame there (.png).")
@option.as_json
def track(
    film: str,
    camera: str,
    marker: str | None,
    disk: str | None,
    out: Path,
    tails: Path | None,
    json_output: bool,
) -> None:
    """Track the robot in FILM.

    FILM is any film from above (MP4, MOV, MKV, AVI …) of a robot that wears a marker. The track is a table:
    t_s, x_cm, y_cm, heading_deg, quality (0 to 1). If the robot is not found in a
    frame, place and heading are empty and quality is 0.

    \b
    Example:
        realitygap track film.mp4 --camera camera.json --out track.csv --tails tails.png
    """
    from realitygap.film.camera import load_camera
    from realitygap.film.printed import draw_tails, save_tails
    from realitygap.film.tag import load_marker
    from realitygap.film.tracker import track_film

    model, worn = load_camera(camera), load_marker(marker, disk)
    begun = time.perf_counter()
    with ProgressLine(FILM_AFTER_S) as line:
        tracked = track_film(film, model, worn, partial(line.frames, "tracking"))
    seconds = time.perf_counter() - begun
    tracked.track.write_csv(out)
    if tails is not None:
        save_tails(tails, draw_tails(tracked.last_frame, tracked.track, model, worn))
    warnings = _doubts(tracked, str(out))
    if json_output:
        facts = {"film": film, "camera": camera, "trouble": tracked.trouble, "seconds": seconds}
        print_json({**facts, "lost": tracked.track.lost, **tracked.track.to_dict(), "warnings": warnings})
    else:
        _print(tracked, seconds)
        for made in (out, tails):
            if made is not None:
                click.echo(f"saved {made}")
    warn(warnings)


def _doubts(tracked: Tracked, source: str) -> tuple[str, ...]:
    """Whether the robot went where its disk says that it looks; nothing of a film that shows too little."""
    from realitygap.correspondence.trials import doubt_of_disk, resampled

    try:
        seen = resampled(tracked.track, source=source)
    except TrackError:
        return ()
    return doubt_of_disk(seen)


def _print(tracked: Tracked, seconds: float) -> None:
    rows = tracked.track
    assert rows.quality is not None
    good = rows.quality[rows.found].mean()
    click.echo(
        f"{len(rows)} frames, {rows.t[-1]:.2f} s of film; found in {len(rows) - rows.lost}, "
        f"mean quality {good:.2f}; {len(rows) / max(seconds, 1e-9):.0f} frames/s"
    )
    if rows.lost:
        gaps = rows.gaps()
        listed = ", ".join(f"{a:.2f} s" if a == b else f"{a:.2f} to {b:.2f} s" for a, b in gaps[:5])
        more = f" and {len(gaps) - 5} more stretches" if len(gaps) > 5 else ""
        click.echo(f"lost in {rows.lost} frames: {listed}{more}")
        if 2 * rows.lost > len(rows):
            from realitygap.track import COLUMNS

            columns = ", ".join(COLUMNS)
            click.echo(f"another program may track it better: `realitygap score` reads its CSV ({columns})")
    if tracked.trouble is not None:
        click.echo(f"warning: {tracked.trouble}; what could be read is kept.", err=True)
