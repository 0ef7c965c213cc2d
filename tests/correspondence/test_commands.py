"""`score`, `classify`, `judge`: a person's files in, figures or one clear refusal out."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from studies.correspondence.kinds import Behaviour

from realitygap.correspondence.judging import Pair, blind_pairs
from realitygap.correspondence.score import compare
from realitygap.correspondence.setting import setting_of
from realitygap.correspondence.trials import read_transfer
from realitygap.study.config import Condition
from realitygap.study.load import load_study
from realitygap.study.runner import run_study
from tests.correspondence.tracks import write
from tests.study.helpers import small

ROBOT = Behaviour(task="obstacle-avoidance", kind="two way turner", seed=1)


@pytest.fixture(scope="module")
def trials():
    return ROBOT.trials(6)


@pytest.fixture
def tracks(tmp_path, trials):
    return write(tmp_path / "a.csv", trials)


def test_a_transfer_is_scored_in_the_arena_of_its_study(json_of, trials, tmp_path):
    """Not in the first of the paper's that its tracks fit in; away from its study the arena is a guess."""
    wide = "obstacle-avoidance-large"
    config = small(conditions=(Condition(task="avoidance"),), arenas={"obstacle-avoidance": wide})
    folder = run_study(tmp_path / "study", config, workers=1).folder / "transfer" / "twin-1" / "run"
    for start, trial in enumerate(trials[:2]):
        (place := folder / f"start-{start}").mkdir(parents=True)
        (place / "transfer.toml").write_text('task = "obstacle-avoidance"\n')
        for name, kept in (("simulated.csv", trial), ("situated.csv", trials[start + 2])):
            write(place / name, [kept], named=False)
    there, task = json_of("score", folder), load_study(tmp_path / "study").task("obstacle-avoidance")
    away = json_of("score", shutil.copytree(folder, tmp_path / "away"))
    made = compare(*read_transfer(folder), setting_of([], task))
    assert there["setting"] == "obstacle-avoidance" and there["score"] == made.score
    assert "guessed" in away["setting"] and away["distances"] != there["distances"]


def test_score_of_the_same_tracks(json_of, call, tracks):
    """The same file twice scores 10 in every part; the JSON has all its keys; the text says the ends."""
    made = json_of("score", tracks, tracks, "--task", "avoidance")
    assert made["behaviour"] == made["layout"] == made["score"] == 10
    assert made["interval"] == [10, 10] and made["differences"] == "observably identical"
    text = call("score", tracks, tracks).stdout
    assert "guessed" in text and "exemplars of obstacle avoidance" in text


@pytest.mark.parametrize(
    ("spoil", "cure"),
    [
        (lambda t: replace(t, heading=np.radians(t.heading)), "is it in radians"),
        (lambda t: replace(t, y=50 - t.y), "does y run downwards"),
        (lambda t: replace(t, heading=np.pi / 2 - t.heading), "is heading_deg 0 where the robot looks"),
        (lambda t: replace(t, heading=t.heading + np.pi / 2), "is heading_deg that of the axle"),
    ],
)
def test_a_heading_that_contradicts_the_way_is_refused(refused, trials, tmp_path, spoil, cure):
    """Radians, y downwards, compass headings and an axle's are told by name; nothing is scored."""
    wrong = write(tmp_path / "wrong.csv", [spoil(t) for t in trials])
    for words in (("score", wrong, wrong), ("classify", wrong)):
        assert f"heading_deg contradicts the way from row to row: {cure}" in refused(*words)


def test_tracks_in_metres_are_doubted(call, refused, trials, tmp_path):
    """A robot cannot stay within its own radius of a corner; in a task's arena it is refused."""
    metres = write(tmp_path / "m.csv", [replace(t, x=t.x / 100, y=t.y / 100) for t in trials])
    assert "Are they in metres? Convert them to cm." in refused(
        "score", metres, metres, "--task", "avoidance"
    )
    result = call("score", metres, metres)
    assert "less than the robot's radius: are they in metres?" in result.stderr, result.output


