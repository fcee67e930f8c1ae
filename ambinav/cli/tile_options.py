"""Options of a map that is built in tiles."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import typer

from ambinav.cli.limits import above_zero, at_least
from ambinav.cli.running import INTERRUPTED, note, progress_bars
from ambinav.runtime.errors import InputError
from ambinav.runtime.processes import processors

if TYPE_CHECKING:
    from ambinav.geometry.environment import Environment
    from ambinav.map_building.build import MapSettings
    from ambinav.tiles.plan import TileEstimate, TilePlan


@dataclass(frozen=True, kw_only=True)
class TileOptions:
    """Options on the tiles of a map and the processes that build them.

    Attributes:
        tile (M): Build the map in tiles of this size, metres: it need not fit into memory, and the
            same command resumes an interrupted one. [default: in one piece]
        dry_run: Only print the number of poses and tiles with the time and memory needed; times a
            small sample.
        workers (N): Number of processes that build tiles; 0: this process, with its threads.
            [default: one per processor]
        scheduler (ADDRESS): Build the tiles on the workers of a Dask scheduler, e.g.
            tcp://10.0.0.5:8786. [default: processes of this computer]
    """

    PANEL: ClassVar[str] = "Tiles"

    tile: Annotated[float | None, above_zero("20")] = None
    dry_run: bool = False
    workers: Annotated[int | None, at_least(0)] = None
    scheduler: str | None = None

    def check(self, output: str) -> None:
        """Check what can be checked before the building is read.

        Raises:
            InputError: an option has a value that cannot be used, or needs --tile; the scheduler
                does not answer, or nothing can be written to the output's URL.
        """
        if self.workers is not None and self.scheduler is not None:
            raise InputError(
                "--workers: processes of this computer and --scheduler exclude each other; give "
                "one of them."
            )
        if self.tile is not None:
            from ambinav.tiles.build import check_place

            check_place(output, self.scheduler)
            return
        needing = {
            "--dry-run": self.dry_run,
            "--workers": self.workers is not None,
            "--scheduler": self.scheduler is not None,
        }
        for option, is_given in needing.items():
            if is_given:
                raise InputError(f"{option}: this is for maps in tiles; give --tile 20 with it.")

    def build(
        self, environment: Environment, settings: MapSettings, output: str, as_json: bool
    ) -> None:
        """Announce time and memory, and build the map.

        Raises:
            InputError: see `run_plan`.
        """
        from ambinav.tiles.build import run_plan
        from ambinav.tiles.plan import TilePlan

        assert self.tile is not None
        plan = TilePlan.of(environment, settings, self.tile)
        count = self._worker_count()
        needs = plan.estimate(count)
        text = self._announcement(plan, needs, count)
        if self.dry_run:
            figures: dict[str, Any] = vars(needs) | {"workers": count}
            typer.echo(json.dumps(figures, indent=2) if as_json else text)
            return
        if not as_json:
            note(text)
        start = time.perf_counter()
        try:
            with progress_bars(as_json) as bars:
                done = run_plan(
                    plan, output, workers=self.workers, scheduler=self.scheduler,
                    progress=bars("tiles"),
                )  # fmt: skip
        except KeyboardInterrupt:
            note("interrupted; finished tiles are kept, and the same command resumes from there.")
            raise typer.Exit(INTERRUPTED) from None
        seconds = round(time.perf_counter() - start, 3)
        if as_json:
            typer.echo(json.dumps(vars(done) | {"seconds": seconds}, indent=2))
            return
        reused = f", {done.kept} were there" if done.kept else ""
        repaired = f", {done.damaged} of them damaged and made again" if done.damaged else ""
        typer.echo(f"{done.poses} poses, {done.tiles} tiles: {done.made} made{reused}{repaired}")
        typer.echo(f"map: {output}")

    def _worker_count(self) -> int:
        """Return the number of workers for the time estimate; a scheduler is asked for its own."""
        if self.scheduler is None:
            return processors() if self.workers is None else max(self.workers, 1)
        from ambinav.runtime.cluster import threads_of

        return max(threads_of(self.scheduler), 1)

    def _announcement(self, plan: TilePlan, needs: TileEstimate, count: int) -> str:
        from ambinav.map_building.estimate import time_text
        from ambinav.store.settings import size_text

        rows, columns = plan.shape
        headed = f" with {needs.headings} headings" if needs.headings > 1 else ""
        by = "1 worker" if count == 1 else f"{count} workers"
        return (
            f"about {needs.poses} poses{headed} in {needs.tiles} tiles ({rows} x {columns}); "
            f"{time_text(needs.seconds)} on {by}, up to {size_text(needs.stored)} on disk, "
            f"{size_text(needs.sent)} of the building sent to workers, "
            f"{size_text(needs.memory)} of memory in each"
        )
