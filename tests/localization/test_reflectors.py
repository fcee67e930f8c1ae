"""Reflectors in scans: detections and expectations against shapely, matching, the Kalman update."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

import ambinav as an
from ambinav.geometry.environment import Environment
from ambinav.geometry.obstacle import Obstacle
from ambinav.layers.reflectors.targets import Targets
from ambinav.layers.reflectors.views import ReflectorRules, seen_reflectors
from ambinav.localization.information import beam_noise
from ambinav.localization.reflector_detection import (
    BEARING,
    COLUMNS,
    EXTENT,
    RANGE,
    SIZE,
    VARIANCE,
    detect_reflectors,
    reflector_beams,
)
from ambinav.localization.reflector_update import update_by_reflectors
from ambinav.localization.reflector_view import (
    BEARING_BY,
    DISTANCE,
    MIDDLE,
    RANGE_BY,
    SLOPE,
    VIEW,
    WIDTH,
    ReflectorMap,
    expect,
)
from ambinav.sensing import Intensity, RangeScanner, RangeSensor, read_intensity

# Compiles kernels that no other test needs.
pytestmark = pytest.mark.slow

Floats = NDArray[np.float64]
ArrayF = NDArray[np.float32]
CHANNEL = Intensity(wall=0.3, reflector=1.0, std=0.15)
CLEAR = Intensity(wall=0.3, reflector=1.0, std=0.01)
GATE = -2.0 * math.log(1e-5)


def laser(
    beams: int = 720,
    mount: tuple[float, float, float] = (0.0, 0.0, 0.0),
    channel: Intensity = CHANNEL,
    aperture: float = 2 * math.pi,
    **fields: float,
) -> RangeScanner:
    """Return a laser of 25 m."""
    sensor = RangeSensor(
        **{"max_range": 25.0, "std": 0.01, "resolution": 0.001, **fields}, intensity=channel
    )
    return RangeScanner.planar(sensor, beams, aperture, mount)


def hall(*posts: tuple[float, float], strips: tuple[float, ...] = ()) -> Environment:
    """Return a hall with posts of 5 cm radius, and strips of 0.3 m on its lower wall."""
    lines = [[(x - 0.15, 0.0), (x + 0.15, 0.0)] for x in strips]
    bare = an.environment_from_shapes([shapely.box(0, 0, 20, 12)], reflectors=lines)
    if not posts:
        return bare
    return bare.edited(add=[Obstacle.post(x, y, 0.05, reflective=True) for x, y in posts])


def known(environment: Environment, scanner: RangeScanner, place: float = 0.0) -> ReflectorMap:
    targets = Targets.of(environment)
    noise = beam_noise(environment, scanner, 0.0)
    return ReflectorMap(targets.edges, targets.first, place, GATE, reflector_beams(scanner), noise)


def detected(scanner: RangeScanner, ranges: ArrayF, intensities: ArrayF, head: int = 0) -> Floats:
    """Return the detections of a scan, (D, COLUMNS)."""
    beams, out = reflector_beams(scanner), np.empty((scanner.beams, COLUMNS))
    noise = beam_noise(hall(), scanner, 0.0)
    count = detect_reflectors(head, ranges, intensities, beams, noise, out)
    return out[:count]


def exact(environment: Environment, scanner: RangeScanner, pose: Floats) -> tuple[ArrayF, ArrayF]:
    """Return true ranges, and intensities that are nearly certain."""
    ranges = scanner.scan(environment, *pose)
    return ranges, read_intensity(
        scanner.with_intensity(CLEAR), environment, *pose, ranges, np.random.default_rng(0)
    )


def test_straight_ahead() -> None:
    """A strip 4 m ahead, square to the robot, and a post 3 m ahead: known in closed form."""
    environment = hall((15.0, 6.0), strips=(10.0,))
    scanner = laser(beams=1440)
    step = math.pi / 720
    pose = np.array([10.0, 4.0, -math.pi / 2])
    strip = detected(scanner, *exact(environment, scanner, pose))
    (ahead,) = strip[np.abs(strip[:, BEARING]) < 0.1]
    half = math.atan2(0.15, 4.0)
    assert ahead[BEARING] == pytest.approx(0.0, abs=1e-9)
    assert ahead[SIZE] == 2 * math.floor(half / step) + 1
    assert ahead[EXTENT] == pytest.approx(2 * math.floor(half / step) * step)
    # Mean of 4 / cos over the angle.
    assert ahead[RANGE] == pytest.approx(4.0 * math.asinh(math.tan(half)) / half, abs=1e-4)
    assert ahead[VARIANCE] == pytest.approx((0.01**2 + 0.001**2 / 12) / ahead[SIZE])
    fine = laser(beams=14400)
    post = detected(fine, *exact(environment, fine, np.array([12.0, 6.0, 0.0])))
    (ahead,) = post[np.abs(post[:, BEARING]) < 0.1]
    # A disc's mean depth, seen from afar, is pi / 4 of its radius.
    assert ahead[RANGE] == pytest.approx(3.0 - math.pi / 4 * 0.05, abs=1e-3)


@pytest.mark.parametrize("mount", [(0.0, 0.0, 0.0), (0.3, -0.2, 2.0)])
def test_detections_are_the_beams_that_meet_each_post(mount: tuple[float, float, float]) -> None:
    """Rays of shapely against the posts' discs, at poses drawn all over the hall."""
    places = [(4.0, 4.0), (15.0, 3.0), (9.0, 9.0), (17.0, 10.5)]
    environment, scanner = hall(*places), laser(mount=mount)
    discs = shapely.union_all([shapely.Point(place).buffer(0.05, 64) for place in places])
    rng = np.random.default_rng(2)
    for x, y, theta in rng.uniform((1.0, 1.0, -3.0), (19.0, 11.0, 3.0), (60, 3)):
        if not environment.is_free(x, y, 0.6):
            continue
        clusters = detected(scanner, *exact(environment, scanner, np.array([x, y, theta])))
        hx = x + math.cos(theta) * mount[0] - math.sin(theta) * mount[1]
        hy = y + math.sin(theta) * mount[0] + math.cos(theta) * mount[1]
        angle = theta + scanner.mounts[:, 2]
        ends = np.column_stack([hx + 25 * np.cos(angle), hy + 25 * np.sin(angle)])
        met = shapely.intersects(shapely.linestrings([[(hx, hy), end] for end in ends]), discs)
        expected = []
        for place in places:
            to = math.atan2(place[1] - hy, place[0] - hx)
            off = (angle - to + math.pi) % (2 * math.pi) - math.pi
            near = np.abs(off) <= math.asin(0.05 / math.dist(place, (hx, hy))) + 1e-4
            if (met & near).any():
                low, high = off[met & near].min(), off[met & near].max()
                expected.append((to - theta + 0.5 * (low + high), high - low))
        hidden = len(expected) - len(clusters)
        assert hidden >= 0
        close = 0
        for bearing, extent in expected:
            off = np.abs((clusters[:, BEARING] - bearing + math.pi) % (2 * math.pi) - math.pi)
            # The world's posts are polygons: one beam at the edge may pass them.
            close += bool(
                ((off < 0.6 * math.pi / 360) & (np.abs(clusters[:, EXTENT] - extent) < 0.01)).any()
            )
        assert close == len(expected) - hidden


