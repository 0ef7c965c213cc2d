"""A trial as a log for Rerun or Foxglove."""

import io
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from realitygap.control.genotype import Genotype
from realitygap.errors import StudyError
from realitygap.files import as_path, atomic_path, must_be
from realitygap.film.video import FilmReader
from realitygap.lazy import needed
from realitygap.report.drawing import front, rays_of
from realitygap.report.network import network_drawing
from realitygap.report.player import activity, decided
from realitygap.robots.drive import Recording
from realitygap.study.load import Run
from realitygap.tasks.task import Task
from realitygap.track import Track, Trajectory, read_track
from realitygap.transfer.record import (
    TransferredTrial,
    load_transfers,
    read_trial,
)
from realitygap.transfer.replay import Replays
from realitygap.values import Floats
from realitygap.work.archive import SIMULATED, SITUATED, unpacked
from realitygap.world.arena import Arena
from realitygap.world.robot import Profile

__all__ = ["Side", "TrialLog", "trial_log", "write_log"]


class Side(NamedTuple):
    """One of the two robots.

    Attributes:
        name: "simulated" or "situated".
        track: [n + 1] poses; NaN where it was lost.
        inside: what is known of each step, [n, k] by name: proximity, ambient (counts), inputs, commands
            (−10 to 10), and outputs of the network's neurons, in the order of the drawing's.
        rays: [n + 1, rays, 2 ends, 2] cm; NaN where it was lost.
    """

    name: str
    track: Track
    inside: Mapping[str, NDArray[Any]]
    rays: Floats


class TrialLog(NamedTuple):
    """A trial: where, who, both robots, and the film of the situated one (None: none was kept).

    Attributes:
        trial: what its file says.
        task: with the arena.
        outlines: [2] lines [points, 2] in cm in the robot's own frame: its body, and a line ahead.
        network: the drawing that the page's player has, None where it is not known who drove.
        sides: simulated, situated.
        film: its file; lead_s: how long before the trial it begins.
    """

    trial: TransferredTrial
    task: Task
    outlines: tuple[Floats, Floats]
    network: Mapping[str, Any] | None
    sides: tuple[Side, Side]
    film: Path | None
    lead_s: float

    @property
    def name(self) -> str:
        """For its file and for people."""
        return f"{self.trial.name.replace('/', '-')}-{self.trial.robot}-start-{self.trial.start}"


def trial_log(
    run: Run, individual: str = "champion", robot: str | None = None, start: int | None = None
) -> TrialLog:
    """A trial of a run on a robot, simulated again beside it; the first that fits.

    What is not known is left out: see `transfer/replay.py`.

    Args:
        run: whose.
        individual: "champion" or "fittest".
        robot: the trial's folder, such as "twin-1"; any if None.
        start: its number; any if None.

    Raises:
        StudyError: there is no such trial; names those that there are.
    """
    must_be(run, Run, "run", "study.run(1) is one.")
    there = [one for one in load_transfers(run.study.folder) if one.run == run.id]
    wanted = {"individual": individual, "robot": robot, "start": start}
    asked = {key: value for key, value in wanted.items() if value is not None}
    fits = [one for one in there if all(getattr(one, key) == value for key, value in asked.items())]
    if not fits:
        known = [f"{one.individual} on {one.robot} from start {one.start}" for one in there]
        got = ", ".join(f"{key} {value}" for key, value in asked.items())
        told = (
            f"expected a trial of run {run.id} on a robot, got {got}; there are: {', '.join(known) or 'none'}"
        )
        raise StudyError(f"{run.study.folder}: {told}. Make one with `realitygap transfer`.")
    trial, task, profile = fits[0], run.study.task(run.task), run.study.profile
    replay = Replays(run.study).of(trial.folder)
    drove = replay.genotype
    drawing, slots = (None, []) if drove is None else network_drawing(drove, task, profile)
    with unpacked(trial.folder) as here:
        paths = [read_track(here / name) for name in (SIMULATED, SITUATED)]
    if replay.simulated is not None:
        paths[0] = replay.simulated.track
    sides = [
        _side(name, path, kept, (drove, slots), (task, profile))
        for name, path, kept in zip(("simulated", "situated"), paths, replay[1:], strict=True)
    ]
    return TrialLog(
        trial=trial, task=task, outlines=_outlines(profile), network=drawing, sides=(sides[0], sides[1]),
        film=trial.folder / "film.mp4" if trial.filmed else None,
        lead_s=float(read_trial(trial.folder).get("film_lead_s", 0.0)),
    )  # fmt: skip


