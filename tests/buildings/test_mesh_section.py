"""Sections of bodies whose outlines are known."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

from ambinav.buildings.mesh_section import section

Mesh = tuple[NDArray[np.float64], NDArray[np.int64]]
FACES = np.array(
    [
        [0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7], [0, 1, 5], [0, 5, 4],
        [1, 2, 6], [1, 6, 5], [2, 3, 7], [2, 7, 6], [3, 0, 4], [3, 4, 7],
    ]
)  # fmt: skip


def box(x0: float, y0: float, z0: float, x1: float, y1: float, z1: float) -> Mesh:
    ring = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    return np.array([(x, y, z) for z in (z0, z1) for x, y in ring], dtype=float), FACES


def both(*meshes: Mesh) -> Mesh:
    first = np.cumsum([0] + [len(vertices) for vertices, _ in meshes])
    return (
        np.concatenate([vertices for vertices, _ in meshes]),
        np.concatenate([faces + k for (_, faces), k in zip(meshes, first, strict=False)]),
    )


@pytest.mark.parametrize("height", [0.0, 0.3, 1.0])  # corners on the plane lie above it
def test_a_box_gives_its_rectangle(height: float) -> None:
    area, lines = section(*box(1, 2, -1, 4, 3, 1), height)
    assert area.equals(shapely.box(1, 2, 4, 3))
    assert lines.is_empty


@pytest.mark.parametrize("height", [-1.0 - 1e-9, 1.0 + 1e-9, 7.0])
def test_beyond_a_body_there_is_nothing(height: float) -> None:
    area, lines = section(*box(1, 2, -1, 4, 3, 1), height)
    assert area.is_empty
    assert lines.is_empty


def test_bodies_that_overlap_are_one_area() -> None:
    area, _ = section(*both(box(0, 0, 0, 2, 1, 1), box(1, 0, 0, 3, 2, 1)), 0.5)
    assert area.area == pytest.approx(5.0)


def test_a_body_within_another_that_is_turned_inside_out_is_a_hollow() -> None:
    inner, faces = box(1, 1, -1, 2, 2, 2)
    outer = box(0, 0, 0, 3, 3, 1)
    area, _ = section(*both(outer, (inner, faces[:, ::-1])), 0.5)
    assert area.area == pytest.approx(8.0)


def test_faces_that_are_turned_at_random_do_not_matter() -> None:
    vertices, faces = box(1, 2, -1, 4, 3, 1)
    turned = faces.copy()
    turned[[4, 5, 9]] = turned[[4, 5, 9], ::-1]
    area, _ = section(vertices, turned, 0.3)
    assert area.equals(shapely.box(1, 2, 4, 3))


def test_a_sheet_is_a_line() -> None:
    vertices, _ = box(0, 0, 0, 2, 0, 1)
    area, lines = section(vertices, np.array([[0, 1, 5], [0, 5, 4]]), 0.5)
    assert area.is_empty
    assert lines.length == pytest.approx(2.0)


def test_a_prism_of_any_outline_in_any_position() -> None:
    rng = np.random.default_rng(5)
    for _ in range(20):
        ring = rng.uniform(-9, 9, (12, 2))
        outline = shapely.concave_hull(shapely.multipoints(ring), ratio=0.2)
        corners = shapely.get_coordinates(outline.exterior)[:-1]
        n = len(corners)
        vertices = np.vstack([np.c_[corners, np.full(n, z)] for z in (0.0, 2.0)])
        sides = [(k, (k + 1) % n, n + k) for k in range(n)]
        sides += [((k + 1) % n, n + (k + 1) % n, n + k) for k in range(n)]
        area, _ = section(vertices, np.array(sides), rng.uniform(0.1, 1.9))
        assert shapely.symmetric_difference(area, outline).area < 1e-4