def test_a_cluster_survives_a_dark_beam_and_a_random_range() -> None:
    scanner = laser()
    ranges, read = np.full(720, 8.0, np.float32), np.full(720, 0.3, np.float32)
    # Across the direction in which the beams begin.
    for k in (717, 718, 719, 0, 1, 2):
        ranges[k], read[k] = 5.0, 1.0
    (unbroken,) = detected(scanner, ranges, read)
    read[718], ranges[1] = 0.3, 2.0
    cluster, odd = sorted(detected(scanner, ranges, read).tolist(), key=lambda row: -row[SIZE])
    assert cluster[BEARING] == pytest.approx(unbroken[BEARING])
    assert cluster[EXTENT] == pytest.approx(5 * math.pi / 360)
    assert (cluster[SIZE], odd[SIZE]) == (4, 1)
    assert (cluster[RANGE], odd[RANGE]) == (5.0, 2.0)


def test_reflectors_in_adjacent_beams_are_two_if_their_ranges_differ() -> None:
    scanner = laser()
    ranges, read = np.full(720, 8.0, np.float32), np.full(720, 0.3, np.float32)
    read[100:106] = 1.0
    ranges[100:103], ranges[103:106] = 5.0, 5.6
    assert sorted(detected(scanner, ranges, read)[:, RANGE].tolist()) == pytest.approx([5.0, 5.6])


