"""Members of GeoJSON documents in the map frame, which say so to their readers.

RFC 7946 knows longitude and latitude only. Its predecessor of 2008 has `crs`, which GDAL and with
it QGIS still read: a name that is the WKT of a local system gives them metres without a place on
Earth (GDAL 3.12). Without it, with null, or with a URN unknown to it GDAL takes WGS 84.
"""

from __future__ import annotations

from typing import Any, Final

_LOCAL: Final = (
    'ENGCRS["map frame",EDATUM["map frame"],CS[Cartesian,2],AXIS["x",east],AXIS["y",north],'
    'LENGTHUNIT["metre",1]]'
)
MAP_FRAME: Final[dict[str, Any]] = {
    "frame": "map",
    "units": "metres, x right, y up; not degrees",
    "crs": {"type": "name", "properties": {"name": _LOCAL}},
}
