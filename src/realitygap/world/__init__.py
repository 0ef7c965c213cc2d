"""§3 and §4: the robot, its arenas, its noise, as frozen values read from TOML."""

from realitygap.world.arena import Arena, Cylinder, Lamp, arena_names, load_arena
from realitygap.world.robot import (
    NOISE_LEVELS,
    Profile,
    load_profile,
    noise_level,
    noise_name,
    profile_names,
)

__all__ = [
    "NOISE_LEVELS", "Arena", "Cylinder", "Lamp", "Profile", "arena_names", "load_arena", "load_profile",
    "noise_level", "noise_name", "profile_names",
]  # fmt: skip