def _side(
    name: str,
    track: Track,
    kept: Trajectory | Recording | None,
    drove: tuple[Genotype | None, list[int]],
    where: tuple[Task, Profile],
) -> Side:
    """One robot on its path, with what was `kept` of it; `drove` is the genotype and its neurons' slots."""
    task, profile = where
    robot, arena, steps = profile.to_kernel(), task.arena.to_kernel(), len(track) - 1
    rays = np.stack([
        rays_of(robot, arena, task.feeds, pose) for pose in zip(track.x, track.y, track.heading, strict=True)
    ])  # fmt: skip
    rays[~track.found] = np.nan
    inside: dict[str, NDArray[Any]] = {}
    if kept is not None:
        inside = {key: getattr(kept, key) for key in ("proximity", "ambient", "inputs")}
        inside["commands"] = decided(kept, profile)
        outputs = None if drove[0] is None else activity(drove[0], kept.inputs, inside["commands"], drove[1])
        inside |= {} if outputs is None else {"outputs": outputs}
    return Side(name, track, {k: v for k, v in inside.items() if v.shape[0] == steps and v.shape[1]}, rays)


def _outlines(profile: Profile) -> tuple[Floats, Floats]:
    robot = profile.to_kernel()
    turn = np.linspace(0.0, 2.0 * np.pi, 33)
    circle = robot.radius * np.stack([np.cos(turn), np.sin(turn)], 1)
    corners = robot.outline[:, :2]
    body = np.concatenate([corners, corners[:1]]) if len(corners) else circle
    return body, np.array([[0.0, 0.0], [front(robot), 0.0]])


FORMATS = {"rerun": ".rrd", "mcap": ".mcap"}
"""Formats of a log, and their file endings."""
COLOURS = {"simulated": (0, 114, 178, 255), "situated": (90, 90, 90, 255)}
RAY, WALL, LAMP = (183, 121, 31, 90), (90, 80, 70, 255), (230, 159, 0, 255)
TIMELINE = "trial"
WIDE = 60
"""A network's cm on Rerun's canvas."""
JPEG_QUALITY = 80


def write_log(one: TrialLog, kind: str, folder: str | Path) -> Path:
    """Write a trial's log into a folder, which is made if needed; return the file.

    Args:
        one: the trial.
        kind: one of FORMATS.
        folder: where to; a file of the same name is replaced.

    Raises:
        UsageError: its library is not installed.
        OSError: it cannot be written.
    """
    library = needed("rerun" if kind == "rerun" else "mcap.writer", "logs")
    folder = as_path(folder, "folder")
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{one.name}{FORMATS[kind]}"
    with atomic_path(path) as new:
        (_rerun if kind == "rerun" else _mcap)(library, one, new)
    return path


