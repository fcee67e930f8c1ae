"""Occupancy grids in ROS map_server's format: a YAML file and a PGM or PNG image."""

from __future__ import annotations

import difflib
import math
import reprlib
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ambinav.config import parse_yaml
from ambinav.geometry.occupancy_grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from ambinav.runtime.array_types import Bytes
from ambinav.runtime.errors import InputError
from ambinav.runtime.files import sha256
from ambinav.runtime.input_suggestions import MAP, kind_of, refuse

MODES: Final = ("trinary", "scale", "raw")
FORMATS: Final = ("PPM", "PNG", "BMP")
# Metres. Nothing that a robot drives in is mapped outside of these limits: a cell of 5 or 50 is
# meant in centimetres or millimetres.
FINEST: Final = 1e-4
COARSEST: Final = 2.0
FURTHEST: Final = 1e8
# Pillow itself refuses more than twice its MAX_IMAGE_PIXELS; between one and two times it warns.
MAX_CELLS: Final = 178_956_970


def load_map_server(yaml_path: str | Path) -> OccupancyGrid:
    """Read a map_server YAML file and its image, as ROS interprets them.

    Keys, as nav2's map_io: `image` (relative to the YAML file, or absolute), `resolution`,
    `origin`, `negate`, `occupied_thresh` and `free_thresh` must be there; `mode` is trinary
    unless given. With the shade s of a pixel from 0 (black) to 1 (white) and its occupancy
    p = 1 - s (p = s with `negate`):

    - trinary: p > occupied_thresh is occupied, p < free_thresh is free, the rest is unknown. An
      alpha of a pixel that is not opaque counts as one more colour channel of its s, as map_server
      has it. An opaque pixel means what it means without alpha; map_server, which counts its alpha
      too, would see it brighter and take the grey of unknown cells for free.
    - scale: the same thresholds; alpha does not enter s, and a pixel that is not opaque is
      unknown. What map_server grades between the thresholds is neither free nor occupied, so it
      is unknown here, as it is to AMCL.
    - raw: the pixel's value (0 to 255) is the occupancy in percent: above 100 * occupied_thresh
      occupied, below 100 * free_thresh free, else unknown, and so is a value above 100;
      `negate` and alpha do not enter.

    Raises:
        InputError: A file is missing or cannot be read, a key is missing or has a wrong value,
            or no cell is free.
    """
    path = Path(yaml_path)
    header = _read_yaml(path)
    refuse(f"{path}", kind_of(header), "a map", MAP)
    name = _value(path, header, "image")
    if not isinstance(name, str) or not name.strip():
        raise _wrong(path, "image", name, "the name of a PGM or PNG file")
    resolution = _number(path, "resolution", _value(path, header, "resolution"))
    if not FINEST <= resolution <= COARSEST:
        expected = f"the edge of a cell in metres, from {FINEST:g} to {COARSEST:g}, e.g. 0.05"
        raise _wrong(path, "resolution", resolution, expected)
    origin = _origin(path, _value(path, header, "origin"))
    negate = _value(path, header, "negate")
    if not isinstance(negate, int) or negate not in (0, 1):
        raise _wrong(path, "negate", negate, "0 or 1")
    occupied = _number(path, "occupied_thresh", _value(path, header, "occupied_thresh"))
    free = _number(path, "free_thresh", _value(path, header, "free_thresh"))
    for key, threshold in (("occupied_thresh", occupied), ("free_thresh", free)):
        if not 0.0 <= threshold <= 1.0:
            raise _wrong(path, key, threshold, "a number from 0 to 1")
    if free >= occupied:
        raise InputError(
            f"{path}: free_thresh {free:g} is not below occupied_thresh {occupied:g}; "
            "swap or correct the two."
        )
    mode = header.get("mode", "trinary")
    if mode not in MODES:
        raise _wrong(path, "mode", mode, "trinary, scale or raw")
    image = path.parent / name
    pixels, white = _read_image(path, image)
    state = _classify(pixels, white, str(mode), bool(negate), occupied, free)
    if not (state == FREE).any():
        raise InputError(
            f"{image}: no cell is free under free_thresh {free:g} and negate {int(negate)} of "
            f"{path}; check these two and the image."
        )
    return OccupancyGrid(state, resolution, origin, path, image, sha256(path, image))


def _wrong(path: Path, key: str, value: object, expected: str) -> InputError:
    return InputError(f"{path}: {key} is {reprlib.repr(value)}; it must be {expected}.")


def _read_yaml(path: Path) -> Mapping[Any, Any]:
    """Return the mapping in a YAML file."""
    try:
        text = path.read_bytes().decode("utf-8")
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "it is not UTF-8 text"
        raise InputError(
            f"{path}: the map's YAML file cannot be read ({reason}); name a map_server YAML file."
        ) from error
    header = parse_yaml(text, str(path), "it needs image, resolution and origin")
    if not isinstance(header, Mapping):
        raise InputError(
            f"{path}: the YAML file holds no keys; it needs image, resolution and origin."
        )
    return header


