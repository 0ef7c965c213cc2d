"""Wheels: nonsense is refused by the file's name, intervals hold the truth, what is not told is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from realitygap.calibration.calibrate import calibrate
from realitygap.calibration.judge import judge
from realitygap.calibration.load import load_recording
from realitygap.calibration.model import wheel_speeds
from realitygap.calibration.wheels import fit_wheels
from realitygap.errors import CalibrationError
from realitygap.report.calibration import write_calibration_page
from realitygap.world.robot import load_profile
from tests.calibration.written import save_recording

PAPER = load_profile("paper")


@pytest.fixture(scope="module")
def sound(driven):
    """A recording that nothing is wrong with."""
    return driven(friction_cm_s2=0.0)


def _posed(scale):
    return lambda r: replace(r, pose=r.pose * scale)


def _blind(r, counters):
    return replace(r, pose=None, counters=counters)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (_posed([10, 10, 1]), "left wheel: expected 6 to 25 pulses per mm by the camera, got 1.2. Are x_cm"),
        (_posed([1, 1, np.pi / 180]), "camera's poses fit no wheels .* heading_deg in degrees"),
        (lambda r: replace(r, counters=r.counters * [-1, 1]), "counter_left runs against command_left"),
        (lambda r: _blind(r, r.counters * [1, -1]), "counter_right runs against command_right"),
        (lambda r: replace(r, counters=r.counters[:, ::-1]), "columns swapped"),
        (lambda r: _blind(r, np.random.default_rng(1).permutation(r.counters)), "explains only"),
        (lambda r: _blind(r, r.counters / 40), "speed_left: 0.05 cm/s per unit, the utmost"),
        (lambda r: replace(r, t_s=r.t_s * 1.5), "expected 30 steps"),
        (lambda r: replace(r, commands=r.commands * 8), "commands up to 80, .* Are these mm/s"),
    ],
)
def test_nonsense_of_wheels_is_refused(sound, spoil, words):
    """No profile is made of another unit's poses, or of counters that are not the commands'."""
    with pytest.raises(CalibrationError, match=f"made: .*{words}"):
        calibrate([spoil(sound)], PAPER)


def _uncounted(recording):
    nothing = np.full_like(recording.counters, np.nan)
    return replace(recording, counters=nothing, speeds=nothing)


def test_a_camera_alone_tells_the_wheels(driven, robot):
    """Without counters pictures of each step give track, speeds and slip, in any unit of commands; one that
    may be another than the base's is doubted."""
    seen = _uncounted(driven(friction_cm_s2=0.0, each=True))
    made = calibrate([seen], PAPER)
    assert made.wheels is not None and made.profile.provenance.pulses_per_mm == ()
    wheels, true = made.profile.wheels, robot.wheels
    assert wheels.track_cm == pytest.approx(true.track_cm, rel=0.015)
    assert wheels.speed_per_unit_cm_s == pytest.approx(true.speed_per_unit_cm_s, rel=0.015)
    assert made.profile.noise.wheel == pytest.approx(0.06, rel=0.15)
    fine = replace(
        PAPER, wheels=replace(PAPER.wheels, top_command=500.0, speed_per_unit_cm_s=(0.0128, 0.0128))
    )
    finer = calibrate([replace(seen, commands=50 * seen.commands)], fine)
    assert [any("written in another unit" in said for said in one.warnings) for one in (made, finer)] == [
        0,
        1,
    ]
    assert finer.profile.wheels.speed_per_unit_cm_s == pytest.approx(
        np.array(wheels.speed_per_unit_cm_s) / 50, rel=1e-3
    )


EPUCK = load_profile("e-puck")


def _as_an_epuck(recording, *, unit=80.0):
    """The same drive of an e-puck, whose commands are smaller units and whose counters step less often."""
    shorter = EPUCK.provenance.pulses_per_mm[0] / 12.0
    return replace(recording, commands=unit * recording.commands, counters=shorter * recording.counters)


