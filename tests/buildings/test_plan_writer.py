"""Buildings that are written as plans are the same when they are read."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import shapely

import ambinav as an
from ambinav.buildings.plan_writer import plan_geojson
from ambinav.demo import DEMO_BUILDING
from ambinav.geometry.obstacle import Obstacle


def again(environment: an.Environment, folder: Path) -> an.Environment:
    path = folder / "plan.geojson"
    path.write_text(json.dumps(plan_geojson(environment)))
    return an.load_environment(path)


def rays(environment: an.Environment) -> np.ndarray:
    """Ranges of 4000 rays from places drawn in the free space."""
    rng = np.random.default_rng(5)
    x0, y0, x1, y1 = environment.free.bounds
    x, y = rng.uniform(x0, x1, 4000), rng.uniform(y0, y1, 4000)
    free = np.asarray(environment.is_free(x, y, 0.05))
    angle = rng.uniform(0.0, 2.0 * np.pi, 4000)
    return np.asarray(environment.cast(x[free], y[free], angle[free], 30.0))


def test_the_demo_with_obstacles_is_the_same(tmp_path: Path) -> None:
    obstacles = (
        Obstacle.post(14.0, 13.0, 0.2),
        Obstacle.wall([(18, 12), (18, 14)]),
        Obstacle.post(10, 13, 0.1, reflective=True),
    )
    environment = an.load_environment(DEMO_BUILDING).edited(add=obstacles)
    found = again(environment, tmp_path)
    np.testing.assert_allclose(rays(found), rays(environment), atol=2e-6)
    assert found.free.area == pytest.approx(environment.free.area, abs=1e-6)
    for mask in ("walls", "reflectors"):
        lengths = [
            one.segments.lengths[getattr(one.segments, mask)].sum() for one in (environment, found)
        ]
        assert lengths[1] == pytest.approx(lengths[0], abs=1e-3)


def test_frontiers_stay_frontiers(tmp_path: Path) -> None:
    environment = an.environment_from_shapes(
        [shapely.box(0, 0, 4, 3)], openings=[shapely.LineString([(0, 1), (0, 2)])]
    )
    found = again(environment, tmp_path)
    frontier = found.segments.lengths[~found.segments.walls].sum()
    assert frontier == pytest.approx(1.0)
