"""`realitygap camera`, `score`, `classify` and `judge`: tracks, from a film to what they say."""

from __future__ import annotations

import json
import time
from contextlib import suppress
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from realitygap.cli import options
from realitygap.cli.console import as_json, shown, table, tell, warn
from realitygap.errors import RealityGapError, TrackError
from realitygap.work.progress import FILM_AFTER_S, ProgressLine

if TYPE_CHECKING:
    from collections.abc import Iterator

    from realitygap.correspondence.judging import Agreement, Pair
    from realitygap.correspondence.logs import Log, LogComparison
    from realitygap.correspondence.score import Comparison
    from realitygap.correspondence.setting import Setting
    from realitygap.correspondence.trials import Trial
    from realitygap.film.calibrate import Calibration
    from realitygap.film.tracker import Tracked
    from realitygap.tasks.task import Task

__all__ = ["camera", "classify", "judge", "score"]

TOLD_APART = 0.01
"""p below which two logs are told apart."""


@click.group()
def camera() -> None:
    """Calibrate an overhead camera, and track films.

    \b
    Example:
        realitygap camera calibrate --frames frames --poses poses.csv --out camera.json
    """


@camera.command()
@click.option("--frames", required=True, metavar="DIR", help="Folder of pictures with the robot in them.")
@click.option("--poses", required=True, metavar="FILE", help="CSV: frame, x_cm, y_cm, heading_deg.")
@click.option("--out", type=options.OutFile(".json"), required=True, help="Write the camera there (.json).")
@options.marker
@click.option(
    "--lens-height",
    type=click.FloatRange(0),
    metavar="CM",
    help="Height of the lens above the floor; needed to track markers of other heights.",
)
@options.as_json
def calibrate(
    frames: str,
    poses: str,
    out: Path,
    marker: str | None,
    lens_height: float | None,
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

    worn, known = load_marker(marker), read_frames(frames, poses)
    with ProgressLine(FILM_AFTER_S) as line:
        report = partial(line.frames, "calibrating")
        made = calibrate_camera(known, worn, lens_height_cm=lens_height, on_progress=report)
    made.camera.save(out)
    tell({"camera": str(out), **made.to_dict()}, *_calibration_lines(made), f"saved {out}")
    warn(made.warnings)


@camera.command(name="sheet")
@click.option(
    "--out",
    type=options.OutFile(".pdf", ".svg", ".png"),
    required=True,
    help="Write the page there (.pdf, .svg or .png).",
)
@options.marker
def print_sheet(out: Path, marker: str | None) -> None:
    """Write a page with a marker to print.

    Print it at 100 %, measure its ruler, cut the marker out along its rim and fix it on the robot, its line
    to the front.

    \b
    Example:
        realitygap camera sheet --marker aruco:4x4_50:7,size=40 --out marker.pdf
    """
    from realitygap.film.printed import save_sheet
    from realitygap.film.tag import load_marker

    save_sheet(out, load_marker(marker))
    click.echo(f"saved {out}")


def _calibration_lines(made: Calibration) -> tuple[str, str]:
    rows = []
    for r in made.residuals:
        numbers = (shown(value, ".2f") for value in (r.x_mm, r.y_mm, r.distance_mm, r.heading_deg))
        remark = "no marker seen" if r.x_mm is None else "" if r.used else "left out: check this pose"
        rows.append((r.frame, *numbers, remark))
    facts = made.to_dict()
    return table(("frame", "x mm", "y mm", "off mm", "heading deg", ""), rows), (
        f"\n{facts['used']} of {facts['frames']} frames used; "
        f"mean {facts['mean_mm']:.2f} mm and {facts['mean_heading_deg']:.2f}°, "
        f"worst {facts['worst_mm']:.2f} mm and {facts['worst_heading_deg']:.2f}°"
    )


@camera.command()
@click.argument("film", type=click.Path())
@click.option("--camera", required=True, metavar="FILE", help="Calibration of the camera (camera.json).")
@options.marker
@click.option("--out", type=options.OutFile(".csv"), required=True, help="Write the track there (.csv).")
@click.option("--tails", type=options.OutFile(".png"), help="Draw tails over the last frame there (.png).")
@options.as_json
def track(film: str, camera: str, marker: str | None, out: Path, tails: Path | None) -> None:
    """Track the robot in FILM.

    FILM is any film from above (MP4, MOV, MKV, AVI …) of a robot that wears a marker. The track is a table:
    t_s, x_cm, y_cm, heading_deg, quality (0 to 1). If the robot is not found in a
    frame, place and heading are empty and quality is 0.

    \b
    Example:
        realitygap camera track film.mp4 --camera camera.json --out track.csv --tails tails.png
    """
    from realitygap.film.camera import load_camera
    from realitygap.film.printed import draw_tails, save_tails
    from realitygap.film.tag import load_marker
    from realitygap.film.tracker import track_film

    model, worn = load_camera(camera), load_marker(marker)
    begun = time.perf_counter()
    with ProgressLine(FILM_AFTER_S) as line:
        tracked = track_film(film, model, worn, partial(line.frames, "tracking"))
    seconds = time.perf_counter() - begun
    tracked.track.write_csv(out)
    if tails is not None:
        save_tails(tails, draw_tails(tracked.last_frame, tracked.track, model, worn))
    warnings = _doubts(tracked, str(out))
    facts = {"film": film, "camera": camera, "trouble": tracked.trouble, "seconds": seconds}
    rows = {"lost": tracked.track.lost, **tracked.track.to_dict(), "warnings": warnings}
    saved = (f"saved {made}" for made in (out, tails) if made is not None)
    tell({**facts, **rows}, *_track_lines(tracked, seconds), *saved)
    if tracked.trouble is not None and not as_json():
        warn([f"{tracked.trouble}; what could be read is kept."])
    warn(warnings)


def _doubts(tracked: Tracked, source: str) -> tuple[str, ...]:
    """Whether the robot went where its disk says that it looks; nothing of a film that shows too little."""
    from realitygap.correspondence.trials import doubt_of_disk, resampled

    try:
        return doubt_of_disk(resampled(tracked.track, source=source))
    except TrackError:
        return ()


def _track_lines(tracked: Tracked, seconds: float) -> Iterator[str]:
    rows = tracked.track
    assert rows.quality is not None
    good = rows.quality[rows.found].mean()
    yield (
        f"{len(rows)} frames, {rows.t[-1]:.2f} s of film; found in {len(rows) - rows.lost}, "
        f"mean quality {good:.2f}; {len(rows) / max(seconds, 1e-9):.0f} frames/s"
    )
    if rows.lost:
        gaps = rows.gaps()
        listed = ", ".join(f"{a:.2f} s" if a == b else f"{a:.2f} to {b:.2f} s" for a, b in gaps[:5])
        more = f" and {len(gaps) - 5} more stretches" if len(gaps) > 5 else ""
        yield f"lost in {rows.lost} frames: {listed}{more}"
        if 2 * rows.lost > len(rows):
            from realitygap.track import COLUMNS

            columns = ", ".join(COLUMNS)
            yield f"another program may track it better: `realitygap score` reads its CSV ({columns})"


@click.command()
@click.argument("a", type=click.Path())
@click.argument("b", type=click.Path(), required=False)
@options.task
@click.option(
    "--ceiling", metavar="PATH", help="Tracks of a different behaviour; they set the zero of the scale."
)
@options.as_json
def score(a: str, b: str | None, task: str | None, ceiling: str | None) -> None:
    """Score how alike two sets of tracks, or of logs, are.

    A (say, simulated) and B (on the robot) are CSV files with columns t_s, x_cm, y_cm, heading_deg, where
    a column start separates several trials and a column unit several robots; or what `realitygap camera
    track` or `realitygap simulate --json` wrote; or folders of such files; or a MAP.toml of any other log
    (`realitygap look`). A folder made by `realitygap
    transfer` needs no B: its simulated trials are compared with those on the robot. 10 means as alike as the
    same robot twice, 0 a different behaviour; the output says what these ends were measured on.

    Logs need no poses: a CSV file with t_s and columns of both by one name (proximity_0, command_left, …), or
    the folder of a drive. They are compared by their readings and commands, the order in time included.

    \b
    Examples:
        realitygap score simulated.csv filmed/ --task avoidance
        realitygap score simulated/steps.csv real/steps.csv
        realitygap score out/reproduce/transfer/twin-1/obstacle-avoidance-observed-1
    """
    from realitygap.correspondence.logs import compare_logs
    from realitygap.correspondence.score import compare
    from realitygap.correspondence.setting import setting_of
    from realitygap.correspondence.trials import doubts_of, read_transfer, read_trials
    from realitygap.tasks.load import load_task

    whose = _task_of(Path(a)) if b is None and task is None else None
    sets, logs, why = (read_transfer(a), (), "") if b is None else _tracks_and_logs(a, b)
    placed = bool(why) and all(one.places for side in logs for one in side)
    found = compare_logs(*logs, poses=placed) if logs else None
    facts, lines = ({}, []) if found is None else ({"logs": asdict(found)}, [*_log_lines(found)])
    if why and found is None:
        has = (f"{logs[0].source}: {', '.join(logs[0].channels) or 'nothing but poses'}" for logs in logs)
        raise TrackError(
            f"{why}, and no columns of one name to compare instead ({'; '.join(has)}). Give both poses, or "
            "name alike what both read or do (proximity_0, command_left, …)."
        )
    if why:
        left = f"correspondence score left out: {why}"
        tell({"a": a, "b": b, **facts, "notes": [left]}, *lines, f"note: {left}")
        return
    others = read_trials(ceiling) if ceiling is not None else None
    every = [trial for trials in (*sets, others or []) for trial in trials]
    setting = setting_of(every, load_task(task)) if task else setting_of([] if whose else every, whose)
    made = compare(sets[0], sets[1], setting, ceiling=others)
    warnings = doubts_of(every)
    words = (*_comparison_lines(made), *[""] * bool(lines), *lines)
    tell({"a": a, "b": b, **made.to_dict(), **facts, "warnings": warnings}, *words)
    warn(warnings)


def _tracks_and_logs(a: str, b: str) -> tuple[list[list[Trial]], list[list[Log]], str]:
    """Both as tracks, both as logs where they can be read so, and why not all are tracks: they have no poses,
    or too few a second."""
    from realitygap.correspondence.logs import read_logs
    from realitygap.correspondence.trials import TooSlowError, read_trials

    sets, logs, lacking, slow = [], [], [], ""
    with suppress(TrackError):  # what reads them as tracks tells what is wrong
        logs = [read_logs(a), read_logs(b)]
    logs = logs if all(logs) else []
    for k, path in enumerate((a, b)):
        try:
            sets.append(read_trials(path))
        except TrackError as error:
            if logs and isinstance(error, TooSlowError):
                slow = slow or str(error)
            elif logs and not all(one.faces for one in logs[k]):
                lacking.append(path)
            else:
                raise
    why = f"no poses (x_cm, y_cm, heading_deg) in {' and '.join(lacking)}" if lacking else slow
    return sets, logs, why


def _log_lines(made: LogComparison) -> Iterator[str]:
    rows, ratio = [], 1.0
    for one in made.channels:
        pairs = (one.mean, one.deviation, one.step_noise, one.alike_s)
        rows.append([one.name, *(f"{a:.3g} / {b:.3g}" for a, b in pairs), f"{one.distance:.2f}"])
        if min(one.step_noise) > 0:
            ratio = max(ratio, max(one.step_noise) / min(one.step_noise))
    yield table(("A / B", "mean", "deviation", "change a step", "alike for s", "distance"), rows)
    more = f"; changes a step differ by up to {ratio:.3g} times" if ratio > 1 else ""
    tests = (("levels (means, deviations)", made.levels, ""), ("order in time", made.order, more))
    for name, test, more in tests:
        said = f"too short to test; needed are {test.needed_s:.0f} s of each without gaps"
        if test.p is not None:
            said = f"{'not ' * (test.p >= TOLD_APART)}told apart, p = {test.p:.3f}"
            said += f", by windows of {test.window_s:.3g} s"
        yield f"{name}: {said}{more}"
    for name, pace in zip("AB", made.pace, strict=True):
        steps = f"a step {pace.usual_s:.3g} s (longest {pace.longest_s:.3g}), {100 * pace.late:.1f} % late"
        yield f"{name}: {pace.rows} rows, {steps}, {pace.gaps} gaps"
    yield f"compared at steps of {made.step_s:.3g} s; distance is Wasserstein's, in deviations"
    yield from (f"note: {note}" for note in made.notes)


def _task_of(folder: Path) -> Task | None:
    """The task of a transfer in its study, whose arena it is; None for trials that left their study, and
    where the task is a program that nobody agreed to run."""
    from realitygap.files import read_toml
    from realitygap.study.load import load_study
    from realitygap.study.store import DATABASE
    from realitygap.work.archive import TRIAL, unpacked

    above = next((one for one in folder.resolve().parents if (one / DATABASE).is_file()), None)
    with suppress(RealityGapError):
        if above is not None:
            with unpacked(folder) as trials:
                facts = read_toml(next(trials.rglob(TRIAL), folder), TrackError, "Transfer again.")
            return load_study(above).task(facts["task"])
    return None


def _comparison_lines(made: Comparison) -> Iterator[str]:
    interval = "" if made.interval is None else f"   (95 %: {made.interval[0]:.1f} to {made.interval[1]:.1f})"
    yield f"correspondence score {made.score:.1f} of 10{interval}"
    yield f"  behaviour {made.behaviour:.1f}, layout {made.layout:.1f}"
    yield f"differences: {made.differences}"
    response = "" if made.responsiveness is None else f", responsiveness {2**made.responsiveness:.2f} ×"
    yield f"  B against A: noisiness {2**made.noisiness:.2f} ×{response}, looping {made.looping:+z.2f}"
    if made.matched:
        far = "fewer than half of the pairs diverged"
        when = (
            far if made.parting_s is None else f"half of the pairs have diverged after {made.parting_s:.1f} s"
        )
        yield f"paired by start: {when}; transferability {made.transferability:z.2f} (0 is perfect)"
    yield f"two-sample test (nearest neighbours): p = {made.p:.3f}"
    yield f"{made.trials[0]} and {made.trials[1]} trials; task: {made.setting}"
    yield f"10 is: {made.scale.floor_from}; 0 is: {made.scale.ceiling_from}"
    for note in made.notes:
        yield f"note: {note}"


@click.command()
@click.argument("tracks", type=click.Path())
@options.task
@options.as_json
def classify(tracks: str, task: str | None) -> None:
    """Name the behaviour in TRACKS.

    One name a trial: the paper's kinds (one way turner, two way turner, wall follower, one way looper;
    three point turner, straight looper, two way turner, bobber) or none of these. Of names with a
    confidence of 0.8 about four in five are right. TRACKS is a file or a folder, as for `realitygap score`.

    \b
    Example:
        realitygap classify track.csv --task light
    """
    from realitygap.correspondence.names import common_name, namer
    from realitygap.correspondence.setting import setting_of
    from realitygap.correspondence.trials import doubts_of, read_trials
    from realitygap.tasks.load import load_task

    trials = read_trials(tracks)
    setting = setting_of(trials, load_task(task) if task else None)
    warnings = doubts_of(trials)
    named = namer(setting, trials[0].radius_cm).name(trials, setting)
    common, entries = common_name(named), [name._asdict() for name in named]
    rows = [(n.start, n.name, f"{n.confidence:.2f}") for n in named]
    facts = {"task": setting.name, "name": common, "tracks": entries, "warnings": warnings}
    named_table = table(("start", "name", "confidence"), rows)
    tell(facts, named_table, f"\n{common} (task: {setting.name})")
    warn(warnings)


@click.group()
def judge() -> None:
    """Collect people's blind ratings of pairs of tracks.

    \b
    Example:
        realitygap judge page pairs/ --task avoidance --out judge.html --key key.json
        realitygap judge marks marks-anna.csv marks-ben.csv --key key.json
    """


@judge.command()
@click.argument("pairs", type=click.Path(exists=True, file_okay=False))
@options.task
@click.option("--out", type=options.OutFile(".html"), required=True, help="Write the page there.")
@click.option(
    "--key",
    type=options.OutFile(".json"),
    required=True,
    help="Write the key there: which pair is which. Keep it from the judges.",
)
def page(pairs: str, task: str | None, out: Path, key: Path) -> None:
    """Make a page of the pairs in a folder PAIRS.

    Each folder in PAIRS is a pair: it holds a (a.csv, or a folder a) and b. The page shows the two
    side by side without their names, on random sides. A judge rates each pair from 0 to 10 and saves
    the ratings as a file. Keep the key from the judges: it contains names and scores.

    \b
    Example:
        realitygap judge page pairs/ --out judge.html --key key.json
    """
    from realitygap.correspondence.judging import blind_pairs
    from realitygap.correspondence.trials import doubts_of
    from realitygap.files import atomic_write
    from realitygap.report.player import judge_page

    found, setting = _pairs(Path(pairs), task)
    data, rows = blind_pairs(found, setting)
    atomic_write(out, judge_page(data, setting.arena, found[0].a[0].radius_cm))
    atomic_write(key, json.dumps(rows, indent=1) + "\n")
    warn(doubts_of(trial for pair in found for trial in (*pair.a, *pair.b)))
    click.echo(f"{len(found)} pairs: open {out} in a browser; keep {key} from the judges")


@judge.command()
@click.argument("files", nargs=-1, required=True, type=click.Path(exists=True))
@click.option(
    "--key", required=True, type=click.Path(exists=True, dir_okay=False), help="The key file of the page."
)
@options.as_json
def marks(files: tuple[str, ...], key: str) -> None:
    """Compare ratings with the score.

    FILES are the CSV files that the page saved (columns pair, judge, mark), or folders of them.

    \b
    Example:
        realitygap judge marks marks/ --key key.json
    """
    from realitygap.correspondence.judging import agreement, read_marks

    made = agreement(read_marks(*files), _scores(Path(key)))
    tell(made._asdict(), *_agreement_lines(made))


def _pairs(folder: Path, task: str | None) -> tuple[list[Pair], Setting]:
    from realitygap.correspondence.judging import Pair
    from realitygap.correspondence.score import compare
    from realitygap.correspondence.setting import setting_of
    from realitygap.correspondence.trials import read_trials
    from realitygap.tasks.load import load_task

    read = []
    for place in sorted(p for p in folder.iterdir() if p.is_dir()):
        sides = [next((p for p in sorted(place.iterdir()) if p.stem == side), None) for side in "ab"]
        if sides[0] is None or sides[1] is None:
            raise TrackError(f"{place}: expected tracks a and b in this folder (a.csv or a folder a).")
        read.append((place.name, read_trials(sides[0]), read_trials(sides[1])))
    if not read:
        raise TrackError(f"{folder}: expected a folder for each pair in it, got none.")
    setting = setting_of([t for _, a, b in read for t in (*a, *b)], load_task(task) if task else None)
    made = [Pair(name=n, a=a, b=b, score=compare(a, b, setting, resamples=2).score) for n, a, b in read]
    return made, setting


def _scores(path: Path) -> dict[int, float]:
    try:
        rows: list[dict[str, Any]] = json.loads(path.read_text(encoding="utf-8"))
        scores = {int(row["pair"]): float(row["score"]) for row in rows}
        if not all(0 <= score <= 10 for score in scores.values()):
            raise ValueError
        return scores
    except (OSError, ValueError, TypeError, KeyError, OverflowError, RecursionError):
        raise TrackError(f"{path}: expected the key that `realitygap judge page` wrote.") from None


def _agreement_lines(made: Agreement) -> Iterator[str]:
    low, high = made.interval
    yield f"{made.judges} judges, {made.pairs} pairs"
    yield f"score and mean rating: r {made.r:.2f} (95 %: {low:.2f} to {high:.2f}), rho {made.rho:.2f}"
    yield f"ratings differ from the score by {made.difference:+.1f} on average"
    if made.between_judges is not None:
        yield f"a judge and the others' mean: r {made.between_judges:.2f}"
