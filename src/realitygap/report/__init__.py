"""Figures 1 to 6, tables 1 and 2, and the page that shows them."""

from realitygap.lazy import names_of

__all__, __getattr__ = names_of(__name__, {
    "build": "build_report",
    "network": "draw_network",
    "drawing": "draw_path save_animation save_picture",
})  # fmt: skip
