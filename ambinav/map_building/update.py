"""Map of a changed building: updated where scans see the change, or built, as is faster."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ambinav.ambiguity.changes import Changes
from ambinav.ambiguity.dataset import clearance_layer, pose_layers, with_building, with_judged
from ambinav.config import check_kind
from ambinav.geometry.environment import Environment
from ambinav.geometry.lattice import Lattice
from ambinav.map_building.build import computed_lattice
from ambinav.map_building.map_change import SLACK, MapChange
from ambinav.map_building.patch import Patch
from ambinav.map_building.worth import ExpectedWork, build_seconds, is_small
from ambinav.maps import schema
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.judged_floor import FloorJudge
from ambinav.runtime.array_types import Bools, Bounds
from ambinav.runtime.errors import InputError
from ambinav.runtime.progress import Progress, reporter, within


def updated(
    amap: AmbiguityMap, env: Environment, *, progress: bool | Progress = False
) -> AmbiguityMap:
    """Return the map `build_map` makes of `env` with the settings of `amap`.

    Args:
        amap: A map.
        env: The building as it is now, see `Environment.edited`.
        progress: As `build_map` takes it.

    Returns:
        A map of its own, layers that were added to `amap` included.

    Raises:
        InputError: the map does not say how it was made, or was made by another version; or the
            robot can stand nowhere in `env`; or one of the two is in space and one is a plan; or
            the map does not keep its building in space.
    """
    check_kind(env, Environment, "env", "give what `Environment.edited` returns")
    # The building of the map itself is read only where it is needed.
    in_space = [env.space is not None, bool(amap.dataset.attrs.get("environment_space"))]
    if in_space[0] != in_space[1]:
        kinds = ["in space" if part else "a plan" for part in in_space]
        raise InputError(
            f"{env.name}: it is {kinds[0]}, and the building of the map is {kinds[1]}; make a new "
            "map with build_map."
        )
    if in_space[1] and "space" not in amap.dataset:
        raise InputError(
            f"{amap.source}: this map was made of a building in space, of which it keeps the floor "
            "alone, so that it is not known what changed; make a new map with build_map."
        )
    with reporter(progress, f"{env.name}, {amap.dataset.attrs['scanner']}") as report:
        return _Update(MapChange.of(amap, env)).run(report)


@dataclass(frozen=True, eq=False)
class _Update:
    """Update or build, whichever is faster.

    Attributes:
        change: Map, and the building in its present state.
    """

    change: MapChange

    @functools.cached_property
    def pays(self) -> bool:
        """True if an update is expected to take less time than to compute every pose."""
        change = self.change
        context = change.context
        seconds = build_seconds(
            int(change.was.sum()), context.scanner.beams, context.radius, change.spacing
        )
        # So small a map is made before it is known what changed.
        return not is_small(seconds) and self.work.pays(seconds)

    @functools.cached_property
    def work(self) -> ExpectedWork:
        """Work of an update, by a sample."""
        change = self.change
        reach = change.boxes(change.seen.reach + SLACK) if len(change.changes.edges) else []
        axes, radius = change.frame.axes(change.spacing), change.context.radius
        work = ExpectedWork.of(change.seen, reach, change.was_free, *axes, change.spacing, radius)
        grown = change.env.free.area / change.amap.environment.free.area - 1.0
        return work.with_more_floor(max(grown, 0.0))

    def run(self, report: Progress) -> AmbiguityMap:
        """Compute what changed, and copy the rest; or compute all where that is faster."""
        change = self.change
        context = change.context
        lattice, variables = self.patched(report) if self.pays else self.built(report)
        dataset = with_building(
            variables,
            lattice,
            change.scanner,
            context.scanner,
            context.model,
            change.theta,
            self.solid(lattice.free),
        )
        amap = AmbiguityMap(with_judged(dataset, self.judge()))
        if schema.added(change.amap.dataset):
            from ambinav.layers.recompute import Changed  # only where there are some

            still_free = lattice.free & change.after.taken(change.was_free, change.frame, False)

            def taken(values: NDArray[Any]) -> NDArray[Any]:
                old_values = change.after.taken(values, change.before, np.nan)
                old_values[~still_free] = np.nan
                return old_values

            boxes = change.boxes if self.pays else _everywhere
            amap = Changed(change.amap, amap, change.env, boxes, taken).with_layers()
        report(1.0)
        return amap

    def patched(self, report: Progress) -> tuple[Lattice, dict[str, xr.DataArray]]:
        """Return the lattice and its layers, computed where the change is seen."""
        return Patch(self.change, self.work.asks_cells).layers(report)

    def built(self, report: Progress) -> tuple[Lattice, dict[str, xr.DataArray]]:
        """Return the lattice and its layers, computed as `build_map` does."""
        change = self.change
        context = change.context
        lattice, results = computed_lattice(
            change.env, change.spacing, context.full_scanner, context.scanner, context.model,
            change.theta, within(report, 0.0, 0.95),
        )  # fmt: skip
        variables = pose_layers(lattice, context.model, change.theta, results)
        change.check_layers(variables)
        return lattice, variables | {"clearance": clearance_layer(lattice)}

    def solid(self, free: Bools) -> Bools | None:
        """Return solid cells of a building whose occupied cells are no longer known; else None.

        A map keeps the walls that were fitted to an occupancy grid, and which cells are solid, but
        not the grid (`AmbiguityMap.environment`).
        """
        change = self.change
        if change.env.occupancy is not None or change.env.resolution is None:
            return None
        if schema.BACKDROP not in change.amap.dataset:
            return None
        was = change.after.taken(
            change.amap.dataset["free"].values.astype(bool), change.before, False
        )
        solid = change.after.taken(change.amap.solid, change.before, False)
        mask: Bools = (solid & ~(free & ~was)) | (was & ~free)
        return mask

    def judge(self) -> FloorJudge:
        """Return the judge of the floor, recomputed only where room for a body changed.

        For a map whose own judge is not at hand the whole floor is judged again, as it would be for
        that.
        """
        change = self.change
        if not self.pays or "judge" not in vars(change.amap):
            judged = change.amap.judged
            return FloorJudge.for_robot(change.env, judged.radius, judged.start)
        old, changes = change.amap.environment, change.changes
        if old.drivable is not None or change.env.drivable is not None:
            changes = Changes.between(old, change.env, True)
        judge = change.amap.judge
        boxes = changes.boxes(judge.radius + SLACK) if len(changes.edges) else []
        return judge.changed(change.env, boxes)


def _everywhere(margin: float) -> list[Bounds]:
    """Return a box around everything, as `MapChange.boxes` gives boxes around the changes."""
    return [(-math.inf, -math.inf, math.inf, math.inf)]
