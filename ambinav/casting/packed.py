"""Buildings in space as bytes, so that files of maps can keep them."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Sequence
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from ambinav.casting.mesh.mesh import Mesh
from ambinav.casting.prisms.prisms import Prisms, Sheets, Solid
from ambinav.casting.space import SpaceCaster
from ambinav.runtime.array_types import Bytes
from ambinav.runtime.errors import InputError

# What numpy raises for files that are cut off or damaged.
DAMAGED: Final = (ValueError, KeyError, TypeError, OSError, EOFError, zipfile.BadZipFile)


def packed(space: SpaceCaster) -> Bytes | None:
    """Return a building as the bytes of an .npz file; None for a caster of another class."""
    if isinstance(space, Mesh):
        arrays = {
            "vertices": space.vertices, "faces": space.faces, "middle": space.middle,
            "voxel": np.array(space.voxel),
        }  # fmt: skip
        return _npz(arrays, (space.name, *space.notes))
    if not isinstance(space, Prisms):
        return None
    sheets, solids = space.given, space.solids
    outlines = [*(solid.outline for solid in solids), *([] if space.free is None else [space.free])]
    encoded = [np.frombuffer(shapely.to_wkb(outline), dtype=np.uint8) for outline in outlines]
    arrays = {
        **sheets._asdict(),
        "solid_z": np.array([(solid.bottom, solid.top) for solid in solids]).reshape(-1, 2),
        "solid_kind": np.array([solid.kind for solid in solids], dtype=np.uint8),
        "outline": np.concatenate([np.empty(0, dtype=np.uint8), *encoded]),
        "length": np.array([len(part) for part in encoded], dtype=np.int64),
        "lids": np.array([space.floor, space.ceiling]),
    }
    return _npz(arrays, ())


def unpacked(data: Bytes) -> SpaceCaster:
    """Return the building that `packed` has made bytes of, equal to the last bit.

    Raises:
        InputError: these are no such bytes.
    """
    try:
        return _unpacked(data)
    except (*DAMAGED, shapely.errors.ShapelyError) as error:
        raise InputError(f"these bytes are not a building in space ({error})") from error


def _unpacked(data: Bytes) -> SpaceCaster:
    with np.load(io.BytesIO(data.tobytes()), allow_pickle=False) as arrays:
        if "faces" in arrays:
            name, *notes = arrays["text"].tolist()
            voxel = float(arrays["voxel"])
            mesh = Mesh(arrays["vertices"], arrays["faces"], name=name, notes=notes, voxel=voxel)
            mesh.middle = arrays["middle"]
            return mesh
        ends = np.cumsum(arrays["length"])[:-1]
        outlines = _outlines(np.split(arrays["outline"], ends) if len(arrays["length"]) else [])
        z, kind = arrays["solid_z"], arrays["solid_kind"]
        solids = [
            Solid(outline, float(low), float(high), int(k))
            for outline, (low, high), k in zip(outlines, z, kind, strict=False)
        ]
        floor, ceiling = (float(lid) if np.isfinite(lid) else None for lid in arrays["lids"])
        return Prisms(
            *Sheets(arrays["xy"], arrays["z"], arrays["kind"]), solids=solids, floor=floor,
            ceiling=ceiling, free=outlines[-1] if len(outlines) > len(solids) else None,
        )  # fmt: skip


def _npz(arrays: dict[str, NDArray[np.generic]], text: Sequence[str]) -> Bytes:
    file = io.BytesIO()
    np.savez(file, allow_pickle=False, **arrays, text=np.array(text, dtype=np.str_))
    return np.frombuffer(file.getvalue(), dtype=np.uint8).copy()


def _outlines(encoded: Sequence[Bytes]) -> list[BaseGeometry]:
    return [shapely.from_wkb(part.tobytes()) for part in encoded]
