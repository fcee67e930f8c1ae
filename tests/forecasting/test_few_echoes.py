"""Stretches of a route on which few beams return an echo."""

from __future__ import annotations

import math

import numpy as np
import pytest

import ambinav as an
from ambinav.drive.noise import OdometryNoise
from ambinav.forecasting.few_echoes import few_echo_metres, learns_from_echoes_alone
from ambinav.forecasting.forecast import Forecaster
from ambinav.forecasting.localizer_class import LocalizerClass
from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import FRONTIER, Segments
from ambinav.routes.route import Route
from tests.drive.cases import laser
from tests.forecasting.test_single_posts import HALL, SCANNER
from tests.localization import worlds

ROOM = worlds.box(40.0, 40.0)


def along_a_wall(environment: Environment, away: float) -> float:
    """Metres with few echoes on 20 m along the lower wall, whose others are out of range."""
    along = np.linspace(0.0, 20.0, 81)
    poses = np.column_stack([10.0 + along, np.full(81, away), np.zeros(81)])
    scanner = laser(max_range=3.0, beams=360)
    if environment.space is not None:
        scanner = scanner.raised(0.5)
    return few_echo_metres(environment, scanner, poses, along)


@pytest.mark.parametrize("away", [2.5, 2.8, 2.9, 2.95, 3.1])
def test_beside_a_wall_the_share_is_an_arc(away: float) -> None:
    """Of the full circle, beams within acos(away / range) of the wall's normal reach it."""
    share = math.acos(min(away / 3.0, 1.0)) / math.pi
    assert along_a_wall(ROOM, away) == (20.0 if 0.0 < share < 0.1 else 0.0)


def test_the_frontier_to_unknown_space_returns_no_echo() -> None:
    kind = np.array([FRONTIER, FRONTIER, FRONTIER, FRONTIER], dtype=np.uint8)
    unknown = Environment(Segments(ROOM.segments.xy, kind), ROOM.free, name="unknown")
    assert along_a_wall(unknown, 2.9) == 0.0
    assert along_a_wall(unknown.in_space(an.extruded(unknown, 2.0)), 2.9) == 0.0


def test_it_is_the_same_in_an_extruded_building() -> None:
    solid = ROOM.in_space(an.extruded(ROOM, 2.0))
    assert along_a_wall(solid, 2.9) == 20.0 and along_a_wall(solid, 2.5) == 0.0


def test_a_forecast_says_so() -> None:
    amap = an.build_map(HALL, SCANNER, 0.25, store=False)
    beside_posts = Route.through([(1.5, 4.0), (14.5, 4.0)])
    result = Forecaster(amap, "poor")(beside_posts)
    assert 5.0 < result.few_echoes < 13.0
    text = f"On {result.few_echoes:.1f} m of it fewer than 1 in 10 beams return an echo"
    assert text in result.sentence
    along_the_wall = Forecaster(amap, "poor")(Route.through([(1.5, 1.2), (14.5, 1.2)]))
    assert along_the_wall.few_echoes == 0.0 and not along_the_wall.caveat


def test_only_likelihood_fields_pass_over_beams_without_an_echo() -> None:
    for name in ("product", "amcl"):
        chosen = LocalizerClass.load(name).chosen(SCANNER, OdometryNoise())
        assert learns_from_echoes_alone(chosen)
    sonars = an.RangeScanner.from_preset("polaroid-6500-ring")
    product = LocalizerClass.load("product").chosen(sonars, OdometryNoise())
    assert not learns_from_echoes_alone(product)
