"""Up axis and unit of a file of surfaces or points: checked, and requested where unclear."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from ambinav.buildings.plan_units import LARGEST, SMALLEST, UNITS
from ambinav.casting.mesh.mesh import Mesh
from ambinav.runtime.array_types import Floats, Ints
from ambinav.runtime.errors import InputError, InputWarning

Number = TypeVar("Number", bound=np.generic)

AXES: Final = ("x", "y", "z")
# No building is higher, metres: one drawn in centimetres is.
HIGHEST: Final = 100.0
HIGH: Final = 6.5
"""Metres; storeys of houses and offices are lower, those of feet taken for metres higher."""
TALLEST: Final = 40.0
"""Metres; no storey is higher, those of inches taken for metres are."""
# Metres. Storeys of houses and offices.
_STOREY: Final = (2.0, 4.5)
# Metres. Level faces at heights within a layer are one; a slab is thinner than a storey is high.
_LAYER, _THICKEST = 0.05, 1.5
# Shares: of the plan that a floor covers, of the floor that a ceiling does, and of the walls' area
# that counts for their height.
_FLOOR_SHARE, _CEILING_SHARE, _MOST = 0.1, 0.3, 0.9
# A wall is upright if the vertical part of its normal is smaller.
_UPRIGHT: Final = 0.2
# A face is level to an axis if its normal is this near to it: the cosine of 5 degrees.
_LEVEL: Final = 0.9962


def check_axis(path: Path, up: str | None) -> None:
    """Raise `InputError` if `up` names no axis."""
    if up is not None and up not in AXES:
        raise InputError(f"{path}: up is {up!r}; it must be x, y or z.")


def turned_up(values: NDArray[Number], up: str) -> NDArray[Number]:
    """Turn columns x, y, z, shape (N, 3), so that `up` becomes z.

    With y up, as in glTF 2.0 (section 3.4) and as other programs read it, x stays and z points
    back; with x up the cyclic order stays. Whole numbers count cells, whose lower sides they are.
    """
    if up != "y":
        return np.roll(values, 2 - AXES.index(up), axis=1)
    x, y, z = values.T
    return np.column_stack([x, ~z if values.dtype.kind == "i" else -z, y])


def check_size(path: Path, kind: str, size: Floats) -> None:
    """Raise `InputError` for a size that is not plausible for a building in metres.

    Args:
        path: The file.
        kind: What is in it: "mesh", "point cloud".
        size: Along x, y and z, which is up, as metres.

    Raises:
        InputError: no building is so large or so small.
    """
    text = " x ".join(f"{length:.4g}" for length in size)
    ask = f"say with --unit whether its numbers are {', '.join(UNITS)}."
    if max(size[:2]) < SMALLEST:
        raise InputError(f"{path}: the {kind} is {text} m in all, and no robot drives in it; {ask}")
    if max(size[:2]) > LARGEST or size[2] > HIGHEST:
        raise InputError(f"{path}: the {kind} is {text} m in all, more than a building has; {ask}")


def check_storey(path: Path, mesh: Mesh) -> list[str]:
    """Check for storeys whose height is not plausible in metres, and ask for the unit.

    A hall of 8 m is as high as a flat whose feet are taken for metres: nobody can tell by the
    numbers, so that up to `TALLEST` this only warns.

    Args:
        path: The file.
        mesh: What is in it, as metres, z up.

    Returns:
        What the notes are to say.

    Raises:
        InputError: no storey is as high.

    Warns:
        InputWarning: few are as high.
    """
    height = storey_height(mesh)
    if height <= HIGH:
        return []
    text = f"{path}: as metres its storey is {height:.3g} m high"
    fits = [
        f"{scale * height:.2g} m if its numbers are {unit}"
        for unit, scale in UNITS.items()
        if unit != "m" and _STOREY[0] <= scale * height <= _STOREY[1]
    ]
    if fits:
        text += f", {' and '.join(fits)}"
    ask = f"say with --unit whether its numbers are {', '.join(UNITS)}"
    if height > TALLEST:
        raise InputError(f"{text}; {ask}.")
    note = f"{text}; {ask}: m is right for a hall."
    warnings.warn(note, InputWarning, stacklevel=3)
    return [note]


def triangle_areas(triangles: Floats) -> Floats:
    """Return the areas of triangles (N, 3, 3), shape (N,), square metres."""
    a, b, c = triangles.swapaxes(0, 1)
    return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2.0)


def layered(above: Floats, area: Floats, thick: float) -> tuple[Floats, Ints]:
    """Sum the area in each layer and the next one, `thick` metres; return the layers too."""
    layer = np.maximum(np.floor(above / thick), 0).astype(np.int64)
    of = np.bincount(layer, weights=area, minlength=1)
    return of + np.append(of[1:], 0.0), layer


def storey_height(mesh: Mesh) -> float:
    """Estimate the height of the lowest storey, metres: to its ceiling, or of most walls."""
    corners = mesh.triangles
    area = triangle_areas(corners)
    tilt = np.abs(mesh.surface_normal[:, 2])
    level, upright = tilt > _LEVEL, tilt < _UPRIGHT
    z, low = corners[..., 2].mean(axis=1), float(mesh.bounds[0, 2])
    of, _ = layered(z[level] - low, area[level], _LAYER)
    plan = float(np.prod(np.ptp(mesh.bounds[:, :2], axis=0)))
    large = np.flatnonzero(of >= _FLOOR_SHARE * plan)
    floor = low + _LAYER * float(large[0]) if len(large) else low
    if len(large):
        first = of[large[0]]
        above = large[
            (large - large[0] > _THICKEST / _LAYER) & (of[large] >= _CEILING_SHARE * first)
        ]
        if len(above):
            return low + _LAYER * float(above[0]) - floor
    if not upright.any():
        return float(mesh.bounds[1, 2]) - floor
    top = corners[upright][..., 2].max(axis=1)
    order = np.argsort(top)
    total = np.cumsum(area[upright][order])
    return float(top[order][np.searchsorted(total, _MOST * total[-1])]) - floor


def check_upright(path: Path, mesh: Mesh) -> None:
    """Check that no axis other than z has more level faces and less height.

    Raises:
        InputError: an axis has, so that it may be up.
    """
    size = np.ptp(mesh.bounds, axis=0)
    area = triangle_areas(mesh.triangles)
    level = [float(area[np.abs(mesh.surface_normal[:, k]) > _LEVEL].sum()) for k in range(3)]
    for k in (1, 0):
        if size[k] < size[2] and level[k] > level[2]:
            raise InputError(
                f"{path}: {AXES[k]} may be up in it (faces level to {AXES[k]} have "
                f"{level[k]:.3g} m2, those level to z {level[2]:.3g} m2); give the axis "
                "that is, up (--up): x, y or z."
            )
