"""Context from which layers are computed: the building, the beams, the map's lattice."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ambinav.ambiguity.beam_table import BeamTable
from ambinav.ambiguity.feasible_poses import standing, standing_lattice
from ambinav.ambiguity.model import AmbiguityModel
from ambinav.ambiguity.returns import BEYOND, Returns, beam_returns
from ambinav.config import check_kind
from ambinav.geometry.environment import Environment
from ambinav.geometry.lattice import Lattice
from ambinav.layers.hits import Hits, beam_hits
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.runtime.array_types import Bools, Bytes, Floats, Floats32
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner

Cast = TypeVar("Cast")

WHOLE = slice(None)


@dataclass(frozen=True, eq=False)
class LayerContext:
    """An environment, the beams that take part, and the poses of a map: P free cells, K headings.

    Free cells are numbered row by row, as in `Lattice.index`. Casts are made when they are asked
    for; the latest of each kind is kept, so that layers computed in a row share it.

    Attributes:
        environment: The building.
        scanner: The beams that take part: those of the map, thinned as they were for it, and in
            the robot's centre if the map has no headings (`RangeScanner.centred`).
        lattice: The cells of the map.
        headings: Headings of the robot, float64, shape (K,), radians; [0] where the map has none.
        has_theta: Whether the map has headings: its layers are then of shape (ny, nx, K).
        model: The map's parameters.
        amap: The map itself, for layers that are made of others; None where there is none.
        mounted: The scanner before it was thinned: where any of its sensors stands inside a wall
            the pose is impossible. None: `scanner`.
    """

    environment: Environment
    scanner: RangeScanner
    lattice: Lattice
    headings: Floats
    has_theta: bool
    model: AmbiguityModel
    amap: AmbiguityMap | None = None
    mounted: RangeScanner | None = None
    _cache: dict[str, tuple[object, Any]] = field(default_factory=dict, init=False, repr=False)

    @classmethod
    def of(
        cls,
        amap: AmbiguityMap,
        environment: Environment | None = None,
        scanner: RangeScanner | None = None,
    ) -> LayerContext:
        """Make the context of a map.

        Args:
            amap: The map.
            environment: What it was built of, where that is at hand: its triangles are then not
                made again. None: as the map stores it.
            scanner: What the map is for, likewise.

        Raises:
            InputError: the map does not say how it was made.
        """
        check_kind(amap, AmbiguityMap, "amap")
        parameters = amap.parameters
        model_fields = {item.name for item in fields(AmbiguityModel)}
        missing = sorted((model_fields | {"beams_used"}) - parameters.keys())
        if missing or "scanner_yaml" not in amap.dataset.attrs:
            raise InputError(
                f"{amap.source}: its parameters lack {', '.join(missing) or 'the scanner'}, so no "
                "layer can be added; make the map again with `ambinav map`."
            )
        if scanner is None:
            scanner = RangeScanner.from_yaml_text(
                amap.dataset.attrs["scanner_yaml"], file=f"{amap.source}: scanner_yaml"
            )
        if not amap.has_theta:
            scanner = scanner.centred
        building = amap.environment if environment is None else environment
        lattice = Lattice(
            building,
            amap.spacing,
            np.asarray(amap.dataset["x"].values, dtype=np.float64),
            np.asarray(amap.dataset["y"].values, dtype=np.float64),
            np.ascontiguousarray(amap.dataset["free"].values, dtype=np.bool_),
        )
        headings = amap.dataset["theta"].values if amap.has_theta else np.zeros(1)
        return cls(
            building,
            _thinned(scanner, int(parameters["beams_used"]), amap.source),
            lattice,
            np.asarray(headings, dtype=np.float64),
            amap.has_theta,
            AmbiguityModel(**{name: parameters[name] for name in model_fields}),
            amap,
            scanner,
        )

    @property
    def full_scanner(self) -> RangeScanner:
        """Scanner with all beams, mounted as those of `scanner` are."""
        return self.mounted or self.scanner

    def over(self, lattice: Lattice) -> LayerContext:
        """Return the same on another lattice, without the points where the robot cannot stand.

        Raises:
            InputError: no point is left.
        """
        lattice, _ = standing_lattice(
            lattice, self.full_scanner, self.headings, self.model.robot_radius
        )
        return replace(self, lattice=lattice)

    @cached_property
    def possible(self) -> Bools:
        """Mask of the poses where the robot can stand, shape (P, K): see `standing`."""
        return standing(self.lattice, self.full_scanner, self.headings, self.model.robot_radius)

    def links(self, heading: int = 0) -> Bytes:
        """Return `Lattice.links` between cells where the robot can stand at this heading, (P,)."""
        return self.lattice.links_among(self.possible[:, heading])

    @property
    def sight(self) -> float:
        """Maximum distance from the robot's centre to a wall that affects a reading, metres."""
        scanner = self.full_scanner
        return float(np.hypot(*scanner.mounts[:, :2].T).max()) + scanner.max_range + BEYOND

    @property
    def turns_in_place(self) -> bool:
        """True if one heading represents all: after some turn on the spot the beams are equal."""
        return self.scanner.turns_in_place

    @property
    def free(self) -> Bools:
        """Cells where a robot can stand, shape (ny, nx)."""
        return self.lattice.free

    @property
    def spacing(self) -> float:
        """Distance between cells, metres."""
        return self.lattice.spacing

    @property
    def radius(self) -> float:
        """Radius R of the neighbourhood of the map's ambiguity, metres."""
        return self.model.radius

    @property
    def map_std(self) -> float:
        """Standard deviation of the walls' position, metres."""
        return self.model.map_std

    @cached_property
    def points(self) -> tuple[Floats, Floats]:
        """Coordinates x and y of the free cells' centres, each of shape (P,), metres."""
        return self.lattice.points

    @cached_property
    def table(self) -> BeamTable:
        """The beams, tabulated for the ambiguity kernel."""
        return BeamTable.of(
            self.scanner, self.model.map_std, self.model.outlier_share,
            self.environment.has_reflectors,
        )  # fmt: skip

    def poses(self, heading: int = 0) -> Floats:
        """Return x, y, theta of the free cells at the heading of this index, shape (P, 3)."""
        x, y = self.points
        return np.column_stack([x, y, np.full(len(x), self.headings[heading])])

    def hits(self, heading: int = 0, part: slice = WHOLE) -> Hits:
        """Return what the beams meet at the free cells `part`, at the heading of this index."""
        x, y = self.points

        def cast() -> Hits:
            angle = float(self.headings[heading])
            return beam_hits(self.environment, self.scanner, x[part], y[part], angle)

        return self.keep("hits", (heading, part.start, part.stop, part.step), cast)

    def returns(self, heading: int = 0, part: slice = WHOLE) -> Returns:
        """Return the ambiguity kernel's input at the free cells `part`; see `Returns`.

        1.3 kB a pose at 60 beams; give parts where the map may be large.
        """
        x, y = self.points

        def cast() -> Returns:
            here_x, here_y = x[part], y[part]
            data = np.zeros((len(here_x), 5, len(self.table.limit)), dtype=np.float32)
            data[:, 4] = 1.0
            beam_returns(
                self.environment, self.scanner, self.table, here_x, here_y,
                float(self.headings[heading]), data,
            )  # fmt: skip
            return Returns(data)

        return self.keep("returns", (heading, part.start, part.stop, part.step), cast)

    def spread(self, values: NDArray[Any]) -> Floats32:
        """Spread values of the free cells over the lattice, nan elsewhere.

        Args:
            values: Shape (P,) for what no heading changes, else (P, K), of which those at poses
                that are impossible become NaN.

        Returns:
            float32, shape (ny, nx), or (ny, nx, K) where the map has headings.
        """
        if values.ndim == 2:
            values = np.where(self.possible, values, np.nan)
            values = values if self.has_theta else values[:, 0]
        full = np.full((*self.free.shape, *values.shape[1:]), np.nan, dtype=np.float32)
        full[self.free] = values
        return full

    def keep(self, name: str, key: object, make: Callable[[], Cast]) -> Cast:
        """Return the result of `make`, cached from the last call if that had the same key.

        Only the latest result of each name is kept: layers computed in succession share it.
        """
        entry = self._cache.get(name)
        if entry is None or entry[0] != key:
            # Delete the old one first: two of them may not fit into memory.
            self._cache.pop(name, None)
            entry = self._cache[name] = (key, make())
        cached: Cast = entry[1]
        return cached


def _thinned(scanner: RangeScanner, used: int, source: str) -> RangeScanner:
    """Return the scanner with the beams a map was made with; the map stores only their number."""
    for beam_count in range(used, scanner.beams + 1):
        thinned = scanner.thinned(beam_count)
        if thinned.beams == used:
            return thinned
    raise InputError(
        f"{source}: beams_used is {used}, but scanner {scanner.name!r} cannot be thinned to that; "
        "make the map again with `ambinav map`."
    )
