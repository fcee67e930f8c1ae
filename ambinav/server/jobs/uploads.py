"""Uploaded maps, stored under fixed names in a folder of their own.

No name that comes with an upload is ever opened. A map_server file names its image; it is written
anew with the name that the uploaded image has been given.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

import yaml
from PIL import Image
from starlette.datastructures import UploadFile

from ambinav.buildings.map_server import FORMATS
from ambinav.config import parse_yaml
from ambinav.runtime.errors import InputError
from ambinav.server.served import slug

GRID_SUFFIXES: Final = (".yaml", ".yml")
PLAN_SUFFIXES: Final = (".geojson", ".json", ".wkt")
IMAGE_SUFFIXES: Final = (".pgm", ".png", ".bmp")
MOST_YAML: Final = 100_000
"""Bytes of a map_server file: it has ten lines."""
MOST_PIXELS: Final = 60_000_000
"""Cells of an uploaded occupancy map."""


class Upload(NamedTuple):
    """A stored map.

    Attributes:
        file: Name in its folder.
        title: File name of the upload without its suffix.
    """

    file: str
    title: str


def store(files: Sequence[UploadFile], folder: Path) -> Upload:
    """Write the files of one map.

    Args:
        files: A drawn plan; or a map_server file and its image, in any order.
        folder: Output folder, empty.

    Raises:
        InputError: they are not the files of one map.
    """
    kinds = {
        "map": [name for name in files if _suffix(name) in (*GRID_SUFFIXES, *PLAN_SUFFIXES)],
        "image": [name for name in files if _suffix(name) in IMAGE_SUFFIXES],
    }
    if (
        len(kinds["map"]) != 1
        or len(kinds["image"]) > 1
        or sum(map(len, kinds.values())) != len(files)
    ):
        raise InputError(
            f"files: {len(files)} were sent; send one map "
            f"({', '.join(GRID_SUFFIXES + PLAN_SUFFIXES)}), "
            f"and with a map_server file its image ({', '.join(IMAGE_SUFFIXES)})."
        )
    source = kinds["map"][0]
    suffix = _suffix(source)
    title = slug(Path((source.filename or "map").replace("\\", "/")).stem)
    if suffix in PLAN_SUFFIXES:
        if kinds["image"]:
            raise InputError("files: a drawn plan has no image; leave the image out.")
        name = f"plan{suffix}"
        (folder / name).write_bytes(source.file.read())
        return Upload(name, title)
    if not kinds["image"]:
        raise InputError("files: the image of the map_server file is missing; send it too.")
    image = f"image{_suffix(kinds['image'][0])}"
    (folder / image).write_bytes(kinds["image"][0].file.read())
    _check_pixels(folder / image)
    (folder / "map.yaml").write_text(_header(source.file.read(MOST_YAML + 1), image))
    return Upload("map.yaml", title)


def _suffix(file: UploadFile) -> str:
    return Path((file.filename or "").replace("\\", "/")).suffix.lower()


def _check_pixels(image: Path) -> None:
    """Refuse an image with too many pixels, without unpacking it."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            with Image.open(image, formats=FORMATS) as opened:
                pixels = opened.width * opened.height
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError):
        return  # for the reader of maps to say
    if pixels > MOST_PIXELS:
        raise InputError(
            f"files: the image has {pixels} cells, more than the {MOST_PIXELS} that this server "
            "takes; crop it or make it coarser."
        )


def _header(content: bytes, image: str) -> str:
    """Create a map_server file that names only our image."""
    if len(content) > MOST_YAML:
        raise InputError(f"files: the map_server file has more than {MOST_YAML} bytes.")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError("files: the map_server file is not UTF-8 text; correct it.") from error
    header = parse_yaml(text, "files: the map_server file", "it needs image and resolution")
    if not isinstance(header, dict) or "image" not in header:
        raise InputError(
            "files: the YAML file is not a map_server file; the key `image` is missing."
        )
    keys = ("resolution", "origin", "negate", "occupied_thresh", "free_thresh", "mode")
    plain = {key: header[key] for key in keys if key in header}
    return yaml.safe_dump({"image": image, **plain})
