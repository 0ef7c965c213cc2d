"""The commands' tests call them as those in tests/cli do."""

from tests.cli.conftest import call, json_of, refused  # noqa: F401
