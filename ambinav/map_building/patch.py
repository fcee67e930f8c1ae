"""Layers of a changed building, computed where scans see the change and copied elsewhere.

A pose's ambiguity depends on its own scan, on those of the poses in its neighbourhood, and on where
a robot can stand and go there. So a pose is computed again if in its neighbourhood

- a robot can stand where it could not before, or the other way round;
- a changed wall is near enough to part neighbours of the lattice; or
- a ray meets a wall that is new, or met one that is gone (`ambinav.ambiguity.sight`); in a mesh a
  beam returns something else.

All else is taken over. Numbers are those of `build_map`, which does the same at every pose.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
import xarray as xr
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from ambinav.ambiguity.dataset import pose_layers
from ambinav.ambiguity.feasible_poses import standing
from ambinav.ambiguity.neighbourhoods import disc
from ambinav.ambiguity.returns import BEYOND
from ambinav.geometry.environment import Environment
from ambinav.geometry.lattice import Lattice, slices_in
from ambinav.map_building.map_change import SLACK, MapChange
from ambinav.map_building.selection import ChosenPoses
from ambinav.maps import schema
from ambinav.maps.zones import NOT_FREE
from ambinav.runtime.array_types import Bools, Bounds
from ambinav.runtime.errors import InputError
from ambinav.runtime.progress import Progress, within

# Points of the lattice within so many spacings of a wall may be parted by it from a neighbour.
PARTED = 1.5


@dataclass(frozen=True, eq=False)
class Patch:
    """Poses that are computed again.

    Attributes:
        change: Map, and the building in its present state.
        asks_cells: Whether each pose within reach is asked whether it sees the change; else all are
            computed.
    """

    change: MapChange
    asks_cells: bool

    def layers(self, report: Progress) -> tuple[Lattice, dict[str, xr.DataArray]]:
        """Return the lattice and its layers, computed where the change is seen."""
        change = self.change
        possible = self.possible()
        free: Bools = np.any(possible, axis=2)
        if not free.any():
            raise InputError(
                f"{change.env.name}: at no point of the lattice the robot fits; give it more room."
            )
        stale = self.stale(possible)
        affected: Bools = self.dilated(stale) & free
        patch = self.computed(possible, affected, report)
        variables = self.merged(patch, change.inner(free), change.inner(affected))
        x, y = change.after.axes(change.spacing)
        return Lattice(change.env, change.spacing, x, y, change.inner(free)), variables

    def possible(self) -> Bools:
        """Return where the robot can stand now, over the frame and the headings."""
        change = self.change
        possible = change.was.copy()
        context, x, y = change.context, *change.frame.axes(change.spacing)
        offset = float(np.hypot(*context.full_scanner.mounts[:, :2].T).max())
        margin = offset + context.model.robot_radius + SLACK
        for box in change.boxes(margin):
            rows, columns = slices_in(box, x, y)
            window = self.window(box, margin)
            window_values = possible[rows, columns]
            window_values[:] = False
            if window is None or not window_values.size:
                continue
            xs, ys = np.meshgrid(x[columns], y[rows])
            inside = window.triangulation.contains(xs.ravel(), ys.ravel()).reshape(xs.shape)
            lattice = Lattice(window, change.spacing, x[columns], y[rows], inside)
            window_values[inside] = standing(
                lattice, context.full_scanner, context.headings, context.model.robot_radius
            )
        return possible

    def stale(self, possible: Bools) -> Bools:
        """Return the frame's cells where a scan, a link or the possibility to stand changed."""
        change = self.change
        stale: Bools = (change.was != possible).any(axis=2)
        changes, (x, y) = change.changes, change.frame.axes(change.spacing)
        if not len(changes.edges):
            return stale
        free = possible.any(axis=2)
        in_reach = np.zeros_like(stale)
        for box in change.boxes(change.seen.reach + SLACK):
            in_reach[slices_in(box, x, y)] = True
        if not self.asks_cells:
            return stale | (in_reach & free)
        edges = shapely.multilinestrings(list(changes.edges.reshape(-1, 2, 2)))
        shapely.prepare(edges)
        near = PARTED * change.spacing
        for box in change.boxes(near):
            rows, columns = slices_in(box, x, y)
            xs, ys = np.meshgrid(x[columns], y[rows])
            stale[rows, columns] |= shapely.dwithin(edges, shapely.points(xs, ys), near)
        row, column = np.nonzero(in_reach & free & ~stale)
        stale[row, column] = change.seen.by(x[column], y[row])
        return stale

    def window(self, box: Bounds, margin: float) -> Environment | None:
        """Return the building in a box with a margin, metres; None where no free space is."""
        around = (box[0] - margin, box[1] - margin, box[2] + margin, box[3] + margin)
        return self.change.env.window(
            around, footprints=self.change.context.model.robot_radius > 0.0
        )

    def dilated(self, cells: Bools) -> Bools:
        """Return the cells within the neighbourhood's radius of the given cells."""
        near = np.zeros_like(cells)
        row, column = np.nonzero(cells)
        if not len(row):
            return near
        reach = int(disc(self.change.context.model.radius, self.change.spacing).max())
        part = (
            slice(max(int(row.min()) - reach, 0), int(row.max()) + reach + 1),
            slice(max(int(column.min()) - reach, 0), int(column.max()) + reach + 1),
        )
        away = distance_transform_edt(~cells[part])
        # As `disc` has it.
        near[part] = away <= self.change.context.model.radius / self.change.spacing * (1 + 5e-10)
        return near

    def computed(
        self, possible: Bools, affected: Bools, report: Progress
    ) -> dict[str, NDArray[Any]]:
        """Compute layers at the M affected cells, row by row, (M, ...); none if there are none."""
        change = self.change
        if not affected.any():
            return {}
        context, table = change.context, change.context.table
        needed = self.dilated(affected) & possible.any(axis=2)
        x, y = change.frame.axes(change.spacing)
        row, column = np.nonzero(needed)
        rows, columns = (slice(int(v.min()), int(v.max()) + 1) for v in (row, column))
        reach = float(np.hypot(*context.scanner.mounts[:, :2].T).max())
        reach += context.scanner.max_range + BEYOND + SLACK
        box = (x[column.min()], y[row.min()], x[column.max()], y[row.max()])
        window = self.window(box, reach) or change.env
        around = Lattice(window, change.spacing, x[columns], y[rows], needed[rows, columns])
        chosen = affected[rows, columns]
        poses = ChosenPoses(
            context.scanner, table, context.model, context.headings,
            "heading" in change.amap.dataset,
        )  # fmt: skip
        stands, picked = possible[rows, columns][around.free], chosen[around.free]
        results = poses.sums(around, stands, picked, within(report, 0.0, 0.95))
        lattice = Lattice(window, change.spacing, x[columns], y[rows], chosen)
        layers = pose_layers(lattice, context.model, change.theta, results)
        return {name: array.values[chosen] for name, array in layers.items()}

    def merged(
        self, patch: dict[str, NDArray[Any]], free: Bools, affected: Bools
    ) -> dict[str, xr.DataArray]:
        """Merge the map's layers, on the new lattice, with those of the patch where it has them."""
        change = self.change
        old, names = change.amap.dataset, change.names
        if patch:
            change.check_layers(patch)
        # Many times faster than the masks themselves.
        was = change.inner(change.was_free)
        removed, fresh = np.nonzero(was & ~free), np.nonzero(affected)
        variables = {}
        for name in patch or names:
            before = old.variables[name]
            values = change.after.taken(before.values, change.before, _empty(name))
            values[removed] = _empty(name)
            if patch:
                values[fresh] = patch[name]
            variables[name] = xr.DataArray(values, dims=before.dims, attrs=before.attrs)
        variables["clearance"] = self.clearance(free)
        return variables

    def clearance(self, free: Bools) -> xr.DataArray:
        """Return the layer, recomputed where a change is at most as far as the nearest wall was."""
        change = self.change
        old = change.amap.dataset.variables["clearance"]
        values = change.after.taken(old.values, change.before, np.nan)
        values[~free] = np.nan
        outdated = free & np.isnan(values)
        x, y = change.after.axes(change.spacing)
        for xmin, ymin, xmax, ymax in change.boxes(SLACK):
            across = np.maximum(np.maximum(xmin - x, x - xmax), 0.0)
            along = np.maximum(np.maximum(ymin - y, y - ymax), 0.0)
            outdated |= np.hypot(along[:, None], across) <= values
        outdated &= free
        row, column = np.nonzero(outdated)
        values[row, column] = change.env.clearance(x[column], y[row])
        return xr.DataArray(values, dims=old.dims, attrs=old.attrs)


def _empty(name: str) -> float:
    """Return the fill value of a layer."""
    return NOT_FREE if schema.base_name(name) == "zone" else np.nan
