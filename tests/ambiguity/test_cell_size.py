"""Rasters of one building, fine and coarse, give the same levels."""

from __future__ import annotations

from pathlib import Path

import pytest

from ambinav.buildings.boundary import environment_from_grid
from ambinav.buildings.map_server import load_map_server
from ambinav.geometry.environment import Environment
from ambinav.sensing import RangeScanner
from benchmarks.raster import busiest, medians

DEMO_MEDIAN = 0.004
MEDIAN = 0.016


@pytest.mark.slow(kept=("0.0",))
@pytest.mark.parametrize("angle", [0.0, 0.3])
def test_drawn(demo: Environment, laser: RangeScanner, angle: float) -> None:
    assert max(medians(demo.transformed(angle), laser)) < DEMO_MEDIAN


@pytest.mark.sweep
@pytest.mark.parametrize("part", range(8))
def test_recorded(data_dir: Path, laser: RangeScanner, part: int) -> None:
    """Every map of the folder: its fitted walls, rasterised anew."""
    paths = sorted(data_dir.glob("*maps*/*.yaml"))
    assert len(paths) >= 30
    most = {
        path.stem: max(medians(environment_from_grid(busiest(load_map_server(path))), laser))
        for path in paths[part::8]
    }
    print(most)
    assert {name: worst for name, worst in most.items() if not worst < MEDIAN} == {}
