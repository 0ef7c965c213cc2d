"""Studies, runs and the rest in a notebook: in a real kernel, and in a real browser."""

import html
import re
import warnings
from pathlib import Path

import pytest
from matplotlib.figure import Figure

import realitygap
from realitygap.errors import StudyError
from realitygap.world.toml import shipped

EXAMPLE = Path(__file__).parents[2] / "examples" / "notebook.py"
SMALL = "evaluations=64, workers=1, settings={'task.seconds': 2, 'fresh_trials': 2, 'retest_trials': 2}"
AGAIN = "realitygap.evolve('avoidance', out=folder / 'study')"


def cells() -> list[str]:
    """The example's code, made short, and a cell that is refused."""
    text = (
        EXAMPLE.read_text("utf-8")
        .replace("evaluations=150", SMALL)
        .replace("starts=1)", 'starts=1, path_from="wheels")')
    )
    assert SMALL in text and 'path_from="wheels"' in text
    parts = text.split("\n# %%")[1:]
    return [part.partition("\n")[2] for part in parts if not part.startswith(" [markdown]")] + [AGAIN]


@pytest.fixture(scope="module")
def executed(tmp_path_factory):
    """The outputs of the example's cells, in a Jupyter kernel of this Python."""
    nbclient = pytest.importorskip("nbclient", reason="no nbclient here: pip install nbclient ipykernel")
    pytest.importorskip("ipykernel", reason="no ipykernel here: pip install ipykernel")
    from nbformat import v4

    folder = tmp_path_factory.mktemp("notebook")
    made = v4.new_notebook(cells=[v4.new_code_cell(cell) for cell in cells()])
    client = nbclient.NotebookClient(
        made, timeout=300, allow_errors=True, resources={"metadata": {"path": str(folder)}}
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the kernel's own connection
        client.execute()
    return [cell.outputs for cell in made.cells]


def test_a_kernel_shows_each_thing_once(executed):
    """One bar, which ends in what it took, and the live page; tables, frames, pictures; one clear error."""
    robot, evolved, run, replay, shown, figure, runs, refused = executed
    assert "data:image/svg+xml" in robot[0]["data"]["text/html"]
    told, bar, study = evolved
    assert told["text"].startswith("watch file:///") and told["text"].endswith("/study/watch.html\n")
    assert bar["data"]["text/plain"].startswith("took ") and "evolving" in bar["data"]["text/html"]
    assert "obstacle-avoidance/observed/1" in study["data"]["text/html"]
    assert "data:image/svg+xml" in run[0]["data"]["text/html"]
    assert [out[0]["data"]["text/html"][:7] for out in (replay, shown)] == ["<iframe"] * 2
    assert "image/png" in figure[0]["data"] and "champion_fresh" in runs[0]["data"]["text/html"]
    kinds = {kind for outs in executed for out in outs for kind in out.get("data", {})}
    assert kinds == {"text/plain", "text/html", "image/png"}  # nothing that needs a widget's comm
    assert refused[-1]["ename"] == "StudyError" and "already holds a study" in refused[-1]["evalue"]


def test_the_player_lives_in_its_frame(browser, played, tmp_path):
    """The whole study's, in a frame that may run scripts and no more; by itself it draws and plays."""
    shown = played.show()
    frame = shown._repr_html_()
    assert 'sandbox="allow-scripts"' in frame
    (tmp_path / "cell.html").write_text(
        f"<!doctype html><meta charset=utf-8><title>cell</title>{frame}", "utf-8"
    )
    shown.save(tmp_path / "page.html")
    browser.problems.clear()
    for name in ("cell.html", "page.html"):
        browser.show(tmp_path / name, tall=1200)
        assert not browser.problems
    assert browser.run("document.getElementById('player').hidden") is False
    assert browser.run("document.getElementById('player-arena-0').toDataURL().length") > 3000


def test_a_replay_is_the_commands(played):
    """The same trial as `Simulation` makes, of whichever individual."""
    run = played.runs[0]
    page = run.replay("fittest", noise="zero", seed=5, seconds=1.0).html
    assert 'id="drive-data"' not in page and 'id="drive-data"' in run.drive_live("fittest").html
    simulation = realitygap.Simulation(played.task(run.task), played.profile, "zero")
    networks = played.networks(run.task, run.fittest)
    _, score = simulation.trajectory(networks, stream=5, seconds=1.0)
    assert f'"score":"{score:.2f}"' in html.unescape(page) and "zero noise" in page
    with pytest.raises(StudyError, match="expected champion, fittest or an evaluation, 0 to 63, got 64"):
        run.replay(64)


def test_everything_has_a_face(played):
    """Studies and runs say what they came to; robots, arenas and networks are pictures."""
    run = played.runs[0]
    text = played._repr_html_()
    assert (
        all(one.name in text for one in played.runs)
        and f"{run.tests['champion', run.noise].mean():.4g} ± " in text
    )
    faces = [run._repr_html_(), played.controller(run.task, run.champion)._repr_html_()]
    faces += [realitygap.load_profile(name)._repr_html_() for name in shipped("profiles")]
    faces += [realitygap.load_arena(name)._repr_html_() for name in shipped("arenas")]
    for face in faces:
        assert len(re.findall('<img alt="[^"]+" ', face)) == 1 and "data:image/svg+xml;base64," in face
    figures = played.figures()
    page = (played.folder / "report" / "index.html").read_text("utf-8")
    assert all(f'id="{name}"' in page for name in figures) and len(figures) > 10
    assert isinstance(figures["robot"], Figure) and "robot" in repr(figures)
