"""Data from controllers with known behaviour, made by studies/correspondence/run.py in the repository."""
