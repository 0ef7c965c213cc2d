"""What a person types twice, with commas, too large or where it cannot work: taken, told or asked."""

from __future__ import annotations

from collections.abc import Iterator

import click
import pytest

from realitygap.cli import estimate, realitygap
from realitygap.cli.failure import tidy

POSE = ("probe", "avoidance", "--noise", 0, "--pose")


def options(command: click.Command, ctx: click.Context, path: str) -> Iterator[tuple[str, click.Command]]:
    """Every command that is no group, with its path."""
    own = click.Context(command, parent=ctx, info_name=command.name)
    if not isinstance(command, click.Group):
        yield path, command
        return
    for name in command.list_commands(own):
        inner = command.get_command(own, name)
        assert inner is not None
        yield from options(inner, own, f"{path} {name}".strip())


COMMANDS = dict(options(realitygap, click.Context(realitygap), ""))


@pytest.mark.parametrize("path", COMMANDS)
def test_an_option_with_one_value_is_taken_once(path):
    """Every option of every command: given twice it is refused, unless it may be repeated."""
    command, ctx = COMMANDS[path], click.Context(realitygap, info_name="realitygap")
    for param in command.params:
        if not isinstance(param, click.Option) or param.is_flag:
            continue
        words = [param.opts[0], *["1"] * param.nargs]
        if param.multiple:
            assert tidy(command, ctx, words * 2) == words * 2
            continue
        with pytest.raises(click.UsageError, match=f"{param.opts[0]}: expected once, got 2 times"):
            tidy(command, ctx, words * 2)


@pytest.mark.parametrize("path", COMMANDS)
def test_a_required_option_is_asked_for(path):
    """Every option without which a command cannot work is missed when it is left out."""
    ctx = click.Context(COMMANDS[path], info_name=path)
    for param in COMMANDS[path].params:
        if isinstance(param, click.Option) and param.required:
            with pytest.raises(click.MissingParameter):
                param.handle_parse_result(ctx, {}, [])


def test_a_command_in_a_group_is_looked_at_too(refused):
    """Also `twin serve`, whose option has two names."""
    assert "--twin-noise: expected once" in refused("twin", "serve", "--twin-noise", 1, "--noise", 2)


def test_several_levels_of_noise_are_several_conditions(call, tmp_path):
    """`evolve --noise 0 --noise 2` evolves at both; the same level twice is refused."""
    from realitygap import load_study

    words = ("evolve", "avoidance", "--evaluations", 3, "--set", "task.seconds=0.5", "--noise", "zero")
    sizes = ("--set", "retest_trials=1", "--set", "fresh_trials=1")
    made = call(*words, *sizes, "--noise", 2, "--out", tmp_path / "both")
    assert made.exit_code == 0, made.output
    assert [c.noise for c in load_study(tmp_path / "both").config.conditions] == [0.0, 2.0]
    assert "note: 3 evaluations are fewer than the population's 64" in made.stderr
    again = call(*words, "--noise", 0, "--out", tmp_path / "same")
    assert again.exit_code == 2 and "leave out the repetition" in again.stderr


@pytest.mark.parametrize("pose", [("25,25,90",), ("25", "25", "90"), ("25,", "25,", "90"), ("25, 25, 90",)])
def test_a_pose_may_have_commas(json_of, pose):
    """`--pose 25,25,90` is `--pose 25 25 90`."""
    assert json_of(*POSE, *pose) == json_of("probe", "avoidance", "--pose=25,25,90", "--noise", 0)


@pytest.mark.parametrize("pose", [("25,25",), ("25", "25"), ("25,25,90,1",), ()])
def test_a_pose_of_other_length_says_what_it_takes(refused, pose):
    """Too few or too many numbers are refused with an example of this command's."""
    line = refused(*POSE, *pose)
    assert "--pose: expected 3 numbers, X Y HEADING_DEG, such as --pose 25 25 90" in line
    assert "realitygap probe --help" in line


def test_a_room_without_a_lamp_is_told(call):
    """Light seeking where no lamp is goes on, with a note; with one there is none."""
    dark = call("probe", "light", "--arena", "obstacle-avoidance", "--pose", 25, 25, 0)
    assert dark.exit_code == 0 and "note: arena 'obstacle-avoidance' has no lamp" in dark.stderr
    assert call("probe", "light", "--pose", 25, 25, 0).stderr == ""


@pytest.mark.parametrize(
    ("work", "told"),
    [
        ({"runs": 1, "evaluations": 10**9}, "1,000,000,000 evaluations: about"),
        ({"trials": 10**6}, "1,000,000 trials on robots: about"),
        ({"runs": 30, "evaluations": 1000, "trials": 240}, None),
        ({"runs": 400, "evaluations": 1000, "trials": 9600}, None),
    ],
)
def test_work_of_days_is_estimated(capsys, work, told):
    """What takes half a day or more is said; the default studies pass without a word."""
    estimate.consider(**work, workers=2)
    said = capsys.readouterr().err
    assert (told in said and " days on this machine" in said) if told else said == ""


def test_work_of_days_is_asked_where_somebody_can_answer(monkeypatch):
    """On a terminal, "no" ends the command before anything is begun."""
    monkeypatch.setattr(estimate, "at_terminal", lambda: True)
    asked = []
    monkeypatch.setattr(click, "confirm", lambda text, **how: asked.append((text, how)))
    estimate.consider(trials=10**6, workers=1)
    estimate.consider(trials=10, workers=1)
    assert asked == [("Start?", {"abort": True, "err": True})]
