"""Measure or randomise? The simulation's knowledge of a robot, compared with randomly drawn constants."""
