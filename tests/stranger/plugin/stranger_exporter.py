"""An exporter: routes as well-known text, which databases and GIS programs read."""

import shapely

from ambinav.export.registry import Exporter
from ambinav.files import replacing
from ambinav.routes.files import trace


def write(route, path):
    """Write the course of a route as a LINESTRING, metres in the map frame."""
    with replacing(path) as fresh:
        fresh.write_text(shapely.LineString(trace(route)[:, :2]).wkt + "\n")
    return (path,)


EXPORTER = Exporter(subject="route", format="wkt", title="the course as WKT", write=write)
