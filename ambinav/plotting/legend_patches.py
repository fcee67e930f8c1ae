"""Legend entries of what a floor is painted with."""

from __future__ import annotations

from collections.abc import Iterable

from matplotlib.artist import Artist
from matplotlib.patches import Patch

from ambinav.maps.judged_floor import JudgedFloor
from ambinav.maps.zones import ZONES
from ambinav.plotting import style


def colour_patch(colour: str, label: str) -> Patch:
    """Return a legend entry for a colour of the floor."""
    return Patch(facecolor=colour, edgecolor=style.EDGE, linewidth=0.6, label=label)


def zone_patches() -> list[Artist]:
    """Return legend entries for the zones."""
    return [colour_patch(*entry) for entry in zip(style.ZONE_COLOURS, ZONES, strict=True)]


def zoneless_patches(
    parts: Iterable[JudgedFloor], unreachable: str = "not reachable"
) -> list[Artist]:
    """Return legend entries for floor without a zone, if any of the floors has such."""
    every = tuple(parts)
    patches: list[Artist] = []
    if any(part.unexplored.any() for part in every):
        patches.append(unexplored_patch("unexplored"))
    if any(part.unreachable.any() for part in every):
        patches.append(colour_patch(style.UNREACHABLE, unreachable))
    return patches


def unexplored_patch(label: str) -> Patch:
    """Return a legend entry for unexplored floor."""
    return Patch(
        facecolor=style.UNKNOWN,
        edgecolor=style.UNEXPLORED,
        hatch="/////",
        linewidth=0.6,
        label=label,
    )
