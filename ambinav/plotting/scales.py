"""Scales for drawing layers: ends, powers, colours. Dark is badly localized."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
import xarray as xr
from matplotlib import colormaps
from matplotlib.colors import LogNorm, Normalize, to_hex

from ambinav.maps import schema
from ambinav.plotting import style
from ambinav.runtime.array_types import Floats

WIDE: Final = 1e4
"""Ratio of the highest values to the lowest from which an added layer is drawn on a log scale."""


class LayerScale(NamedTuple):
    """Scale for drawing a layer.

    Attributes:
        values: The layer as it is drawn: axes and angles in degrees, others within the ends.
        norm: Normalization of values to [0, 1], linear or by powers.
        colours: Name of the colour map.
        unit: Unit of `values`.
        unknown: Colour of what is not known, apart from those of the scale.
    """

    values: Floats
    norm: Normalize
    colours: str
    unit: str
    unknown: str

    def stops(self, count: int = 33) -> list[str]:
        """Return colours at even steps from one end of the scale to the other, hexadecimal."""
        return [to_hex(colour) for colour in colormaps[self.colours](np.linspace(0.0, 1.0, count))]


def layer_scale(layer: str, data: xr.DataArray, values: Floats) -> LayerScale:
    """Choose the scale of a layer.

    Args:
        layer: Its name, without suffix of a summary over headings.
        data: The layer, for its attributes.
        values: Values to draw, nan where nothing is drawn.
    """
    unit = str(data.attrs.get("units", ""))
    if unit == "rad" or schema.is_axis(layer):
        top = 180.0 if schema.is_axis(layer) else 360.0
        turned = np.mod(np.degrees(values), top)
        return LayerScale(
            turned, Normalize(0.0, top), "twilight", "degrees", style.UNKNOWN_BEHIND_ANGLES
        )
    # Perceptually uniform and fit for colour-blind eyes; turned round so that the bad places
    # are the dark ones. cividis fades into the greys.
    low_is_bad = data.attrs.get("worse") == "low" or data.attrs.get("better") == "high"
    norm = layer_norm(layer, values, added="source" in data.attrs)
    within = np.clip(values, norm.vmin, norm.vmax)
    return LayerScale(within, norm, "viridis" if low_is_bad else "viridis_r", unit, style.UNKNOWN)


def layer_norm(layer: str, values: Floats, *, added: bool) -> Normalize:
    """Return a scale up to the highest value, from 0 or below; by powers for a wide added layer."""
    if schema.is_share(layer):
        return Normalize(0.0, 1.0)
    finite = values[np.isfinite(values)]
    if not finite.size:
        return Normalize(0.0, 1.0)
    low, high = min(float(finite.min()), 0.0), float(finite.max())
    if added and low == 0.0 < high:
        # The lowest percentile is not usable as a limit: it may be almost zero.
        most, least = np.percentile(finite[finite > 0.0], [99.0, 1.0])
        if most > WIDE * least:
            return LogNorm(max(float(least), 1e-9 * high), high)
    return Normalize(low, high if high > low else low + 1.0)
