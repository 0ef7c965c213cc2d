"""The study of noise levels: does a simulation as noisy as the robot cross the gap best?

Every controller drives every unit of the twin, and is compared with the simulation at every level.
"""
