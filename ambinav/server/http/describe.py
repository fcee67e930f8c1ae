"""Descriptions of a map: a summary and full details."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ambinav.drive.odometries import ODOMETRIES
from ambinav.forecasting.document import LOCALIZER, ODOMETRY
from ambinav.forecasting.localizer_class import classes_for
from ambinav.maps.zones import MEANINGS
from ambinav.plotting import style
from ambinav.reports import parameters
from ambinav.runtime.errors import InputError
from ambinav.server.http.models import (
    Choice,
    Figures,
    ForecastChoices,
    Layer,
    MapDetail,
    MapInfo,
    Parameter,
    Zone,
)
from ambinav.server.problems import Problem
from ambinav.server.served import ServedMap, finite, layer_kind, worse_end
from ambinav.server.tiles.pyramid import depth_of

_ATTRS: Final = {
    "environment": "The building.",
    "environment_source": "The file that the building was read from.",
    "scanner": "The scanner.",
    "cost_layer": "The layer from which costs and rewards are computed.",
    "ambinav_version": "The version of the program that made the map.",
    "created": "The time at which the map was made.",
}


def map_info(served: ServedMap) -> MapInfo:
    """Return the summary of a map."""
    amap = served.amap
    ny, nx = amap.possible.shape[:2]
    radius = served.amap.parameters.get("radius")
    return MapInfo(
        id=served.name,
        digest=served.digest,
        name=served.title,
        environment=str(amap.dataset.attrs["environment"]),
        scanner=str(amap.dataset.attrs["scanner"]),
        bounds=amap.bounds,
        in_space=bool(amap.dataset.attrs.get("environment_space")),
        spacing=amap.spacing,
        shape=(ny, nx),
        headings=amap.dataset.sizes["theta"] if amap.has_theta else None,
        radius=float(radius) if isinstance(radius, int | float) else None,
        cost_layer=amap.cost_layer,
        layers=[_layer(served, name) for name in amap.layers],
        max_zoom=depth_of((ny, nx)),
    )


def _layer(served: ServedMap, name: str) -> Layer:
    data = served.amap.dataset[name]
    return Layer.model_validate(
        {
            "name": name,
            "long_name": str(data.attrs.get("long_name", name)),
            "units": str(data.attrs.get("units", "")),
            "worse": worse_end(served.amap, name),
            "kind": layer_kind(name),
            "has_theta": "theta" in data.dims,
        }
    )


def map_detail(served: ServedMap) -> MapDetail:
    """Return all details of a map."""
    amap = served.amap
    parts = amap.judged
    level = amap.floor("level").values[parts.counted]
    shares = amap.zone_shares(mask=parts.counted)
    attrs = {
        name: Parameter(value=str(amap.dataset.attrs[name]), unit="", text=text)
        for name, text in _ATTRS.items()
        if amap.dataset.attrs.get(name)
    }
    if "environment_source" in attrs:
        source = attrs["environment_source"]
        attrs["environment_source"] = source.model_copy(
            update={"value": str(source.value).replace("\\", "/").rpartition("/")[2]}
        )
    for name, value in served.amap.parameters.items():
        unit, text = parameters.MAP.get(name, ("", ""))
        plain = value if isinstance(value, int | float | str) or value is None else str(value)
        attrs[name] = Parameter(value=plain, unit=unit, text=text)
    return MapDetail(
        **map_info(served).model_dump(),
        attrs=attrs,
        zones=[
            Zone(
                zone=share.zone,
                code=code,
                colour=style.ZONE_COLOURS[code].lower(),
                meaning=MEANINGS[code],
                area_m2=share.area,
                share=share.share,
            )
            for code, share in enumerate(shares)
        ],
        figures=Figures(
            free_area_m2=amap.free_area,
            **parts.areas(),
            robot_radius_m=parts.radius,
            mean_level=finite(float(np.nanmean(level))) if level.size else None,
        ),
        forecast=_forecast_choices(served),
    )


def _forecast_choices(served: ServedMap) -> ForecastChoices:
    turns = {
        name: math.degrees(math.sqrt(2.0 * noise.packed.turn_trans))
        for name, noise in ODOMETRIES.items()
    }
    try:
        classes = classes_for(served.scanner)
    except (Problem, InputError):  # the map lacks its scanner, or a plug-in's is not installed
        classes = ()
    return ForecastChoices(
        odometries=[
            Choice(name=name, title=f"{turn:.2g} degrees off after a metre")
            for name, turn in turns.items()
        ],
        odometry=ODOMETRY,
        localizers=[Choice(name=entry.name, title=entry.title) for entry in classes],
        localizer=LOCALIZER,
    )
