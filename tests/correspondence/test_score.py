"""The correspondence score: identity, symmetry, mirrors, small ladders, other behaviours, words."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from studies.correspondence.kinds import Behaviour
from studies.correspondence.ladders import against, behaviours, climb, ladders_of, lives, setting_for

from realitygap.control.genotype import Genotype
from realitygap.correspondence.descriptors import chosen
from realitygap.correspondence.distances import Distances, matched_starts
from realitygap.correspondence.score import (
    behaviour_score,
    compare,
    differences,
    ends_of,
    exemplar_scale,
    noisiness,
    parting_s,
    transferability,
)
from realitygap.correspondence.trials import Trial, trial_of
from realitygap.errors import UsageError
from realitygap.simulation.simulation import Simulation
from realitygap.tasks.load import load_task
from realitygap.transfer import paths
from realitygap.world.robot import load_profile
from tests.correspondence.tracks import half_round, in_mirror, mirrored, turned

EACH = pytest.mark.parametrize("robot", behaviours(0)[1::4], ids=lambda b: f"{b.task[:5]} {b.kind}")
"""A two way turner and a straight looper; all kinds are in studies/correspondence."""
TURNER = Behaviour(task="obstacle-avoidance", kind="two way turner", seed=1)
NOISY = {"again": 5, "profile": None, "noise": 3.0}
"""As on the ladder of noise: trials that are made once."""


@EACH
def test_the_same_robot_again_scores_full_marks(robot):
    """A robot's trials and its trials again, other noise, score 9.5 or more; a trial and itself, 10."""
    ours = lives(robot)
    assert against(robot, ours, ours).score == 10
    assert against(robot, ours, lives(robot, again=5)).score >= 9.5
    elsewhere = lives(robot, again=2, starts=3)
    made = compare(ours, elsewhere, setting_for(robot.task), resamples=20)
    assert not made.matched and made.score >= 9.5
    assert made.scale.floor_from == "split halves of the same trials"


@EACH
def test_another_behaviour_scores_two_at_most(robot):
    """Every other kind of behaviour at the same task scores at most 2, either way round."""
    for other in behaviours(1):
        if other.task == robot.task and other.kind != robot.kind:
            made = against(robot, lives(robot), lives(other))
            assert made.score <= 2
            assert (made.behaviour <= 0.3) == made.differences.startswith("another behaviour")
            assert against(robot, lives(other), lives(robot)).score == pytest.approx(made.score)


@EACH
def test_the_ladder_of_response_goes_down(robot):
    """Infrared gain, or what a light seeker makes of a turn, 1 → 0.15 lowers the score (Spearman > 0.9)."""
    made = climb(robot, ladders_of(robot)[-2])
    assert made.spearman > 0.9
    assert made.scores[0] >= 9.5 and made.scores[-1] < 6
    if robot.task == "obstacle-avoidance":
        assert "less responsive" in made.rungs[3].differences


@EACH
def test_the_ladder_of_noise_goes_down(robot):
    """Noise × 1 → × 8 lowers the score at every step, and every robot becomes noisier on it."""
    made = climb(robot, "noise")
    assert made.spearman > 0.9
    assert made.scores[-1] < 6
    noisy = [rung.noisiness for rung in made.rungs]
    assert (np.diff(noisy) > 0).all()
    assert "noisier" in made.rungs[-1].differences


@EACH
def test_mirror_and_turn_change_nothing(robot):
    """Two sets in a mirror, or in a room that is turned with its lamp, score as they did."""
    setting = setting_for(robot.task)
    width, depth = setting.arena.size_cm
    a, b = lives(robot), lives(robot, **NOISY)
    for arena in (setting.arena, None):
        room = replace(setting, arena=arena)
        plain = compare(a, b, room, resamples=0).score
        glass = replace(setting, arena=arena and in_mirror(arena))
        flipped = compare(mirrored(a, width), mirrored(b, width), glass, resamples=0).score
        round_ = replace(setting, arena=arena and half_round(arena))
        moved = compare(turned(a, width, depth), turned(b, width, depth), round_, resamples=0).score
        assert flipped == pytest.approx(plain, abs=1e-3) and moved == pytest.approx(plain, abs=1e-3)