def test_pulses_that_nobody_states_are_the_base_profiles(driven, tmp_path):
    """An e-puck's: with a Khepera's its speeds came out 35 % too low. A base without any is refused where a
    Khepera's pulses contradict its speeds; judged, it is warned of."""
    drive = driven(camera=False, friction_cm_s2=0.0, speed_per_unit_cm_s=(0.64, 0.64))
    save_recording(tmp_path, _as_an_epuck(drive, unit=50.0))
    unsaid = load_recording(tmp_path)
    made = calibrate([unsaid], EPUCK, form="paper")
    assert made.profile.wheels.speed_per_unit_cm_s == pytest.approx((0.0128, 0.0128), rel=0.03)
    assert made.profile.provenance.pulses_per_mm == (7.8125, 7.8125)
    assert any("7.8125 pulses per mm are assumed" in warning for warning in made.warnings)
    bare = replace(EPUCK, provenance=PAPER.provenance)
    told = "pulses_per_mm: expected in recording.toml, .* by a Khepera's 12 the wheels made 0.008.* State the"
    with pytest.raises(CalibrationError, match=told):
        calibrate([unsaid], bare, form="paper")
    assert any("a Khepera's 12 are assumed" in warning for warning in judge(unsaid, bare).warnings)
    assert not any("assumed" in warning for warning in judge(unsaid, EPUCK).warnings)


def test_speeds_are_no_surer_than_the_pulses(driven):
    """Their intervals hold the truth, for they carry what the camera leaves open about cm per pulse."""
    hits = 0
    for seed in range(10, 13):
        made = fit_wheels(
            driven(seed=seed, friction_cm_s2=0.0, speed_per_unit_cm_s=(0.84, 0.83)), PAPER, "printed"
        )
        told = {c.key: c for c in made.constants}
        hits += told["speed_left"].low < 0.84 < told["speed_left"].high
        hits += told["speed_right"].low < 0.83 < told["speed_right"].high
    assert hits >= 5


def test_steps_of_any_number_of_periods_are_fitted(sound):
    """Without rows in which the command stayed: the model's mean over the longer steps is that of its steps,
    and the fit is that of the whole. Steps of no whole number of periods are counted."""
    same = (sound.commands[1:] == sound.commands[:-1]).all(axis=1) & (np.diff(sound.trial) == 0)
    kept = ~np.concatenate([[False], same & (np.arange(1, len(sound.t_s)) % 3 == 0)])
    begin, last = np.flatnonzero(kept), np.diff(np.append(sound.trial, -1)) != 0
    names = ("t_s", "commands", "counters", "speeds", "trial", "kind", "pose")
    fewer = replace(sound, **{name: getattr(sound, name)[kept] for name in names})
    assert fewer.periods().max() == 2
    every, mean = wheel_speeds(PAPER, sound), wheel_speeds(PAPER, fewer)
    inner = ~(last[begin] | np.append(last[1:], True)[begin])
    count = np.diff(np.append(begin, len(kept)))[:, None]
    assert np.allclose(mean[inner], (np.add.reduceat(every, begin) / count)[inner], atol=1e-12)
    one, other = (fit_wheels(r, PAPER, "printed").profile.wheels for r in (sound, fewer))
    assert other.speed_per_unit_cm_s == pytest.approx(one.speed_per_unit_cm_s, rel=0.005)
    shaken = replace(sound, t_s=sound.t_s + np.random.default_rng(1).uniform(0, 0.04, len(sound.t_s)))
    said = [w for w in calibrate([shaken], PAPER, form="paper").warnings if "last no whole number" in w]
    assert len(said) == 1 and f"of {len(sound.t_s)} steps" in said[0]


def test_without_commands_lengths_alone_are_fitted(sound, robot, tmp_path):
    """Track and pulses are the truth's, gains the base's, which is said; judged by its runs' ends."""
    seen = replace(sound, commands=np.full_like(sound.commands, np.nan))
    made = calibrate([seen], PAPER)
    assert made.profile.wheels == replace(PAPER.wheels, track_cm=made.profile.wheels.track_cm)
    assert made.profile.wheels.track_cm == pytest.approx(robot.wheels.track_cm, rel=0.015)
    assert any("no commands recorded" in warning for warning in made.warnings)
    assert "Wheels" in write_calibration_page(made, tmp_path / "page.html").read_text("utf-8")
    judged = judge(seen, made.profile)
    assert np.isnan(judged.rmse) and judged.ends is not None and judged.ends[0] < 1
    with pytest.raises(CalibrationError, match="expected commands, or poses at 12 places"):
        calibrate([replace(seen, pose=None)], PAPER)
