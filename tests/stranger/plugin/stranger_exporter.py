"""Routes as well-known text, which databases and GIS programs know: an exporter that also reads."""

import shapely

from ambinav.config import read_text
from ambinav.export.registry import Exporter
from ambinav.routes.files import trace
from ambinav.routes.route import Route
from ambinav.runtime.errors import InputError
from ambinav.runtime.files import replacing


def write(route, path):
    """Write the course of a route as a LINESTRING, metres in the map frame."""
    with replacing(path) as fresh:
        fresh.write_text(shapely.LineString(trace(route)[:, :2]).wkt + "\n")
    return (path,)


def read(path):
    """The route along a LINESTRING; what it costs is measured on the map where it is used."""
    try:
        line = shapely.from_wkt(read_text(path))
    except shapely.errors.GEOSException as error:
        raise InputError(f"{path}: no well-known text ({error}); give a LINESTRING.") from error
    return Route.through(shapely.get_coordinates(line), planner="wkt")


EXPORTER = Exporter(subject="route", format="wkt", title="the course", write=write, read=read)
