"""The twin: a stand-in for reality, of which the simulation knows nothing and which knows nothing of it.

Physics by MuJoCo, sensor laws of its own, reached as a robot is: through a serial line and a camera.
The literature calls it pseudo-reality (Ligot and Birattari, Swarm Intelligence 2020).
"""

from realitygap.lazy import names_of

__all__, __getattr__ = names_of(__name__, {
    "body": "TwinBody",
    "camera": "OverheadCamera",
    "unit": "Unit draw_unit",
})  # fmt: skip
