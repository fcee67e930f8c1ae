"""Files of meshes that the reader of meshes would misread: found before it reads them.

Of a polygon it makes a fan of triangles, which leaves a polygon that is not convex; vertices that
an OBJ counts from the end it takes from the end of the file, and a face with the vertex 0 it leaves
out; an ASCII PLY that is cut off it reads as far as it goes.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from ambinav.buildings.mesh.cloud_tables import content_lines, ply_elements
from ambinav.runtime.array_types import Bools, Floats
from ambinav.runtime.errors import InputError

# Sine of the angle by which a corner may point inwards: rounding.
FLAT = 1e-3
# Faces of an OBJ: with an index below 1, and with more than three corners.
_FROM_END: Final = re.compile(
    rb"^[ \t]*f[ \t][^\r\n]*?(?<=[ \t])(-\d+|0+)(?=[/\s]|$)", re.MULTILINE
)
_POLYGON: Final = re.compile(rb"^[ \t]*f(?:[ \t]+[^\s]+){4}", re.MULTILINE)


def check_polygons(path: Path) -> None:
    """Check the polygons of an OBJ or an ASCII PLY; other files have none or are not checked.

    Raises:
        InputError: a face is a polygon that is not convex, an OBJ counts vertices from the end or
            from 0, or a PLY is cut off.
    """
    suffix = path.suffix.lower()
    if suffix not in (".obj", ".ply"):
        return
    points, faces = _obj(path) if suffix == ".obj" else _ply(path)
    for size in {len(face) for face in faces}:
        corners = np.array([face for face in faces if len(face) == size], dtype=np.int64)
        if corners.min() < 0 or corners.max() >= len(points):
            continue  # who reads it says so
        inward = _inward(np.array(points)[corners])
        if inward.any():
            x, y, z = points[corners[np.argmax(inward), 0]]
            raise InputError(
                f"{path}: {np.count_nonzero(inward)} of its faces are not convex, e.g. one of "
                f"{size} corners at ({x:g}, {y:g}, {z:g}); triangulate them on export."
            )


def _inward(polygons: Floats) -> Bools:
    """Return which of K polygons, shape (K, n, 3), have a corner that points inwards."""
    edges = np.roll(polygons, -1, axis=1) - polygons
    around = polygons - polygons[:, :1]
    # Newell's normal: of any polygon, flat or not.
    normal = np.cross(around, np.roll(around, -1, axis=1)).sum(axis=1)
    turns = np.cross(np.roll(edges, 1, axis=1), edges)
    along = np.einsum("kni,ki->kn", turns, normal)
    lengths = np.linalg.norm(edges, axis=2)
    scale = lengths * np.roll(lengths, 1, axis=1) * np.linalg.norm(normal, axis=1)[:, None]
    return np.asarray((along < -FLAT * scale).any(axis=1))


def _obj(path: Path) -> tuple[list[Sequence[float]], list[list[int]]]:
    """Return vertices and polygons of four corners and more; nothing if there is none of these."""
    content = path.read_bytes()
    points: list[Sequence[float]] = []
    faces: list[list[int]] = []
    match = _FROM_END.search(content)
    if match:
        number = content.count(b"\n", 0, match.start()) + 1
        raise InputError(
            f"{path}: line {number} has the vertex {match[1].decode()}, counted from the end or "
            "from 0; export it with indices above 0."
        )
    if not _POLYGON.search(content):
        return points, faces
    for number, line in enumerate(content.splitlines(), 1):
        words = line.split()
        if words[:1] == [b"v"]:
            points.append(_numbers(words[1:4], path, number))
        elif words[:1] == [b"f"] and len(words) > 4:
            corners = [word.partition(b"/")[0] for word in words[1:]]
            # What is no index is said by who reads it.
            faces.append([int(k) - 1 if k.isdigit() else -1 for k in corners])
    return points, faces


def _numbers(words: Sequence[bytes], path: Path, number: int) -> Sequence[float]:
    try:
        x, y, z = map(float, words)
    except ValueError as error:
        raise InputError(
            f"{path}: line {number} is not a valid vertex ({b' '.join(words).decode('latin-1')}); "
            "export it again."
        ) from error
    return x, y, z


def _ply(path: Path) -> tuple[list[Sequence[float]], list[list[int]]]:
    """Return vertices and polygons of four corners and more; none of a binary file."""
    points: list[Sequence[float]] = []
    faces: list[list[int]] = []
    with path.open("rb") as file:
        kind, elements = ply_elements(file, path)
        if kind != "ascii":
            return points, faces
        lines: Iterator[bytes] = content_lines(file)
        for element in elements:
            for k in range(element.size):
                line = next(lines, None)
                if line is None:
                    raise InputError(
                        f"{path}: it is cut off: of {element.name} it has {k} of {element.size}; "
                        "copy it again."
                    )
                words = line.split()
                if element.name == "vertex" and element.fields is not None:
                    names = [field[0] for field in element.fields]
                    if {"x", "y", "z"} <= set(names) and len(words) >= len(names):
                        points.append([float(words[names.index(axis)]) for axis in "xyz"])
                elif element.name == "face" and words[0].isdigit() and int(words[0]) > 3:
                    corners = [int(word) for word in words[1 : 1 + int(words[0])]]
                    # Else what comes first is no number of corners.
                    if len(corners) == int(words[0]):
                        faces.append(corners)
    return points, faces
