"""What posts in a bare hall tell: as forecast for the ray model, less for likelihood fields."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

import ambinav as an
from ambinav.buildings.shapes import environment_from_shapes
from ambinav.drive.odometries import ODOMETRIES
from ambinav.forecasting.ensemble import EnsembleRunner
from ambinav.forecasting.forecast import Forecaster
from ambinav.localization.parameters import ALPHAS, MclParameters
from ambinav.localization.scanner_settings import CONE_PRODUCT
from ambinav.routes.route import Route
from tests.drive.cases import laser

POSTS = [shapely.Point(x, 4.8167).buffer(0.2) for x in (2.4083, 4.8167, 9.6333, 12.0417)]
HALL = environment_from_shapes(
    [shapely.box(0, 0, 16, 8).difference(shapely.union_all(POSTS))], name="hall with posts"
)
SCANNER = laser(max_range=3.0, beams=120)


@pytest.mark.sweep
def test_a_likelihood_field_loses_more_than_is_forecast_and_the_ray_model_does_not() -> None:
    # The walls along the route are out of range: beside a post nearly all beams have no echo, and
    # a likelihood field learns nothing from these (docs/forecast.md has the figures).
    route = Route.through([(1.5, 4.0), (14.5, 4.0)])
    odometry = ODOMETRIES["poor"]
    amap = an.build_map(HALL, SCANNER, 0.25, store=False)
    forecaster = Forecaster(amap, odometry, "product", routes=[route])
    known = {key: getattr(odometry.modelled, key) for key in ALPHAS if key != "alpha5"}
    rays = MclParameters(**{**CONE_PRODUCT, **known})
    lost = {
        name: runner.drive(route, np.random.default_rng(3), 256).lost.mean()
        for name, runner in (
            ("field", forecaster.runner()),
            ("rays", EnsembleRunner(HALL, SCANNER, rays, noise=odometry)),
        )
    }
    # Without the limit by echoes, 2 to 6 % are forecast.
    assert 0.08 < forecaster(route).lost_probability < 0.11
    assert lost["rays"] < 0.01
    assert 0.25 < lost["field"] < 0.34
