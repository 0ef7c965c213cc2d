"""The page's player: everything that it can show of a study, as one JSON document.

Tasks contain noise levels, those contain runs, those contain trials; a trial is a simulated drive and, if the
run drove a robot or a twin, that drive too. Numbers are packed as little-endian int16 or int8 in base64: a
tenth of the size of JSON.
"""

import base64
import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import ArrayLike, NDArray

from realitygap.control.genotype import Genotype
from realitygap.report.drawing import LIT_RAYS_CM, WHEEL_CM, front
from realitygap.report.evolution import PER_CONDITION, NoiseClass, Paths, Row, TaskPart, individual, unit_of
from realitygap.report.network import network_drawing
from realitygap.report.page import rendered
from realitygap.report.style import noise_styles
from realitygap.report.transfers import Pair, robots_of
from realitygap.robots.drive import Recording
from realitygap.simulation.simulation import Simulation
from realitygap.study.load import Study
from realitygap.tasks.task import Task
from realitygap.track import Track, Trajectory
from realitygap.transfer.replay import Replays
from realitygap.values import fed
from realitygap.world.arena import Arena
from realitygap.world.robot import TOP_INPUT, Profile, noise_name
from realitygap.world.sensors import RAY_ANGLES_DEG, AmbientSensor, ProximitySensor

__all__ = [
    "LOST", "MOST_TRIALS", "activity", "decided", "judge_page", "pack", "player_data", "player_json",
    "replay_data",
]  # fmt: skip

Json = dict[str, object]

MOST_RUNS = 2 * PER_CONDITION
"""Runs of a condition on the page: as many as in its tables."""
MOST_TRIALS = 2
"""Trials of a run on the page."""
FINEST_CM = 0.01
LARGEST = 32_000
"""Maximum length of an arena's longer side in units of packed positions, which are int16."""
LOST = -32768
"""A missing number: the camera lost the robot."""
TURN = 100.0
"""Headings are packed in hundredths of a degree."""
DIGITS = 9
"""More digits than a file has, fewer than a heading loses in conversions from degrees and back."""