def test_the_bias_of_the_sensor_is_taken_away() -> None:
    scanner = laser(bias=0.05)
    ranges, read = np.full(720, 8.0, np.float32), np.full(720, 0.3, np.float32)
    ranges[100:103], read[100:103] = 5.05, 1.0
    assert detected(scanner, ranges, read)[0, RANGE] == pytest.approx(5.0, abs=1e-6)


def test_two_sensors_detect_apart() -> None:
    both = RangeScanner.mixed(laser(360, (0.3, 0.0, 0.0)), laser(360, (-0.3, 0.0, math.pi)))
    beams = reflector_beams(both)
    assert sorted(beams.head[:, 0].tolist()) == [-0.3, 0.3]
    assert beams.step == pytest.approx([math.pi / 180] * 2)
    environment = hall((10.0, 4.0))
    scan = exact(environment, both, np.array([10.0, 6.0, 0.0]))
    for head in (0, 1):
        (row,) = detected(both, *scan, head)
        assert row[RANGE] == pytest.approx(math.hypot(0.3, 2.0) - math.pi / 4 * 0.05, abs=0.01)


def view_of(reflectors: ReflectorMap, pose: Floats, cov: Floats, k: int = 0) -> Floats | None:
    view = np.empty(VIEW)
    return view if expect(pose, cov, 0, k, reflectors, view) else None


