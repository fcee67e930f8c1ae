"""Core layers of every ambiguity map, one record each.

Layers that are added (`ambinav.layers`) say the same of themselves, and how they are
computed besides.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

from ambinav.maps.zones import ZONES

AGGREGATES: Final = ("mean", "best", "worst")
"""Suffixes of the two-dimensional summaries over heading: `level_mean`, `level_best` ..."""

_MODEL: Final = "own model (docs/model.md) on the definition of Ruiz-Mayor et al. 2017"
_GEOMETRY: Final = "the environment alone"


@dataclass(frozen=True, kw_only=True)
class LayerRecord:
    """Description of a layer of a map.

    Attributes:
        name: Lower-case letters, digits and underscores; the variable in the map's dataset.
        title: What legends call it, without the unit.
        unit: "m", "1", "bits" ...
        source: Paper and equation, in a line.
        worse: Which end means badly localized; None: neither.
    """

    name: str
    title: str
    unit: str
    source: str
    worse: Literal["high", "low"] | None


@dataclass(frozen=True, kw_only=True)
class CoreLayer(LayerRecord):
    """Layer that `build_map` always computes.

    Attributes:
        read: How values between cells are read: linearly, as an axis (an angle with period pi),
            or from the nearest cell, where values in between mean nothing.
        share: Whether it runs from 0 to 1: drawn on that scale, so that pictures can be compared.
        summaries: Of `AGGREGATES` those of its values that a map with headings keeps. (The mean
            of `direction` is that of the mean tensor and the one of `zone` that of most headings,
            and not listed here.)
        required: Whether a dataset without it is no ambiguity map.
    """

    read: Literal["linear", "axis", "nearest"] = "linear"
    share: bool = False
    summaries: tuple[str, ...] = ()
    required: bool = True


CORE_LAYERS: Final = {
    record.name: record
    for record in (
        CoreLayer(
            name="ambiguity", unit="1", worse="high", source=_MODEL,
            title="probability that a neighbouring pose gives the same scan",
            share=True, summaries=AGGREGATES,
        ),
        CoreLayer(
            name="major", unit="1", worse="high", source=_MODEL,
            title="major ambiguity radius relative to the free neighbourhood",
            share=True, summaries=AGGREGATES,
        ),
        CoreLayer(
            name="minor", unit="1", worse="high", source=_MODEL,
            title="minor ambiguity radius relative to the free neighbourhood",
            share=True, summaries=AGGREGATES,
        ),
        CoreLayer(
            name="level", unit="1", worse="high", source=_MODEL,
            title="ambiguity level, mean of major and minor",
            share=True, summaries=AGGREGATES,
        ),
        CoreLayer(
            name="major_radius", unit="m", worse="high", source=_MODEL,
            title="how far the robot can slide unseen in the weak direction",
            summaries=("mean",),
        ),
        CoreLayer(
            name="minor_radius", unit="m", worse="high", source=_MODEL,
            title="how far the robot can slide unseen across the weak direction",
            summaries=("mean",),
        ),
        CoreLayer(
            name="direction", unit="rad", worse=None, source=_MODEL,
            title="weak direction, axis of the major radius",
            read="axis",
        ),
        CoreLayer(
            name="zone", unit="code", worse=None, source=_MODEL,
            title=", ".join(f"{code}: {name}" for code, name in enumerate(ZONES)),
            read="nearest", summaries=("best", "worst"),
        ),
        CoreLayer(
            name="free", unit="bool", worse=None, source=_GEOMETRY,
            title="in the free space, and possible for body and sensors at some heading",
            read="nearest",
        ),
        CoreLayer(
            name="judged", unit="code", worse=None, source=_GEOMETRY,
            title="0: counts in every figure; 1: unexplored, 2: too close to walls, "
            "3: not reachable, 4: outside of the building",
            read="nearest", required=False,
        ),
        CoreLayer(
            name="clearance", unit="m", worse="high",
            title="distance to the nearest wall or frontier",
            source="own: a rule of thumb, which coastal navigation improves on "
            "(Roy et al. 1999, ICRA)",
        ),
        CoreLayer(
            name="heading", unit="1", worse="high", source=_MODEL,
            title="how far the robot can turn unseen, relative to all turns within 45 degrees",
            share=True, required=False,
        ),
        CoreLayer(
            name="heading_radius", unit="rad", worse="high", source=_MODEL,
            title="how far the robot can turn unseen, within 45 degrees to both sides",
            required=False,
        ),
        CoreLayer(
            name="unknown", unit="1", worse="high", source=_GEOMETRY,
            title="share of the beams that end in unknown space, over possible headings",
            required=False,
        ),
        CoreLayer(
            name="best_heading", unit="rad", worse=None, source=_MODEL,
            title="heading of the lowest level",
            read="nearest", required=False,
        ),
    )
}  # fmt: skip
"""By name, in the order of a dataset."""
