"""Map of a building, and the building as it is now."""

from __future__ import annotations

import functools
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambinav.ambiguity.changes import Changes
from ambinav.geometry.environment import Environment
from ambinav.geometry.lattice import Lattice
from ambinav.layers.context import LayerContext
from ambinav.map_building.frame import Frame
from ambinav.map_building.seen_changes import SeenChanges
from ambinav.maps import schema
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.core_layers import CORE_LAYERS
from ambinav.maps.part import is_part
from ambinav.runtime.array_types import Bools, Bounds, Floats
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner

# A window reaches this much farther than what is asked in it, metres.
SLACK = 0.1
# With more edges than this, one box is laid around all of them.
MOST_LINES = 1000
# More boxes than this are merged into one.
MOST_BOXES = 24


@dataclass(frozen=True, eq=False)
class MapChange:
    """Map, and the building in its present state.

    Attributes:
        amap: The map.
        env: The building.
        context: Scanner, headings and parameters of the map.
        scanner: The scanner as it was given.
        spacing: Spacing of the lattice, metres.
        before: Lattice of the map.
        after: Lattice of the building.
        frame: Around both.
    """

    amap: AmbiguityMap
    env: Environment
    context: LayerContext
    scanner: RangeScanner
    spacing: float
    before: Frame
    after: Frame
    frame: Frame

    @classmethod
    def of(cls, amap: AmbiguityMap, env: Environment) -> MapChange:
        """Compare the building with that of the map."""
        text = amap.dataset.attrs.get("scanner_yaml")
        scanner = None if text is None else _scanner_of(text)
        # It refuses a map without.
        context = LayerContext.of(amap, env, scanner)
        spacing = float(amap.parameters.get("spacing", amap.spacing))
        before = Frame.of(amap.dataset["x"].values, amap.dataset["y"].values, spacing)
        after = Frame.of(*Lattice.axes(env, spacing), spacing)
        if is_part(amap):
            raise InputError(
                f"{env.name}: the map is a part of its building and cannot be updated; open it "
                "without bounds, or build the map of the changed building."
            )
        return cls(
            amap,
            env,
            context,
            scanner or context.scanner,
            spacing,
            before,
            after,
            before.around(after),
        )

    @functools.cached_property
    def changes(self) -> Changes:
        """Between the two buildings."""
        body = self.context.model.robot_radius > 0.0
        return Changes.between(self.amap.environment, self.env, body)

    @functools.cached_property
    def seen(self) -> SeenChanges:
        """The changes as the scanner sees them."""
        return SeenChanges(self.amap.environment, self.env, self.changes, self.context)

    @property
    def theta(self) -> Floats | None:
        """Headings, radians; None for a map without headings."""
        return self.context.headings if self.context.has_theta else None

    @functools.cached_property
    def was(self) -> Bools:
        """True where the robot could stand before, over the frame and the headings."""
        return self.frame.taken(self.amap.possible, self.before, False)

    @functools.cached_property
    def was_free(self) -> Bools:
        """True where it could at some heading, over the frame."""
        free: Bools = np.any(self.was, axis=2)
        return free

    def boxes(self, margin: float) -> list[Bounds]:
        """Return boxes around all changes, with a margin, metres; one if there are many."""
        ends = self.changes.edges.reshape(-1, 2)
        if len(ends) <= 2 * MOST_LINES:
            boxes = self.changes.boxes(margin)
            if len(boxes) <= MOST_BOXES:
                return boxes
        (left, low), (right, high) = ends.min(axis=0) - margin, ends.max(axis=0) + margin
        return [(float(left), float(low), float(right), float(high))]

    def inner(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return the values over the frame, on the new lattice only."""
        return self.after.taken(values, self.frame, False)

    @property
    def names(self) -> list[str]:
        """Layers of the map that the beams determine."""
        return [
            str(name)
            for name in self.amap.dataset.data_vars
            if name in self.amap.layers
            and schema.base_name(str(name)) in CORE_LAYERS
            and name not in ("free", "clearance", "judged")
        ]

    def check_layers(self, fresh: Iterable[str]) -> None:
        """Check that the layers that are computed are those of the map.

        Raises:
            InputError: they are not.
        """
        if odd := ", ".join(sorted(set(fresh) ^ set(self.names))):
            raise InputError(
                f"{self.amap.source}: it was made by another version of ambinav, which differs in "
                f"{odd}; make the map again with `ambinav map`."
            )


@functools.lru_cache(maxsize=8)
def _scanner_of(text: str) -> RangeScanner:
    """Parse and cache a map's scanner, as interactive edits update maps several times a second."""
    return RangeScanner.from_yaml_text(text, file="scanner_yaml")