@pytest.mark.parametrize("mount", [(0.0, 0.0, 0.0), (0.4, -0.3, 1.0)])
def test_expectations_are_those_of_shapely(mount: tuple[float, float, float]) -> None:
    """Direction halfway between the edges, mean range over 400 rays; derivatives by differences."""
    environment, scanner = hall((6.0, 5.0), strips=(10.0,)), laser(mount=mount)
    reflectors, targets = known(environment, scanner), Targets.of(environment)
    rng = np.random.default_rng(5)
    for pose in rng.uniform((1.0, 2.0, -3.0), (19.0, 11.0, 3.0), (40, 3)):
        hx = pose[0] + math.cos(pose[2]) * mount[0] - math.sin(pose[2]) * mount[1]
        hy = pose[1] + math.sin(pose[2]) * mount[0] + math.cos(pose[2]) * mount[1]
        for k, (x, y) in enumerate(targets.middle):
            if math.hypot(x - hx, y - hy) < 1.0:
                continue
            rows = targets.edges[targets.first[k] : targets.first[k + 1]].reshape(-1, 2, 2)
            shape, to = shapely.union_all(shapely.linestrings(rows)), math.atan2(y - hy, x - hx)
            ends = rows.reshape(-1, 2) - (hx, hy)
            off = (np.arctan2(ends[:, 1], ends[:, 0]) - to + math.pi) % (2 * math.pi) - math.pi
            angle = to + np.linspace(off.min(), off.max(), 802)[1::2]
            far = np.column_stack([hx + 40 * np.cos(angle), hy + 40 * np.sin(angle)])
            rays = shapely.linestrings([[(hx, hy), end] for end in far])
            ranges = shapely.distance(shapely.intersection(rays, shape), shapely.Point(hx, hy))
            view = view_of(reflectors, pose, np.zeros((3, 3)), k)
            assert view is not None
            middle = to + 0.5 * (off.min() + off.max()) - pose[2]
            off_middle = math.remainder(view[MIDDLE] - middle, 2 * math.pi)
            assert off_middle == pytest.approx(0.0, abs=1e-9)
                0.0, abs=1e-9
            )
            assert view[DISTANCE] == pytest.approx(np.nanmean(ranges), abs=1e-3)
            assert view[WIDTH] == pytest.approx(np.ptp(off))
            # A ray along a strip's end misses it by rounding.
            hit = np.isfinite(ranges)
            slope = np.polyfit(angle[hit] - to, ranges[hit], 1)[0]
            assert view[SLOPE] == pytest.approx(slope, abs=0.02 * view[DISTANCE])
            for j, nudge in enumerate(1e-4 * np.eye(3)):
                after, before = (
                    view_of(reflectors, pose + sign * nudge, np.zeros((3, 3)), k)
                    for sign in (1.0, -1.0)
                )
                assert after is not None and before is not None
                change = (after[[MIDDLE, DISTANCE]] - before[[MIDDLE, DISTANCE]]) / 2e-4
                change[0] = math.remainder(after[MIDDLE] - before[MIDDLE], 2 * math.pi) / 2e-4
                assert view[BEARING_BY + j] == pytest.approx(change[0], abs=2e-3)
                # A slanted strip shows its near end a little more than its far one.
                assert view[RANGE_BY + j] == pytest.approx(change[1], abs=0.06)


def test_detections_are_unbiased_at_many_poses() -> None:
    """Of posts and strips, at all angles up to 45 degrees: to 2 mm, and as noisy as they say."""
    environment = hall((4.0, 4.0), (15.0, 8.0), strips=(6.0, 13.0))
    scanner = laser(beams=1440, mount=(0.3, -0.1, 0.7))
    reflectors, targets = known(environment, scanner), Targets.of(environment)
    rng = np.random.default_rng(3)
    poses = rng.uniform((1.0, 1.0, -3.0), (19.0, 11.0, 3.0), (1500, 3))
    poses = poses[np.asarray(environment.is_free(poses[:, 0], poses[:, 1], 0.6))]
    seen = seen_reflectors(environment, scanner, targets, poses, ReflectorRules())
    ranges = scanner.read(environment, *poses.T, rng)
    read = read_intensity(scanner, environment, *poses.T, ranges, rng)
    for k in range(len(targets)):
        errors = []
        for pose, scan, bright in zip(
            poses[seen[:, k]], ranges[seen[:, k]], read[seen[:, k]], strict=True
        ):
            view = view_of(reflectors, pose, np.zeros((3, 3)), k)
            assert view is not None
            rows = detected(scanner, scan, bright)
            off = (rows[:, BEARING] - view[MIDDLE] + math.pi) % (2 * math.pi) - math.pi
            apart = np.hypot(off * view[DISTANCE], rows[:, RANGE] - view[DISTANCE])
            if len(rows) and apart.min() < 0.3:
                best = apart.argmin()
                errors.append((off[best] * view[DISTANCE], rows[best, RANGE] - view[DISTANCE]))
        across, along = np.array(errors).T
        assert len(across) > 0.98 * seen[:, k].sum()
        for values in (across, along):
            bound = max(0.002, 4.0 * values.std() / math.sqrt(len(values)))
            assert abs(values.mean()) < bound <= 0.004


