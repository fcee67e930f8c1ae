"""Map of a changed building, recomputed only where scans see the change.

A pose's ambiguity depends on its own scan, on those of the poses in its neighbourhood, and on where
a robot can stand and go there. So a pose is computed again if in its neighbourhood

- a robot can stand where it could not before, or the other way round;
- a changed wall is near enough to part neighbours of the lattice; or
- a ray meets a wall that is new, or met one that is gone (`ambinav.ambiguity.sight`); in a mesh a
  beam returns something else.

All else is taken over. Numbers are those of `build_map`, which does the same at every pose.
"""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
import xarray as xr
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from ambinav.ambiguity.changes import Changes
from ambinav.ambiguity.dataset import clearance_layer, pose_layers, with_building, with_judged
from ambinav.ambiguity.feasible_poses import standing
from ambinav.ambiguity.neighbourhoods import disc
from ambinav.ambiguity.returns import BEYOND
from ambinav.config import check_kind
from ambinav.geometry.environment import Environment
from ambinav.geometry.lattice import Lattice, slices_in
from ambinav.layers.context import LayerContext
from ambinav.map_building.build import computed_lattice, reporter
from ambinav.map_building.frame import Frame
from ambinav.map_building.seen_changes import SeenChanges
from ambinav.map_building.selection import ChosenPoses
from ambinav.map_building.worth import ExpectedWork, build_seconds, is_small
from ambinav.maps import schema
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.core_layers import CORE_LAYERS
from ambinav.maps.judged_floor import FloorJudge
from ambinav.maps.part import is_part
from ambinav.maps.zones import NOT_FREE
from ambinav.runtime.array_types import Bools, Bounds, Floats
from ambinav.runtime.errors import InputError
from ambinav.runtime.progress import Progress, within
from ambinav.sensing.scanner import RangeScanner

# Points of the lattice within so many spacings of a wall may be parted by it from a neighbour.
PARTED = 1.5
# A window reaches this much farther than what is asked in it, metres.
SLACK = 0.1
# With more edges than this, one box is laid around all of them.
MOST_LINES = 1000
# More boxes than this are merged into one.
MOST_BOXES = 24


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
            robot can stand nowhere in `env`; or one of the two is in space and one is a plan.
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
    with reporter(progress, f"{env.name}, {amap.dataset.attrs['scanner']}") as report:
        return _Update.of(amap, env).run(report)


