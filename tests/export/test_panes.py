"""Occupancy grids of drawings with panes that rays pass, and robots do not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import shapely
from scipy.ndimage import label

from ambinav.export import occupancy as grids
from tests.buildings.test_dxf import lines, loaded, rectangle


@pytest.mark.parametrize("resolution", [0.05, 0.1, 0.3])
def test_an_occupancy_grid_keeps_panes_for_robots(tmp_path: Path, resolution: float) -> None:
    """Whatever the size of its cells: a pane is thinner. A localizer's grid is as rays are."""

    def draw(space: Any) -> None:
        rectangle(space, shapely.box(0.0, 0.0, 10.0, 6.0), "A-WALL")
        lines(space, "GLASS", (5.02, 0.0, 5.02, 6.0))

    env = loaded(tmp_path, draw, glass="clear")
    raster = grids.raster_of(env, resolution, resolution)
    assert label(grids.occupancy(env, raster) == grids.FREE)[1] == 2
    assert label(grids.occupancy(env, raster, for_rays=True) == grids.FREE)[1] == 1
