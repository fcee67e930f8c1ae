"""IFC buildings in 3D: their prisms against the plan, and against the file's own triangles.

- Level rays at the height at which the plan is cut, from random free poses, 90 all around: prisms
  against the plan.
- Random rays from random free places, heights of 0.1 to 2.2 m: prisms against the triangles of the
  same elements, cast by Embree. Rays that start in a solid are left out, and those that end on a
  frontier, which triangles have none of; these must not pass through a triangle.
"""

from __future__ import annotations

import argparse
import math
import time
import warnings
from typing import NamedTuple

import numpy as np
from harness import add_out, environment_path, report, table
from numpy.typing import NDArray

from ambinav.buildings.ifc.file import read_storey
from ambinav.buildings.ifc.parts import BELOW, elements_of, meshes, part_role
from ambinav.buildings.load import load_environment
from ambinav.casting.mesh.mesh import Mesh
from ambinav.casting.plane.fan import scan_plan
from ambinav.casting.space import SpaceRays
from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import FRONTIER
from ambinav.runtime.errors import InputWarning

BUILDINGS: dict[str, str | int | None] = {
    "institute": 1,
    "duplex": "Level 1",
    "barcelona_pavilion": None,
}
HEIGHT = 0.3
"""Above the floor, metres: where plans are cut."""
REACH = 30.0
LEVEL_RAYS, RANDOM_RAYS = 90, 200
"""From each pose."""
LIMITS = (0.001, 0.02, 0.1)
LEFT_OUT = {"space", "opening", "door", "leaf"}
"""Roles of what is no body where doors are open."""


class Poses(NamedTuple):
    """Poses of the rays' origins, metres and radians, shape (N,) each."""

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    theta: NDArray[np.float64]


def main() -> None:
    """Cast, compare and report."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--poses", type=int, default=1500)
    parser.add_argument("--seed", type=int, default=0)
    add_out(parser)
    args = parser.parse_args()
    warnings.simplefilter("ignore", InputWarning)
    level, steep = [], []
    for name, storey in BUILDINGS.items():
        path, rng = environment_path(name), np.random.default_rng(args.seed)
        begun = time.perf_counter()
        load_environment(path, level=storey)
        planned = time.perf_counter()
        building = load_environment(path, level=storey, in_space=True)
        seconds = (planned - begun, time.perf_counter() - planned)
        poses = free_poses(building, args.poses, rng)
        level.append((name, *(f"{value:.1f}" for value in seconds), *level_row(building, poses)))
        triangles, floor = mesh_of(name, storey)
        first_poses = Poses(*(values[: args.poses * 2 // 3] for values in poses))
        steep.append(
            (name, len(triangles.faces), *random_row(building, triangles, floor, first_poses, rng))
        )
    text = "\n\n".join([
        str(__doc__).split("\n\n", 1)[1].strip(),
        "## Level rays",
        table(
            ("building", "read as a plan, s", "in space, s", "rays", "largest difference, m",
             "kinds differ"),
            level,
        ),
        "## Random rays",
        table(
            ("building", "triangles", "rays", "on a frontier",
             *(f"differ by > {1000 * limit:g} mm" for limit in LIMITS),
             "on a frontier behind a triangle"),
            steep,
        ),
    ])  # fmt: skip
    report("IFC buildings in space", ["ifcopenshell", "embreex", "numpy"], text, args.out)


def free_poses(building: Environment, count: int, rng: np.random.Generator) -> Poses:
    """Draw random poses on the floor."""
    xmin, ymin, xmax, ymax = building.bounds
    points = np.empty((0, 2))
    while len(points) < count:
        drawn = rng.uniform((xmin, ymin), (xmax, ymax), (count, 2))
        points = np.concatenate([points, drawn[building.is_free(*drawn.T)]])
    x, y = np.ascontiguousarray(points[:count].T)
    return Poses(x, y, rng.uniform(-math.pi, math.pi, count))


def level_row(building: Environment, poses: Poses) -> tuple[object, ...]:
    """Return the differences between the prisms and the plan."""
    assert building.space is not None
    azimuth = np.linspace(-math.pi, math.pi, LEVEL_RAYS, endpoint=False)
    origin = np.zeros((LEVEL_RAYS, 3))
    flat, segment, _ = scan_plan(building.plan, *poses, origin[:, :2], azimuth, REACH)
    origin[:, 2] = HEIGHT + building.floor
    rays = SpaceRays(origin, azimuth, np.zeros(LEVEL_RAYS))
    solid, surface, _ = building.space.cast_scans(*poses, rays, REACH)
    met = np.isfinite(flat) & np.isfinite(solid)
    both = (np.isnan(flat) == np.isnan(solid)) & (np.isinf(flat) == np.isinf(solid))
    largest = np.abs(flat[met] - solid[met]).max() if both.all() else math.inf
    kinds = building.plan.segments.kind[segment[met]] != building.surface_kind[surface[met]]
    return flat.size, f"{largest:.1e}", f"{kinds.mean():.2%}"


def mesh_of(name: str, storey: str | int | None) -> tuple[Mesh, float]:
    """Return the triangles of the elements of a storey, and z of its floor."""
    plan = read_storey(
        environment_path(name), storey, height=HEIGHT, doors="open", glass="solid", furniture=True
    )
    top = plan.next_floor + BELOW - plan.storey.elevation
    elements = elements_of(plan.model, plan.storey, top, furniture=True)
    bodies = [element for element in elements if part_role(element) not in LEFT_OUT]
    vertices, faces, count = [], [], 0
    for _, corners, triangles, _ in meshes(plan.model, bodies):
        if len(triangles):
            vertices.append(corners)
            faces.append(triangles + count)
            count += len(corners)
    return Mesh(np.concatenate(vertices), np.concatenate(faces)), plan.storey.elevation


def random_row(
    building: Environment, triangles: Mesh, floor: float, poses: Poses, rng: np.random.Generator
) -> tuple[object, ...]:
    """Return the differences between the prisms and the triangles."""
    assert building.space is not None
    u = rng.normal(size=(RANDOM_RAYS, 3))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    origin = np.zeros((RANDOM_RAYS, 3))
    origin[:, 2] = floor + rng.uniform(0.1, 2.2, RANDOM_RAYS)
    rays = SpaceRays(origin, np.arctan2(u[:, 1], u[:, 0]), np.arcsin(u[:, 2]))
    mine, surface, _ = building.space.cast_scans(*poses, rays, REACH)
    other, _, _ = triangles.cast_scans(*poses, rays, REACH)
    outside = ~np.isnan(mine)
    a, b = (np.minimum(values, REACH)[outside].astype(float) for values in (mine, other))
    end = surface[outside]
    frontier = (end >= 0) & (building.surface_kind[end] == FRONTIER)
    off = np.where(frontier, 0.0, np.abs(a - b))
    behind = frontier & (b < a - LIMITS[0])
    return (
        len(a), f"{frontier.mean():.1%}", *(f"{(off > limit).mean():.2%}" for limit in LIMITS),
        f"{behind.mean():.2%}",
    )  # fmt: skip


if __name__ == "__main__":
    main()
