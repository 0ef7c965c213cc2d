"""A finished small study, made once."""

from tests.study.conftest import finished

__all__ = ["finished"]
