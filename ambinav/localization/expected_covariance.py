"""Expected covariance of a localizer at a pose, before anything is driven there.

For monitors of localization quality, which ask whether the covariance that a localizer reports
suits the place where it says that it is. Two answers: of the ambiguity map (docs/model.md), the
spread of the poses nearby that a scan cannot distinguish from this one, sensor noise, bins and
open neighbourhood included; of the Fisher information (Censi 2007, "On achievable accuracy for
range-finder localization", ICRA), what a scan leaves of a given prior, the bound for an ideal
localizer that knows where about it is.
"""

from __future__ import annotations

from types import NoneType

import numpy as np
from numpy.typing import ArrayLike

from ambinav.config import check_kind, nearest
from ambinav.geometry.environment import Environment
from ambinav.localization.information import as_covariances, as_poses, scan_information
from ambinav.localization.online import USUAL_PRIOR, posteriors
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner

SOURCES = ("ambiguity", "fisher")


def expected_covariance(
    place: AmbiguityMap | Environment,
    poses: ArrayLike,
    *,
    source: str | None = None,
    scanner: RangeScanner | None = None,
    prior: ArrayLike | None = None,
    map_std: float | None = None,
) -> Floats:
    """Compute the expected covariance of x, y, theta at poses, map frame.

    Args:
        place: A map of ambiguity, or an environment.
        poses: x, y, theta, shape (N, 3) or (3,).
        source: "ambiguity": the map's radii as deviations, major_radius along direction and
            minor_radius across it; of the heading, taken for independent of the position,
            heading_radius, but at most the map's sigma_theta, to which its position radii take the
            heading as known, and sigma_theta where the map has no heading_radius. The position
            deviates by no more than the map's neighbourhood allows: where nothing is in range by
            half of its radius, in a corridor by 1 / sqrt(3) of it, and a little more for the cells.
            "fisher": what one scan of all beams leaves of `prior`, as the layer `fisher` has it for
            its own prior. None: "ambiguity" of a map, "fisher" of an environment.
        scanner: For "fisher"; None: the map's own.
        prior: For "fisher": covariance without the scan, shape (3, 3) or (N, 3, 3); None: 0.5 m
            along x and y, 15 degrees.
        map_std: For "fisher", as for `information.scan_information`; None: what the map of
            ambiguity was made with, or the environment's.

    Returns:
        Shape (N, 3, 3), square metres and radians; nan where the map has no value: outside of
        the free floor.

    Raises:
        InputError: an argument cannot be used, or is missing.
    """
    rows = as_poses(poses, "poses")
    mapped = isinstance(place, AmbiguityMap)
    source = SOURCES[0 if mapped else 1] if source is None else source
    if source not in SOURCES:
        raise InputError(f"source is {source!r}; {nearest(str(source), SOURCES)}.")
    if source == "fisher":
        environment, scanner = place_and_scanner(place, scanner)
        usual = np.diag(USUAL_PRIOR)
        before = as_covariances(usual if prior is None else prior, "prior", len(rows))
        map_std = walls_std(place, map_std)
        covariances = posteriors(before, scan_information(environment, scanner, rows, map_std))
        inside = np.asarray(environment.is_free(rows[:, 0], rows[:, 1]))
        return np.where(inside[:, np.newaxis, np.newaxis], covariances, np.nan)
    if not isinstance(place, AmbiguityMap):
        raise InputError(
            f"source is 'ambiguity', which environment {place.name!r} does not give; give an "
            "AmbiguityMap, or source 'fisher'."
        )
    for name, value in (("scanner", scanner), ("prior", prior), ("map_std", map_std)):
        if value is not None:
            raise InputError(f"{name} is given, which source 'ambiguity' does not use; omit it.")
    return _of_radii(place, rows)


def place_and_scanner(
    place: AmbiguityMap | Environment, scanner: RangeScanner | None
) -> tuple[Environment, RangeScanner]:
    """Return the environment, and the given scanner or else the map's.

    Raises:
        InputError: there is no scanner, or one of the two is something else.
    """
    check_kind(place, (AmbiguityMap, Environment), "place", "give an AmbiguityMap or Environment")
    check_kind(scanner, (RangeScanner, NoneType), "scanner")
    if isinstance(place, Environment):
        if scanner is None:
            raise InputError(f"no scanner is given for environment {place.name!r}; give one.")
        return place, scanner
    if scanner is not None:
        return place.environment, scanner
    if "scanner_yaml" not in place.dataset.attrs:
        raise InputError(
            f"{place.source}: the map does not name its scanner; give one, or make the map again "
            "with `ambinav map`."
        )
    text = place.dataset.attrs["scanner_yaml"]
    return place.environment, RangeScanner.from_yaml_text(text, file=f"{place.source}: scanner")


def walls_std(place: AmbiguityMap | Environment, map_std: float | None) -> float | None:
    """Return the given deviation of the walls, or else that of the map, metres.

    None, which means that of the environment, if an environment is given and no deviation.

    Raises:
        InputError: the map does not tell it.
    """
    if map_std is not None or isinstance(place, Environment):
        return map_std
    return _parameter(place, "map_std")


def _parameter(place: AmbiguityMap, name: str) -> float:
    parameters = place.parameters
    if name not in parameters:
        raise InputError(
            f"{place.source}: its parameters lack {name}; make the map again with `ambinav map`."
        )
    return float(parameters[name])


def _of_radii(amap: AmbiguityMap, rows: Floats) -> Floats:
    sigma_theta = _parameter(amap, "sigma_theta")
    x, y, theta = rows.T

    def at(layer: str) -> Floats:
        heading = theta if amap.has_theta else None
        return np.asarray(amap.sample(layer, x, y, heading), dtype=np.float64)

    major, minor, direction = (at(name) for name in ("major_radius", "minor_radius", "direction"))
    turn = np.full(len(rows), sigma_theta)
    if "heading_radius" in amap.layers:
        turn = np.minimum(turn, at("heading_radius"))
    c, s = np.cos(direction), np.sin(direction)
    out = np.zeros((len(rows), 3, 3))
    out[:, 0, 0] = (major * c) ** 2 + (minor * s) ** 2
    out[:, 1, 1] = (major * s) ** 2 + (minor * c) ** 2
    out[:, 0, 1] = out[:, 1, 0] = (major**2 - minor**2) * c * s
    out[:, 2, 2] = turn**2
    out[~np.isfinite(out).all(axis=(1, 2))] = np.nan
    return out
