"""Building of an ambiguity map tile by tile, which continues an interrupted build."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import numpy as np
import xarray as xr

from ambinav.ambiguity.dataset import judged_radius, labels, with_building
from ambinav.geometry.environment import Environment
from ambinav.geometry.lattice import Lattice
from ambinav.map_building.build import MapSettings
from ambinav.map_building.same_code import do_all
from ambinav.map_building.stored import computing_digest
from ambinav.maps.address import Address, reason_of
from ambinav.maps.judged_floor import LAYER as JUDGED
from ambinav.maps.judged_floor import FloorJudge, JudgedFloor
from ambinav.maps.store import check_target
from ambinav.maps.zones import NOT_FREE
from ambinav.runtime.errors import InputError
from ambinav.runtime.files import move_onto
from ambinav.runtime.progress import Progress, reporter
from ambinav.runtime.runfolder import RunFolder
from ambinav.sensing.scanner import RangeScanner
from ambinav.tiles.claim import claimed
from ambinav.tiles.job import Tile
from ambinav.tiles.plan import TilePlan
from ambinav.tiles.queue import TileQueue, TileWork
from ambinav.tiles.store import TileStore

PART: Final = ".part"
"""Added to the name of a folder in which a map is being made."""
MAP: Final = "map"
FOLDER: Final = RunFolder("map in tiles", (MAP, f"{MAP}.old", "lock"), locked="")


@dataclass(frozen=True)
class TiledBuild:
    """Result of a build.

    Attributes:
        output: Where the map is.
        poses: Its free points.
        tiles: All of its tiles.
        made: Those that were made now.
        kept: Those that an earlier build had made.
        damaged: Those of an earlier build that were not as they were written, and made again.
    """

    output: str
    poses: int
    tiles: int
    made: int
    kept: int
    damaged: int


def build_tiled(
    env: Environment,
    scanner: RangeScanner | str | Path,
    output: str | Path,
    tile: float = 20.0,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    storage_options: Mapping[str, Any] | None = None,
    progress: bool | Progress = False,
    **arguments: Any,
) -> TiledBuild:
    """Compute a map that need not fit into memory, and write it tile by tile.

    The result is bit-identical to the map that `build_map` makes and `AmbiguityMap.save` writes,
    for any tiles and workers. If it is interrupted, the same call resumes it.

    Args:
        env: The building.
        scanner: As for `build_map`.
        output: Folder of the map, a zarr store, or a URL that fsspec knows. During the build, the
            folder has the suffix `.part`; an older map is replaced at the end. At a URL it is
            written in place, and an existing map is not replaced.
        tile: Edge of a tile, metres.
        workers: Number of processes; 0: only this one, with its threads; None: one per processor.
        scheduler: Address of a Dask scheduler, whose workers make the tiles instead. They must
            reach `output` under the same name.
        storage_options: Options of the file system of a URL.
        progress: As for `build_map`.
        arguments: Those of `build_map` that decide the map: `spacing`, `radius` and so on.

    Raises:
        InputError: an argument is out of its range, nothing can be written, another build is at
            work there, or tiles of another map are.
        RuntimeError: worker processes were killed repeatedly.
    """
    plan = TilePlan.of(env, MapSettings.of(env, scanner, **arguments), tile)
    return run_plan(
        plan, str(output), workers=workers, scheduler=scheduler, storage_options=storage_options,
        progress=progress,
    )  # fmt: skip


def run_plan(
    plan: TilePlan,
    output: str,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    storage_options: Mapping[str, Any] | None = None,
    progress: bool | Progress = False,
) -> TiledBuild:
    """Build the tiles of a plan; see `build_tiled`."""
    if workers is not None and workers < 0:
        raise InputError(f"workers is {workers}; give 0 or more processes.")
    check_place(output, scheduler, storage_options)
    address = Address.of(output, storage_options)
    title = f"{plan.environment.name}, {plan.job.settings.scanner.name}"
    try:
        with reporter(progress, title) as report, _store_at(plan, address) as store:
            queue = _queue(plan, store, report)
            do_all(queue, TileWork(plan.job, store), computing_digest(), workers, scheduler)
            settings = plan.job.settings
            radius = judged_radius(settings.scanner, settings.model)
            judge = FloorJudge.for_robot(plan.environment, radius)
            store.finish(_attributes(plan, store, queue.free), judge)
    except OSError as error:
        raise InputError(
            f"{output}: the map cannot be written ({reason_of(error)}); what was made is kept: "
            "make room or check your rights, and give the same command again."
        ) from error
    return TiledBuild(output, queue.free, queue.total, queue.made, queue.kept, queue.damaged)


def check_place(
    output: str, scheduler: str | None, storage_options: Mapping[str, Any] | None = None
) -> None:
    """Check, before anything is computed, that tiles can be made and written.

    Args:
        output: As for `build_tiled`; of a folder, that it can be written is tried when it is held.
        scheduler: Likewise.
        storage_options: Likewise.

    Raises:
        InputError: the scheduler does not answer, or nothing can be written at the URL.
    """
    address = Address.of(output, storage_options)
    if address.is_url:
        address.check_writable()
    if scheduler is not None:
        from ambinav.runtime.cluster import threads_of

        threads_of(scheduler)


@contextlib.contextmanager
def _store_at(plan: TilePlan, address: Address) -> Iterator[TileStore]:
    """Lock a map's address, write its template there, and move it to its place at the end."""
    if address.folder is None:
        store = TileStore(address, plan.cells)
        with claimed(*address.files, address.place):
            _write_template(plan, store)
            yield store
        return
    check_target(address)
    # Through a link, so that the tiles are on the file system of the map.
    path = Path(os.path.realpath(address.folder))
    part = path.with_name(path.name + PART)
    FOLDER.check(part)
    with FOLDER.hold(part):
        store = TileStore(Address.of(part / MAP), plan.cells)
        _write_template(plan, store)
        yield store
        move_onto(part / MAP, path)
        shutil.rmtree(part, ignore_errors=True)


