"""Information of a scan from the radii of a map and from its walls, against what is known."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
import xarray as xr
from numpy.typing import NDArray

from ambinav import build_map, load_environment
from ambinav.ambiguity.model import independent_tau
from ambinav.buildings.shapes import environment_from_shapes
from ambinav.forecasting import information_field as module
from ambinav.forecasting.information_field import ECHOES, InformationField
from ambinav.geometry.environment import Environment
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor
from tests.maps.synthetic import dataset, scanner
from tests.planners.conftest import DEMO

LONG, WIDE = 9.13, 6.07
IN_ROOM, IN_CORRIDOR, IN_HALL = [2.0, 2.0, 0.0], [10.0, 2.0, 0.0], [21.0, 5.0, 0.0]


def with_tensor(posterior: NDArray[np.float64], prior: NDArray[np.float64]) -> AmbiguityMap:
    """A map with the same Gaussians everywhere, with axes in common."""
    data = dataset()
    variance, axes = np.linalg.eigh(posterior)
    free = np.sqrt([axes[:, k] @ prior @ axes[:, k] for k in range(2)])
    radius = np.sqrt(variance)
    layers = {
        "major_radius": radius[1],
        "minor_radius": radius[0],
        "major": radius[1] / free[1],
        "minor": radius[0] / free[0],
        "direction": math.atan2(axes[1, 1], axes[0, 1]) % math.pi,
    }
    for name, value in layers.items():
        full = np.where(data["free"].values, value, np.nan).astype(np.float32)
        data[name] = xr.DataArray(full, dims=("y", "x"))
    return AmbiguityMap(data)


def of_position(found: NDArray[np.float64]) -> NDArray[np.float64]:
    """What is left of information (N, 3, 3) about x and y if the heading is unknown."""
    shift, turn = found[:, :2, 2], found[:, 2, 2]
    both = shift[:, :, None] * shift[:, None, :]
    lost = np.divide(both, turn[:, None, None], out=np.zeros_like(both), where=both != 0.0)
    return np.asarray(found[:, :2, :2] - lost)


def test_prior_and_information_make_the_posterior() -> None:
    """Gaussians fused: posterior^-1 = prior^-1 + information, whatever the direction."""
    added = np.array([[90.0, 25.0], [25.0, 40.0]])
    prior = 0.0625 * np.eye(2)  # a round neighbourhood of 0.5 m
    posterior = np.linalg.inv(np.linalg.inv(prior) + added)
    found = InformationField.of(with_tensor(posterior, prior)).at(np.array([IN_ROOM]))
    np.testing.assert_allclose(of_position(found)[0], added, rtol=1e-3, atol=0.05)


def test_a_scan_that_changes_nothing_tells_nothing_of_the_position() -> None:
    prior = 0.0625 * np.eye(2)
    information = InformationField.of(with_tensor(prior, prior))
    found = information.at(np.array([IN_ROOM]))
    np.testing.assert_allclose(of_position(found), 0.0, atol=0.05)
    np.testing.assert_allclose(information.weak, 0.0, atol=1e-3)


@pytest.mark.parametrize("radius", [0.05, 0.005, 0.0005])
def test_a_fine_scan_is_not_capped(radius: float) -> None:
    """Cells are 0.1 m apart; a scan may fix the position far better than that."""
    found = InformationField.of(with_tensor(radius**2 * np.eye(2), 0.0625 * np.eye(2)))
    expected = 1.0 / radius**2 - 16.0
    assert found.weak[20, 20, 0] == pytest.approx(expected, rel=1e-4)


def by_differences(
    environment: Environment, sensor: RangeScanner, pose: NDArray[np.float64], std: float
) -> NDArray[np.float64]:
    """Fisher information of the scan at a pose, ranges cast beside it; beams that jump left out."""
    step = 1e-5
    gradients = []
    for axis in range(3):
        ends = [pose.copy(), pose.copy()]
        ends[0][axis] -= step
        ends[1][axis] += step
        low, high = (sensor.scan(environment, *end) for end in ends)
        seen = np.isfinite(low) & np.isfinite(high)
        gradients.append(np.subtract(high, low, out=np.zeros(len(low)), where=seen) / (2 * step))
    jacobian = np.array(gradients)
    return np.asarray(jacobian @ jacobian.T / std**2)


@pytest.mark.parametrize("beams", [60, pytest.param(241, marks=pytest.mark.slow)])
@pytest.mark.parametrize("mount", [(0.0, 0.0, 0.0), (0.15, -0.1, 0.5)])
def test_heading_and_coupling_against_differences_of_scans(
    beams: int, mount: tuple[float, float, float]
) -> None:
    """All beams of the scan, at cells of the map where no beam is near to grazing or an edge."""
    environment = load_environment(DEMO)
    sensor = RangeSensor(max_range=6.0, std=0.03, resolution=1e-6)
    laser = RangeScanner.planar(sensor=sensor, beams=beams, aperture=1.4 * math.pi, mount=mount)
    amap = build_map(environment, laser, spacing=0.4, headings=3, map_std=0.04)
    information = InformationField.of(amap)
    free = np.argwhere(amap.possible)
    chosen = free[np.random.default_rng(3).permutation(len(free))[:40]]
    data, std = amap.dataset, math.hypot(0.03, 0.04)
    agreed = 0
    for row, column, k in chosen:
        pose = np.array([float(data[name].values[i])
                         for name, i in (("x", column), ("y", row), ("theta", k))])  # fmt: skip
        fisher = by_differences(environment, laser, pose, std)
        found = information.at(pose[None])[0]
        turn = fisher[2, 2] / (2.0 * independent_tau(laser))
        shift = fisher[:2, 2] / fisher[2, 2]
        # The map's own tau is of every second beam, whose aperture is a little less.
        near = np.isclose(found[2, 2], turn, rtol=0.03)
        near &= np.allclose(found[:2, 2] / found[2, 2], shift, rtol=5e-3, atol=2e-3)
        agreed += bool(near)
    assert agreed >= 0.8 * len(chosen)  # the others have a beam that grazes a wall


@pytest.mark.slow
def test_few_beams_beside_many_count_as_the_map_counts_them() -> None:
    """A map takes every beam of a small part and one in eleven of a large one."""
    environment = load_environment(DEMO)
    sensor = RangeSensor(max_range=6.0, std=0.01, resolution=1e-6)
    few = RangeScanner.planar(sensor=sensor, beams=12, aperture=1.2 * math.pi)
    fine = RangeSensor(max_range=6.0, std=0.05, resolution=1e-6, name="fine")
    many = RangeScanner.planar(sensor=fine, beams=331, aperture=1.4 * math.pi)
    amap = build_map(environment, RangeScanner.mixed(few, many, name="both"), spacing=0.4,
                     headings=3, map_std=0.0)  # fmt: skip
    parameters = json.loads(amap.dataset.attrs["parameters"])
    kept = parameters["beams_used"] - 12
    information = InformationField.of(amap)
    free = np.argwhere(amap.possible)
    data, agreed = amap.dataset, 0
    chosen = free[np.random.default_rng(4).permutation(len(free))[:30]]
    for row, column, k in chosen:
        pose = np.array([float(data[name].values[i])
                         for name, i in (("x", column), ("y", row), ("theta", k))])  # fmt: skip
        fisher = by_differences(environment, few, pose, 0.01)
        fisher = fisher + kept / 331 * by_differences(environment, many, pose, 0.05)
        found = information.at(pose[None])[0]
        near = np.isclose(found[2, 2], fisher[2, 2] / (2.0 * parameters["tau"]), rtol=0.03)
        near &= np.allclose(found[:2, 2] / found[2, 2], fisher[:2, 2] / fisher[2, 2], atol=1e-2)
        agreed += bool(near)
    assert agreed >= 0.7 * len(chosen)


@pytest.mark.parametrize("mount", [(0.05, 0.02, 0.1), (0.2, -0.1, 0.4)])
@pytest.mark.parametrize("aperture", [math.tau, 1.5 * math.pi])
def test_what_echoes_tell_in_a_hall(aperture: float, mount: tuple[float, float, float]) -> None:
    """From the middle a laser of 3 m sees no wall, from elsewhere one or two."""
    laser = RangeScanner.planar(
        RangeSensor(max_range=3.0, std=0.03, resolution=1e-6), 60, aperture, mount=mount
    )
    hall = environment_from_shapes([shapely.box(0.0, 0.0, LONG, WIDE)])
    amap = build_map(hall, laser, spacing=0.5, headings=4, store=False)
    field = InformationField.of(amap, echoes=True)
    ends = replace(field, entries=field.entries[:, ECHOES:])
    assert field.has_echoes and not InformationField.of(amap).has_echoes
    theta = amap.dataset["theta"].values if amap.has_theta else np.zeros(1)
    for row, column, k in np.argwhere(amap.possible)[::7]:
        pose = np.array([amap.dataset["x"].values[column], amap.dataset["y"].values[row], theta[k]])
        seen = laser if amap.has_theta else laser.centred
        reading = seen.scan(hall, *pose)
        x, y, yaw = seen.mounts.T
        c, s = math.cos(pose[2]), math.sin(pose[2])
        wanted = np.zeros((3, 3))
        for beam in np.flatnonzero(np.isfinite(reading)):
            d, to = reading[beam], pose[2] + yaw[beam]
            ex = c * x[beam] - s * y[beam] + d * math.cos(to)
            ey = s * x[beam] + c * y[beam] + d * math.sin(to)
            upright = min(abs(pose[0] + ex), abs(pose[0] + ex - LONG)) < 1e-6
            line = np.array([1.0, 0.0, -ey] if upright else [0.0, 1.0, ex])
            wanted += np.outer(line, line) / len(reading)
        wanted *= np.isfinite(reading).mean()
        np.testing.assert_allclose(ends.at(pose[None])[0], wanted, rtol=1e-4, atol=1e-5)


def test_corridor_tells_across_only() -> None:
    information = InformationField.of(AmbiguityMap(dataset()))
    found = information.at(np.array([IN_ROOM, IN_CORRIDOR, IN_HALL]))
    room, corridor, hall = of_position(found)
    # Radii are a quarter of the ratios.
    assert corridor[0, 0] == pytest.approx((1 - 0.81) / 0.225**2, rel=1e-3)
    assert corridor[1, 1] == pytest.approx((1 - 0.01) / 0.025**2, rel=1e-3)
    assert room[0, 0] == pytest.approx((1 - 0.01) / 0.025**2, rel=1e-3)
    assert hall[1, 1] < 4.0
    assert abs(corridor[0, 1]) < 1e-2


def test_positive_semidefinite_and_weakest_everywhere() -> None:
    information = InformationField.of(AmbiguityMap(dataset()))
    rng = np.random.default_rng(1)
    poses = rng.uniform([0, 0, -4], [26, 10, 4], (500, 3))
    found = information.at(poses)
    values = np.linalg.eigvalsh(found)
    assert values.min() >= -1e-3
    assert np.isfinite(found).all()
    # At the centres of cells the weakest direction is stored.
    row, column = np.argwhere(AmbiguityMap(dataset()).dataset["free"].values)[::97].T
    data = dataset()
    centres = np.column_stack([data["x"].values[column], data["y"].values[row], 0.0 * row])
    there = information.at(centres)
    some = there[:, 2, 2] > 0.0
    np.testing.assert_allclose(
        np.linalg.eigvalsh(of_position(there[some]))[:, 0],
        information.weak[row, column, 0][some],
        rtol=1e-3,
        atol=1e-1,
    )


@pytest.mark.slow
def test_map_with_headings_is_read_at_the_heading() -> None:
    information = InformationField.of(AmbiguityMap(dataset(8)))
    ahead, back = of_position(information.at(np.array([[10.0, 2.0, 0.0], [10.0, 2.0, math.pi]])))
    # Looking along +x the radii are half as large: major is 0.45 and not 0.9 there.
    assert ahead[0, 0] == pytest.approx((1 - 0.45**2) / (0.25 * 0.45) ** 2, rel=1e-3)
    assert back[0, 0] == pytest.approx((1 - 0.81) / 0.225**2, rel=1e-3)


@pytest.mark.sweep
def test_thinned_beams_tell_as_much_as_all(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a scanner of many beams on a map with headings only some are cast."""
    data = dataset(8)
    dense = replace_beams(scanner(8), 721)
    data.attrs["scanner_yaml"] = dense.to_yaml()
    thinned = InformationField.of(AmbiguityMap(data))
    monkeypatch.setattr(module, "BEAMS_A_CELL", 10**9)
    whole = InformationField.of(AmbiguityMap(data))
    # At the rim of what is in range a single beam may make the difference.
    turn = whole.entries[whole.nearest, 5]
    some = data["free"].values[..., None] & (turn > 0.01 * turn.max())
    ratio = thinned.entries[thinned.nearest, 5][some] / turn[some]
    assert 0.98 < np.median(ratio) < 1.02
    assert np.quantile(np.abs(np.log(ratio)), 0.9) < 0.2
    assert (ratio != 1.0).any()


