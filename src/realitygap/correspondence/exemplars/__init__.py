"""What was learnt from controllers whose behaviour is known: made by `python -m tests.exemplars.make`."""
