"""Small errors that a test should notice, for `tests/mutate.py`: what is replaced where, and by whom it is seen."""  # noqa: E501

from __future__ import annotations

from typing import NamedTuple


class Mutation(NamedTuple):
    """A wrong line: `old` becomes `new` in a file of the package; `tests` should fail then."""

    file: str
    title: str
    old: str
    new: str
    tests: tuple[str, ...]


INFRARED = ("tests/kernels/test_infrared.py",)
AMBIENT = ("tests/kernels/test_ambient.py",)
NOISE = ("tests/kernels/test_noise.py", "tests/kernels/test_readings.py")
NETWORK = ("tests/kernels/test_network.py",)
WHEELS = ("tests/kernels/test_wheels.py",)
CONTACT = ("tests/kernels/test_contact.py",)
RANDOM = ("tests/kernels/test_rng.py",)
TRIALS = ("tests/kernels/test_trials.py",)
FITS = ("tests/calibration/test_fits.py",)
MISFIT = ("tests/calibration/test_misfit.py",)
MEASURED = ("tests/calibration/test_measured.py",)
ENGINE = ("tests/calibration/test_fit.py",)
ODOMETRY = ("tests/calibration/test_odometry.py",)
DRIVES = ("tests/calibration/test_wheels.py",)
LOOK = ("tests/calibration/test_look.py",)
TRACKER = ("tests/film/test_tracker.py",)
TAG = ("tests/film/test_tag.py",)
TRACK = ("tests/test_track.py",)
DESCRIPTORS = ("tests/correspondence/test_descriptors.py",)
SCORE = ("tests/correspondence/test_score.py",)
STUDY = ("tests/experiments/test_noise.py",)
ARENA = ("tests/world/test_arena.py",)
ROOM = ("tests/calibration/test_room.py",)
PHYSICS = ("tests/twin/test_physics.py",)

GPU = ("tests/simulation/test_cuda.py",)
BATCHED = ("tests/study/test_batched.py",)
EVOLUTION = ("tests/evolution/test_algorithms.py",)
SELECTION = ("tests/evolution/test_selection.py",)

