"""Ambient light as measured: the extended form's optics, and a falling curve for each sensor.

What reaches a sensor (lamp, walls, lobe) is as the extended form found it; what it makes of that is a table
in place of a straight law between dark and floor.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from realitygap.calibration.curves import Curves, Seen, on_curves, smoothness
from realitygap.calibration.forms import with_columns
from realitygap.calibration.light import LightMemory, with_light
from realitygap.calibration.rows import Rows
from realitygap.calibration.solve import Values
from realitygap.values import Floats
from realitygap.world.profile import Profile

__all__ = ["LightCurves"]

EXTENDED = "extended"


class LightCurves:
    """The form "measured" of the ambient sensors, on the optics of the extended form's fit."""

    def __init__(self, rows: Rows, base: Profile, values: Values, noise: float) -> None:
        """Of `rows`, all of them, with the extended form's `values` from `base`; `noise` in counts."""
        self._rows, self._base = rows, base
        light = self._light(values)
        bright = light[rows.use & (light > 0)]
        self._knee = float(np.median(bright)) if len(bright) else 1.0
        top = rows.top
        seen = Seen(counts=top - rows.counts, use=rows.use, top=top, most=top, noise=noise)
        self._seen = smoothness(seen, self._share(light), rows.folds())
        self._values = values

    def model(self) -> Floats:
        """[n, A] what they read, counts."""
        return self._read(self._values, np.zeros(len(self._rows.counts), bool))

    def held_out(self, folds: Sequence[tuple[NDArray[np.bool_], Values]]) -> Floats:
        """[n, A] what they read on places held out, by the extended form's fits without each.

        Args:
            folds: [n] rows that were held out, and the values fitted without them.
        """
        out = self.model()
        for without, values in folds:
            out[without] = self._read(values, without)[without]
        return out

    def profile(self, extended: Profile) -> Profile:
        """The extended form's profile, with curves in place of its law; its gains may have been scaled."""
        law = extended.ambient
        before = with_light(self._base, self._values, EXTENDED).ambient.sensors
        scale = float(np.median([now.gain / s.gain for now, s in zip(law.sensors, before, strict=True)]))
        curves = self._curves(self._values, np.zeros(len(self._rows.counts), bool))
        falling = np.maximum(self._seen.top - curves, 0.0).round(3).tolist()
        sensors = with_columns(law.sensors, {"curve": [tuple(row) for row in falling]})
        measured = replace(law, response="measured", curve_light=self._knee * scale, sensors=sensors)
        return replace(extended, ambient=measured)

    def _light(self, values: Values) -> Floats:
        """[n, A] the light that reaches each sensor, times its gain."""
        made = with_light(self._base, values, EXTENDED)
        light = LightMemory().light(made, values, self._rows.scenes)
        return np.asarray(light * np.array([sensor.gain for sensor in made.ambient.sensors]))

    def _share(self, light: Floats) -> Floats:
        """[n, A] how far along its curve each reading lies."""
        root = np.sqrt(light)
        return np.asarray(root / (root + np.sqrt(self._knee)))

    def _curves(self, values: Values, without: NDArray[np.bool_]) -> Floats:
        seen = replace(self._seen, use=self._seen.use & ~without[:, None])
        return Curves(seen, self._share(self._light(values))).fitted()

    def _read(self, values: Values, without: NDArray[np.bool_]) -> Floats:
        return self._seen.top - on_curves(self._curves(values, without), self._share(self._light(values)))