def one_update(
    environment: Environment, scanner: RangeScanner, pose: Floats, prior: Floats, cov: Floats,
    place: float = 0.0, scan: tuple[ArrayF, ArrayF] | None = None,
) -> tuple[Floats, Floats, int]:  # fmt: skip
    """Return estimate, covariance and number of reflectors after a scan without noise."""
    reflectors = known(environment, scanner, place)
    ranges, read = exact(environment, scanner, pose) if scan is None else scan
    mean, after, used = prior[None].copy(), cov[None].copy(), np.empty(1, dtype=np.int64)
    rules = ReflectorRules()
    seen = seen_reflectors(environment, scanner, Targets.of(environment), mean, rules)
    update_by_reflectors(mean, after, ranges[None], read[None], seen, reflectors, used)
    return mean[0], after[0], int(used[0])


PRIOR = np.array([[0.04, 0.01, 0.002], [0.01, 0.03, -0.001], [0.002, -0.001, 0.001]]) / 4


def test_one_post_is_the_update_of_the_textbook() -> None:
    """The gain K = P H' (H P H' + R)^-1 (Probabilistic Robotics, table 7.2), by differences."""
    environment, scanner = hall((8.0, 7.0)), laser(mount=(0.2, 0.1, 0.5))
    truth = np.array([12.0, 5.0, 2.0])
    before = truth + np.array((0.05, -0.04, 0.01))
    mean, cov, used = one_update(environment, scanner, truth, before, PRIOR, place=0.0004)
    assert used == 1

    def reading(pose: Floats) -> Floats:
        c, s = math.cos(pose[2]), math.sin(pose[2])
        dx = 8.0 - pose[0] - (0.2 * c - 0.1 * s)
        dy = 7.0 - pose[1] - (0.2 * s + 0.1 * c)
        return np.array([math.atan2(dy, dx) - pose[2], math.hypot(dx, dy)])

    scan = exact(environment, scanner, truth)
    (row,) = detected(scanner, *scan)
    depth = math.pi / 4 * 0.05
    off = np.array([row[BEARING], row[RANGE] + depth]) - reading(before)
    H = np.array([reading(before + e) - reading(before - e) for e in 1e-6 * np.eye(3)]).T / 2e-6
    far = reading(before)[1] - depth
    # Depths of a disc of radius r have the variance (2 / 3 - pi^2 / 16) r^2.
    shape = (2 / 3 - math.pi**2 / 16) * 0.05**2
    R = np.diag(
        [(math.pi / 360) ** 2 / 12 + 0.0004 / far**2,
         (0.01**2 + 0.001**2 / 12 + shape) / row[SIZE] + 0.0004]
    )  # fmt: skip
    K = PRIOR @ H.T @ np.linalg.inv(H @ PRIOR @ H.T + R)
    assert np.allclose(mean, before + K @ off, atol=3e-4)
    assert np.allclose(cov, PRIOR - K @ H @ PRIOR, atol=2e-5)


def test_three_in_view_fix_the_pose() -> None:
    environment = hall((4.0, 4.0), (15.0, 8.0), (12.0, 2.0))
    truth = np.array([9.0, 6.0, 0.3])
    mean, cov, used = one_update(
        environment, laser(1440), truth, truth + np.array((0.1, -0.1, 0.03)), PRIOR
    )
    assert used == 3
    assert np.hypot(*(mean - truth)[:2]) < 0.02
    assert math.sqrt(cov[0, 0] + cov[1, 1]) < 0.02
    assert np.linalg.eigvalsh(cov).min() > 0.0


def test_what_is_no_reflector_of_the_map_is_left_out() -> None:
    """A vest beside the path, a surface wider than the post, and a post behind a wall."""
    environment, scanner = hall((8.0, 7.0)), laser()
    truth = np.array([12.0, 5.0, 2.0])
    ranges, read = exact(environment, scanner, truth)
    bright = np.flatnonzero(read > 0.7)
    vest = read.copy()
    vest[bright], vest[bright - 90] = 0.3, 1.0
    wide = read.copy()
    wide[bright[0] - 6 : bright[-1] + 7] = 1.0
    flat = ranges.copy()
    flat[bright[0] - 6 : bright[-1] + 7] = ranges[bright].mean()
    for scan in ((ranges, vest), (flat, wide)):
        mean, cov, used = one_update(environment, scanner, truth, truth, PRIOR, scan=scan)
        assert used == 0
        assert np.array_equal(mean, truth)
        assert np.array_equal(cov, PRIOR)
    walled = environment.edited(add=[Obstacle.wall([(9.0, 4.0), (11.0, 9.0)])])
    assert one_update(walled, scanner, truth, truth, PRIOR, scan=(ranges, read))[2] == 0


