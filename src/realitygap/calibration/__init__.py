"""§3.2.1 of the paper: recordings of a robot, curves through them, a profile, and its judge."""