def _value(path: Path, header: Mapping[Any, Any], key: str) -> Any:
    if key not in header:
        near = difflib.get_close_matches(key, [str(k) for k in header], n=1)
        hint = f" (found {near[0]!r})" if near else ""
        raise InputError(f"{path}: the key {key} is missing{hint}; add it.")
    return header[key]


def _number(path: Path, key: str, value: object) -> float:
    """Return a finite number; also from text such as 5e-2, which YAML 1.1 does not parse."""
    if isinstance(value, int | float | str) and not isinstance(value, bool):
        try:
            number = float(value)
        except (ValueError, OverflowError):
            number = math.nan
        if math.isfinite(number):
            return number
    raise _wrong(path, key, value, "a finite number")


def _origin(path: Path, value: object) -> tuple[float, float, float]:
    if not isinstance(value, list) or len(value) != 3:
        raise _wrong(path, "origin", value, "a list [x, y, yaw] in metres and radians")
    x, y, yaw = (_number(path, f"origin[{i}]", item) for i, item in enumerate(value))
    if max(abs(x), abs(y)) > FURTHEST:
        raise _wrong(path, "origin", value, f"within {FURTHEST:g} m of 0")
    if abs(yaw) > math.tau + 1e-6:
        raise _wrong(path, "origin", value, f"a yaw of at most 2 pi: radians, not {yaw:g} degrees")
    return x, y, yaw


def _read_image(path: Path, image: Path) -> tuple[NDArray[np.generic], int]:
    """Return pixels, (rows, columns, channels), first row on top, and the value of white."""
    try:
        if not image.is_file():
            raise InputError(f"{path}: image {str(image)!r} is not a file; correct the key image.")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            with Image.open(image, formats=FORMATS) as opened:
                if opened.width * opened.height > MAX_CELLS:
                    raise Image.DecompressionBombError
                return _channels(opened)
    except InputError:
        raise
    except Image.DecompressionBombError as error:
        raise InputError(
            f"{image}: the image has more than {MAX_CELLS} cells; crop it or make it coarser."
        ) from error
    except Exception as error:  # Pillow's decoders raise many kinds of errors for damaged files
        detail = str(error) if isinstance(error, OSError) else ""
        reason = "it is truncated" if "truncated" in detail else "it is not a sound PGM or PNG"
        raise InputError(f"{image}: the image cannot be read ({reason}); export it again.") from (
            error
        )


def _channels(opened: Image.Image) -> tuple[NDArray[np.generic], int]:
    """Return grey, grey with alpha, RGB or RGBA as an array, and the value of white."""
    deep = opened.mode.startswith("I")
    if not deep:
        alpha = opened.has_transparency_data
        grey = opened.mode in ("1", "L", "LA", "La")
        opened = opened.convert(("LA" if grey else "RGBA") if alpha else ("L" if grey else "RGB"))
    pixels = np.asarray(opened)
    if pixels.size == 0 or not np.issubdtype(pixels.dtype, np.integer):
        raise ValueError("no grey values")
    if deep:
        pixels = pixels.astype(np.uint16)
    return pixels.reshape(pixels.shape[0], pixels.shape[1], -1), 65535 if deep else 255


def _classify(
    pixels: NDArray[np.generic], white: int, mode: str, negate: bool, occupied: float, free: float
) -> Bytes:
    """Return the state of each cell, row 0 at the bottom of the image."""
    has_alpha = pixels.shape[2] in (2, 4)
    colours = pixels[..., :-1] if has_alpha else pixels

    def classified(channels: NDArray[np.generic]) -> Bytes:
        # One exact decision for each possible sum, then a table look-up for each cell.
        count = channels.shape[2]
        total = channels[..., 0] if count == 1 else channels.sum(axis=2, dtype=np.uint32)
        return np.asarray(_states(white * count, mode, negate, occupied, free)[total])

    state = classified(colours)
    if has_alpha and mode != "raw":
        clear = pixels[..., -1] != white
        if mode == "scale":
            state[clear] = UNKNOWN
        elif clear.any():
            # map_server sees three colour channels in a grey image that has alpha.
            weights = [0, 0, 0, 1] if colours.shape[2] == 1 else [0, 1, 2, 3]
            state[clear] = classified(pixels[clear][np.newaxis][..., weights])[0]
    return np.ascontiguousarray(state[::-1])


def _states(top: int, mode: str, negate: bool, occupied: float, free: float) -> Bytes:
    """Return the state of a cell for each sum of its channels, from 0 to `top`."""
    shade = np.arange(top + 1) / top
    if mode == "raw":
        percent = np.round(shade * 255.0)
        chance = np.where(percent <= 100.0, percent / 100.0, np.nan)
    else:
        chance = shade if negate else 1.0 - shade
    table = np.full(top + 1, UNKNOWN, dtype=np.uint8)
    table[chance > occupied] = OCCUPIED
    table[chance < free] = FREE
    return table
