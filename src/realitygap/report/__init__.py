"""Figures 1 to 6, tables 1 and 2, and the page that shows them."""

from realitygap.errors import UsageError
from realitygap.lazy import names_of

try:
    import matplotlib  # noqa: F401
except ValueError as error:  # it reads the environment when first imported
    raise UsageError(f"MPLBACKEND: {error}. Name a backend of Matplotlib's, or unset it.") from None

__all__, __getattr__ = names_of(__name__, {
    "build": "build_report",
    "network": "draw_network",
    "drawing": "draw_path save_animation save_picture",
})  # fmt: skip
