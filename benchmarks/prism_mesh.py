"""Random buildings of prisms, and the same buildings as triangles, for Embree and for tests."""

from __future__ import annotations

import math

import numpy as np
import shapely
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray
from shapely import affinity

from ambinav.casting.prisms.prisms import Prisms, Solid
from ambinav.casting.space import SpaceRays
from ambinav.sensing.scanner import RangeScanner

# How far the floor's and the ceiling's triangles reach beyond the walls, metres.
BEYOND = 100.0
CEILING = 2.8
# VLP-16: 16 layers from -15 to 15 degrees.
LAYERS = np.radians(np.linspace(-15.0, 15.0, 16))


def office(rooms: int, seed: int) -> Prisms:
    """Return a floor of `rooms` x `rooms` turned rooms with doors, windows and furniture."""
    rng = np.random.default_rng(seed)
    size, thick = 5.0, 0.1
    solids: list[Solid] = []

    def add(x: float, y: float, wide: float, deep: float, bottom: float, top: float) -> None:
        shape = shapely.box(x - wide / 2, y - deep / 2, x + wide / 2, y + deep / 2)
        solids.append(Solid(affinity.rotate(shape, 17.0, origin=(0.0, 0.0)), bottom, top))

    def wall(x: float, y: float, upright: bool, openings: bool) -> None:
        """Add a wall of one room, from (x, y) on, with a door or a window in it."""
        pieces = [(0.0, size, 0.0, CEILING)]
        if openings:
            at, door = rng.uniform(0.5, size - 1.5), rng.random() < 0.6
            pieces = [(0.0, at, 0.0, CEILING), (at + 1.0, size, 0.0, CEILING)]
            pieces.append((at, at + 1.0, 2.1, CEILING))
            if not door:
                pieces.append((at, at + 1.0, 0.0, 0.9))
        for low, high, bottom, top in pieces:
            middle, long = (low + high) / 2, high - low
            if upright:
                add(x, y + middle, thick, long, bottom, top)
            else:
                add(x + middle, y, long, thick, bottom, top)

    for i in range(rooms + 1):
        for j in range(rooms):
            inner = 0 < i < rooms
            wall(i * size, j * size, True, inner)
            wall(j * size, i * size, False, inner)
    for i in range(rooms):
        for j in range(rooms):
            x, y = i * size, j * size
            add(x + 2.5, y + 2.5, 0.2, size - thick, 2.5, CEILING)
            for _ in range(2):
                tx, ty = rng.uniform((x + 1.0, y + 1.0), (x + 4.0, y + 4.0))
                add(tx, ty, 1.6, 0.8, 0.70, 0.74)
                for lx, ly in ((-0.75, -0.35), (0.75, -0.35), (-0.75, 0.35), (0.75, 0.35)):
                    add(tx + lx, ty + ly, 0.06, 0.06, 0.0, 0.70)
            for shelf in (0.3, 0.9, 1.5):
                add(x + 0.25, y + 3.0, 0.3, 1.2, shelf, shelf + 0.03)
    return Prisms(solids=solids, floor=0.0, ceiling=CEILING)


def triangles(prisms: Prisms) -> NDArray[np.float64]:
    """Return the triangles of all surfaces, shape (T, 3, 3), metres."""
    faces = []
    for (ax, ay, bx, by), (low, high) in zip(prisms.walls.xy, prisms.wall_z, strict=True):
        a, b = (ax, ay, low), (bx, by, low)
        c, d = (bx, by, high), (ax, ay, high)
        faces += [(a, b, c), (a, c, d)]
    flats = [(solid.outline, z) for solid in prisms.solids for z in (solid.bottom, solid.top)]
    box = shapely.box(*prisms.walls.bounds).buffer(BEYOND, join_style="mitre")
    flats += [(box, z) for z in (prisms.floor, prisms.ceiling) if math.isfinite(z)]
    for outline, z in flats:
        for part in shapely.get_parts(shapely.constrained_delaunay_triangles(outline)):
            faces.append(tuple((x, y, z) for x, y in shapely.get_coordinates(part)[:3]))
    return np.array(faces)


def embree_scene(prisms: Prisms) -> EmbreeScene:
    """Return the building as an Embree scene."""
    scene = EmbreeScene()
    TriangleMesh(scene, triangles(prisms).astype(np.float32))
    return scene


def poses(prisms: Prisms, count: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Draw poses x, y, theta within the walls, in no solid that a scanner 0.5 m high meets."""
    solid = shapely.union_all([s.outline for s in prisms.solids if s.bottom < 0.6])
    shapely.prepare(solid)
    inner = shapely.union_all([s.outline for s in prisms.solids]).convex_hull.buffer(-0.2)
    xmin, ymin, xmax, ymax = prisms.walls.bounds
    drawn = np.empty((0, 3))
    while len(drawn) < count:
        tried = rng.uniform((xmin, ymin, -math.pi), (xmax, ymax, math.pi), (2 * count, 3))
        points = shapely.points(tried[:, :2])
        good = shapely.contains(inner, points) & ~shapely.dwithin(solid, points, 0.05)
        drawn = np.concatenate([drawn, tried[good]])
    return np.ascontiguousarray(drawn[:count])


def vlp16(beams: int = 360) -> SpaceRays:
    """Return the rays of a level VLP-16, half a metre above the floor."""
    azimuth = -math.pi + 2.0 * math.pi * np.arange(beams) / beams
    return SpaceRays.layers(LAYERS, azimuth, 0.5)


def mid360() -> SpaceRays:
    """Return the sampled rays of a level Mid-360, half a metre above the floor."""
    rays = RangeScanner.from_preset("livox-mid-360").rays(in_space=True)
    origin = np.zeros((len(rays.angle), 3))
    origin[:, 2] = 0.5
    return SpaceRays(origin, rays.angle, rays.elevation)
