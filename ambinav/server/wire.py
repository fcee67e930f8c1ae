"""Binary format between the server and its client."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Iterable
from pathlib import Path
from typing import Final

import numpy as np
import xarray as xr

from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError

OCTETS: Final = "application/octet-stream"
"""Media type of columns of little-endian float64."""
POSE_COLUMNS: Final = ("x", "y", "theta")
STEP_COLUMNS: Final = ("x0", "y0", "x1", "y1", "theta0", "theta1")

ABOUT: Final = ".about"
"""Name of the entry with the non-array data of a dataset file."""

_LITTLE: Final = np.dtype("<f8")


def packed(columns: Iterable[Floats]) -> bytes:
    """Join columns of equal length into bytes, one after the other."""
    return b"".join(np.ascontiguousarray(column, dtype=_LITTLE).tobytes() for column in columns)


def unpacked(body: bytes, names: str, columns: tuple[str, ...], required: int) -> dict[str, Floats]:
    """Return the columns of a body by name, as views of the body.

    Args:
        body: Columns one after the other, float64, little-endian.
        names: Names of the columns, in order, with commas between.
        columns: Names that there are.
        required: Number of leading columns that are required.

    Raises:
        InputError: a name is unknown, twice there or missing, or the body is no such columns.
    """
    sent = names.split(",")
    if len(set(sent)) != len(sent) or not set(sent) <= set(columns):
        raise InputError(f"columns is {names!r}; give names from {','.join(columns)}, each once.")
    missing = [name for name in columns[:required] if name not in sent]
    if missing:
        raise InputError(f"columns is {names!r}; it lacks {', '.join(missing)}.")
    size, excess = divmod(len(body), _LITTLE.itemsize * len(sent))
    if excess:
        raise InputError(
            f"the body has {len(body)} bytes, which is not a whole number of rows of {len(sent)} "
            "float64."
        )
    table = np.frombuffer(body, dtype=_LITTLE).reshape(len(sent), size)
    return dict(zip(sent, table, strict=True))


def write_dataset(dataset: xr.Dataset, path: Path) -> None:
    """Write a map's dataset as one .npz file that holds no pickled objects.

    Beside an array for each variable, named as that is, there is `.about`: JSON in bytes with the
    dimensions and attributes of each, and the attributes of all.
    """
    about = {
        "attrs": dataset.attrs,
        "variables": {
            str(name): {"dims": list(variable.dims), "attrs": variable.attrs}
            for name, variable in dataset.variables.items()
        },
        "coords": [str(name) for name in dataset.coords],
    }
    text = json.dumps(about, default=str).encode()
    arrays = {str(name): variable.values for name, variable in dataset.variables.items()}
    with path.open("wb") as file:
        np.savez(file, **{ABOUT: np.frombuffer(text, dtype=np.uint8)}, **arrays)  # type: ignore[arg-type]


def read_map(path: Path, source: str) -> AmbiguityMap:
    """Read the map of a dataset that `write_dataset` wrote; `source` names it in messages.

    Raises:
        InputError: it is no such file.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            about = json.loads(file[ABOUT].tobytes())
            variables = {
                name: (entry["dims"], file[name], entry["attrs"])
                for name, entry in about["variables"].items()
            }
            coords = {name: variables.pop(name) for name in about["coords"]}
            dataset = xr.Dataset(variables, coords, about["attrs"])
    except (OSError, ValueError, KeyError, TypeError, zipfile.BadZipFile) as error:
        raise InputError(f"{path.name}: not an ambiguity map sent by ambinav.") from error
    return AmbiguityMap(dataset, source=source)
