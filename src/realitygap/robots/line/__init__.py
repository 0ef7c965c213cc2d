"""Robots on a line of letters: table of commands, faults, safe stop, body; dialects are apart."""
