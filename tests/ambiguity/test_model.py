"""The parameters: how much evidence a scanner has, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

import ambinav as an
from ambinav.ambiguity.model import PIECES_PER_TURN, AmbiguityModel, independent_tau

TURN = 2 * math.pi
SENSOR = an.RangeSensor(max_range=6.0, std=0.02, resolution=0.01)


@pytest.mark.parametrize("beams", [3, 8, 11, 12, 13, 15])
def test_few_beams_are_independent(beams: int) -> None:
    assert independent_tau(an.RangeScanner.planar(SENSOR, beams, TURN)) == pytest.approx(1.0)


@pytest.mark.parametrize("beams", [30, 60, 360])
def test_evidence_depends_on_the_aperture_not_on_the_number_of_beams(beams: int) -> None:
    whole = an.RangeScanner.planar(SENSOR, beams, TURN)
    assert beams / independent_tau(whole) == pytest.approx(PIECES_PER_TURN)
    half = an.RangeScanner.planar(SENSOR, beams, math.pi)
    assert beams / independent_tau(half) == pytest.approx(PIECES_PER_TURN / 2)


def test_one_beam_is_one_piece() -> None:
    assert independent_tau(an.RangeScanner.planar(SENSOR, 1, 0.0)) == 1.0


@pytest.mark.parametrize("beams", [8, 11, 12, 13, 30])
def test_a_closed_room_is_localizable_with_few_beams_too(beams: int) -> None:
    room = an.environment_from_shapes([shapely.box(0, 0, 4, 3)])
    amap = an.build_map(room, an.RangeScanner.planar(SENSOR, beams, TURN), spacing=0.2)
    assert amap.zone_shares()[0].share > 0.95


def test_numbers_of_any_kind_are_taken() -> None:
    model = AmbiguityModel(radius=np.float32(0.5), map_std=0, tau=np.int64(4))  # type: ignore[arg-type]
    assert model.as_dict()["tau"] == 4.0 and isinstance(model.tau, float)


@pytest.mark.parametrize("value", [True, None, math.nan, -0.1])
def test_a_bad_number_is_named(value: object) -> None:
    with pytest.raises(an.InputError, match="map_std"):
        AmbiguityModel(radius=0.5, map_std=value, tau=1.0)  # type: ignore[arg-type]


@pytest.mark.parametrize("headings", [0, -1, 2.5, True])
def test_headings_are_a_whole_number(headings: object) -> None:
    room = an.environment_from_shapes([shapely.box(0, 0, 4, 3)])
    scanner = an.RangeScanner.planar(SENSOR, 8, TURN)
    with pytest.raises(an.InputError, match="headings"):
        an.build_map(room, scanner, headings=headings)  # type: ignore[arg-type]
