"""Measure or randomise? What the simulation knows of a robot, compared with constants drawn by chance."""
