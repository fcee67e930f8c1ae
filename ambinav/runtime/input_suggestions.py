"""Kind of a file that was given in place of another, and the command that takes it.

People have a map, a scanner and a scenario in YAML beside each other, and give one for another.
"The key image is missing" is true then, and of no help.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final, NamedTuple

from ambinav.runtime.errors import InputError

IMAGES: Final = (".pgm", ".png", ".bmp", ".ppm", ".jpg", ".jpeg", ".tif", ".tiff", ".gif")
PLANS: Final = (".geojson", ".wkt", ".ifc", ".dxf")
GEOJSON: Final = ("FeatureCollection", "Feature", "GeometryCollection", "Polygon", "LineString")


class Kind(NamedTuple):
    """Kind of a file: its name in messages, and the commands that take it."""

    name: str
    remedy: str


MAP: Final = Kind("an occupancy map", "give it as MAP to `ambinav audit` or `ambinav map`")
PLAN: Final = Kind("a floor plan", "give it as MAP to `ambinav audit` or `ambinav map`")
SCANNER: Final = Kind("a scanner", "give it with --scanner")
SENSOR: Final = Kind(
    "a sensor", "put it into a scanner file: parts, each with a sensor and planar, ring or mounts"
)
SCENARIO: Final = Kind("a scenario", "give it to `ambinav compare`")
TRAINING: Final = Kind("a training configuration", "give it to `ambinav train`")
STORE: Final = Kind(
    "an ambiguity map that is made already", "give it to `ambinav plan`, or name the building"
)


def kind_of(plain: object) -> Kind | None:
    """Return the kind of a YAML or JSON file by its keys; None: unknown."""
    if not isinstance(plain, Mapping):
        return None
    if plain.get("type") in GEOJSON:
        return PLAN
    if "image" in plain and ("resolution" in plain or "origin" in plain):
        return MAP
    if "parts" in plain:
        return SCANNER
    if "pairs" in plain or "routes" in plain:
        return SCENARIO
    if "algorithm" in plain or "hyperparameters" in plain:
        return TRAINING
    if "max_range" in plain and ("std" in plain or "resolution" in plain):
        return SENSOR
    return None


def kind_of_path(path: Path) -> Kind | None:
    """Return the kind of a file or folder by its name alone; None: YAML, JSON, or unknown."""
    if (path / "zarr.json").is_file() or path.suffix == ".zarr":
        return STORE
    if path.suffix.lower() in IMAGES:
        return MAP
    if path.suffix.lower() in PLANS:
        return PLAN
    return None


def refuse(where: str, kind: Kind | None, expected: str, *fits: Kind) -> None:
    """Raise `InputError` with a file's kind, if that is known and not the kind wanted.

    Args:
        where: The file.
        kind: What it is, or None.
        expected: What it should be, with its article.
        fits: Kinds that are what is wanted.

    Raises:
        InputError: it is something else.
    """
    if kind is not None and kind not in fits:
        raise InputError(f"{where}: this is {kind.name}, not {expected}; {kind.remedy}.")


def refuse_image(path: Path) -> None:
    """Raise `InputError` with the YAML file to give instead of a map's image.

    Raises:
        InputError: `path` has the suffix of an image.
    """
    if path.suffix.lower() not in IMAGES:
        return
    beside = [path.with_suffix(suffix) for suffix in (".yaml", ".yml")]
    beside += [other for other in _yaml_files(path.parent) if path.name in _head(other)]
    for other in beside:
        if other.is_file():
            raise InputError(
                f"{path}: this is the image of a map; give {other}, which stands beside it."
            )
    if not path.exists():
        raise InputError(f"{path}: there is no such file; name the .yaml file of a map.")
    raise InputError(
        f"{path}: an image alone does not say how large its cells are; write "
        f"{path.with_suffix('.yaml')} with image: {path.name}, resolution (m), origin: [0, 0, 0], "
        "negate: 0, occupied_thresh: 0.65 and free_thresh: 0.196, and give that."
    )


def _yaml_files(folder: Path) -> list[Path]:
    try:
        return sorted(p for p in folder.iterdir() if p.suffix.lower() in (".yaml", ".yml"))
    except OSError:
        return []


def _head(path: Path) -> str:
    """Return the value of the key image in a map's YAML file, or nothing."""
    try:
        with path.open("rb") as file:
            lines = file.read(4096).decode("utf-8", "replace").splitlines()
    except OSError:
        return ""
    return "".join(line for line in lines if line.strip().startswith("image"))
