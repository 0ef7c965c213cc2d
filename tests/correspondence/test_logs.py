"""Two logs without a study: compared by readings and commands, the order in time included."""

import csv
from pathlib import Path

import numpy as np
import pytest
from studies.correspondence.kinds import Behaviour

from realitygap.correspondence.logs import Log, compare_logs
from tests.correspondence.tracks import write

STEP_S = 0.064


@pytest.fixture(scope="module")
def trials():
    return Behaviour(task="obstacle-avoidance", kind="two way turner", seed=1).trials(2)


def waves(seed: int, steps: int = 3000, *, noise: float = 2.6) -> np.ndarray:
    """Of a real wall follower: slow waves (0.016 to 0.019 Hz) about 141 counts, deviation 75, little noise a
    step."""
    draw = np.random.default_rng(seed)
    phase = np.cumsum(2 * np.pi * draw.uniform(0.016, 0.019, steps) * STEP_S) + draw.uniform(0, 6)
    return 141 + 75 * np.sqrt(2) * np.sin(phase) + draw.normal(0, noise, steps)


def white(seed: int, steps: int = 3000) -> np.ndarray:
    """The same mean and deviation, in no order."""
    return np.random.default_rng(seed).normal(141, 75, steps)


def log(*columns: np.ndarray, step_s: float = STEP_S) -> Log:
    names = ("proximity_0", "command_left")
    return Log(t=np.arange(len(columns[0])) * step_s, channels=dict(zip(names, columns, strict=False)))


def test_the_order_in_time_tells_a_jittery_follower_from_a_real_one():
    """Mean and deviation agree; a step of the one changes by 2.5 counts, of the other by 70."""
    made = compare_logs([log(waves(1))], [log(white(2))])
    (one,) = made.channels
    assert abs(one.mean[0] - one.mean[1]) < 15 and abs(one.deviation[0] / one.deviation[1] - 1) < 0.1
    assert one.distance < 0.3 and one.step_noise[0] < 6 and 40 < one.step_noise[1] < 90
    assert one.alike_s[0] > 5 and one.alike_s[1] <= 2 * STEP_S
    assert made.order.p is not None and made.order.p < 0.001
    assert made.levels.p is None or made.levels.p > 0.01


def test_two_drives_of_one_robot_are_not_told_apart():
    """Of 40 pairs of slow processes at most 4 at p < 0.05, by levels or by order; four times the noise is."""
    found = [compare_logs([log(waves(k))], [log(waves(100 + k))]) for k in range(40)]
    for tests in ([one.order for one in found], [one.levels for one in found]):
        assert sum(test.p is not None and test.p < 0.05 for test in tests) <= 4
    assert compare_logs([log(waves(1))], [log(waves(2, noise=10.0))]).order.p < 0.01


def test_levels_rates_and_gaps():
    """Other commands are told apart; a faster log is thinned to the slower one's steps; a gap cuts; short
    logs say how long they must be; what one side lacks is named."""
    draw = np.random.default_rng(3)
    a, b = (log(white(k), draw.normal(mean, 1, 3000)) for k, mean in ((1, 5), (2, 7)))
    made = compare_logs([a], [b])
    assert made.levels.p < 0.001 and made.channels[1].distance == pytest.approx(2, abs=0.2)
    fast = log(np.repeat(white(14), 4), step_s=STEP_S / 4)
    made = compare_logs([fast], [log(white(15))])
    assert made.step_s == STEP_S and made.order.p > 0.01
    assert made.notes == () and "command_left" in compare_logs([a], [fast]).notes[0]
    t = a.t + np.where(np.arange(3000) >= 1500, 60.0, 0.0)
    assert compare_logs([Log(t=t, channels=a.channels)], [b]).pace[0].gaps == 1
    short = compare_logs([log(white(1, 60))], [log(white(2, 60))])
    assert short.order.p is None and short.order.needed_s > 9
    assert compare_logs([log(white(1))], [Log(t=a.t, channels={"ambient_0": a.t})]) is None


def table(path: Path, **columns: np.ndarray) -> Path:
    with path.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(columns)
        rows.writerows(zip(*columns.values(), strict=True))
    return path


def test_score_takes_logs_without_poses(json_of, call, refused, tmp_path):
    """And says what the score of tracks would need; without a common column it says what is there."""
    t = np.arange(3000) * STEP_S
    a = table(tmp_path / "a.csv", t_s=t, proximity_0=waves(1), counter_left=np.arange(3000.0) * 3)
    b = table(tmp_path / "b.csv", t_s=t, proximity_0=white(2), counter_left=np.arange(3000.0) * 3)
    made = json_of("score", a, b)
    assert made["logs"]["order"]["p"] < 0.001 and "no poses" in made["notes"][0]
    assert [one["name"] for one in made["logs"]["channels"]] == ["proximity_0", "counter_left (a second)"]
    said = call("score", a, b).stdout
    assert "order in time: told apart" in said and "3000 rows, a step 0.064 s" in said
    other = table(tmp_path / "c.csv", t_s=t, light=white(2))
    assert "no columns of one name to compare instead" in refused("score", a, other)


def test_slow_tracks_are_compared_by_places_and_speeds(json_of, tmp_path, trials):
    """Rows 0.35 s apart do not show turns: the score is left out, and says so."""
    slow = write(tmp_path / "slow.csv", trials, hz=1 / 0.35)
    made = json_of("score", slow, slow)
    assert "expected at least 5 rows a second, got 2.9" in made["notes"][0] and "score" not in made
    assert [one["name"] for one in made["logs"]["channels"]] == ["x_cm", "y_cm", "speed over ground (cm/s)"]


def test_jumps_are_warned_of_with_their_row(json_of, tmp_path, trials):
    """Of a tracker that sees another thing now and then; a steady track has none."""
    trial = trials[0]
    good = write(tmp_path / "good.csv", [trial], named=False)
    lines = good.read_text().splitlines()
    cells = lines[50].split(",")
    lines[50] = ",".join([cells[0], f"{float(cells[1]) + 22.8:.4f}", *cells[2:]])
    (bad := tmp_path / "bad.csv").write_text("\n".join(lines) + "\n")
    assert json_of("score", good, good)["warnings"] == []
    (warning,) = json_of("score", bad, bad)["warnings"]
    assert "jumps 2 × from row to row" in warning and "cm in 0.1 s" in warning
    assert "row 50 (t_s 4.9)" in warning or "row 51 (t_s 5)" in warning
