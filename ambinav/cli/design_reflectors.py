"""`ambinav design reflectors`: reflectors for robots that navigate by them."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Annotated, ClassVar

import typer

from ambinav.cli import options
from ambinav.cli.checks import conflict, naming_options
from ambinav.cli.design_place import (
    OBSTACLE_COLUMNS,
    UNUSED_LAYERS,
    PositionOptions,
    obstacle_cells,
)
from ambinav.cli.limits import above_zero
from ambinav.cli.map_options import BuildingOptions, MapOptions, ReachOptions
from ambinav.cli.printing import finish, show, table
from ambinav.cli.region_options import KeepOut, keep_out_zones
from ambinav.cli.running import check_report, progress_bars, reporting
from ambinav.runtime.errors import InputError

if TYPE_CHECKING:
    from ambinav.layers.reflectors.views import ReflectorRules
    from ambinav.studies.design.place.candidates import Kind
    from ambinav.studies.design.reflectors.document import Document


@dataclass(frozen=True, kw_only=True)
class NewOptions(PositionOptions):
    """Options on new reflectors.

    Attributes:
        posts (N): Place at most N round posts. [default: none]
        tags (N): Place at most N strips flat on walls. [default: none]
        post_radius (M): Radius of a post, metres.
        width (M): Width of a tag, metres.
    """

    PANEL: ClassVar[str] = "New reflectors"

    posts: int | None = None
    tags: int | None = None
    post_radius: Annotated[float, typer.Option("--radius")] = 0.05
    width: float = 0.3
    keep_out: KeepOut = None

    def kind_and_count(self) -> tuple[Kind, int]:
        """Return the kind and number of new reflectors.

        Raises:
            InputError: both kinds are asked for, or a number is out of its range.
        """
        if self.posts is not None and self.tags is not None:
            raise InputError("--posts, --tags: both are given; give one, such as --tags 8.")
        kind: Kind = "tag" if self.tags is not None else "post"
        count = self.posts if self.tags is None else self.tags
        if count is not None:
            self.check(kind, count)
        return kind, count or 0


@dataclass(frozen=True, kw_only=True)
class NeedOptions:
    """Options on what the robot needs.

    Attributes:
        needed (N): Reflectors that must be in view at a time.
        reflector_range (M): Range up to which reflectors are recognised, metres.
            [default: the range of the scanner]
        max_incidence (DEG): Angle of incidence up to which a flat reflector is recognised.
        tolerance (M): Distances between reflectors that differ by less are alike, metres.
        max_std (M): Largest standard deviation of the position, metres.
    """

    PANEL: ClassVar[str] = "Navigation"

    needed: int = 3
    reflector_range: Annotated[float | None, above_zero("20")] = None
    max_incidence: float = 45.0
    tolerance: float = 0.1
    max_std: float = 0.05

    def rules(self) -> ReflectorRules:
        """Return the rules.

        Raises:
            InputError: a number is out of its range.
        """
        from ambinav.layers.reflectors.views import ReflectorRules

        with naming_options(*(field.name for field in fields(ReflectorRules))):
            return ReflectorRules(
                self.needed, self.reflector_range, self.max_incidence, self.tolerance, self.max_std
            )


@options.documented
def reflectors(
    map_file: options.MapFile,
    scanner: options.Scanner,
    *,
    new: NewOptions,
    output: options.ReportFolder = None,
    needs: NeedOptions,
    building: BuildingOptions,
    map_options: MapOptions,
    robot: ReachOptions,
    pictures: options.Pictures = "png",
    as_json: options.AsJson = False,
) -> None:
    """Judge the reflectors of a building, and place more for robots that navigate by them.

    A robot navigates where enough reflectors are in view at every heading, no other pose shows the
    same, and they fix its position precisely. Without --posts or --tags the layout is only judged.

    Example: `ambinav design reflectors hall.yaml --scanner scanner.yaml --tags 12 -o layout`
    """
    with reporting():
        from ambinav.studies.design.reflectors.document import document
        from ambinav.studies.design.reflectors.report import STUDY, write_report
        from ambinav.studies.design.reflectors.study import check_reflectors, plan_reflectors

        conflict("--layers", map_options.layers is not None, UNUSED_LAYERS)
        kind, count = new.kind_and_count()
        new.check_used([kind] if count else ())
        new.rules_of(kind)
        rules = needs.rules()
        zones = keep_out_zones(new.keep_out)
        check_report(STUDY, output, pictures)
        environment, chosen = map_options.load(map_file, scanner, building)
        reach = robot.reach(environment, chosen)
        positions = new.rules_of(kind, chosen) if count else None
        check_reflectors(environment, chosen, reach, positions, zones)
        with progress_bars(as_json) as bars:
            amap = map_options.build(environment, chosen, bars("ambiguity"))
            layout = plan_reflectors(
                environment,
                chosen,
                amap,
                reach,
                rules,
                positions,
                count,
                keep_out=zones,
                stages=bars,
            )
            if output is None:
                report = document(layout, count)
            else:
                report = write_report(layout, count, output, bars("report"), pictures)
        finish(report, _show, STUDY.page(output), as_json=as_json)


def _show(report: Document) -> None:
    show(report.summary, *report.remarks)
    rows = (
        (
            *obstacle_cells(reflector),
            f"{reflector.after.enough_m2:,.1f} m²",
            f"{reflector.after.good_m2:,.1f} m²",
        )
        for reflector in report.reflectors
    )
    if report.reflectors:
        columns = (*OBSTACLE_COLUMNS, "enough in view", "navigates on")
        show("", table(columns, rows, left=("kind", "position"), no_wrap=columns))
