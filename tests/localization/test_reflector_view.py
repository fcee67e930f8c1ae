"""Expectations of reflectors against shapely, and detections against them at many poses."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from ambinav.layers.reflectors.targets import Targets
from ambinav.layers.reflectors.views import ReflectorRules, seen_reflectors
from ambinav.localization.reflector_detection import BEARING, RANGE
from ambinav.localization.reflector_view import BEARING_BY, DISTANCE, MIDDLE, RANGE_BY, SLOPE, WIDTH
from ambinav.sensing import read_intensity
from tests.localization.reflector_scenes import detected, hall, known, laser, view_of

# Compiles kernels that no other test needs.
pytestmark = pytest.mark.slow


@pytest.mark.slow(kept=("mount1",))
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
    found = [detected(scanner, scan, bright) for scan, bright in zip(ranges, read, strict=True)]
    for k in range(len(targets)):
        errors = []
        for i in np.flatnonzero(seen[:, k]):
            view = view_of(reflectors, poses[i], np.zeros((3, 3)), k)
            assert view is not None
            rows = found[i]
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
