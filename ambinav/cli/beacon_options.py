"""Options on beacons whose distances a receiver on the robot measures."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Final

from ambinav.cli.checks import conflict
from ambinav.cli.limits import above_zero

if TYPE_CHECKING:
    from ambinav.geometry.environment import Environment
    from ambinav.maps.ambiguity_map import AmbiguityMap
    from ambinav.sensing.scanner import RangeScanner

LAYER: Final = "beacons"


@dataclass(frozen=True, kw_only=True)
class BeaconOptions:
    """Options on ultra-wideband beacons, for the layer `beacons`.

    Attributes:
        beacons (FILE): Points (.geojson or .wkt) of beacons whose distances the robot measures;
            adds the layer beacons. [default: none]
        beacon_std (M): Standard deviation of a distance, metres. [default: 0.1]
        beacon_range (M): Largest distance that is measured, metres. [default: 30]
    """

    PANEL: ClassVar[str] = "Beacons"

    beacons: Path | None = None
    beacon_std: Annotated[float | None, above_zero("0.1")] = None
    beacon_range: Annotated[float | None, above_zero("30")] = None

    def check(self, **others: bool) -> None:
        """Refuse a file without points, and options that do not go together.

        Args:
            others: Whether options that make no map for a layer are given, by name.

        Raises:
            InputError: a value or a combination of options cannot be used.
        """
        if self.beacons is None:
            conflict("--beacon-std", self.beacon_std is not None, "is for --beacons")
            conflict("--beacon-range", self.beacon_range is not None, "is for --beacons")
        else:
            for name, is_given in others.items():
                conflict("--beacons", is_given, f"is not for --{name}")
        self._options()

    def check_suited(self, environment: Environment, scanner: RangeScanner) -> None:
        """Refuse a building or a scanner without the layer, before the map is built.

        Raises:
            InputError: it is in space, or looks up and down.
        """
        from ambinav.layers.registry import chosen_layers

        chosen_layers([LAYER] if self.beacons else [], scanner, environment)

    def add(self, amap: AmbiguityMap, environment: Environment) -> AmbiguityMap:
        """Return a map with the layer, if there are beacons."""
        if self.beacons is None:
            return amap
        from ambinav.layers.build import with_layers

        return with_layers(amap, [LAYER], environment=environment, beacons=self._options())

    def _options(self) -> dict[str, Any]:
        """Return the options of the layer; without beacons none.

        Raises:
            InputError: the file cannot be read, or holds anything but points.
        """
        if self.beacons is None:
            return {}
        from ambinav.buildings.drawn_items import load_points

        options = {"std": self.beacon_std, "max_range": self.beacon_range}
        numbers = {name: value for name, value in options.items() if value is not None}
        return {"at": load_points(self.beacons), **numbers}
