"""What is recorded at a place: readings of a standing robot, or a trial of its wheels."""

from realitygap.calibration.recorder.wheel_plans import Trial
from realitygap.errors import BaudError
from realitygap.robots.body import Body
from realitygap.robots.drive import MOVING, StopOnSignal, raise_pending
from realitygap.values import Command, Pose

__all__ = ["drive_trial", "read_standing"]

APART_S = 0.3
"""Time between two readings at a place, s, so that slow noise shows too."""


def drive_trial(body: Body, trial: Trial) -> tuple[list[tuple[str, ...]], dict[int, Pose]]:
    """Drive one trial as a controller would, step by step.

    Returns:
        Its rows as texts, without poses; and the poses that the robot reported, by step, where a camera
        looks.

    Raises:
        BaudError: the line has no room for counters and speeds in a step.
    """
    clock = body.clock
    body.reset()
    rows, poses, looks = [], {}, trial.seen() if body.knows_pose else ()
    start = due = clock.now()
    with StopOnSignal(() if clock.waits else MOVING) as stopping:
        try:
            for k, command in enumerate(trial.commands):
                clock.sleep_until(due)
                now = clock.now()
                body.sense()
                counters, speeds = body.odometry
                if body.counts_turns and (counters is None or speeds is None):
                    raise BaudError(
                        "robot: expected counters and speeds at each step, got only one of them. A line "
                        "needs 38400 baud or more; a body of your own gives Odometry(counters=…, speeds=…)."
                    )
                if k in looks and body.knows_pose:
                    poses[k] = body.known_pose()
                raise_pending()
                body.act(Command(left=command[0], right=command[1]))
                turned = (*(counters or ()), *(speeds or ())) if body.counts_turns else ()
                numbers = (*command, *turned, trial.number)
                rows.append((f"{now - start:.4f}", *map(str, numbers), trial.kind))
                due = max(due + body.period_s, now)
        finally:
            with stopping.held():
                body.stop()
    return rows, poses


def read_standing(body: Body, kind: str, repeats: int) -> list[list[str]]:
    """Repeated readings [repeats][sensors] of a standing robot, as texts."""
    clock = body.clock
    readings = []
    for _ in range(repeats):
        clock.sleep_until(clock.now() + APART_S)
        asked = clock.now()
        read = body.sense()
        while body.read_at is not None and body.read_at < asked:  # a missing answer is not a reading
            read = body.sense()
        raise_pending()
        counts = read.proximity if kind == "proximity" else read.ambient
        readings.append([f"{count:.10g}" for count in counts.tolist()])
    return readings