def player_json(data: Json) -> str:
    """The document as text for a script element: "<" is escaped."""
    text = json.dumps(data, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c")


def player_data(
    study: Study, parts: Sequence[TaskPart], pairs: Mapping[str, Sequence[Pair]], paths: Paths
) -> Json | None:
    """The player's data, with transfers by task; None if no run has started."""
    styles = noise_styles({c.level for part in parts for c in part.conditions})
    replays, tasks = Replays(study), []
    for part in parts:
        noises = []
        for condition in part.conditions:
            if not condition.begun:
                continue
            rows = condition.shown(MOST_RUNS)
            runs = [_run(part, condition, row, pairs[part.task.name], replays, paths) for row in rows]
            noises.append({
                "name": part.names[condition.level], "colour": styles[condition.level].colour,
                "shown": 0 if condition.chosen is None else rows.index(condition.chosen), "runs": runs,
            })  # fmt: skip
        if noises:
            tasks.append({**_scene(part.task, study.profile), "noises": noises})
    return _document(study.profile, tasks) if tasks else None


def replay_data(
    simulation: Simulation, genotype: Genotype, driven: tuple[Trajectory, float], name: str
) -> Json:
    """The player's data of one simulated trial: whose network drove, the trial and its score, and a name."""
    task, profile, noise = simulation.task, simulation.profile, simulation.noise
    drawing, slots = network_drawing(genotype, task, profile)
    side = _Side(task=task, genotype=genotype, slots=slots, profile=profile)
    run = {"name": name, "link": name, "network": drawing, "trials": [_alone(side, *driven, "simulated")]}
    colour = noise_styles([noise])[noise].colour
    level = {"name": f"{noise_name(noise)} noise", "colour": colour, "shown": 0, "runs": [run]}
    return _document(profile, [{**_scene(task, profile), "noises": [level]}])


def _document(profile: Profile, tasks: Sequence[Json]) -> Json:
    body = profile.to_kernel()
    robot = {
        "radius": float(body.radius), "front": front(body), "outline": body.outline[:, :2].tolist(),
        "track": float(body.wheels.track), "wheel": list(WHEEL_CM),
    }  # fmt: skip
    return {"step_s": profile.period_s, "robot": robot, "tasks": list(tasks)}


def _scene(task: Task, profile: Profile) -> Json:
    """A task: its arena, the sensors it feeds."""
    return {
        "name": task.name, "title": task.title, "unit": unit_of(task.fitness_unit), "feeds": task.feeds,
        "unit_cm": _unit_cm(task), "arena": arena_json(task.arena), "sensors": _sensors(task, profile),
    }  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class _Side:
    """A run's individual, whose drives are shown; `slots` are neurons in the order of packed outputs."""

    task: Task
    genotype: Genotype
    slots: Sequence[int]
    profile: Profile

    def drive(
        self, who: str, score: str, path: Track, kept: Trajectory | Recording | None, drove: Genotype | None
    ) -> Json:
        """A drive along a path: n + 1 poses, and of the first n the readings (counts), commands and outputs
        (−10 to 10), as far as its record `kept` has them; `drove` is the driving genotype, if known."""
        steps, unit = len(path) - 1, _unit_cm(self.task)
        poses = np.stack([path.x, path.y, path.heading_deg.round(DIGITS)], axis=1)
        inside: dict[str, tuple[NDArray[Any] | None, str]] = {}
        if kept is not None:
            readings, commands, outputs = fed(kept, self.task.feeds), decided(kept, self.profile), None
            known = kept.inputs.shape[1] == len(self.task.sensors)
            if known and self.genotype == drove:  # the drawn network is the one that drove
                outputs = activity(self.genotype, kept.inputs, commands, self.slots)
            inside = {"readings": (readings, "<i2"), "commands": (commands, "i1"), "outputs": (outputs, "i1")}
        packed = {
            key: pack(of, kind) if of is not None and len(of) == steps > 0 else None
            for key, (of, kind) in inside.items()
        }
        return {
            "who": who, "score": score, "steps": steps,
            "poses": pack(poses * np.array([1 / unit, 1 / unit, TURN]), "<i2"),
            **dict.fromkeys(("readings", "commands", "outputs")), **packed,
        }  # fmt: skip


def _run(
    part: TaskPart, condition: NoiseClass, row: Row, pairs: Sequence[Pair], replays: Replays, paths: Paths
) -> Json:
    """A run: its network and its trials; without transfers the simulated one in the figures of paths."""
    run, genotype, task = row.run, individual(row.run), part.task
    drawing, slots = network_drawing(genotype, task, run.study.profile)
    side = _Side(task=task, genotype=genotype, slots=slots, profile=run.study.profile)
    here = [pair for pair in pairs if pair.run == run.id]
    order = {robot: i for i, robot in enumerate(robots_of(here))}
    here.sort(key=lambda p: (p.individual != "champion", order.get(p.robot, len(order)), p.start))
    shown = [pair for pair in here if pair.seen][:MOST_TRIALS]
    trials = [_transfer(part, pair, side, replays) for pair in shown]
    if not trials:
        one, score = paths.of(part, condition, row)
        trials = [_alone(side, one, score, "simulated only")]
    name = f"#{run.index}" + ("" if run.finished else ", unfinished")
    return {"name": name, "link": run.name, "network": drawing, "trials": trials}


def _alone(side: _Side, one: Trajectory, score: float, name: str) -> Json:
    """A trial in simulation only."""
    drive = side.drive("simulated", f"{score / side.task.fitness_scale:.2f}", one.track, one, side.genotype)
    return {"name": name, "link": "simulated", "simulated": drive, "driven": None}


def _transfer(part: TaskPart, pair: Pair, side: _Side, replays: Replays) -> Json:
    """One transfer: both drives, as far as they are known."""
    replay = replays.of(pair.folder)
    scores = [part.text(value) for value in pair.fitness]
    known = replay.simulated
    path = pair.simulated if known is None else known.track
    who = "" if pair.individual == "champion" else f"{pair.individual}/"
    return {
        "name": f"{pair.where}, start {pair.start}", "link": f"{pair.robot}/{who}start-{pair.start}",
        "simulated": side.drive("simulated", scores[0], path, known, replay.genotype),
        "driven": side.drive(pair.where, scores[1], pair.situated, replay.situated, replay.genotype),
    }  # fmt: skip


def _unit_cm(task: Task) -> float:
    """Unit of packed positions: hundredths of a cm, larger in an arena too large for int16."""
    return float(max(FINEST_CM, max(task.arena.size_cm) / LARGEST))


def arena_json(arena: Arena) -> Json:
    """An arena as plain numbers in cm; a lamp has its middle and its points."""
    plain = arena.plain()
    plain["lamps"] = [
        {"x": lamp.x_cm, "y": lamp.y_cm, "points": [list(point) for point in lamp.points()]}
        for lamp in arena.lamps
    ]
    return dict(plain)


def _sensors(task: Task, profile: Profile) -> Json:
    """The sensors that a task feeds: places in the robot's frame, rays, and the counts' range.

    `dull` and `bright` are the counts at which a sensor's rays are invisible, and strongest.
    """
    near, light = profile.infrared, profile.ambient
    looks = {
        "proximity": {"petals": False, "top": near.top, "dull": 0, "bright": near.top},
        "ambient": {"petals": True, "top": light.dark, "dull": light.dark, "bright": light.floor},
    }
    sensors = [
        {"x": one.x_cm, "y": one.y_cm, "direction": one.direction_deg, "reach": _reach(one), **looks[kind]}
        for kind in task.kinds
        for one in (near if kind == "proximity" else light).sensors
    ]
    return {"each": sensors, "rays": list(RAY_ANGLES_DEG), "fed": list(task.sensors)}


def _reach(one: ProximitySensor | AmbientSensor) -> float:
    """As far as its rays are drawn, cm."""
    return round(min(one.reach_cm(), LIT_RAYS_CM), 2) if isinstance(one, ProximitySensor) else LIT_RAYS_CM


def judge_page(data: Mapping[str, object], arena: Arena | None, radius_cm: float) -> str:
    """The page on which people rate pairs, from `correspondence.blind_pairs`; it keeps ratings in the
    browser and as a file. Without an arena an empty one is drawn around all of them."""
    body: Json = dict.fromkeys(("radius", "front"), radius_cm)
    body |= {"outline": [], "track": 1.8 * radius_cm, "wheel": WHEEL_CM}
    empty = {"size_cm": data["size_cm"], "cylinders": [], "walls": [], "lamps": []}
    text = player_json({**data, "arena": arena_json(arena) if arena else empty, "robot": body})
    name = hashlib.sha256(text.encode()).hexdigest()[:16]  # ratings of another page are kept apart
    return rendered("judge.html.j2", {"data": Markup(text[:-1] + f',"id":"{name}"}}')})


# One drive


def pack(values: ArrayLike, kind: str) -> str:
    """Whole numbers as base64: `kind` is "<i2" or "i1"; NaN becomes LOST; larger values are clipped."""
    numbers = np.asarray(values, np.float64)
    limits = np.iinfo(np.dtype(kind))
    lowest = limits.min + 1 if kind == "<i2" else limits.min
    whole = np.clip(np.round(np.nan_to_num(numbers)), lowest, limits.max)
    whole = np.where(np.isnan(numbers), limits.min, whole)
    return base64.b64encode(np.ascontiguousarray(whole).astype(kind).tobytes()).decode("ascii")


def decided(drive: Trajectory | Recording, profile: Profile) -> NDArray[np.int64]:
    """A drive's commands [n, 2] from −10 to 10: a recording has them in the robot's own units."""
    if isinstance(drive, Trajectory):
        return drive.commands
    outputs = np.rint(drive.commands * (TOP_INPUT / profile.wheels.top_command))
    return np.asarray(outputs, np.int64)


def activity(
    genotype: Genotype, inputs: NDArray[np.int64], commands: NDArray[np.int64], slots: Sequence[int]
) -> NDArray[np.int64] | None:
    """Outputs [n, slots] of a network's neurons at the end of each step, by replaying inputs [n, I].

    None if its commands [n, 2] are not the network's: another one drove.
    """
    controller = genotype.controller()
    shown = np.zeros((len(inputs), len(slots)), np.int64)
    for k, (readings, command) in enumerate(zip(inputs.tolist(), commands.tolist(), strict=True)):
        decided = controller.decide(readings)
        if [decided.left, decided.right] != command:
            return None
        outputs = controller.outputs
        shown[k] = [outputs[slot] for slot in slots]
    return shown