def test_it_is_symmetric():
    """B beside A scores as A beside B, its interval and p too; what is said is turned round."""
    a, b = lives(TURNER), lives(TURNER, noise=4.0, again=4)
    setting = setting_for(TURNER.task)
    for theirs in (b, lives(TURNER, again=2, starts=3)):
        ways = compare(a, theirs, setting, resamples=50), compare(theirs, a, setting, resamples=50)
        assert len({(made.score, made.interval, made.p) for made in ways}) == 1
    one, other = against(TURNER, a, b), against(TURNER, b, a)
    assert one.noisiness == pytest.approx(-other.noisiness)
    assert one.differences == "noisier" and other.differences == "less noisy"


def test_a_score_goes_on_beyond_floor_and_ceiling():
    """Identity is 10, the floor 9.7, the ceiling 0.3; less is less on both sides, and it never leaps."""
    scale = exemplar_scale("obstacle-avoidance", 12, 12)
    floor, ceiling = scale.behaviour_floor, scale.behaviour_ceiling
    assert scale.part("behaviour", 0.0) == 10
    assert scale.part("behaviour", floor) == pytest.approx(9.7)
    assert scale.part("behaviour", ceiling) == pytest.approx(0.3)
    steps = [scale.part("behaviour", d) for d in np.linspace(0, 3 * ceiling, 300)]
    assert (np.diff(steps) < 0).all() and np.diff(steps).min() > -0.5 and steps[-1] > 0


def test_jitter_may_be_left_out_of_the_behaviour():
    """Left out, what jitters in place loses less, on ends of its own; all else counts as before."""
    draw, setting = np.random.default_rng(3), setting_for(TURNER.task)
    ours = lives(TURNER)
    shaken = [replace(t, heading=t.heading + np.radians(1.5) * draw.standard_normal(len(t))) for t in ours]
    full, calm = (
        Distances(a=ours, b=shaken, arena=setting.arena, matched=True, jitter=jitter)
        for jitter in (True, False)
    )
    jitter = [d.name for d in chosen(setting.arena)].index("jitter")
    assert np.array_equal(calm.rows, np.delete(full.rows, jitter, axis=1))
    assert calm.behaviour() < 0.7 * full.behaviour() and calm.layout() == full.layout()
    made = compare(ours, shaken, replace(setting, jitter=False), resamples=0)
    assert made.score > compare(ours, shaken, setting, resamples=0).score
    assert made.noisiness == compare(ours, shaken, setting, resamples=0).noisiness
    ends = [exemplar_scale(TURNER.task, 12, 12, jitter=jitter) for jitter in (True, False)]
    assert ends[0].behaviour_ceiling != ends[1].behaviour_ceiling
    assert ends[0].layout_ceiling == ends[1].layout_ceiling


def test_left_and_right_handed_robots_are_not_alike():
    """A one way turner and its mirror image do different things: the score must see it."""
    robot = Behaviour(task="obstacle-avoidance", kind="one way turner")
    width = load_task(robot.task).arena.size_cm[0]
    assert against(robot, lives(robot), mirrored(lives(robot), width)).score < 5


def test_the_distance_is_unbiased():
    """Sets of 4, 8 or 20 trials of one robot are at energy 0 on average; the plug-in form is not."""
    trials = [t for s in range(4) for t in TURNER.trials(12, again=20 + s, starts=s)]
    pool = Distances(a=trials[:24], b=trials[24:], arena=setting_for(TURNER.task).arena)
    draw = np.random.default_rng(1)
    for n in (4, 8, 20):
        found = []
        for _ in range(200):
            order = draw.permutation(48)
            sides = np.zeros((2, 48))
            sides[0, order[:n]], sides[1, order[n : 2 * n]] = 1, 1
            found.append(pool.energy(*sides))
        assert abs(np.mean(found)) < 4 * np.std(found) / np.sqrt(200)
        plug_in = pool._between.mean() * 2 / n
        assert plug_in > 4 * np.std(found) / np.sqrt(200)


def test_a_wider_interval_with_fewer_starts():
    """The interval holds the score, and four starts say less than twelve."""
    setting = setting_for(TURNER.task)
    a, b = lives(TURNER), lives(TURNER, noise=3.0, again=4)
    full = compare(a, b, setting)
    few = compare(a[:4], b[:4], setting)
    assert full.interval[0] <= full.score <= full.interval[1]
    assert np.diff(few.interval) > 0
    assert compare(a[:1], b[:1], setting).interval is None