def test_what_may_be_two_is_used_once_others_tell() -> None:
    """Posts 0.3 m apart and a pose known to 0.3 m: alone neither is used, beside a third both."""
    pair, third = ((8.0, 7.0), (8.0, 7.3)), (16.0, 9.0)
    truth, wide = np.array([12.0, 5.0, 2.0]), np.diag([0.09, 0.09, 0.01])
    prior = truth + np.array((0.1, 0.15, 0.02))
    scanner = laser(1440)
    mean, _, used = one_update(hall(*pair), scanner, truth, prior, wide)
    assert used == 0
    assert np.array_equal(mean, prior)
    mean, _, used = one_update(hall(*pair, third, (12.0, 10.0)), scanner, truth, prior, wide)
    assert used == 4
    assert np.hypot(*(mean - truth)[:2]) < 0.03


def test_a_half_hidden_strip_widens_the_bearing() -> None:
    """The estimate stays within what the covariance says, at 40 poses behind a screen."""
    environment = hall(strips=(10.0,)).edited(add=[Obstacle.wall([(9.0, 0.5), (9.99, 0.5)])])
    scanner, in_sight = laser(1440), hall(strips=(10.0,))
    squares = []
    for y in np.linspace(2.0, 5.0, 40):
        truth = np.array([10.0, y, 0.4])
        mean, cov, used = one_update(environment, scanner, truth, truth, PRIOR)
        _, free, _ = one_update(in_sight, scanner, truth, truth, PRIOR)
        assert used == 1
        assert np.linalg.det(cov) > 4.0 * np.linalg.det(free)
        error = mean - truth
        squares.append(error @ np.linalg.solve(cov, error))
    assert max(squares) < 3.0


def test_a_strip_at_grazing_incidence_keeps_to_its_covariance() -> None:
    """At 70 degrees, with the rule for incidence off: bearing and range err together."""
    environment, scanner = hall(strips=(14.0,)), laser(1440)
    reflectors, rng = known(environment, scanner), np.random.default_rng(8)
    cov = np.diag([0.05, 0.05, 0.02]) ** 2
    squares = []
    for shift in rng.uniform(0.0, 0.5, 200):
        truth = np.array([14.0 - 8.0 * math.tan(math.radians(70)) * 0.3 - shift, 2.4, 0.0])
        ranges = scanner.read(environment, *truth, rng)
        read = read_intensity(scanner, environment, *truth, ranges, rng)
        mean = (truth + rng.normal(size=3) * np.sqrt(np.diag(cov)))[None]
        after, used = cov[None].copy(), np.empty(1, dtype=np.int64)
        update_by_reflectors(
            mean, after, ranges[None], read[None], np.ones((1, 1), bool), reflectors, used
        )
        if used[0]:
            error = mean[0] - truth
            squares.append(error @ np.linalg.solve(after[0], error))
    assert len(squares) > 180
    assert 2.4 < np.mean(squares) < 3.6


def test_beams_are_sorted_by_sensor_and_direction() -> None:
    beams = reflector_beams(RangeScanner.mixed(laser(16), laser(8, (1.0, 0.0, 0.5))))
    assert beams.first.tolist() == [0, 16, 24]
    for low, high in pairwise(beams.first.tolist()):
        turns = np.mod(beams.yaw[low:high], 2 * math.pi)
        assert (np.diff(turns) > 0.0).all()
