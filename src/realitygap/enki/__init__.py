"""Enki as a reality: EPFL's simulator of the Khepera, the e-puck and the Thymio II, in a process of its own.

Only the units are ours: gains, directions and wheels, drawn from a unit's number on top of its
published models (`unit.py`). Its noise is its own, with a scale; its step is 20 ms. The library is under the
GNU General Public License, version 2 or later. So it stays behind a pipe: `process.py` compiles a small
program at first use, with the system's compiler, and talks to it.
"""