def _rerun(rr: Any, one: TrialLog, path: Path) -> None:
    """Places in cm, z up; a row a step, in columns."""
    stream = rr.RecordingStream("realitygap", recording_id=one.name)
    made = stream.memory_recording()  # its own writer hangs on a full disk, or says nothing of what is lost
    stream.send_blueprint(_blueprint(one), make_active=False)
    stream.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    for name, lines, colour in _room(one.task.arena):
        strips = rr.LineStrips3D([_up(line) for line in lines], colors=colour)
        stream.log(f"arena/{name}", strips, static=True)
    facts = json.dumps({**one.trial.to_dict(), "folder": one.trial.folder.name}, indent=1)
    stream.log("about", rr.TextDocument(f"```\n{facts}\n```", media_type="text/markdown"), static=True)
    for side in one.sides:
        _rerun_side(rr, stream, one, side)
    if one.film is not None:
        film = rr.AssetVideo(path=one.film)
        stream.log("situated/film", film, static=True)
        frames = film.read_frame_timestamps_nanos()
        when = rr.TimeColumn(TIMELINE, duration=frames * 1e-9 - one.lead_s)
        columns = rr.VideoFrameReference.columns_nanos(frames)
        stream.send_columns("situated/film", indexes=[when], columns=columns)
    path.write_bytes(made.drain_as_bytes())


def _rerun_side(rr: Any, stream: Any, one: TrialLog, side: Side) -> None:
    found, colour = side.track.found, COLOURS[side.name]
    when = rr.TimeColumn(TIMELINE, duration=side.track.t)
    seen = rr.TimeColumn(TIMELINE, duration=side.track.t[found])

    def columns(name: str, columns: Any, each: int, indexes: Any) -> None:
        stream.send_columns(f"{side.name}/{name}", indexes=[indexes], columns=columns.partition([each] * n))

    n = int(found.sum())
    bodies = [_up(line) for lines in _bodies(one, side) for line in lines]
    columns("body", rr.LineStrips3D.columns(strips=bodies), 2, seen)
    rays = side.rays[found]
    strips = [_up(ray) for step in rays for ray in step]
    columns("rays", rr.LineStrips3D.columns(strips=strips), rays.shape[1], seen)
    for name, look in (("body", colour), ("rays", RAY)):
        stream.log(f"{side.name}/{name}", rr.LineStrips3D.from_fields(colors=look), static=True)
    path = _up(np.stack([side.track.x[found], side.track.y[found]], 1))
    stream.log(f"{side.name}/path", rr.LineStrips3D([path], colors=colour), static=True)
    n = len(side.track)
    pose = np.stack([side.track.x, side.track.y, side.track.heading_deg], 1)
    scalars: dict[str, tuple[NDArray[Any], Sequence[str]]] = {"pose": (pose, ("x_cm", "y_cm", "heading_deg"))}
    scalars |= {key: (rows, _names(one, key, rows.shape[1])) for key, rows in side.inside.items()}
    for name, (rows, names) in scalars.items():
        stream.log(f"{side.name}/{name}", rr.SeriesLines(names=names), static=True)
        n = len(rows)
        times = when if n == len(side.track) else rr.TimeColumn(TIMELINE, duration=side.track.t[:-1])
        columns(name, rr.Scalars.columns(scalars=rows.astype(float).ravel()), rows.shape[1], times)
    if one.network is not None:
        _rerun_network(rr, stream, one.network, side)


def _rerun_network(rr: Any, stream: Any, network: Mapping[str, Any], side: Side) -> None:
    """Neurons in their places on the robot, which looks up: orange above zero, purple below."""
    neurons, links = network["neurons"], network["links"]
    ids = [str(k) for k in range(len(neurons))]
    nodes = rr.GraphNodes(
        ids,
        positions=[(WIDE * one["x"], WIDE * one["y"]) for one in neurons],
        labels=[one["name"] for one in neurons],
        radii=[WIDE * one["r"] for one in neurons],
    )
    edges = rr.GraphEdges([(ids[one["from"]], ids[one["to"]]) for one in links], graph_type="directed")
    stream.log(f"{side.name}/network", nodes, edges, static=True)
    outputs = side.inside.get("outputs")
    if outputs is not None:
        share = np.abs(outputs.ravel()[:, None]) / 10.0
        full = np.where(outputs.ravel()[:, None] >= 0, (230, 159, 0), (204, 121, 167))
        colours = (share * full + (1 - share) * 200).astype(np.uint8)
        columns = rr.GraphNodes.columns(colors=colours).partition([len(neurons)] * len(outputs))
        when = rr.TimeColumn(TIMELINE, duration=side.track.t[:-1])
        stream.send_columns(f"{side.name}/network", indexes=[when], columns=columns)


