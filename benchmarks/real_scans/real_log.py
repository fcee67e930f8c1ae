"""One log against maps of its other parts: predictions and measurements."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ambinav.ambiguity.beam_table import BeamTable
from ambinav.ambiguity.model import AmbiguityModel
from ambinav.geometry.environment import Environment
from ambinav.logs.grid_map import map_from_log
from ambinav.logs.log import Log
from ambinav.map_building.build import build_map
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner
from real_scans.agreement import pose_figures
from real_scans.compared import SPACING, Compared, compared, evidence_of
from real_scans.displaced_scan import displaced_figures
from real_scans.log_split import as_seen_from_laser, check_scans, model_of, scanner_of, stretches
from real_scans.rank_agreement import rank_at_equal
from real_scans.scan_pairs import scan_pairs

# Neighbourhood of the model, metres; and how far apart the scans of a pair are at most: robots
# that record a scan a metre have few nearer ones.
RADIUS: Final = 0.5
PAIR_RADIUS: Final = 1.5
# Metres of the path that go to one part before the next one's turn.
STRETCH: Final = 5.0
# The figures that both a map and a scan alone have.
FIGURES: Final = ("level", "major", "minor", "ambiguity", "direction")


@dataclass(frozen=True, eq=False)
class PairValues:
    """Ordered pairs of scans.

    Attributes:
        first: Index of the scan in the log, shape (N,).
        distance: Metres to the other, shape (N,).
        common: Share of the beams that both look to, shape (N,).
        measured: log I of the real scans, shape (N,).
        beams: How many beams that the map knows both scans have returned, shape (N,).
        predicted: log I of those that the map predicts, shape (N,).
        measured_rank: Rank of `measured` among pairs of about the same distance and common view,
            0 to 1.
        predicted_rank: The same of `predicted`.
    """

    first: NDArray[np.intp]
    distance: Floats
    common: Floats
    measured: Floats
    beams: Floats
    predicted: Floats
    measured_rank: Floats
    predicted_rank: Floats

    def mean_by_scan(self, values: Floats) -> tuple[NDArray[np.intp], Floats]:
        """Return scans that are first in a pair, rising, and the mean of their pairs' values."""
        scans, row = np.unique(self.first, return_inverse=True)
        return scans, np.bincount(row, values) / np.bincount(row)


@dataclass(frozen=True, eq=False)
class RealLog:
    """Ambiguity of a log's poses: predicted by maps of other parts, and measured by its scans.

    Attributes:
        log: The scans, of a robot that is its laser.
        scanner: The beams that were compared.
        model: The parameters of all comparisons.
        pairs: Pairs of scans within `PAIR_RADIUS`.
        scans: Index of each scan that is first in a pair, shape (U,).
        measured: Their `ambiguity`, `level`, ... over their pairs, each of shape (U,).
        known: The same, of the beams alone that the map knows, see `Compared`.
        predicted: The same, over the same pairs, from the map.
        alone: Index of each scan that stands in its map's free space, shape (A,).
        scan_says: `FIGURES` of each scan compared with itself displaced, each of shape (A,).
        map_says: The same read at the scan's pose from the ambiguity map of the other parts.
        maps: The ambiguity maps, one for each part of the path.
    """

    log: Log
    scanner: RangeScanner
    model: AmbiguityModel
    pairs: PairValues
    scans: NDArray[np.intp]
    measured: dict[str, Floats]
    known: dict[str, Floats]
    predicted: dict[str, Floats]
    alone: NDArray[np.intp]
    scan_says: dict[str, Floats]
    map_says: dict[str, Floats]
    maps: tuple[AmbiguityMap, ...]

    def place(self, scans: NDArray[np.intp]) -> tuple[Floats, Floats]:
        """Return x and y of the laser at some scans, metres, map frame."""
        x, y, _ = self.log.required_poses()[scans].T
        return x, y


def parts_of(
    log: Log, environment: Environment | None, length: float = STRETCH, parts: int = 2
) -> tuple[tuple[Environment, NDArray[np.bool_]], ...]:
    """Return maps, and for each the scans of the log with which it is compared.

    Without an environment there is one for each part: made of all stretches of the path but
    those of the part, whose scans judge it. A given one is judged by all scans.

    Raises:
        InputError: the log is too short to part, or does not belong to the environment.
    """
    if environment is not None:
        check_scans(log, environment)
        return ((environment, np.ones(log.scans, dtype=np.bool_)),)
    if parts < 2:
        raise InputError(f"parts is {parts}; give at least 2, one of which judges the others' map.")
    part = stretches(log, length, parts)
    if part.max() + 1 < parts:
        raise InputError(
            f"{log.source or log.name}: its path has fewer than {parts} stretches of {length:g} m, "
            "so no part of it is left to judge a map of the others; give a shorter stretch."
        )
    return tuple((map_from_log(log.chosen(part != k)), part == k) for k in range(parts))