def test_a_start_without_a_partner_leaves_the_others_pairs():
    """A lost start is left out of both sets, and that is said; few starts in common make no pairs."""
    a, b = lives(TURNER), lives(TURNER, noise=3.0, again=4)
    made = compare(a, b[:4] + b[5:], setting_for(TURNER.task), resamples=0)
    both = compare(a[:4] + a[5:], b[:4] + b[5:], setting_for(TURNER.task), resamples=0)
    assert made.matched and made.score == both.score and made.trials == (12, 11)
    assert f"starts {a[4].start} " in made.notes[0]
    assert not compare(a, b[:4], setting_for(TURNER.task), resamples=0).matched


def test_the_two_sample_test_says_yes_and_no():
    """p is small for another behaviour, not for the same robot again, and never 0 of 199 permutations."""
    setting = setting_for(TURNER.task)
    other = Behaviour(task=TURNER.task, kind="wall follower")
    assert 1 / 200 <= compare(lives(TURNER), lives(other), setting, resamples=2).p < 0.02
    assert compare(lives(TURNER), lives(TURNER, again=6, starts=2), setting, resamples=2).p > 0.05


def test_pairs_part_and_transfer():
    """Identical pairs never part and transfer perfectly; another behaviour's part early."""
    a = lives(TURNER)
    other = lives(Behaviour(task=TURNER.task, kind="one way looper"))
    assert matched_starts(a, other) and not matched_starts(a, lives(TURNER, starts=3))
    assert parting_s(a, a) == [np.inf] * 12 and transferability(a, a) == 0
    assert np.median(parting_s(a, other)) < 5 and transferability(a, other) < -0.3


def test_words():
    """Signs and sizes become the paper's words, the largest difference first."""
    assert differences(9.8, 10, 2.0, -1.0, 0) == "observably identical"
    assert differences(7, 7, 0.5, 0.0, 0) == "a little noisier"
    assert differences(7, 7, -0.5, None, 0) == "slightly less noisy"
    assert differences(5, 5, 2.0, -0.1, 0) == "much noisier, a little less responsive"
    assert differences(6, 6, 0, 0, 0.3) == "loops more"
    assert differences(1, 0.2, 2.0, 0, 0) == "another behaviour, much noisier"
    assert differences(0.2, 0.2, 0, 0, 0) == "another behaviour"
    assert differences(1, 0.9, 2.0, 0, 0) == "much noisier"
    assert differences(7.5, 7, 0, 0, 0) == "similar"


def test_behaviour_score_goes_from_standing_to_ideal():
    """A robot that stands has 0, the ideal 10, Braitenberg's vehicle something between, often."""
    profile = load_profile("paper")
    for name in ("obstacle-avoidance", "light-seeking"):
        task = load_task(name)
        ends = ends_of(task, profile)
        assert behaviour_score([ends[0]], ends) == 0 and behaviour_score([ends[1]] * 3, ends) == 10
        simulation = Simulation(task, profile)
        networks = Genotype.braitenberg(task.feeds).networks()
        scores = simulation.scores(networks, np.arange(20, dtype=np.uint64)[None])
        assert 2 < behaviour_score(scores, ends) < 10
        trajectory, score = simulation.trajectory(networks, stream=1)
        assert paths.score(trajectory.track, task, profile) == pytest.approx(score, rel=0.05)


def test_noise_of_the_simulation_is_seen():
    """Braitenberg's vehicle at levels 0, ½, 1, 2, 4: each level's jitter is above the last one's."""
    task = load_task("avoidance")
    networks = Genotype.braitenberg(task.feeds).networks()
    sets = []
    for level in (0, 0.5, 1, 2, 4):
        simulation = Simulation(task, load_profile("paper"), level)
        sets.append([trial_of(simulation.trajectory(networks, stream=k)[0]) for k in range(10)])
    assert all(noisiness(one, other) > 0.1 for one, other in itertools.pairwise(sets))


@pytest.mark.parametrize(
    ("odd", "says"),
    [
        ({"x": np.append(np.ones(200), np.nan)}, "finite x and y"),
        ({"heading": np.where(np.arange(201) < 100, 3.1, -3.1)}, "π from row to row, got 6.2. Unwrap it"),
    ],
)
def test_a_trial_holds_what_can_be_compared(odd, says):
    """Finite rows; radians, unwrapped."""
    good = {name: np.ones(201) for name in ("x", "y", "heading")}
    with pytest.raises(UsageError, match=says):
        Trial(**good | odd, source="t.csv")