def replace_beams(laser: RangeScanner, beams: int) -> RangeScanner:
    """The same laser with another number of beams over the same aperture."""
    return RangeScanner.planar(sensor=laser.sensors[0], beams=beams, aperture=math.pi)


@pytest.mark.parametrize("radius", [0.5, 1e-5])
def test_the_heading_is_no_better_known_than_by_the_map(radius: float) -> None:
    data = dataset()
    plain = InformationField.of(AmbiguityMap(data)).at(np.array([IN_ROOM]))
    for name, value in (("heading_radius", radius), ("heading", radius / 1.8)):
        full = np.where(data["free"].values, value, np.nan).astype(np.float32)
        data[name] = xr.DataArray(full, dims=("y", "x"))
    found = InformationField.of(AmbiguityMap(data)).at(np.array([IN_ROOM]))
    expected = min(plain[0, 2, 2], 1.0 / radius**2 - 1.0 / 1.8**2)
    assert found[0, 2, 2] == pytest.approx(expected, rel=1e-5)
    # A turn looks like the same shift, and the position is known as before.
    np.testing.assert_allclose(
        found[0, :2, 2] / expected, plain[0, :2, 2] / plain[0, 2, 2], atol=1e-6
    )
    np.testing.assert_allclose(of_position(found), of_position(plain), rtol=1e-4, atol=0.05)


