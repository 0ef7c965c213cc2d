"""`realitygap camera`: the overhead camera."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from realitygap.cli import option
from realitygap.cli.kinds import PICTURE, FileToWrite, Finite
from realitygap.cli.output import Figure, table, tell, warn
from realitygap.work.progress import FILM_AFTER_S, ProgressLine

if TYPE_CHECKING:
    from realitygap.film.calibrate import Calibration

__all__ = ["camera"]


@click.group()
def camera() -> None:
    """Calibrate the overhead camera, and print markers for it.

    \b
    Example:
        realitygap camera calibrate --frames frames --poses poses.csv --out camera.json
    """


@camera.command()
@click.option("--frames", required=True, metavar="DIR", help="Folder of pictures with the robot in them.")
@click.option("--poses", required=True, metavar="FILE", help="CSV: frame, x_cm, y_cm, heading_deg.")
@click.option("--out", type=FileToWrite(".json"), required=True, help="Write the camera there (.json).")
@option.marker
@option.disk
@click.option(
    "--lens-height",
    type=Finite(low=0),
    metavar="CM",
    help="Height of the lens above the floor; needed to track markers of other heights.",
)
@option.as_json
def calibrate(
    frames: str,
    poses: str,
    out: Path,
    marker: str | None,
    disk: str | None,
    lens_height: float | None,
    json_output: bool,
) -> None:
    """Calibrate a camera with known poses.

    Put the robot, with its marker, at 12 or more places all over the floor, at many headings. Take a
    picture of each, and write down the pose. Prints the error of each pose.

    \b
    Example:
        realitygap camera calibrate --frames frames --poses poses.csv --out camera.json
    """
    from realitygap.film.calibrate import calibrate_camera, read_frames
    from realitygap.film.tag import load_marker

    worn, known = load_marker(marker, disk), read_frames(frames, poses)
    with ProgressLine(FILM_AFTER_S) as line:
        report = partial(line.frames, "calibrating")
        made = calibrate_camera(known, worn, lens_height_cm=lens_height, on_progress=report)
    made.camera.save(out)
    tell(json_output, {"camera": str(out), **made.to_dict()}, *_told(made), f"saved {out}")
    warn(made.warnings)


@camera.command(name="sheet")
@click.option("--out", type=PICTURE, required=True, help="Write the page there (.pdf, .svg or .png).")
@option.marker
@option.disk
def print_sheet(out: Path, marker: str | None, disk: str | None) -> None:
    """Write a page with a marker to print.

    Print it at 100 %, measure its ruler, cut the marker out along its rim and fix it on the robot, its line
    to the front.

    \b
    Example:
        realitygap camera sheet --marker aruco:4x4_50:7,size=40 --out marker.pdf
    """
    from realitygap.film.printed import save_sheet
    from realitygap.film.tag import load_marker

    save_sheet(out, load_marker(marker, disk))
    click.echo(f"saved {out}")


def _told(made: Calibration) -> tuple[str, str]:
    rows = []
    for r in made.residuals:
        numbers = (Figure(value, ".2f") for value in (r.x_mm, r.y_mm, r.distance_mm, r.heading_deg))
        rows.append((r.frame, *numbers, _remark(r.used, r.x_mm)))
    facts = made.to_dict()
    return table(("frame", "x mm", "y mm", "off mm", "heading deg", ""), rows), (
        f"\n{facts['used']} of {facts['frames']} frames used; "
        f"mean {facts['mean_mm']:.2f} mm and {facts['mean_heading_deg']:.2f}°, "
        f"worst {facts['worst_mm']:.2f} mm and {facts['worst_heading_deg']:.2f}°"
    )


def _remark(used: bool, x_mm: float | None) -> str:
    if x_mm is None:
        return "no marker seen"
    return "" if used else "left out: check this pose"
