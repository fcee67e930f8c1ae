"""Points from LAS, LAZ and E57 in chunks, read with packages for these formats."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ambinav.buildings.mesh.cloud_tables import AT_ONCE, cut_off
from ambinav.runtime.errors import InputError
from ambinav.runtime.packages import need

Points = NDArray[np.float64]

# GeoTIFF's keys of the kind of coordinates and of their unit, and what they say of degrees, metres.
_KIND, _DEGREES = 1024, 2
_UNIT, _METRES = 3076, 9001
# Bytes of a record before its content, at the head of a LAS file and behind its points; and the bit
# of the format of points that says that they are compressed.
_RECORD, _EXTENDED_RECORD, _COMPRESSED = 54, 60, 0x80
_CARTESIAN: Final = ("cartesianX", "cartesianY", "cartesianZ")
_SPHERICAL: Final = ("sphericalRange", "sphericalAzimuth", "sphericalElevation")
_INVALID: Final = ("cartesianInvalidState", "sphericalInvalidState")


def las_points(path: Path, notes: list[str], unit: str | None) -> Iterator[Points]:
    """Yield the points of a LAS or LAZ file, by its scale and offset.

    Raises:
        InputError: laspy is missing, the file cannot be read or is cut off, or its coordinates are
            in degrees, or in feet and no unit is given.
    """
    need(f"{path}: reading it", ("laspy", "lazrs"), "clouds")
    import laspy

    read = 0
    _check_counts(path)
    with laspy.open(path) as file:
        _check_reference(path, file.header, unit)
        for chunk in file.chunk_iterator(AT_ONCE):
            read += len(chunk)
            yield np.stack([np.asarray(chunk[axis], dtype=np.float64) for axis in "xyz"], axis=1)
        if read < file.header.point_count:
            raise cut_off(path, read, file.header.point_count)


def _check_counts(path: Path) -> None:
    """Check the numbers of records and chunks in a LAS file: laspy makes as many as they say.

    The layout is that of LAS 1.4 R15, section 2.4, and of chunk tables of LAZ.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(375).ljust(375, b"\0")
        (header, points, records) = struct.unpack_from("<HII", head, 94)
        too_many = header + _RECORD * records > max(points, header)
        if head[:4] == b"LASF" and (head[24], head[25]) >= (1, 4):
            first, extended = struct.unpack_from("<QI", head, 235)
            too_many |= first + _EXTENDED_RECORD * extended > size and extended > 0
        if head[104] & _COMPRESSED and not too_many:
            file.seek(points)
            (table,) = struct.unpack("<q", file.read(8).ljust(8, b"\0"))
            if table == -1:  # written without going back: the place is at the end of the file
                file.seek(max(size - 8, 0))
                (table,) = struct.unpack("<q", file.read(8).ljust(8, b"\0"))
            file.seek(min(max(table, 0) + 4, size))
            (chunks,) = struct.unpack("<I", file.read(4).ljust(4, b"\0"))
            too_many = not points < table < size or chunks > size
    if head[:4] == b"LASF" and too_many:
        raise InputError(
            f"{path}: its header is damaged or it is cut off; copy or export it again."
        )


def _check_reference(path: Path, header: Any, unit: str | None) -> None:
    """Check the coordinate reference of a LAS file."""
    degrees, other = False, ""
    for record in (*header.vlrs, *(header.evlrs or ())):
        keys = {key.id: key.value_offset for key in getattr(record, "geo_keys", ())}
        degrees |= keys.get(_KIND) == _DEGREES
        if keys.get(_UNIT, _METRES) != _METRES:
            other = f"its reference system is in the unit EPSG:{keys[_UNIT]}, not metres"
        text = str(getattr(record, "string", "")).upper()
        degrees |= text.startswith(("GEOGCS", "GEOGCRS"))
        if "FOOT" in text or "FEET" in text:
            other = "its reference system is in feet"
    if degrees:
        raise InputError(
            f"{path}: its reference system is longitude and latitude in degrees; project it to "
            "metres first, e.g. to the UTM zone of the place."
        )
    if other and unit is None:
        raise InputError(f"{path}: {other}; say with --unit what its numbers are, e.g. ft or m.")


def e57_points(path: Path, notes: list[str]) -> Iterator[Points]:
    """Yield the points of all scans of an E57 file, each moved by its pose.

    Raises:
        InputError: pye57 is missing, or a scan has no coordinates.
    """
    need(f"{path}: reading it", ("pye57",), "clouds")
    import pye57

    with pye57.E57(str(path)) as file:
        if file.scan_count > 1:
            notes.append(f"{path}: {file.scan_count} scans are put together by their poses.")
        for k in range(file.scan_count):
            head = file.get_header(k)
            names = next((c for c in (_CARTESIAN, _SPHERICAL) if {*c} <= {*head.point_fields}), ())
            if not names:
                raise InputError(f"{path}: scan {k} has no coordinates; export it again.")
            turn, move = head.rotation_matrix, head.translation
            invalid = [name for name in _INVALID if name in head.point_fields]
            count = min(head.point_count, AT_ONCE)
            if not count:
                continue
            data, buffers = file.make_buffers([*names, *invalid], count)
            reader = head.points.reader(buffers)
            while read_count := reader.read():
                fine = np.ones(read_count, dtype=np.bool_)
                for name in invalid:
                    fine &= data[name][:read_count] == 0
                values = np.stack([data[name][:read_count][fine] for name in names], axis=1)
                yield (_cartesian(values) if names is _SPHERICAL else values) @ turn.T + move
            reader.close()


def _cartesian(values: Points) -> Points:
    """Convert ranges, azimuths and elevations (metres, radians) to x, y, z, shape (N, 3)."""
    distance, azimuth, elevation = values.T
    flat = distance * np.cos(elevation)
    return np.stack(
        [flat * np.cos(azimuth), flat * np.sin(azimuth), distance * np.sin(elevation)], axis=1
    )
