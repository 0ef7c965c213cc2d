"""Data from controllers with known behaviour, made by `python -m tests.exemplars.make`."""