def _blueprint(one: TrialLog) -> Any:
    """Both robots side by side, the film; below what they read, decided, and their networks."""
    import rerun.blueprint as rrb

    names = [side.name for side in one.sides]
    parts = ("body", "rays", "path")
    drawn = {name: ["/arena/**", *(f"/{name}/{part}" for part in parts)] for name in names}
    views = [rrb.Spatial3DView(name=name, contents=contents) for name, contents in drawn.items()]
    views += [rrb.Spatial2DView(name="film", origin="/situated/film")] if one.film is not None else []
    read = [(name, part) for name in names for part in ("inputs", "commands")]
    series = [rrb.TimeSeriesView(name=f"{name}: {part}", origin=f"/{name}/{part}") for name, part in read]
    graphs = [rrb.GraphView(name=f"{name}: network", origin=f"/{name}/network") for name in names]
    return rrb.Blueprint(rrb.Vertical(rrb.Horizontal(*views), rrb.Horizontal(*series, *graphs)))


def _mcap(writer: Any, one: TrialLog, path: Path) -> None:
    """JSON messages from the trial's start on; scenes (in metres) and pictures by Foxglove's schemas."""
    with path.open("wb") as file:
        log = writer.Writer(file)
        log.start()
        facts = {key: str(value) for key, value in one.trial.to_dict().items() if key != "folder"}
        log.add_metadata("trial", facts)
        if one.network is not None:
            log.add_metadata("network", {"json": json.dumps(one.network)})
        channels: dict[str, int] = {}

        def send(topic: str, schema: str, t_s: float, message: Mapping[str, Any]) -> None:
            if topic not in channels:
                kind = log.register_schema(schema, "jsonschema", b'{"type": "object"}')
                channels[topic] = log.register_channel(topic, "json", kind)
            text = json.dumps(message, allow_nan=False).encode()
            log.add_message(channels[topic], round(t_s * 1e9), text, round(t_s * 1e9))

        send("/arena", "foxglove.SceneUpdate", 0.0, _scene("arena", 0.0, [
            (line, colour, 0.004) for _, lines, colour in _room(one.task.arena) for line in lines
        ]))  # fmt: skip
        for side in one.sides:
            for t_s, step, scene in _steps(one, side):
                send(f"/{side.name}/step", "realitygap.Step", t_s, step)
                if scene is not None:
                    send(f"/{side.name}/scene", "foxglove.SceneUpdate", t_s, scene)
        for t_s, picture in _pictures(one):
            send("/situated/film", "foxglove.CompressedImage", t_s, picture)
        log.finish()


def _steps(one: TrialLog, side: Side) -> Iterator[tuple[float, dict[str, Any], dict[str, Any] | None]]:
    """Each step's time, its numbers (null where the robot was lost), and its scene (None there)."""
    track = side.track
    bodies = iter(_bodies(one, side))
    for k, t_s in enumerate(track.t.tolist()):
        pose = {"x_cm": track.x[k], "y_cm": track.y[k], "heading_deg": track.heading_deg[k]}
        step = {"t_s": t_s, **{key: float(v) if np.isfinite(v) else None for key, v in pose.items()}}
        for name, rows in side.inside.items():
            if k < len(rows):
                step[name] = [float(v) if np.isfinite(v) else None for v in rows[k]]
        if not track.found[k]:
            yield t_s, step, None
            continue
        lines = [(line, COLOURS[side.name], 0.002) for line in next(bodies)]
        lines += [(ray, RAY, 0.0005) for ray in side.rays[k]]
        yield t_s, step, _scene(side.name, t_s, lines)