def _write_template(plan: TilePlan, store: TileStore) -> None:
    """Write the template, if it is not there.

    Raises:
        InputError: tiles of another map are there.
    """
    key = store.key()
    if key == plan.key:
        return
    if key:
        raise InputError(
            f"{store.address}: tiles are there of another map (another building, scanner, "
            "parameter, tile or version of ambinav); remove them, or choose another output."
        )
    _, layers = plan.sample
    settings = plan.job.settings
    radius = judged_radius(settings.scanner, settings.model)
    blank = np.full((1, 1), NOT_FREE, dtype=np.uint8)
    judged = xr.DataArray(JudgedFloor(blank, 0.0, radius).layer)
    store.lay(plan.key, plan.job.shape, {**layers, JUDGED: judged}, _building(plan))


def _building(plan: TilePlan) -> xr.Dataset:
    """Return coordinates, attributes and the stored building of a map."""
    settings, (rows, columns) = plan.job.settings, plan.job.shape
    x, y = plan.job.axes((0, rows), (0, columns))
    point = np.zeros((1, 1), dtype=np.bool_)
    lattice = Lattice(plan.environment, settings.spacing, x[:1], y[:1], point)
    small = with_building(
        {}, lattice, settings.scanner, settings.thinned, settings.model, settings.theta, point
    )
    over = [name for name, array in small.data_vars.items() if array.dims[:2] == ("y", "x")]
    attrs = {name: small[name].attrs for name in ("x", "y")}
    return small.drop_vars([*over, "x", "y"]).assign_coords(
        x=("x", x, attrs["x"]), y=("y", y, attrs["y"])
    )


def _queue(plan: TilePlan, store: TileStore, report: Progress) -> TileQueue:
    """Return a queue of all tiles, existing ones first."""
    records = store.records()

    def order() -> Iterator[tuple[Tile, bool]]:
        for has_record in (True, False):
            for row, column in np.argwhere(records == has_record).tolist():
                yield plan.tile(row, column), has_record

    return TileQueue(plan, report, order(), records.size)


def _attributes(plan: TilePlan, store: TileStore, free: int) -> dict[str, Any]:
    attributes = store.attributes()
    # The template may be of an earlier run, with another file's name.
    attributes |= labels(plan.environment, plan.job.settings.scanner)
    parameters = json.loads(attributes["parameters"]) | {"free_poses": free}
    return attributes | {
        "parameters": json.dumps(parameters),
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
    }