def study_log(
    log: Log,
    max_range: float | None = None,
    *,
    environment: Environment | None = None,
    pair_radius: float = PAIR_RADIUS,
    spacing: float = SPACING,
    stretch: float = STRETCH,
    parts: int = 2,
) -> RealLog:
    """Measure the ambiguity of a log's poses from its scans, and predict it from maps.

    Args:
        log: Scans with corrected poses.
        max_range: Readings beyond are "no echo", as for a scanner of shorter range; None: as it
            is.
        environment: A map; None: maps made of the log, see `parts_of`.
        pair_radius: Largest distance of a pair, metres.
        spacing: Spacing of the ambiguity maps, metres.
        stretch: Length of the path's stretches, metres, see `parts_of`.
        parts: How many parts they make.

    Raises:
        InputError: the log has no poses, does not belong to the environment, or has no pairs.
    """
    log = as_seen_from_laser(log)
    scanner = scanner_of(log, max_range)
    compared_parts: list[Compared] = []
    alone, scan_says, map_says, maps = [], [], [], []
    for made, judged in parts_of(log, environment, stretch, parts):
        model = model_of(scanner, made, RADIUS)
        pairs = scan_pairs(log, judged, made, pair_radius)
        if len(pairs):
            compared_parts.append(compared(log, pairs, made, scanner, model))
        amap = build_map(
            made, log.scanner(max_range=max_range), spacing=spacing, radius=RADIUS, store=False
        )
        maps.append(amap)
        poses = log.required_poses()
        index = np.flatnonzero(judged & np.asarray(made.is_free(poses[:, 0], poses[:, 1])))
        alone.append(index)
        scan_says.append(_scan_says(log, index, made, scanner, model))
        map_says.append({name: np.asarray(amap.sample(name, *poses[index].T)) for name in FIGURES})
    if not compared_parts:
        raise InputError(
            f"{log.source or log.name}: no two scans of it are within {pair_radius:g} m of each "
            "other; give a larger radius."
        )
    measured = [pose_figures(part.pairs, part.measured) for part in compared_parts]
    explained = [pose_figures(part.pairs, part.known) for part in compared_parts]
    predicted = [pose_figures(part.pairs, part.predicted) for part in compared_parts]
    return RealLog(
        log,
        scanner,
        model,
        _values(compared_parts),
        np.concatenate([np.unique(part.pairs.first) for part in compared_parts]),
        _joined(measured),
        _joined(explained),
        _joined(predicted),
        np.concatenate(alone),
        _joined(scan_says),
        _joined(map_says),
        tuple(maps),
    )


def _values(compared_parts: list[Compared]) -> PairValues:
    distance = np.concatenate([part.pairs.distance for part in compared_parts])
    common = np.concatenate([part.common for part in compared_parts])
    measured = np.log(np.concatenate([part.measured.alike for part in compared_parts]))
    predicted = np.log(np.concatenate([part.predicted.alike for part in compared_parts]))
    return PairValues(
        np.concatenate([part.pairs.first for part in compared_parts]),
        distance,
        common,
        measured,
        np.concatenate([part.beams for part in compared_parts]),
        predicted,
        rank_at_equal(measured, distance, common),
        rank_at_equal(predicted, distance, common),
    )


def _scan_says(
    log: Log,
    index: NDArray[np.intp],
    environment: Environment,
    scanner: RangeScanner,
    model: AmbiguityModel,
) -> dict[str, Floats]:
    """Return figures of scans compared with themselves displaced, over the free neighbourhood."""
    reach = int(model.radius / SPACING + 1e-9)
    steps = np.mgrid[-reach : reach + 1, -reach : reach + 1].reshape(2, -1).T
    dy, dx = SPACING * steps.T
    near = np.hypot(dx, dy) <= model.radius + 1e-9
    steps, dx, dy = steps[near], dx[near], dy[near]
    poses = log.required_poses()[index]
    x, y = poses[:, :1], poses[:, 1:2]
    free = np.asarray(environment.is_free(x + dx, y + dy))
    bearing = np.arctan2(dy, dx)[None, :]
    free &= np.asarray(environment.cast(x, y, bearing, 2.0 * model.radius)) >= np.hypot(dx, dy)
    table = BeamTable.of(scanner, model.map_std, model.outlier_share)
    return displaced_figures(
        log.ranges[index], log.angles, np.ascontiguousarray(poses[:, 2]), steps, SPACING, free,
        np.ascontiguousarray(scanner.mounts[:, 2]), table, evidence_of(table), model.tau,
        (SPACING**2 / 4.0, model.sigma_theta**2),
    )  # fmt: skip


def _joined(parts: list[dict[str, Floats]]) -> dict[str, Floats]:
    return {name: np.concatenate([part[name] for part in parts]) for name in FIGURES}
