"""What a person types with commas, or where it cannot work: taken, or told."""

from __future__ import annotations

from collections.abc import Iterator

import click
import pytest

from realitygap.cli import realitygap

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
def test_a_required_option_is_asked_for(path):
    """Every option without which a command cannot work is missed when it is left out."""
    ctx = click.Context(COMMANDS[path], info_name=path)
    for param in COMMANDS[path].params:
        if isinstance(param, click.Option) and param.required:
            with pytest.raises(click.MissingParameter):
                param.handle_parse_result(ctx, {}, [])


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


@pytest.mark.parametrize("pose", [("25,25",), ("25", "25"), ()])
def test_a_pose_of_other_length_says_what_it_takes(refused, pose):
    """Too few numbers are refused."""
    assert "'--pose' requires 3 arguments" in refused(*POSE, *pose)


def test_a_room_without_a_lamp_is_told(call):
    """Light seeking where no lamp is goes on, with a note; with one there is none."""
    dark = call("probe", "light", "--arena", "obstacle-avoidance", "--pose", 25, 25, 0)
    assert dark.exit_code == 0 and "note: arena 'obstacle-avoidance' has no lamp" in dark.stderr
    assert call("probe", "light", "--pose", 25, 25, 0).stderr == ""
