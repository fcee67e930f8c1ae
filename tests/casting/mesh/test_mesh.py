"""Rays against triangles: known distances, the same building as prisms, and other processes."""

from __future__ import annotations

import math
import os
import pickle
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from ambinav.casting.mesh.mesh import Mesh
from ambinav.casting.prisms.prisms import Prisms
from ambinav.casting.space import SpaceCaster, SpaceRays
from ambinav.runtime.errors import InputError

pytest.importorskip("embreex", reason="embreex is not installed")

REACH = 30.0
ROOT = Path(__file__).parents[3]
BOX = [
    (0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1),
    (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3),
]  # fmt: skip


def corners(x: float, y: float, z: float) -> np.ndarray:
    """Corners of a box from the origin to (x, y, z): 0 is the origin, z runs fastest."""
    return np.array([(a, b, c) for a in (0, x) for b in (0, y) for c in (0, z)], dtype=float)


def room() -> Mesh:
    return Mesh(corners(6, 4, 3), BOX, name="room")


def test_known_distances_from_the_middle_of_a_room() -> None:
    six = np.vstack([np.eye(3), -np.eye(3)])
    mesh = room()
    distance, face = mesh.cast((2.0, 1.0, 0.5), six * 7.0, REACH)
    assert distance == pytest.approx([4.0, 3.0, 2.5, 2.0, 1.0, 0.5], abs=1e-6)
    assert np.abs((mesh.surface_normal[face] * six).sum(axis=1)) == pytest.approx(1.0)
    away, none = mesh.cast((9.0, 1.0, 0.5), (1.0, 0.0, 0.0), REACH)
    assert (away, none) == (REACH, -1)
    near, none = mesh.cast((2.0, 1.0, 0.5), (1.0, 0.0, 0.0), 3.9)
    assert (near, none) == (pytest.approx(3.9), -1)


def test_far_from_the_map_s_origin_it_is_as_exact() -> None:
    inside = np.array([2.0, 1.0, 0.5])
    at = np.array([500_000.0, 5_400_000.0, 300.0])
    distance, _ = Mesh(corners(6, 4, 3) + at, BOX).cast(at + inside, (1, 0, 0), REACH)
    assert distance == pytest.approx(4.0, abs=1e-5)


def test_a_scan_is_its_rays_one_by_one() -> None:
    mesh, rng = room(), np.random.default_rng(1)
    x, y, theta = rng.uniform(0.5, 3.5, 50), rng.uniform(0.5, 3.5, 50), rng.uniform(-3, 3, 50)
    rays = SpaceRays.layers(np.radians([-20.0, 0.0, 30.0]), rng.uniform(-3, 3, 10), 0.6)
    rays = rays.mounted(0.1, 0.0, 0.0, 0.2, 0.3, -0.1)
    distance, face, incidence = mesh.cast_scans(x, y, theta, rays, 2.0)
    origin, direction = rays.at(x, y, theta)
    expected, of = mesh.cast(origin, direction, 2.0)
    assert np.array_equal(face, of) and (face < 0).any() and (face >= 0).any()
    assert np.array_equal(np.isinf(distance), face < 0)
    assert np.abs(np.minimum(distance, 2.0) - expected).max() < 1e-6
    facing = np.abs((direction * mesh.surface_normal[face]).sum(axis=-1))
    assert np.abs(np.cos(incidence) - facing)[face >= 0].max() < 1e-6
    assert np.isnan(incidence[face < 0]).all()


