"""A robot of your own, from its recording to its transfer: `python own_robot.py FOLDER` (an empty one).
It has five sensors of 12 bits, no ambient light and no counters; its commands act two steps late. It is
simulated, so it has a `clock` and a `pose` and goes into any room (`enter`); a real robot has none of these.
"""

import subprocess
import sys
from collections import deque

import numpy as np

from realitygap.robots import Body, Channel, SteppedClock
from realitygap.values import Command, Pose, Readings

EYES, RAYS, WEIGHTS = np.radians([60, 30, 0, -30, -60]), np.radians([-25, 0, 25]), [0.25, 0.5, 0.25]


class FiveEyes(Body):
    channels = (Channel(name="proximity", sensors=5, high=4095),)

    def __init__(self):
        self.clock = SteppedClock(self.step, self.period_s)
        self.enter({"size_cm": [60, 60]}, 0, None)

    def enter(self, room, seed, pose):
        self.size = np.array(room["size_cm"], float)
        self.cylinders = np.array(room.get("cylinders", []), float).reshape(-1, 3)
        self.random = np.random.default_rng(seed)
        self.reset(pose or Pose(x=self.size[0] / 2, y=self.size[1] / 2, heading=0.0))

    def reset(self, pose=None):
        self.stop()
        self.pose = pose or self.pose

    def sense(self):
        light = [(9000 / (self.see(self.pose.heading + eye) + 0.4) ** 2) @ WEIGHTS for eye in EYES]
        counts = np.array(light) + self.random.normal(-80, 60, 5)
        return Readings(proximity=np.clip(np.rint(counts), 0, 4095), ambient=np.empty(0))

    def see(self, heading):  # distances (cm) along the rays of an eye that looks to a heading
        eye = [self.pose.x, self.pose.y] + 2.8 * np.array([np.cos(heading), np.sin(heading)])
        way = np.stack([np.cos(heading + RAYS), np.sin(heading + RAYS)], 1) + 1e-9
        walls = (np.where(way > 0, self.size - eye, -eye) / way).min(axis=1)
        to = self.cylinders[:, :2] - eye
        along = way @ to.T
        inside = self.cylinders[:, 2] ** 2 - (to**2).sum(axis=1) + along**2
        hits = np.where((inside > 0) & (along > 0), along - np.sqrt(np.abs(inside)), np.inf)
        return np.minimum(walls, hits.min(axis=1, initial=np.inf))

    def act(self, command):
        self.given = command

    def stop(self):
        self.given = Command(left=0, right=0)
        self.late = deque([self.given] * 3, maxlen=3)

    def step(self):
        self.late.append(self.given)  # the first of the three was given two steps ago
        given = np.array([self.late[0].left, self.late[0].right])
        left, right = 0.075 * given * self.random.normal(1, 0.05, 2)
        heading = self.pose.heading + (right - left) / 5.6
        x, y = np.array([np.cos(heading), np.sin(heading)]) * (left + right) / 2 + [self.pose.x, self.pose.y]
        gaps = np.hypot(*(self.cylinders[:, :2] - [x, y]).T) - self.cylinders[:, 2]
        free = min(x, y, *(self.size - [x, y]), *gaps) > 3.0
        self.pose = Pose(x=x if free else self.pose.x, y=y if free else self.pose.y, heading=heading)


if __name__ == "__main__":
    folder, base = sys.argv[1], __file__.replace("own_robot.py", "five_eyes.toml")
    for words in (
        f"record --robot {__file__}:FiveEyes --base {base} --plan all --repeats 4 --out {folder}/recorded",
        f"calibrate {folder}/recorded --base {base} --form extended --out {folder}/robot.toml --no-report",
        f"evolve avoidance --profile {folder}/robot.toml --out {folder}/study --evaluations 64 --workers 1 "
        "--set task.seconds=3 --set fresh_trials=1 --set retest_trials=1",
        f"transfer {folder}/study --robot {__file__}:FiveEyes --starts 2 --workers 1",
    ):
        subprocess.run([sys.executable, "-m", "realitygap", *words.split()], check=True)
