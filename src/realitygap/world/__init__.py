"""§3 and §4: the robot, its arenas, its noise, as frozen values read from TOML."""