def test_prisms_and_their_triangles_return_the_same_through_one_protocol() -> None:
    from prism_mesh import office, poses, triangles, vlp16

    prisms, rays = office(2, 5), vlp16(60)
    points = triangles(prisms)
    mesh = Mesh(points.reshape(-1, 3), np.arange(3 * len(points)).reshape(-1, 3))
    at = poses(prisms, 40, np.random.default_rng(6))
    ours = prisms.cast_scans(*at.T, rays, REACH)
    theirs = mesh.cast_scans(*at.T, rays, REACH)
    gap = np.abs(ours[0] - theirs[0])
    assert (gap > 1e-4).sum() <= 2
    same = gap < 1e-4
    facing = [
        np.abs(caster.surface_normal[surface] @ np.eye(3))
        for caster, surface in ((prisms, ours[1]), (mesh, theirs[1]))
    ]
    assert (np.abs(facing[0] - facing[1]).max(axis=-1) < 1e-5)[same].mean() > 0.999
    assert np.median(np.abs(ours[2] - theirs[2])) < 1e-5


@pytest.mark.parametrize("kind", ["prisms", "mesh"])
def test_poses_that_are_not_finite_and_no_poses_and_no_rays(kind: str) -> None:
    caster: SpaceCaster = room()
    if kind == "prisms":
        sheets = [(0, 0, 6, 0), (6, 0, 6, 4), (6, 4, 0, 4), (0, 4, 0, 0)]
        caster = Prisms(sheets, [(0, 3)] * 4, floor=0.0, ceiling=3.0)
    rays = SpaceRays.layers(np.radians([-90.0, 0.0, 20.0]), np.zeros(2), 0.5).mounted(
        0.1, 0.0, 0.0, 0.0, 0.0, 0.0
    )
    nan, inf = math.nan, math.inf
    poses = np.array([(nan, 1, 0), (1, inf, 0), (1, 1, nan), (1, 1, 0)], dtype=float)
    distance, surface, incidence = caster.cast_scans(*poses.T, rays, math.inf)
    assert np.isnan(distance).all(axis=1).tolist() == [True, True, True, False]
    assert (surface[:3] == -1).all() and np.isnan(incidence[:3]).all()
    assert distance[3, ::2] == pytest.approx([0.5, 4.9, 4.9 / math.cos(math.radians(20))])
    for rows, few in ((poses[:0], rays), (poses[3:], SpaceRays(*(part[:0] for part in rays)))):
        found = caster.cast_scans(*rows.T, few, REACH)
        assert {part.shape for part in found} == {(len(rows), len(few.azimuth))}


# -- other processes ---------------------------------------------------------------------------


def many_rays(count: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(2)
    return rng.uniform(0.1, (5.9, 3.9, 2.9), (count, 3)), rng.normal(size=(count, 3))


@pytest.mark.slow
def test_processes_and_order_change_no_bit() -> None:
    origin, direction = many_rays(30_000)
    order = np.random.default_rng(3).permutation(len(origin))
    one, face = room().cast(origin, direction, REACH)
    with Mesh(corners(6, 4, 3), BOX, processes=3) as mesh:
        for rows in (np.arange(len(origin)), order, order[:5], order[:0]):
            distance, of = mesh.cast(origin[rows], direction[rows], REACH)
            assert np.array_equal(distance, one[rows]) and np.array_equal(of, face[rows])


def pids(mesh: Mesh) -> list[int]:
    return [process.pid for process in mesh._caster._team._processes]


def ended(pid: int, seconds: float = 20.0) -> bool:
    """Whether a process is gone, or only waits to be buried by its parent."""
    stop = time.monotonic() + seconds
    while time.monotonic() < stop:
        try:
            state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
        except OSError:
            return True
        if state == "Z":
            return True
        time.sleep(0.02)
    return False


@pytest.mark.slow
def test_a_killed_process_is_said_and_the_next_cast_works() -> None:
    origin, direction = many_rays(10_000)
    with Mesh(corners(6, 4, 3), BOX, processes=2) as mesh:
        before, _ = mesh.cast(origin, direction, REACH)
        first = pids(mesh)
        os.kill(first[1], signal.SIGKILL)
        with pytest.raises(RuntimeError, match="ended with the status -9"):
            mesh.cast(origin, direction, REACH)
        after, _ = mesh.cast(origin, direction, REACH)
        assert np.array_equal(before, after)
        second = pids(mesh)
        assert pickle.loads(pickle.dumps(mesh)).bounds.tolist() == mesh.bounds.tolist()
    assert all(ended(pid) for pid in [*first, *second])


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="no /proc to look into")
def test_no_process_outlives_the_one_that_started_it() -> None:
    # The script has no `if __name__ == "__main__":`, and needs none.
    script = (
        "import numpy as np, os, signal\n"
        "from tests.casting.mesh.test_mesh import *\n"
        "mesh = Mesh(corners(6, 4, 3), BOX, processes=2)\n"
        "mesh.cast(*many_rays(10_000), REACH)\n"
        "print(*pids(mesh), flush=True)\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": f"{ROOT}:{ROOT / 'benchmarks'}"},
        stdout=subprocess.PIPE,
        timeout=120,
        check=False,
    )
    assert done.returncode == -signal.SIGKILL
    started = [int(word) for word in done.stdout.split()]
    assert len(started) == 2
    assert all(ended(pid) for pid in started)


