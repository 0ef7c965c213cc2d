"""Robots on a line of letters: table of commands, faults, safe stop, body; what a dialect says apart."""