@pytest.mark.parametrize("hz", [25, 50, 7])
def test_other_rates_are_the_same_behaviour(json_of, tracks, trials, tmp_path, hz):
    """A film's rate does not count: the same trials at 7, 25 or 50 rows a second score 9.5 or more."""
    made = json_of("score", tracks, write(tmp_path / "b.csv", trials, hz=hz))
    assert made["score"] >= 9.5


def test_folders_json_and_units(json_of, tracks, trials, tmp_path, call):
    """A folder holds a file a start and a folder a unit; what `simulate --json` prints is a track."""
    for unit in ("one", "two"):
        (tmp_path / "f" / unit).mkdir(parents=True)
        for trial in trials:
            write(tmp_path / "f" / unit / f"{trial.start}.csv", [trial])
    assert json_of("score", tracks, tmp_path / "f")["trials"] == [6, 12]
    (tmp_path / "j").mkdir()
    for seed in (1, 2):
        words = ("simulate", "avoidance", "--controller", "braitenberg", "--pose", f"25,25,{90 * seed}")
        (tmp_path / "j" / f"{seed}.json").write_text(call(*words, "--seed", seed, "--json").stdout)
    assert len(json_of("classify", tmp_path / "j")["tracks"]) == 2


def test_a_broken_track_in_a_folder_is_refused(refused, tmp_path, trials):
    """In a folder a file that was meant as a track is not passed over; other tables are."""
    write(tmp_path / "good.csv", trials[:1])
    (tmp_path / "counts.csv").write_text("t_s,left,right\n0,1,2\n")
    for name, text in (("odd.csv", b"t_s,x_cm,y_cm,heading\n0,1,2,3\n"), ("odd.json", b'{"t_s": ')):
        (tmp_path / name).write_bytes(text)
        assert name in refused("classify", tmp_path)
        (tmp_path / name).unlink()
    assert "no such file" in refused("score", tmp_path / "none.csv", tmp_path)


def test_a_transfers_folder_is_scored_by_itself(json_of, refused, tmp_path, trials):
    """Of a transfer's trials the situated tracks count, never the sealed ones; alone it is scored inside."""
    for sim, real in zip(trials, ROBOT.trials(6, again=7), strict=True):
        folder = tmp_path / "run" / f"start-{sim.start}"
        folder.mkdir(parents=True)
        (folder / "transfer.toml").write_text("")
        for name, trial in (("simulated", sim), ("situated", real), ("track", real), ("sealed", real)):
            write(folder / f"{name}.csv", [trial], named=False)
    named = json_of("classify", tmp_path / "run")["tracks"]
    assert [entry["start"] for entry in named] == [f"start-{k}" for k in range(1, 7)]
    made = json_of("score", tmp_path / "run")
    assert made["trials"] == [6, 6] and made["matched"] and made["score"] > 9
    assert json_of("score", tmp_path / "run", tmp_path / "run")["score"] == 10
    (tmp_path / "other").mkdir()
    assert "transfer" in refused("score", tmp_path / "other")


def test_several_controllers_are_not_scored_as_one(json_of, refused, tmp_path, trials):
    """A study's trials mix controllers and tasks: the folder of one is asked for; units of one may mix."""
    for name in ("run-1", "run-2"):
        for unit in ("twin-1", "twin-2"):
            folder = tmp_path / "transfer" / unit / name / "start-1"
            folder.mkdir(parents=True)
            (folder / "transfer.toml").write_text(f'name = "{name}"\n')
            for file in ("simulated", "situated"):
                write(folder / f"{file}.csv", [trials[0]], named=False)
    said = refused("score", tmp_path)
    assert "trials of one controller, got those of 2" in said and "transfer/twin-2/run-2" in said
    assert json_of("score", tmp_path / "transfer" / "twin-1" / "run-1")["trials"] == [1, 1]
    for unit in ("twin-1", "twin-2"):
        shutil.rmtree(tmp_path / "transfer" / unit / "run-2")
    assert json_of("score", tmp_path)["trials"] == [2, 2]