@pytest.mark.parametrize("mount", [(0.15, 0.0, 0.0), (-0.06, 0.1, 1.0)])
def test_a_scanner_off_the_centre_tells_the_same_in_a_turned_building(
    mount: tuple[float, float, float],
) -> None:
    """It looks all around, and its map is that of the scanner in the robot's centre."""
    sensor = RangeSensor(max_range=4.0, std=0.03, resolution=0.01)
    room = shapely.box(0.0, 0.0, 8.0, 3.2).union(shapely.box(0.0, 0.0, 3.2, 7.2))
    laser = RangeScanner.planar(sensor, 60, math.tau, mount=mount)
    poses = np.array([(1.0, 1.2, 0.0), (6.2, 2.6, 0.0), (2.8, 6.6, 0.0), (7.8, 1.0, 0.0)])
    found = []
    for quarter in range(4):
        env = environment_from_shapes([room]).transformed(0.5 * math.pi * quarter)
        field = InformationField.of(build_map(env, laser, spacing=0.4, store=False))
        c, s = round(math.cos(0.5 * math.pi * quarter)), round(math.sin(0.5 * math.pi * quarter))
        turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        found.append(turn.T @ field.at(poses @ turn.T) @ turn)
    centred = InformationField.of(
        build_map(environment_from_shapes([room]), laser.centred, spacing=0.4, store=False)
    ).at(poses)
    for each in found:
        np.testing.assert_allclose(each, centred, rtol=1e-4, atol=1e-3)


@pytest.mark.parametrize("missing", ["tau", "map_std", "beams", "beams_used"])
def test_a_map_that_does_not_say_how_it_was_made(missing: str) -> None:
    data = dataset()
    parameters = json.loads(data.attrs["parameters"])
    del parameters[missing]
    data.attrs["parameters"] = json.dumps(parameters)
    with pytest.raises(InputError, match=f"parameters lack {missing}; make the map again"):
        InformationField.of(AmbiguityMap(data))