@dataclass(frozen=True, eq=False)
class _Update:
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
    def of(cls, amap: AmbiguityMap, env: Environment) -> _Update:
        """Compare the building with that of the map."""
        text = amap.dataset.attrs.get("scanner_yaml")
        scanner = None if text is None else _scanner_of(text)
        # It refuses a map without.
        context = LayerContext.of(amap, env, scanner)
        spacing = float(json.loads(amap.dataset.attrs["parameters"]).get("spacing", amap.spacing))
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
    def seen(self) -> SeenChanges:
        """The changes as the scanner sees them."""
        return SeenChanges(self.amap.environment, self.env, self.changes, self.context)

    @property
    def theta(self) -> Floats | None:
        """Headings, radians; None for a map without headings."""
        return self.context.headings if self.context.has_theta else None

    @functools.cached_property
    def changes(self) -> Changes:
        """Between the two buildings."""
        body = self.context.model.robot_radius > 0.0
        return Changes.between(self.amap.environment, self.env, body)

    @functools.cached_property
    def was(self) -> Bools:
        """Where the robot could stand before, over the frame and the headings."""
        return self.frame.taken(self.amap.possible, self.before, False)

    @functools.cached_property
    def was_free(self) -> Bools:
        """Where it could at some heading, over the frame."""
        free: Bools = np.any(self.was, axis=2)
        return free

    @functools.cached_property
    def pays(self) -> bool:
        """Whether an update is expected to take less time than to compute every pose."""
        context = self.context
        seconds = build_seconds(
            int(self.was.sum()), context.scanner.beams, context.radius, self.spacing
        )
        # So small a map is made before it is known what changed.
        return not is_small(seconds) and self.work.pays(seconds)

    @functools.cached_property
    def work(self) -> ExpectedWork:
        """Work of an update, by a sample."""
        reach = self.boxes(self.seen.reach + SLACK) if len(self.changes.edges) else []
        axes, radius = self.frame.axes(self.spacing), self.context.radius
        work = ExpectedWork.of(self.seen, reach, self.was_free, *axes, self.spacing, radius)
        grown = self.env.free.area / self.amap.environment.free.area - 1.0
        return work.with_more_floor(max(grown, 0.0))

    def run(self, report: Progress) -> AmbiguityMap:
        """Compute what changed, and copy the rest; or compute all where that is faster."""
        context = self.context
        lattice, variables = self.patched(report) if self.pays else self.built(report)
        dataset = with_building(
            variables,
            lattice,
            self.scanner,
            context.scanner,
            context.model,
            self.theta,
            self.solid(lattice.free),
        )
        amap = AmbiguityMap(with_judged(dataset, self.judge()))
        if schema.added(self.amap.dataset):
            from ambinav.layers.recompute import Changed  # only where there are some

            kept = lattice.free & self.after.taken(self.was_free, self.frame, False)

            def taken(values: NDArray[Any]) -> NDArray[Any]:
                old_values = self.after.taken(values, self.before, np.nan)
                old_values[~kept] = np.nan
                return old_values

            boxes = self.boxes if self.pays else _everywhere
            amap = Changed(self.amap, amap, self.env, boxes, taken).with_layers()
        report(1.0)
        return amap

    def patched(self, report: Progress) -> tuple[Lattice, dict[str, xr.DataArray]]:
        """Return the lattice and its layers, computed where the change is seen."""
        possible = self.possible()
        free: Bools = np.any(possible, axis=2)
        if not free.any():
            raise InputError(
                f"{self.env.name}: at no point of the lattice the robot fits; give it more room."
            )
        stale = self.stale(possible)
        affected: Bools = self.dilated(stale) & free
        patch = self.computed(possible, affected, report)
        variables = self.merged(patch, self.inner(free), self.inner(affected))
        x, y = self.after.axes(self.spacing)
        return Lattice(self.env, self.spacing, x, y, self.inner(free)), variables

    def built(self, report: Progress) -> tuple[Lattice, dict[str, xr.DataArray]]:
        """Return the lattice and its layers, computed as `build_map` does."""
        context = self.context
        lattice, results = computed_lattice(
            self.env, self.spacing, context.full_scanner, context.scanner, context.model,
            self.theta, within(report, 0.0, 0.95),
        )  # fmt: skip
        variables = pose_layers(lattice, context.model, self.theta, results)
        self.check_layers(variables)
        return lattice, variables | {"clearance": clearance_layer(lattice)}

    def solid(self, free: Bools) -> Bools | None:
        """Return solid cells of a building whose occupied cells are no longer known; else None.

        A map keeps the walls that were fitted to an occupancy grid, and which cells are solid, but
        not the grid (`AmbiguityMap.environment`).
        """
        if self.env.occupancy is not None or self.env.resolution is None:
            return None
        if schema.BACKDROP not in self.amap.dataset:
            return None
        was = self.after.taken(self.amap.dataset["free"].values.astype(bool), self.before, False)
        solid = self.after.taken(self.amap.solid, self.before, False)
        mask: Bools = (solid & ~(free & ~was)) | (was & ~free)
        return mask

    def inner(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return the values over the frame, on the new lattice only."""
        return self.after.taken(values, self.frame, False)

    def judge(self) -> FloorJudge:
        """Return the judge of the floor, recomputed only where room for a body changed.

        For a map whose own judge is not at hand the whole floor is judged again, as it would be for
        that.
        """
        if not self.pays or "judge" not in vars(self.amap):
            judged = self.amap.judged
            return FloorJudge.for_robot(self.env, judged.radius, judged.start)
        old, changes = self.amap.environment, self.changes
        if old.drivable is not None or self.env.drivable is not None:
            changes = Changes.between(old, self.env, True)
        judge = self.amap.judge
        boxes = changes.boxes(judge.radius + SLACK) if len(changes.edges) else []
        return judge.changed(self.env, boxes)

    def possible(self) -> Bools:
        """Return where the robot can stand now, over the frame and the headings."""
        possible = self.was.copy()
        context, x, y = self.context, *self.frame.axes(self.spacing)
        offset = float(np.hypot(*context.full_scanner.mounts[:, :2].T).max())
        margin = offset + context.model.robot_radius + SLACK
        for box in self.boxes(margin):
            rows, columns = slices_in(box, x, y)
            window = self.window(box, margin)
            here = possible[rows, columns]
            here[:] = False
            if window is None or not here.size:
                continue
            xs, ys = np.meshgrid(x[columns], y[rows])
            inside = window.triangulation.contains(xs.ravel(), ys.ravel()).reshape(xs.shape)
            lattice = Lattice(window, self.spacing, x[columns], y[rows], inside)
            here[inside] = standing(
                lattice, context.full_scanner, context.headings, context.model.robot_radius
            )
        return possible

    def boxes(self, margin: float) -> list[Bounds]:
        """Return boxes around all changes, with a margin, metres; one if there are many."""
        ends = self.changes.edges.reshape(-1, 2)
        if len(ends) <= 2 * MOST_LINES:
            boxes = self.changes.boxes(margin)
            if len(boxes) <= MOST_BOXES:
                return boxes
        (left, low), (right, high) = ends.min(axis=0) - margin, ends.max(axis=0) + margin
        return [(float(left), float(low), float(right), float(high))]

    def stale(self, possible: Bools) -> Bools:
        """Return the frame's cells where a scan, a link or the possibility to stand changed."""
        stale: Bools = (self.was != possible).any(axis=2)
        changes, (x, y) = self.changes, self.frame.axes(self.spacing)
        if not len(changes.edges):
            return stale
        free = possible.any(axis=2)
        in_reach = np.zeros_like(stale)
        for box in self.boxes(self.seen.reach + SLACK):
            in_reach[slices_in(box, x, y)] = True
        if not self.work.asked:
            return stale | (in_reach & free)
        edges = shapely.multilinestrings(list(changes.edges.reshape(-1, 2, 2)))
        shapely.prepare(edges)
        near = PARTED * self.spacing
        for box in self.boxes(near):
            rows, columns = slices_in(box, x, y)
            xs, ys = np.meshgrid(x[columns], y[rows])
            stale[rows, columns] |= shapely.dwithin(edges, shapely.points(xs, ys), near)
        row, column = np.nonzero(in_reach & free & ~stale)
        stale[row, column] = self.seen.by(x[column], y[row])
        return stale

    def window(self, box: Bounds, margin: float) -> Environment | None:
        """Return the building in a box with a margin, metres; None where no free space is."""
        around = (box[0] - margin, box[1] - margin, box[2] + margin, box[3] + margin)
        return self.env.window(around, footprints=self.context.model.robot_radius > 0.0)

    def dilated(self, cells: Bools) -> Bools:
        """Return the cells within the neighbourhood's radius of the given cells."""
        near = np.zeros_like(cells)
        row, column = np.nonzero(cells)
        if not len(row):
            return near
        reach = int(disc(self.context.model.radius, self.spacing).max())
        part = (
            slice(max(int(row.min()) - reach, 0), int(row.max()) + reach + 1),
            slice(max(int(column.min()) - reach, 0), int(column.max()) + reach + 1),
        )
        away = distance_transform_edt(~cells[part])
        # As `disc` has it.
        near[part] = away <= self.context.model.radius / self.spacing * (1 + 5e-10)
        return near

    def computed(
        self, possible: Bools, affected: Bools, report: Progress
    ) -> dict[str, NDArray[Any]]:
        """Compute layers at the M affected cells, row by row, (M, ...); none if there are none."""
        if not affected.any():
            return {}
        context, table = self.context, self.context.table
        needed = self.dilated(affected) & possible.any(axis=2)
        x, y = self.frame.axes(self.spacing)
        row, column = np.nonzero(needed)
        rows, columns = (slice(int(v.min()), int(v.max()) + 1) for v in (row, column))
        reach = float(np.hypot(*context.scanner.mounts[:, :2].T).max())
        reach += context.scanner.max_range + BEYOND + SLACK
        box = (x[column.min()], y[row.min()], x[column.max()], y[row.max()])
        window = self.window(box, reach) or self.env
        around = Lattice(window, self.spacing, x[columns], y[rows], needed[rows, columns])
        chosen = affected[rows, columns]
        poses = ChosenPoses(
            context.scanner, table, context.model, context.headings,
            "heading" in self.amap.dataset,
        )  # fmt: skip
        stands, picked = possible[rows, columns][around.free], chosen[around.free]
        results = poses.sums(around, stands, picked, within(report, 0.0, 0.95))
        lattice = Lattice(window, self.spacing, x[columns], y[rows], chosen)
        layers = pose_layers(lattice, context.model, self.theta, results)
        return {name: array.values[chosen] for name, array in layers.items()}

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

    def merged(
        self, patch: dict[str, NDArray[Any]], free: Bools, affected: Bools
    ) -> dict[str, xr.DataArray]:
        """Merge the map's layers, on the new lattice, with those of the patch where it has them."""
        old, names = self.amap.dataset, self.names
        if patch:
            self.check_layers(patch)
        # Many times faster than the masks themselves.
        was = self.inner(self.was_free)
        gone, fresh = np.nonzero(was & ~free), np.nonzero(affected)
        variables = {}
        for name in patch or names:
            before = old.variables[name]
            values = self.after.taken(before.values, self.before, _empty(name))
            values[gone] = _empty(name)
            if patch:
                values[fresh] = patch[name]
            variables[name] = xr.DataArray(values, dims=before.dims, attrs=before.attrs)
        variables["clearance"] = self.clearance(free)
        return variables

    def clearance(self, free: Bools) -> xr.DataArray:
        """Return the layer, recomputed where a change is at most as far as the nearest wall was."""
        old = self.amap.dataset.variables["clearance"]
        values = self.after.taken(old.values, self.before, np.nan)
        values[~free] = np.nan
        outdated = free & np.isnan(values)
        x, y = self.after.axes(self.spacing)
        for xmin, ymin, xmax, ymax in self.boxes(SLACK):
            across = np.maximum(np.maximum(xmin - x, x - xmax), 0.0)
            along = np.maximum(np.maximum(ymin - y, y - ymax), 0.0)
            outdated |= np.hypot(along[:, None], across) <= values
        outdated &= free
        row, column = np.nonzero(outdated)
        values[row, column] = self.env.clearance(x[column], y[row])
        return xr.DataArray(values, dims=old.dims, attrs=old.attrs)


@functools.lru_cache(maxsize=8)
def _scanner_of(text: str) -> RangeScanner:
    """Parse and cache a map's scanner, as interactive edits update maps several times a second."""
    return RangeScanner.from_yaml_text(text, file="scanner_yaml")


def _everywhere(margin: float) -> list[Bounds]:
    """Return a box around everything, as `_Update.boxes` gives boxes around the changes."""
    return [(-math.inf, -math.inf, math.inf, math.inf)]


def _empty(name: str) -> float:
    """Return the fill value of a layer."""
    return NOT_FREE if schema.base_name(name) == "zone" else np.nan
