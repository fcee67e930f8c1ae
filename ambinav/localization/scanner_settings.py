"""Settings of Monte Carlo localization that suit a scanner; they are defined only here.

AMCL's defaults are made for lasers, and lasers keep them. For cones (sonars, wide time-of-flight
sensors) three things are wrong with them. A likelihood field takes an echo to come from the axis
of its cone, and draws the estimate off walls that are seen aslant; it learns nothing from "no
echo", which a sonar often reads; and sums of cubes weigh the best of the particles only a few
times as much as the worst, which the few beams of a ring never make up for. The ray model takes
the nearest echo of the whole cone, and multiplied beams are what the book has (Probabilistic
Robotics, section 6.1). docs/compare.md has the figures, benchmarks/bench_sonar.py makes them.

Lasers that look up and down end on floors, ceilings and tables too, which no likelihood field of a
plan knows: they take the ray model as well, and cast their rays.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from ambinav.sensing.scanner import RangeScanner

CONE_RAYS: Final[Mapping[str, Any]] = MappingProxyType({
    "z_hit": 0.7, "z_max": 0.2, "z_short": 0.05, "z_rand": 0.05, "beam_table_resolution": 0.1,
})  # fmt: skip
"""Parameters of the ray model of cones, whether its beams are added up or multiplied."""

CONE_PRODUCT: Final[Mapping[str, Any]] = MappingProxyType(
    {**CONE_RAYS, "laser_model_type": "beam_prob", "importance_factor": 0.3, "sigma_hit": 0.1}
)
"""Default parameters for scanners with cones."""

LAYERS_PRODUCT: Final[Mapping[str, Any]] = MappingProxyType(
    {**CONE_PRODUCT, "beam_table_resolution": 0.0}
)
"""Parameters for lasers with several elevations: their rays are cast, not looked up."""

FIELDS: Final = ("likelihood_field", "likelihood_field_prob")
"""Models that look up how far a beam's end point is from a wall."""


def has_cones(scanner: RangeScanner) -> bool:
    """Return whether any sensor of the scanner has a cone."""
    return any(sensor.aperture > 0.0 for sensor in scanner.sensors)


def settings_for(scanner: RangeScanner, model: str | None = None) -> dict[str, Any]:
    """Return localization parameters that suit a scanner, where they differ from AMCL's.

    Args:
        scanner: The scanner.
        model: The laser_model_type that the user has chosen; None: the one that suits the scanner.

    Returns:
        Nothing for level scanners without cones. With cones those of `CONE_PRODUCT`; of a chosen
        "beam" those of `CONE_RAYS`, and of a chosen likelihood field nothing: it is AMCL's own. Of
        lasers that look up or down those of `LAYERS_PRODUCT`, if no model is chosen; beside cones
        their rays are cast too.
    """
    if not has_cones(scanner):
        return dict(LAYERS_PRODUCT) if model is None and not scanner.level else {}
    if model in FIELDS:
        return {}
    settings = dict(CONE_RAYS if model == "beam" else CONE_PRODUCT)
    if not scanner.level and any(sensor.aperture == 0.0 for sensor in scanner.sensors):
        # A table for each elevation would not fit into memory.
        settings["beam_table_resolution"] = 0.0
    return settings


def unsuited(model: str, scanner: RangeScanner) -> str | None:
    """Explain why a laser_model_type cannot use the scanner; None if it can."""
    if model not in FIELDS:
        return None
    if not scanner.level:
        return (
            f"the localizer's laser_model_type {model} takes every echo to come from a wall of the "
            f"plan, and beams of scanner {scanner.name!r} end on floors, ceilings and furniture "
            "too; take what suits the scanner (type mcl without a laser_model_type, or "
            "MclParameters.for_scanner), or choose beam_prob."
        )
    if not has_cones(scanner):
        return None
    return (
        f"the localizer's laser_model_type {model} takes every echo to come from the axis of its "
        f"beam and learns nothing from a missing one, so it loses robots where scanner "
        f"{scanner.name!r}, which has cones, would not; take what suits the scanner (type mcl "
        "without a laser_model_type, or MclParameters.for_scanner), or choose beam_prob."
    )
