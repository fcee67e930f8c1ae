"""Routes as well-known text, which databases and GIS programs know: an exporter that also reads."""

import shapely

from ambinav import InputError, Route
from ambinav.plugin import Exporter, read_text, replacing, trace_route


def write(route, path):
    """Write the course of a route as a LINESTRING, metres in the map frame."""
    with replacing(path) as fresh:
        fresh.write_text(shapely.LineString(trace_route(route)[:, :2]).wkt + "\n")
    return (path,)


def read(path):
    """The route along a LINESTRING; what it costs is measured on the map where it is used."""
    try:
        line = shapely.from_wkt(read_text(path))
    except shapely.errors.GEOSException as error:
        raise InputError(f"{path}: no well-known text ({error}); give a LINESTRING.") from error
    return Route.through(shapely.get_coordinates(line), planner="wkt")


EXPORTER = Exporter(subject="route", format="wkt", title="the course", write=write, read=read)
