"""`--resume` where there is nothing to resume, and Ctrl-C before anything was begun."""

from __future__ import annotations

import pytest

COMMANDS = {
    "realitygap.study.runner.open_folder": ("evolve", "light"),
    "realitygap.experiments.reproduction.open_to_begin": ("reproduce",),
    "realitygap.experiments.noise_run.check_robot": ("experiment", "noise"),
    "realitygap.experiments.realities.check_robot": ("realities", "--only", "--robot", "twin"),
}
"""Commands, by what each calls before it keeps its settings."""


@pytest.mark.parametrize("first", COMMANDS, ids=lambda first: COMMANDS[first][-1])
def test_a_mistyped_folder_is_noted_and_ctrl_c_promises_nothing(first, call, monkeypatch, tmp_path):
    """--resume of a folder without work says that it starts anew; stopped before that, no command is told
    that would go on with the usual settings instead of those that were given."""

    def stopped(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(first, stopped)
    result = call(*COMMANDS[first], "--resume", "--out", tmp_path / "mistyped", "--workers", 1)
    assert result.exit_code == 130 and result.stdout == ""
    noted, *_, said = result.stderr.splitlines()
    assert noted.startswith(f"note: --resume: nothing was begun in {tmp_path / 'mistyped'}; starting there")
    assert said == f"stopped before the work in {tmp_path / 'mistyped'} began; give the command again"
