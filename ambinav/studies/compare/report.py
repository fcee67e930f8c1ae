"""Comparison run that writes a folder: map, routes, drives, tables, pictures, reports."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Final

from ambinav.config import as_count, check_kind
from ambinav.layers.registry import on_request
from ambinav.map_building.build import build_map
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.content_digest import environment_digest
from ambinav.plotting.style import check_format
from ambinav.reports.parameters import scenario_parameters
from ambinav.reports.table import difference_text, ratio_text, value_text
from ambinav.routes.bad_floor import stretch_text
from ambinav.routes.files import save_route
from ambinav.runtime.files import replacing
from ambinav.runtime.progress import Stages, silent_stages
from ambinav.runtime.provenance import PLANNING, POLICIES, Provenance, digest_of, discard_stale
from ambinav.runtime.runfolder import LOCK, WORK
from ambinav.store.map_store import MapStore
from ambinav.studies.compare.actions import actions
from ambinav.studies.compare.document import Document, document, pairs_of
from ambinav.studies.compare.exports import export_all
from ambinav.studies.compare.forecasts import forecast_note, make_forecasts
from ambinav.studies.compare.main_guard import check_guarded
from ambinav.studies.compare.overview import plot_overview
from ambinav.studies.compare.page import page_map
from ambinav.studies.compare.pictures import OVERVIEW, PICTURES, pair_figures, slug
from ambinav.studies.compare.plans import Plan, check_plans, make_plans
from ambinav.studies.compare.runs import drive_all
from ambinav.studies.compare.scenario_file import ScenarioBundle
from ambinav.studies.compare.tables import FIGURES, Row, make_rows, to_csv
from ambinav.studies.compare.verdict_text import EFFECTS, OUTCOMES
from ambinav.studies.compare.workers import Setup
from ambinav.studies.compare.worlds import make_worlds
from ambinav.studies.study import Content, Study

ROUTES: Final = "routes"
DRIVES: Final = "drives"
"""Folder of the drives for other programs."""
TABLE: Final = "table.csv"
STUDY: Final = Study("comparison", "ambinav.studies.compare", PICTURES, (TABLE, ROUTES, DRIVES))
"""Its folder `work` has the map, and a file for each piece of work."""


def compare_routes(
    loaded: ScenarioBundle,
    folder: str | Path,
    *,
    jobs: int = 1,
    stages: Stages = silent_stages,
    image_format: str = "png",
    store: bool | MapStore = False,
) -> tuple[Document, tuple[Row, ...]]:
    """Compare the routes of a scenario and write all results.

    What an earlier call left in `folder` is used: the map and the drives whose inputs are
    unchanged are not made again. What other code made is discarded, which a warning says.

    Args:
        loaded: The scenario.
        folder: Output folder.
        jobs: Number of worker processes.
        stages: Begins a stage by its name; what it returns is called with the share done.
        image_format: Format of the pictures, one of `ambinav.plotting.style.FORMATS`.
        store: Store of maps, as for `build_map`; used if `folder` holds no map of the scenario.

    Returns:
        What report.json holds, and the rows of the table.

    Raises:
        InputError: see `RunFolder.check`, `check_plans`, `make_plans`, `make_worlds` and
            `drive_all`; another call is at work in `folder`; or a script calls this that is not
            guarded (`check_guarded`).
    """
    check_guarded("compare_routes")
    check_kind(loaded, ScenarioBundle, "loaded", "give what `load_scenario` returns")
    jobs = as_count(jobs, "jobs")
    check_format(image_format)
    out = STUDY.folder.check(folder)
    with loaded.named():
        check_plans(loaded)
    with STUDY.folder.hold(out):
        return _compare(loaded, out, jobs, stages, image_format, store)


def _compare(
    loaded: ScenarioBundle,
    out: Path,
    jobs: int,
    stages: Stages,
    image_format: str,
    store: bool | MapStore,
) -> tuple[Document, tuple[Row, ...]]:
    scenario = loaded.scenario
    has_policy = any(part.kind == "policy" for part in scenario.routes)
    here = Provenance.here(*PLANNING, *(POLICIES if has_policy else ()))
    discard_stale(out / WORK, here, kept=(LOCK,))
    with loaded.named():
        amap = _load_map(loaded, out / WORK, stages, store)
        plans = make_plans(loaded, amap, stages("routes"))
        worlds = make_worlds(loaded, plans)
    setup = Setup(scenario, loaded.environment, loaded.scanner, amap, worlds)
    names = [
        f"{number + 1:02d}-{slug(plan.pair)}-{slug(plan.name)}" for number, plan in enumerate(plans)
    ]
    files = _save_routes(plans, names, out)
    results = drive_all(setup, plans, out / WORK, jobs=jobs, progress=stages("drives"))
    written = export_all(setup, plans, out / DRIVES, names, jobs)
    forecasts = make_forecasts(loaded, amap, plans)
    rows = make_rows(plans, results, scenario.baseline, scenario.drive.seed, forecasts)
    by_pair = pair_figures(setup, plans, results)
    figures = {
        name: figure
        for figures_of_pair in by_pair.values()
        for name, figure in figures_of_pair.items()
    }
    figures[OVERVIEW] = partial(plot_overview, rows, f"Routes compared: {scenario.name}")
    drawn = STUDY.draw(out, figures, image_format, stages("pictures"))
    pictures = {
        pair: tuple(drawn[name] for name in figures_of_pair)
        for pair, figures_of_pair in by_pair.items()
    }
    drives = [f"{DRIVES}/{name}" for name in written]
    report = document(loaded, plans, files, rows, pictures, drawn[OVERVIEW], drives)
    content = Content(
        report,
        {
            "actions": actions(report),
            "parameters": scenario_parameters(report.parameters),
            "pairs": pairs_of(rows),
            "rows": rows,
            "figures": FIGURES,
            "ratios": [figure for figure in FIGURES if figure.has_ratio],
            "effects": EFFECTS,
            "outcomes": OUTCOMES,
            "forecast_note": forecast_note(forecasts),
        },
        {
            "value": value_text,
            "difference": difference_text,
            "ratio": ratio_text,
            "stretch": stretch_text,
        },
        page_map(setup, plans),
        {TABLE: to_csv(rows)},
    )
    STUDY.write_documents(out, content, {name: name for name in drawn.values()})
    STUDY.remove_pictures(out, drawn.values())  # of an earlier scenario, or in another format
    return report, rows


def _load_map(
    loaded: ScenarioBundle, work: Path, stages: Stages, store: bool | MapStore
) -> AmbiguityMap:
    """Build or read the map of the scenario."""
    options = loaded.scenario.map.model_dump(exclude={"layer"})
    layer = loaded.scenario.map.layer
    options["layers"] = () if layer is None else on_request(layer)
    environment = loaded.environment
    key = digest_of(
        Provenance.here().digest,
        options,
        loaded.scanner.to_yaml(),
        environment_digest(environment),
        environment.name,
    )
    path = work / f"map-{key[:16]}.zarr"
    if path.is_dir():
        return AmbiguityMap.open(path)
    progress = stages("ambiguity")
    amap = build_map(environment, loaded.scanner, progress=progress, store=store, **options)
    amap.save(path)
    # Read back, so that it makes no difference whether the map was there.
    return AmbiguityMap.open(path)


def _save_routes(plans: Sequence[Plan], names: Sequence[str], out: Path) -> list[str]:
    """Write all routes and remove those of an earlier scenario; return their files."""
    with replacing(out / ROUTES) as fresh:
        fresh.mkdir()
        for plan, name in zip(plans, names, strict=True):
            save_route(plan.route, fresh / f"{name}.csv")
    return [f"{ROUTES}/{name}.csv" for name in names]
