from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

import ambinav as an
from ambinav_envs.buildings.cells import cut, doorways, is_roomy, long_axis
from ambinav_envs.buildings.procedural import ROBOT, ProceduralParameters, procedural_building
from tests.envs.buildings.scenes import places_in

SQUARE = np.array([(0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0)])


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**63))
def test_connected_whatever_the_seed(seed: int) -> None:
    building = procedural_building(np.random.default_rng(seed))
    assert isinstance(building.free.buffer(-ROBOT), shapely.Polygon)
    # The lattice for a robot of the usual size says so as well, but for single cells.
    labels = places_in(building).labels
    assert (labels > 0).sum() <= 0.005 * (labels >= 0).sum()


@pytest.mark.slow
def test_walls_at_odd_angles_and_along_the_axes() -> None:
    angles, shares = [], []
    for seed in range(12):
        segments = procedural_building(np.random.default_rng(seed)).segments.xy
        along = segments[:, 2:] - segments[:, :2]
        long = np.hypot(*along.T) > 3.0
        angle = np.degrees(np.arctan2(*along[long].T[::-1])) % 90.0
        odd = np.minimum(angle, 90.0 - angle) > 5.0
        angles.extend(angle[odd])
        shares.append(odd.mean())
    assert len(np.unique(np.round(angles))) > 5
    assert 0.1 < np.mean(shares) < 0.7


def test_parameters_are_followed() -> None:
    parameters = ProceduralParameters(
        size=(10.0, 11.0), corridors=(0, 0), tilted=0.0, furniture=0.0
    )
    for seed in range(5):
        building = procedural_building(np.random.default_rng(seed), parameters, name="small")
        xmin, ymin, xmax, ymax = building.bounds
        assert 9.5 < xmax - xmin < 11.0 and 9.5 < ymax - ymin < 11.0
        along = np.diff(building.segments.xy.reshape(-1, 2, 2), axis=1)[:, 0]
        assert (np.abs(along).min(axis=1) < 1e-9).all()
        assert building.name == "small"


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("size", (3.0, 9.0), r"size is \(3.0, 9.0\); give a rising range from 8 to 100"),
        ("size", 12.0, "give a range: the least, the greatest"),
        ("corridors", (0.5, 1.0), "give whole numbers"),
        ("room_area", (30.0, 10.0), "rising range from 6"),
        ("tilt", (0.0, 60.0), "from 0 to 45"),
        ("halls", 1.5, "halls is 1.5; give a share from 0 to 1"),
        ("furniture", math.nan, "furniture"),
    ],
)
def test_bad_parameters(field: str, value: object, words: str) -> None:
    with pytest.raises(an.InputError, match=words):
        ProceduralParameters(**{field: value})  # type: ignore[arg-type]


@settings(max_examples=50, deadline=None)
@given(st.floats(0.1, 3.9), st.floats(0.1, 3.9), st.floats(-180.0, 180.0))
def test_a_cut_leaves_nothing_out(x: float, y: float, degrees: float) -> None:
    left, right = (shapely.Polygon(part) for part in cut(SQUARE, (x, y), degrees))
    assert left.area + right.area == pytest.approx(16.0)
    assert left.is_valid and right.is_valid
    angle = math.radians(degrees + 90.0)
    middle = left.representative_point()
    assert (middle.x - x) * math.cos(angle) + (middle.y - y) * math.sin(angle) > 0.0


def test_a_cut_beside_it_leaves_it_whole() -> None:
    left, right = cut(SQUARE, (0.0, -1.0), 0.0)
    assert len(left) == 4 and len(right) == 0
    left, right = cut(SQUARE, (0.0, 0.0), 45.0)
    assert len(left) == len(right) == 3


def test_roomy() -> None:
    assert is_roomy(SQUARE, 4.0, 4.0, 16.0, 90.0 - 1e-9)
    assert not is_roomy(SQUARE, 4.1, 1.0, 1.0, 10.0)
    assert not is_roomy(SQUARE, 1.0, 4.1, 1.0, 10.0)
    assert not is_roomy(SQUARE, 1.0, 1.0, 16.1, 10.0)
    tip = np.array([(0.0, 0.0), (8.0, 0.0), (8.0, 3.0)])
    assert is_roomy(tip, 2.5, 1.0, 1.0, 20.0)
    assert not is_roomy(tip, 2.5, 1.0, 1.0, 21.0)
    assert not is_roomy(tip, 3.0, 1.0, 1.0, 20.0)
    assert not is_roomy(tip[:2], 0.1, 0.1, 0.0, 0.0)


def test_the_long_axis() -> None:
    turned = shapely.affinity.rotate(shapely.box(0, 0, 5, 2), 30.0)
    ring = shapely.get_coordinates(shapely.geometry.polygon.orient(turned).exterior)[:-1]
    assert long_axis(ring) % 180.0 == pytest.approx(30.0)


def test_doorways_are_where_only_a_wall_is_between() -> None:
    rooms = [shapely.box(0, 0, 3, 3), shapely.box(3.2, 1, 6, 5), shapely.box(0, 3.2, 2, 5)]
    rooms.append(shapely.box(10, 0, 12, 3))
    found = {doorway.rooms: doorway for doorway in doorways(rooms, 0.2, 1.5)}
    assert set(found) == {(0, 1), (0, 2)}
    east, north = found[0, 1], found[0, 2]
    assert east.middle == pytest.approx((3.1, 2.0)) and east.length == pytest.approx(2.0)
    assert abs(east.degrees) == pytest.approx(90.0)
    assert north.middle == pytest.approx((1.0, 3.1)) and north.length == pytest.approx(2.0)
    ends = sorted(east.at(share, 1.0)[1] for share in (0.0, 1.0))
    assert ends == pytest.approx([1.5, 2.5])
    # Turned by any angle they are the same.
    turned = [shapely.affinity.rotate(room, 33.0, origin=(0, 0)) for room in rooms]
    lengths = [doorway.length for doorway in doorways(turned, 0.2, 1.5)]
    assert sorted(lengths) == pytest.approx([2.0, 2.0])
