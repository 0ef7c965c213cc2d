"""Measure or randomise? What the simulation knows of a robot, held against constants drawn by chance."""