def _scene(name: str, t_s: float, lines: Sequence[tuple[Floats, Sequence[int], float]]) -> dict[str, Any]:
    """Lines in cm as one entity of Foxglove's, which stays until the next of its name."""
    pose = {"position": {"x": 0, "y": 0, "z": 0}, "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}}
    drawn = [
        {
            "type": 0, "pose": pose, "thickness": thick, "scale_invariant": False,
            "colors": [], "indices": [],
            "points": [{"x": x, "y": y, "z": 0} for x, y in (line / 100.0).round(5).tolist()],
            "color": dict(zip("rgba", (part / 255 for part in colour), strict=True)),
        }
        for line, colour, thick in lines
    ]  # fmt: skip
    entity = {
        "timestamp": _stamp(t_s), "frame_id": "arena", "id": name, "lines": drawn, "frame_locked": False,
        "lifetime": {"sec": 0, "nsec": 0}, "metadata": [],
    }  # fmt: skip
    return {"deletions": [], "entities": [entity]}


def _pictures(one: TrialLog) -> Iterator[tuple[float, dict[str, Any]]]:
    """The film's frames from the trial's start on, as JPEG."""
    import base64

    from PIL import Image

    if one.film is None:
        return
    with FilmReader(one.film) as film:
        for frame in film:
            t_s = frame.t_s - one.lead_s
            if t_s < 0:
                continue
            made = io.BytesIO()
            Image.fromarray(frame.colour()).save(made, "JPEG", quality=JPEG_QUALITY)
            data = base64.b64encode(made.getvalue()).decode()
            yield t_s, {"timestamp": _stamp(t_s), "frame_id": "film", "format": "jpeg", "data": data}


def _bodies(one: TrialLog, side: Side) -> list[tuple[Floats, Floats]]:
    """The robot's outlines in the arena at each step at which it was seen."""
    found, track = side.track.found, side.track
    out = []
    for x, y, heading in zip(track.x[found], track.y[found], track.heading[found], strict=True):
        cos, sin = np.cos(heading), np.sin(heading)
        turn = np.array([[cos, sin], [-sin, cos]])
        out.append((one.outlines[0] @ turn + (x, y), one.outlines[1] @ turn + (x, y)))
    return out


def _room(arena: Arena) -> list[tuple[str, list[Floats], tuple[int, int, int, int]]]:
    """Name, lines [points, 2] in cm and colour of what stands in an arena."""
    room = arena.to_kernel()
    width, depth = (float(v) for v in room.size)
    edge = np.array([[0, 0], [width, 0], [width, depth], [0, depth], [0, 0]], dtype=float)
    turn = np.linspace(0, 2 * np.pi, 33)
    round_ = np.stack([np.cos(turn), np.sin(turn)], 1)
    cylinders = [radius * round_ + (x, y) for x, y, radius in room.cylinders.reshape(-1, 3)]
    lamps = [0.5 * round_ + np.mean(lamp.points(), axis=0)[:2] for lamp in arena.lamps]
    parts = [("walls", [edge, *room.segments.reshape(-1, 2, 2)], WALL), ("cylinders", cylinders, WALL)]
    return [part for part in (*parts, ("lamps", lamps, LAMP)) if part[1]]


def _names(one: TrialLog, kind: str, count: int) -> list[str]:
    if kind == "commands":
        return ["left", "right"]
    if kind == "outputs" and one.network is not None:
        return [neuron["name"] for neuron in one.network["neurons"]]
    return [f"{kind} {k}" for k in range(count)]


def _up(line: Floats) -> Floats:
    """On the floor of a room with three dimensions."""
    return np.pad(line, ((0, 0), (0, 1)))


def _stamp(t_s: float) -> dict[str, int]:
    return {"sec": int(t_s), "nsec": round((t_s - int(t_s)) * 1e9)}
