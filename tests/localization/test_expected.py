"""The covariance to expect at a place: by the map's radii, and by the Fisher information."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from ambinav.geometry.environment import Environment
from ambinav.localization.expected_covariance import expected_covariance
from ambinav.localization.information import scan_information
from ambinav.map_building.build import build_map
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.runtime.errors import InputError
from tests.localization import worlds

ANGLE = 0.6
TURN = np.array([[math.cos(ANGLE), -math.sin(ANGLE)], [math.sin(ANGLE), math.cos(ANGLE)]])
LASER = worlds.laser(beams=24, reach=4.0)
# The middle of a corridor that is turned, and a place out of it.
CENTRE = TURN @ [7.0, 1.0]
POSES = np.array([[*CENTRE, 0.3], [*(TURN @ [7.0, 3.5]), 0.3]])


def corridor() -> Environment:
    ring = np.array([[0.0, 0.0], [14.0, 0.0], [14.0, 2.0], [0.0, 2.0]]) @ TURN.T
    return worlds.walls(tuple((float(x), float(y)) for x, y in ring))


@pytest.fixture(scope="module")
def amap() -> AmbiguityMap:
    return build_map(corridor(), LASER, spacing=0.2, map_std=0.0)


def test_the_maps_radii_are_its_deviations(amap: AmbiguityMap) -> None:
    found = expected_covariance(amap, POSES)
    assert np.isnan(found[1]).all() and np.isfinite(found[0]).all()
    np.testing.assert_array_equal(found[0], found[0].T)
    at = {name: amap.sample(name, *CENTRE) for name in ("major_radius", "minor_radius")}
    values, vectors = np.linalg.eigh(found[0][:2, :2])
    assert math.sqrt(values[1]) == pytest.approx(at["major_radius"], rel=1e-5)
    assert math.sqrt(values[0]) == pytest.approx(at["minor_radius"], rel=1e-5)
    # Along the corridor the scan tells nothing: anywhere on a line of the neighbourhood's length.
    assert abs(vectors[:, 1] @ TURN[:, 0]) > math.cos(math.radians(2.0))
    assert math.sqrt(values[1]) == pytest.approx(0.5 / math.sqrt(3.0), rel=0.1)
    assert values[0] < 0.1**2
    # Half a turn looks the same here, which is no matter of tracking.
    assert math.sqrt(found[0, 2, 2]) == pytest.approx(amap.sample("heading_radius", *CENTRE))
    assert 0.001 < math.sqrt(found[0, 2, 2]) < 0.01
    assert (found[0, 2, :2] == 0.0).all()
    np.testing.assert_array_equal(expected_covariance(amap, POSES[0])[0], found[0])


def test_the_fisher_information_and_a_prior(amap: AmbiguityMap) -> None:
    prior = np.array([[0.04, 0.01, 0.0], [0.01, 0.09, 0.002], [0.0, 0.002, 0.01]])
    env = corridor()
    found = expected_covariance(env, POSES, scanner=LASER, prior=prior, map_std=0.0)
    information = scan_information(env, LASER, POSES[:1], 0.0)[0]
    np.testing.assert_allclose(
        found[0], np.linalg.inv(np.linalg.inv(prior) + information), rtol=1e-8
    )
    assert np.isnan(found[1]).all()
    # With the prior as without it along the corridor; sharp across it.
    usual = expected_covariance(env, POSES[0], scanner=LASER)[0, :2, :2]
    along, across = TURN.T
    assert along @ usual @ along == pytest.approx(0.25, rel=1e-6)
    assert across @ usual @ across < 0.02**2
    # A map knows its scanner and its building.
    same = expected_covariance(amap, POSES, source="fisher", prior=prior, map_std=0.0)
    np.testing.assert_allclose(same[0], found[0], rtol=1e-6)


def test_maps_with_headings(amap: AmbiguityMap) -> None:
    forward = worlds.mixed()
    small = build_map(worlds.box(3.0, 2.0), forward, spacing=0.25, max_beams=20)
    assert small.has_theta and "heading_radius" not in small.layers
    found = expected_covariance(small, [[1.5, 1.0, 0.0], [1.5, 1.0, 2.0]])
    sigma = json.loads(small.dataset.attrs["parameters"])["sigma_theta"]
    np.testing.assert_allclose(found[:, 2, 2], sigma**2)
    radius = small.sample("major_radius", 1.5, 1.0, 2.0)
    assert np.linalg.eigvalsh(found[1, :2, :2])[1] == pytest.approx(radius**2, rel=1e-5)


def test_bad_input_is_refused(amap: AmbiguityMap) -> None:
    env = corridor()
    with pytest.raises(InputError, match="no scanner is given for environment 'room'"):
        expected_covariance(env, POSES)
    with pytest.raises(InputError, match="source is 'ambiguity', which environment 'room'"):
        expected_covariance(env, POSES, source="ambiguity")
    with pytest.raises(InputError, match="source is 'fischer'; did you mean fisher"):
        expected_covariance(amap, POSES, source="fischer")
    with pytest.raises(InputError, match="prior is given, which source 'ambiguity' does not use"):
        expected_covariance(amap, POSES, prior=np.eye(3))
    with pytest.raises(InputError, match="prior: the shape"):
        expected_covariance(env, POSES, scanner=LASER, prior=np.eye(2))
    bare = AmbiguityMap(amap.dataset.assign_attrs(parameters="{}"), source="bare.zarr")
    with pytest.raises(InputError, match=r"bare\.zarr: its parameters lack sigma_theta"):
        expected_covariance(bare, POSES)
    del bare.dataset.attrs["scanner_yaml"]
    with pytest.raises(InputError, match="does not name its scanner"):
        expected_covariance(bare, POSES, source="fisher")