# -- what it is made of ------------------------------------------------------------------------


def test_open_and_self_intersecting_meshes_are_no_error() -> None:
    assert room().open_edges == 0
    lidless = Mesh(corners(6, 4, 3), BOX[:8])
    assert lidless.open_edges > 0
    crossed = np.concatenate([corners(6, 4, 3), corners(6, 4, 3) + 1.0])
    both = Mesh(crossed, [*BOX, *(tuple(k + 8 for k in face) for face in BOX)])
    distance, _ = both.cast((3.0, 2.0, 2.0), (-1.0, 0.0, 0.0), REACH)
    assert distance == pytest.approx(2.0, abs=1e-5)


def test_faces_without_an_area_are_left_out() -> None:
    mesh = Mesh(corners(6, 4, 3), [(0, 0, 1), *BOX])
    assert len(mesh.faces) == len(BOX)
    assert np.isfinite(mesh.surface_normal).all()


@pytest.mark.parametrize(
    ("vertices", "faces", "text"),
    [
        (corners(1, 1, 1), [], "8 points and no triangle"),
        (corners(1, 1, 1), [(0, 0, 1)], "no triangle with an area"),
        (corners(1, math.nan, 1), BOX, "not finite"),
        (corners(1, 1, math.inf), BOX, "not finite"),
        (corners(1, 1, 1), [(0, 1, 8)], "not there"),
        (corners(1, 1, 1), [(0, 1, -1)], "not there"),
    ],
)
def test_refused(vertices: np.ndarray, faces: list[tuple[int, int, int]], text: str) -> None:
    with pytest.raises(InputError, match=text):
        Mesh(vertices, faces)


def test_refused_calls() -> None:
    with pytest.raises(InputError, match="processes is 0"):
        Mesh(corners(1, 1, 1), BOX, processes=0)
    with pytest.raises(InputError, match="max_range is 0"):
        room().cast((1, 1, 1), (1, 0, 0), 0)
    distance, face = room().cast([(1, 1, math.nan), (1, 1, 1)], [(1, 0, 0), (0, 0, 0)], REACH)
    assert np.isnan(distance).all() and (face == -1).all()


def test_each_ray_may_have_a_pose_of_its_own() -> None:
    rng = np.random.default_rng(3)
    x, y, theta = rng.uniform((0.5, 0.5, -3.0), (5.5, 3.5, 3.0), (4, 6, 3)).transpose(2, 0, 1)
    rays = SpaceRays(np.tile((0.1, 0.0, 1.0), (6, 1)), rng.uniform(-3, 3, 6), rng.uniform(-1, 1, 6))
    mesh = room()
    found = mesh.cast_scans(x, y, theta, rays, REACH)
    for k in range(6):
        alone = mesh.cast_scans(x[:, k], y[:, k], theta[:, k], rays, REACH)
        assert all(np.array_equal(a[:, k], b[:, k]) for a, b in zip(found, alone, strict=True))
