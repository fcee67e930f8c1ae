"""Reader of meshes; unit and up axis are checked, and requested where unclear."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Final

import numpy as np

from ambinav.buildings.mesh.frame import (
    check_axis,
    check_size,
    check_storey,
    check_upright,
    turned_up,
)
from ambinav.buildings.mesh.level import levelled
from ambinav.buildings.mesh.polygons import check_polygons
from ambinav.buildings.plan_units import metres_in
from ambinav.casting.mesh.mesh import Mesh
from ambinav.runtime.array_types import Floats, Ints
from ambinav.runtime.errors import InputError
from ambinav.runtime.packages import need

SUFFIXES: Final = (".glb", ".obj", ".ply", ".stl")
"""The suffixes of files that can be read."""
# Where nobody has set up logging, what trimesh logs would be printed: tracebacks of what is said
# here in a sentence.
_SILENT: Final = logging.NullHandler()
# glTF says that it is in metres, and that y is up.
_GLTF_UP: Final = "y"


def read_mesh(
    path: str | Path, *, unit: str | None = None, up: str | None = None, processes: int = 1
) -> Mesh:
    """Read PLY, STL, OBJ or GLB.

    Args:
        path: The file; its suffix determines the format.
        unit: What its numbers are in, one of `plan_units.UNITS`; None: metres, where that makes a
            building.
        up: The axis that is up, "x", "y" or "z"; None: y for a .glb, as defined by glTF, otherwise
            z, where the mesh does not look as if it lay on its side.
        processes: See `Mesh`.

    Returns:
        The mesh in metres, z up, its floor level (`levelled`).

    Raises:
        InputError: it cannot be read, trimesh is not installed, there is no triangle in it, or its
            unit or upward axis has to be said.

    Warns:
        InputWarning: as metres its storey is high, as one is in feet.
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(
            f"{path}: the suffix {path.suffix or '(none)'} names no format of meshes; give one of "
            f"{', '.join(SUFFIXES)}."
        )
    scale = metres_in(unit, str(path))
    check_axis(path, up)
    vertices, faces = _load(path)
    if not len(faces):
        if not len(vertices):
            raise InputError(f"{path}: it is empty or cut off; copy or export it again.")
        raise InputError(
            f"{path}: there are {len(vertices)} points and no triangles in it; give a mesh of "
            "surfaces, or read points with read_cloud."
        )
    gltf = path.suffix.lower() == ".glb"
    mesh = Mesh(
        turned_up(vertices, up or (_GLTF_UP if gltf else "z")) * scale,
        faces,
        name=path.stem,
        source=path,
        processes=processes,
    )
    if unit is None:
        check_size(path, "mesh", np.ptp(mesh.bounds, axis=0))
    if up is None and not gltf:
        check_upright(path, mesh)
    mesh = levelled(mesh)
    if unit is None:
        mesh.notes = (*mesh.notes, *check_storey(path, mesh))
    return mesh


def _load(path: Path) -> tuple[Floats, Ints]:
    """Return vertices and faces as the file stores them."""
    need(f"{path}: reading it", ("trimesh",), "mesh")
    import trimesh

    if not path.is_file():
        raise InputError(f"{path}: there is no such file; give the path of a mesh.")
    try:
        check_polygons(path)
        logging.getLogger("trimesh").addHandler(_SILENT)
        # `process` would merge vertices and drop what is not finite, which is to be seen here.
        scene = trimesh.load_scene(path, process=False)
        every = scene.dump()
        parts = [part for part in every if isinstance(part, trimesh.Trimesh)]
        points = [part.vertices for part in every if isinstance(part, trimesh.PointCloud)]
        first = np.cumsum([0, *(len(part.vertices) for part in parts)])
        faces = [part.faces + k for part, k in zip(parts, first[:-1], strict=True)]
        return (
            np.concatenate([np.empty((0, 3)), *(part.vertices for part in parts), *points]),
            np.concatenate([np.empty((0, 3), dtype=np.int64), *faces]),
        )
    except InputError:
        raise
    except Exception as error:  # readers raise many kinds of errors for damaged files
        # Its reader takes faces of different sizes in a binary PLY for a file that is cut off.
        again = "export it again"
        if path.suffix.lower() == ".ply":
            again = "copy it again if it is cut off, else export it again with triangles only"
        raise InputError(
            f"{path}: it cannot be read as {path.suffix[1:].upper()} ({type(error).__name__}: "
            f"{error}); {again}."
        ) from error