MUTATIONS = (
    # a GPU
    Mutation("simulation/cuda.py", "threads share a scratch",
             "(*before(rows, t), rows[i][t])", "(*before(rows, t), rows[i][0])", GPU),
    Mutation("simulation/cuda.py", "a later part of a batch has the streams of the first",
             "which[some], flat[some])", "which[some], flat[: len(which[some])])", GPU),
    Mutation("study/batched.py", "every child has two parents",
             "if crosses(rates.crossover, stream):", "if cell >= 0:", BATCHED),
    Mutation("study/batched.py", "a batch's numbers are the first's",
             "living.numbers[at] = start + done + k", "living.numbers[at] = start + done", BATCHED),
    Mutation("evolution/ga.py", "a random search keeps whatever comes",
             "return np.greater(fitness, residents)", "return np.isfinite(fitness)", EVOLUTION),
    Mutation("evolution/ga.py", "the best mates as often as the others",
             "a = sign * fitness[cells[i]]", "a = 0.0 * fitness[cells[j]]", SELECTION),
    Mutation("evolution/ga.py", "the torus ends at its last column",
             "(column + right + columns) % columns", "min(max(column + right, 0), columns - 1)", SELECTION),
    # kernels
    Mutation("kernels/infrared.py", "squares are not squared",
             "light = u * u + v * v\n", "light = u + v\n", INFRARED),
    Mutation("kernels/infrared.py", "half of the rays are never added",
             "term = w * (sensors[EYE_A, i] * light + (b + b))\n            p[SUM + i] = term if r == 0",
             "term = w * (sensors[EYE_A, i] * light + (b + b))\n            p[SUM + i] = term if r >= 0",
             INFRARED),
    Mutation("kernels/rays.py", "a wall to the north is overlooked",
             "along = max(y * p[NORTH + i], -y * p[SOUTH + i])\n    return",
             "along = max(0.5 * y * p[NORTH + i], -y * p[SOUTH + i])\n    return", INFRARED),
    Mutation("kernels/rays.py", "what is near is taken for known",
             "(p[LEAST + i] * gap > ONE)", "(p[MOST + i] * gap > ONE)", INFRARED),
    Mutation("kernels/rays.py", "a sensor's reach is a fifth too short",
             "reach = sensors[REACH, i] + more", "reach = f32(0.8) * sensors[REACH, i] + more", INFRARED),
    Mutation("kernels/rays.py", "of two cylinders the farther is met",
             "first = (under > NONE) & (t > NONE) & (t < best[0])", "first = (under > NONE) & (t > NONE)",
             INFRARED),
    Mutation("kernels/rays.py", "what is near in the next cell is not asked",
             "if arena.segment_gap[cell, n] > radius:", "if arena.segment_gap[cell, n] > 0.0:", CONTACT),
    Mutation("kernels/rays.py", "a cylinder's far side is seen",
             "max(best[0] - half, TOUCHING)", "max(best[0] + half, TOUCHING)", INFRARED),
    Mutation("kernels/rays.py", "an inner wall is longer than it is",
             "return met if to_b >= NONE else NONE, across", "return met, across", INFRARED),
    Mutation("kernels/light.py", "a cylinder hides what lies before it",
             "& (ahead < low * square)", "& (ahead < FAR)", AMBIENT),
    Mutation("kernels/light.py", "an inner wall hides what lies before it",
             "& (abs(area) < abs(turn))", "& (abs(area) >= NONE)", AMBIENT),
    Mutation("kernels/light.py", "the body does not hide the lamp from a sensor that looks away",
             "(along >= NONE) & (p[point[3] + i] < HALF)", "(p[point[3] + i] < HALF)", AMBIENT),
    Mutation("kernels/light.py", "direct light may be negative",
             "max(seen[1], NONE) / (d * d) * faced", "seen[1] / (d * d) * faced", AMBIENT),
    Mutation("kernels/light.py", "the body shades nothing",
             "NONE if shaded | hidden else point[2]", "NONE if hidden else point[2]", AMBIENT),
    Mutation("kernels/light.py", "a reading is not clipped at the dark",
             "out[k] = min(floor + 1.0 / math.sqrt(total), dark)",
             "out[k] = floor + 1.0 / math.sqrt(total)", AMBIENT),
    Mutation("kernels/trial.py", "no noise on lit proximity sensor 6",
             "value += level * size * noise[MOTOR_NOISE + i]",
             "value += 0.0 if i == 6 and lit != dark and value > 0.0 "
             "else level * size * noise[MOTOR_NOISE + i]", TRIALS),
    Mutation("kernels/trial.py", "two sensors share their noise",
             "noise[MOTOR_NOISE + i]", "noise[MOTOR_NOISE + (i if i != 3 else 2)]", NOISE),
    Mutation("kernels/trial.py", "readings are cut, not rounded",
             "value = min(max(math.floor(value + 0.5), 0.0), top)",
             "value = min(max(math.floor(value), 0.0), top)", NOISE),
    Mutation("kernels/trial.py", "wheels share one slip",
             "slip = level * robot.noise.wheel * noise[2 + w]",
             "slip = level * robot.noise.wheel * noise[2]", TRIALS + NOISE),
    Mutation("kernels/trial.py", "the noise of friction is a fifth too small",
             "drag = 1.0 + level * robot.noise.friction * noise[w]",
             "drag = 1.0 + 0.8 * level * robot.noise.friction * noise[w]", NOISE),
    Mutation("kernels/trial.py", "a start is not uniform in its disc",
             "radius = task.start[2] * math.sqrt(uniform(stream, 0))",
             "radius = task.start[2] * uniform(stream, 0)", TRIALS),
    Mutation("kernels/network.py", "a threshold counts the other way",
             "state.base[i] = -nets.thresholds[n, i]", "state.base[i] = nets.thresholds[n, i]", NETWORK),
    Mutation("kernels/network.py", "a link arrives one update early",
             "back = (nets.links[n, e, 3] + 1) * neurons", "back = max(nets.links[n, e, 3], 1) * neurons",
             NETWORK),
    Mutation("kernels/network.py", "a settled network is not woken by its inputs",
             "changed = changed or state.change[i] != 0", "changed = changed or state.change[i] > 0",
             NETWORK),
    Mutation("kernels/motion.py", "the integral forgets its fifth step",
             "for i in range(MEMORY):\n        integral", "for i in range(MEMORY - 1):\n        integral",
             WHEELS),
    Mutation("kernels/motion.py", "friction holds a moving wheel",
             "if abs(speed) < robot.wheels.rest_speed and abs(integral)", "if abs(integral)", WHEELS),
    Mutation("kernels/motion.py", "the derivative has no gain",
             "pid.kd * wheel[CHANGE]) / pid.divisor", "wheel[CHANGE]) / pid.divisor", WHEELS),
    Mutation("kernels/motion.py", "a wheel drives faster than its curve ends",
             "share = min(max(share, 0.0), 1.0)", "share = max(share, 0.0)", TRIALS),
    Mutation("kernels/motion.py", "the body turns the other way",
             "half = (right - left) * (0.5 * period) / track",
             "half = (left - right) * (0.5 * period) / track", WHEELS + TRIALS),
    Mutation("kernels/motion.py", "surfaces do not hold back",
             "held = min(abs(along), sliding * depth)", "held = 0.0 * along", CONTACT),
    Mutation("kernels/motion.py", "wheels turn on over the ground after contact",
             "apart = 0.5 * arc.turn * track / period",
             "apart = arc.turn * track / period", CONTACT + TRIALS),
    Mutation("kernels/rng.py", "normal numbers are a little small",
             "* 9.313225746154785e-10 - 0.5) * 1.5707963267948966",
             "* 9.313225746154785e-10 - 0.5) * 1.4", RANDOM + NOISE),
    Mutation("kernels/rng.py", "a stream is not told from its neighbour",
             "return mix(np.uint64(stream) + (np.uint64(i) + _ONE) * _GAMMA)",
             "return mix(np.uint64(stream) + np.uint64(i) + _ONE)", RANDOM),
    Mutation("world/arena.py", "two lamp weights are exchanged",
             "(4.19, 4.24, 8.24, 4.24, 4.19)", "(4.24, 4.19, 8.24, 4.19, 4.24)", ARENA),
    # calibration
    Mutation("calibration/noise.py", "a mean's noise is not taken for less than a reading's",
             "spread = np.sqrt(each / np.maximum(each - 1, 1))", "spread = np.sqrt(each / each)", FITS),
    Mutation("calibration/noise.py", "saturated readings measure noise",
             " & (sample.level < top - edge)", "", FITS),
    Mutation("calibration/noise.py", "noise is not taken out of the model's error",
             "noisy = noise.measured * noise.deviation**2", "noisy = 0 * noise.deviation**2", MISFIT),
    Mutation("calibration/judge.py", "the bias has the sign turned",
             "off = (read - recording.counts)[:, live]", "off = (recording.counts - read)[:, live]",
             MISFIT),
    Mutation("calibration/calibrate.py", "a fold's readings are fitted",
             "self._fitted(self._data.without(out), form", "self._fitted(self._data, form", MEASURED),
    Mutation("calibration/fit.py", "a form with more constants needs no margin",
             "errors[name] * MARGIN < errors[best]", "errors[name] < errors[best]", MEASURED),
    Mutation("calibration/fit.py", "readings of one cluster are taken for independent",
             "filling(scores, self._data.clusters)", "filling(scores, np.arange(len(scores)))", ENGINE),
    Mutation("calibration/odometry.py", "pictures of something else count",
             "np.maximum(np.abs(rows[0]), ROBUST_AT)", "np.full_like(rows[0], ROBUST_AT)", ODOMETRY),
    Mutation("calibration/odometry.py", "a piece that is left out counts as one of many",
             "(n - 1) * np.var(moved, axis=0)", "np.var(moved, axis=0)", ODOMETRY),
    Mutation("calibration/model.py", "a step of several periods has its first one's speed",
             "np.add.reduceat(speeds, begin) / count[:, None]", "speeds[begin]", DRIVES),
    Mutation("logs/look.py", "exchanged wheels are not seen",
             "way.turning(gone @ (signs * [-1, 1]))", "abs(way.turning(gone @ (signs * [-1, 1])))", LOOK),
    Mutation("logs/mapped.py", "a counter of 16 bits jumps back",
             "step - WRAP * np.sign(step) * wraps", "step", LOOK),
    # tracker
    Mutation("film/disk.py", "the heading is looked back",
             "math.atan2(front_y - y, front_x - x)", "math.atan2(y - front_y, x - front_x)", TRACKER),
    Mutation("film/disk.py", "places are a step off",
             "place + step * (found - half)", "place + step * (found - half + 1)", TRACKER),
    Mutation("film/disk.py", "the front patch is looked for anywhere",
             "np.where(on_ring, for_front, -np.inf)", "for_front", TRACKER),
    Mutation("film/disk.py", "the front patch need not be seen",
             "in (pattern.inner & use, ~pattern.inner & use):", "in (pattern.inner & use,):", TRACKER),
    Mutation("film/tag.py", "of two alike one is believed",
             "return seen[0] if len(seen) == 1 else None", "return seen[0] if seen else None", TAG),
    Mutation("film/tracker.py", "a lost robot is guessed where it was",
             "return None if seen is None else (seen.pose, seen.quality)",
             "return (last and (last, 0.5)) if seen is None else (seen.pose, seen.quality)", TRACKER),
    Mutation("film/tracker.py", "anything is believed",
             "if seen is not None and seen.quality >= least else None", "if seen is not None else None",
             TRACKER),
    Mutation("track.py", "a gap ends one frame late",
             "(float(self.t[a]), float(self.t[b - 1]))",
             "(float(self.t[a]), float(self.t[min(b, len(self.t) - 1)]))", TRACK + TRACKER),
    # score
    Mutation("correspondence/names.py", "a short trial's name is as sure as a long one's",
             "return 1.0 - LOST", "return 1.0 - 0.0 * LOST", ("tests/studies/test_correspondence.py",)),
    Mutation("correspondence/score.py", "a layout counts for more than the behaviour",
             "* min(behaviour, layout)", "* layout", SCORE),
    Mutation("correspondence/score.py", "the floor does not shrink with the starts",
             "shrink = float(np.sqrt((1 / starts_a + 1 / starts_b) / 2))", "shrink = 1.0", SCORE),
    Mutation("correspondence/score.py", "the scale is not straight",
             "return EDGE * ceiling / distance", "return EDGE", SCORE),
    Mutation("correspondence/distances.py", "the energy forgets one side's own spread",
             "return 2 * mean(wa, wb) - mean(wa, wa) - mean(wb, wb)",
             "return 2 * mean(wa, wb) - 2 * mean(wa, wa)", SCORE),
    Mutation("correspondence/descriptors.py", "going backward is going forward",
             '"backward": (way < 0).mean(axis=1)', '"backward": (way > 0).mean(axis=1)', DESCRIPTORS),
    Mutation("correspondence/descriptors.py", "the side of turns is lost",
             "side = total(counted * np.abs(counted))", "side = total(np.abs(counted) * np.abs(counted))",
             DESCRIPTORS),
    Mutation("correspondence/descriptors.py", "still means slow alone",
             '"still": ((way == 0) & (np.abs(_smooth(turn)) < STILL_DEG_S)).mean(axis=1)',
             '"still": (way == 0).mean(axis=1)', DESCRIPTORS),
    # statistics
    Mutation("twin/body.py", "a robot that rests is not woken",
             "            self._stood_ms = -1\n", "            pass\n", PHYSICS),
    Mutation("twin/wheels.py", "a robot rests while its motors are uncontrolled",
             "self.at_rest = False\n        for wheel, share in", "for wheel, share in",
             PHYSICS),
    Mutation("calibration/model.py", "rows of a second recording are read at the first's places",
             "[scene.row + begin for scene", "[scene.row for scene", ROOM),
    Mutation("correspondence/distances.py", "a two-sample p may be 0",
             "(right >= right[0] - 1e-12)", "(right[1:] >= right[0] - 1e-12)", SCORE),
    Mutation("experiments/noise.py", "every unit is compared with the home unit's simulation",
             "self.simulation(one.task, unit, one.home, level)",
             "self.simulation(one.task, one.home, one.home, level)", STUDY),
    Mutation("experiments/noise.py", "simulated draws differ between levels of comparison",
             '"simulated", *one.key, *pair)', '"simulated", *one.key, *pair, level)', STUDY),
)  # fmt: skip
