"""`realitygap.calibrate`: what the command does, from Python, and its page in a notebook."""

import pytest
from click.testing import CliRunner
from matplotlib.figure import Figure
from threadpoolctl import threadpool_info, threadpool_limits

import realitygap
from realitygap.cli import realitygap as command
from realitygap.errors import CalibrationError
from tests.calibration.tables import BEARINGS


def test_the_same_profile_as_the_commands(made_tables, tmp_path, capsys):
    """From paths, with the options' names; progress goes to stderr, nothing to stdout. The page says that
    five distances tell nothing of noise by the reading."""
    wall = tmp_path / "wall.sam"
    rows = (made_tables / "wall.sam").read_text("utf-8").splitlines()
    near = rows[1 : 1 + 5 * (1 + BEARINGS)]
    wall.write_text("\n".join([f"8 {BEARINGS} 5 2 3", *near, "END", ""]), "utf-8")
    out = tmp_path / "robot.toml"
    made = realitygap.calibrate(wall, objects="wall", form="paper", out=out)
    ours, said = out.read_text("utf-8"), capsys.readouterr()
    assert said.out == "" and "fitting the simulation" in said.err
    words = ["calibrate", str(wall), "--object", "wall", "--form", "paper", "--out", str(out), "--no-report"]
    assert CliRunner().invoke(command, words).exit_code == 0
    assert out.read_text("utf-8") == ours and realitygap.load_profile(out) == made.profile
    page = made.show()
    assert "too few readings to show it by the reading" in page.html
    assert "Infrared proximity" in page.html and page._repr_html_().startswith("<iframe")
    figures = made.figures()
    assert "infrared-curves" in figures and isinstance(figures["infrared-maps"], Figure)


def test_a_machines_cores_change_no_bit(made_tables, monkeypatch):
    """Linear algebra takes one thread within, and as many as before afterwards."""
    during = []

    def fitted(*_given, **_named):
        during.extend(threads())
        raise CalibrationError("enough")

    monkeypatch.setattr("realitygap.calibration.calibrate.fit_channel", fitted)
    with threadpool_limits(2, user_api="blas"):
        before = threads()
        with pytest.raises(CalibrationError, match="enough"):
            realitygap.calibrate(made_tables / "wall.sam", objects="wall", form="paper")
        assert set(before) == {2} and threads() == before
    assert set(during) == {1}


def threads() -> list[int]:
    """Of each library of linear algebra."""
    return [one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"]
