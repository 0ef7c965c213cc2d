"""The finished small study, as the tests of studies have it."""

from tests.study.conftest import finished, folder

__all__ = ["finished", "folder"]
