"""Which way is up in a file of surfaces or points, and its unit: checked, asked where unclear."""

from __future__ import annotations

from pathlib import Path
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from ambinav.errors import InputError
from ambinav.geometry.io.plan_units import LARGEST, SMALLEST, UNITS
from ambinav.geometry.mesh.mesh import Mesh

Number = TypeVar("Number", bound=np.generic)

AXES: Final = ("x", "y", "z")
# No building is higher, metres: one drawn in centimetres is.
HIGHEST: Final = 100.0
# A face is level to an axis if its normal is this near to it: the cosine of 5 degrees.
_LEVEL: Final = 0.9962


def check_axis(path: Path, up: str | None) -> None:
    """Raise `InputError` where `up` names no axis."""
    if up is not None and up not in AXES:
        raise InputError(f"{path}: up is {up!r}; it must be x, y or z.")


def turned_up(values: NDArray[Number], up: str) -> NDArray[Number]:
    """Columns x, y and z, shape (N, 3), so that `up` becomes z; their cyclic order stays."""
    return np.roll(values, 2 - AXES.index(up), axis=1)


def check_size(path: Path, what: str, size: NDArray[np.float64]) -> None:
    """Ask for the unit of what is no building in metres.

    Args:
        path: The file.
        what: What is in it: "mesh", "point cloud".
        size: Along x, y and z, which is up, as metres.

    Raises:
        InputError: no building is so large or so small.
    """
    text = " x ".join(f"{length:.4g}" for length in size)
    ask = f"say with unit whether its numbers are {', '.join(UNITS)}."
    if max(size[:2]) < SMALLEST:
        raise InputError(f"{path}: the {what} is {text} m in all, and no robot drives in it; {ask}")
    if max(size[:2]) > LARGEST or size[2] > HIGHEST:
        raise InputError(f"{path}: the {what} is {text} m in all, more than a building has; {ask}")


def check_upright(path: Path, mesh: Mesh) -> None:
    """Ask what is up where another axis has more level faces and less height than z.

    Raises:
        InputError: there is one.
    """
    size = np.ptp(mesh.bounds, axis=0)
    a, b, c = mesh.triangles.swapaxes(0, 1)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2.0
    level = [float(area[np.abs(mesh.surface_normal[:, k]) > _LEVEL].sum()) for k in range(3)]
    for k in (1, 0):
        if size[k] < size[2] and level[k] > level[2]:
            raise InputError(
                f"{path}: {AXES[k]} may be up in it (faces level to {AXES[k]} have "
                f"{level[k]:.3g} m2, those level to z {level[2]:.3g} m2); say with up which axis "
                "is, x, y or z."
            )