def test_judges_see_one_start_side_by_side(trials):
    """Both films of a row set out from one pose, however many units drove and whichever start is missing."""
    units = [replace(t, unit=unit) for unit in ("1", "2") for t in trials if t.start != "3"]
    data, _ = blind_pairs([Pair(name="x", a=trials, b=units, score=5)], setting_of(trials))
    (shown,) = data["pairs"]
    places = [[(film["x"][0], film["y"][0]) for film in shown[side]] for side in ("left", "right")]
    assert places[0] == places[1] and len(places[0]) == 10


def test_classify_names_every_trial(json_of, tracks):
    """One entry a trial with start, name and confidence; names as in the paper, and the robot's own.

    In its third trial this robot meets everything at one side: nothing there tells that it turns both ways.
    """
    made = json_of("classify", tracks, "--task", "avoidance")
    assert made["name"] == "two way turner"
    assert [entry["start"] for entry in made["tracks"]] == [str(k) for k in range(1, 7)]
    names = [entry["name"] for entry in made["tracks"]]
    assert names.count("two way turner") >= 5 and set(names) <= {"two way turner", "one way turner"}
    assert all(0 < entry["confidence"] <= 1 for entry in made["tracks"])


HEAD = "t_s,x_cm,y_cm,heading_deg\n"


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("t_s,x_cm,y_cm\n0,1,2\n", "heading_deg"),
        (HEAD + "0,25,25,0\n0.1,25,east,0\n", "y_cm"),
        (HEAD + "".join(f"{k / 10},25,25,0\n" for k in range(10)), "at least 2 s"),
        (HEAD + "".join(f"{k},25,25,0\n" for k in range(30)), "rows a second"),
        (HEAD + "".join(f"{k % 50 / 10},25,25,0\n" for k in range(100)), "column start"),
        (HEAD + "".join(f"{k / 10},{'' if 40 < k < 60 else 25},25,0\n" for k in range(100)), "lost from"),
        (HEAD + "".join(f"{k / 10},15,15,0\n" for k in range(100)), "arena"),
    ],
)
def test_bad_tracks_are_refused_with_the_reason(refused, tmp_path, text, named):
    """A track that cannot be used is refused in one line that says what is wrong with it."""
    path = tmp_path / "bad.csv"
    path.write_text(text)
    assert named in refused("classify", path, "--task", "avoidance")


def test_judging_is_blind_and_marks_agree(call, json_of, refused, tmp_path, trials):
    """The page tells neither names nor sides; perfect marks give r = 1; a strange pair is refused."""
    for k, noise in enumerate((1.0, 3.0, 6.0)):
        (tmp_path / "pairs" / f"secret{k}").mkdir(parents=True)
        write(tmp_path / "pairs" / f"secret{k}" / "a.csv", trials[:3])
        write(tmp_path / "pairs" / f"secret{k}" / "b.csv", ROBOT.trials(3, noise=noise, again=5))
    page, key = tmp_path / "judge.html", tmp_path / "key.json"
    assert call("judge", "page", tmp_path / "pairs", "--out", page, "--key", key).exit_code == 0
    assert "secret" not in page.read_text() and "http" not in page.read_text()
    rows = json.loads(key.read_text())
    assert {row["name"] for row in rows} == {"secret0", "secret1", "secret2"}
    marks = tmp_path / "marks.csv"
    marks.write_text("pair,judge,mark\n" + "".join(f"{r['pair']},anna,{r['score']}\n" for r in rows))
    made = json_of("judge", "marks", marks, "--key", key)
    assert made["r"] == pytest.approx(1) and made["difference"] == pytest.approx(0, abs=1e-9)
    for rows, says in (("9,anna,5", "not in the key"), ("1,anna,11", "0 to 10"), ("1,A,5\n1,A,9", "5 and 9")):
        marks.write_text(f"pair,judge,mark\n{rows}\n")
        assert says in refused("judge", "marks", marks, "--key", key)
