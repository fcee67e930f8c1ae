"""Read a mesh from a file: its unit and which way is up are checked, and asked where unclear."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ambinav.errors import InputError
from ambinav.geometry.io.plan_units import LARGEST, SMALLEST, UNITS, metres_in
from ambinav.geometry.mesh.mesh import Mesh

SUFFIXES: Final = (".glb", ".obj", ".ply", ".stl")
"""The suffixes of files that can be read."""
AXES: Final = ("x", "y", "z")
# No building is higher, metres: one drawn in centimetres is.
HIGHEST: Final = 100.0
# glTF says that it is in metres, and that y is up.
_GLTF_UP: Final = "y"
# A face is level to an axis if its normal is this near to it: the cosine of 5 degrees.
_LEVEL: Final = 0.9962


def read_mesh(
    path: str | Path, *, unit: str | None = None, up: str | None = None, processes: int = 1
) -> Mesh:
    """Read PLY, STL, OBJ or GLB.

    Args:
        path: The file; the suffix says which.
        unit: What its numbers are in, "m", "cm" or "mm"; None: metres, where that makes a building.
        up: The axis that is up, "x", "y" or "z"; None: y of a .glb, as glTF has it, and else z,
            where the mesh does not look as if it lay on its side.
        processes: See `Mesh`.

    Returns:
        The mesh in metres, z up.

    Raises:
        InputError: it cannot be read, trimesh is not installed, there is no triangle in it, or its
            unit or upward axis has to be said.
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(
            f"{path}: the suffix {path.suffix or '(none)'} names no format of meshes; give one of "
            f"{', '.join(SUFFIXES)}."
        )
    scale = metres_in(unit, str(path))
    if up is not None and up not in AXES:
        raise InputError(f"{path}: up is {up!r}; it must be x, y or z.")
    vertices, faces = _load(path)
    if not len(faces):
        raise InputError(
            f"{path}: there are {len(vertices)} points and no triangles in it; give a mesh of "
            "surfaces."
        )
    gltf = path.suffix.lower() == ".glb"
    mesh = Mesh(
        _upright(vertices, up or (_GLTF_UP if gltf else "z")) * scale,
        faces,
        name=path.stem,
        source=path,
        processes=processes,
    )
    if unit is None:
        _check_size(path, mesh)
    if up is None and not gltf:
        _check_upright(path, mesh)
    return mesh


def _load(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices and faces as they stand in the file."""
    try:
        import trimesh
    except ImportError:
        raise InputError(
            f"{path}: reading meshes needs trimesh; install it with `pip install ambinav[mesh]`."
        ) from None
    if not path.is_file():
        raise InputError(f"{path}: there is no such file; give the path of a mesh.")
    try:
        # `process` would merge vertices and drop what is not finite, which is to be seen here.
        found = trimesh.load_scene(path, process=False)
        every = found.dump()
        parts = [part for part in every if isinstance(part, trimesh.Trimesh)]
        points = [part.vertices for part in every if isinstance(part, trimesh.PointCloud)]
    except Exception as error:  # whatever a broken file makes of a reader
        raise InputError(
            f"{path}: it cannot be read as {path.suffix[1:].upper()} ({type(error).__name__}: "
            f"{error}); export it again."
        ) from error
    first = np.cumsum([0, *(len(part.vertices) for part in parts)])
    return (
        np.concatenate([np.empty((0, 3)), *(part.vertices for part in parts), *points]),
        np.concatenate(
            [
                np.empty((0, 3), dtype=np.int64),
                *(part.faces + k for part, k in zip(parts, first[:-1], strict=True)),
            ]
        ),
    )


def _upright(vertices: NDArray[np.float64], up: str) -> NDArray[np.float64]:
    """Turned so that `up` becomes z; the other axes keep their cyclic order."""
    shift = 2 - AXES.index(up)
    return np.roll(vertices, shift, axis=1)


def _check_size(path: Path, mesh: Mesh) -> None:
    """Ask for the unit of what is no building in metres; raises `InputError`."""
    size = np.ptp(mesh.bounds, axis=0)
    text = " x ".join(f"{length:.4g}" for length in size)
    ask = f"say with unit whether its numbers are {', '.join(UNITS)}."
    if max(size[:2]) < SMALLEST:
        raise InputError(f"{path}: the mesh is {text} m in all, and no robot drives in it; {ask}")
    if max(size[:2]) > LARGEST or size[2] > HIGHEST:
        raise InputError(f"{path}: the mesh is {text} m in all, more than a building has; {ask}")


def _check_upright(path: Path, mesh: Mesh) -> None:
    """Ask what is up where another axis has more level faces and less height than z."""
    size = np.ptp(mesh.bounds, axis=0)
    a, b, c = (mesh.triangles[:, k] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2.0
    level = [float(area[np.abs(mesh.surface_normal[:, k]) > _LEVEL].sum()) for k in range(3)]
    for k in (1, 0):
        if size[k] < size[2] and level[k] > level[2]:
            raise InputError(
                f"{path}: {AXES[k]} may be up in it (faces level to {AXES[k]} have "
                f"{level[k]:.3g} m2, those level to z {level[2]:.3g} m2); say with up which axis "
                "is, x, y or z."
            )
