"""Changes of the scanner: another one, another mount, or a second one."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from ambinav.runtime.errors import InputError
from ambinav.sensing.layout import Planar
from ambinav.sensing.preset_summary import field_of_view
from ambinav.sensing.scanner import RangeScanner
from ambinav.studies.audit.counterfactual.alternatives import at_mount_of, other_mounts
from ambinav.studies.design.requirement.costs import Allowed, Costs

Change = Literal["none", "scanner", "mount", "second-scanner"]


@dataclass(frozen=True, eq=False)
class Hardware:
    """A scanner on the robot.

    Attributes:
        change: Kind of the change.
        label: In pictures and tables; empty for the scanner as it is.
        title: The change in the imperative; empty for none.
        cost: Of the change.
        scanner: The scanner, or both of them.
    """

    change: Change
    label: str
    title: str
    cost: float
    scanner: RangeScanner

    @property
    def name(self) -> str:
        """The label, or the scanner's name where nothing is changed."""
        return self.label or self.scanner.name

    @property
    def reads_tags(self) -> bool:
        """True if the scanner measures intensities."""
        return len(self.scanner.intensity_beams) > 0


def hardware_options(
    scanner: RangeScanner, allowed: Allowed, costs: Costs, source: str
) -> tuple[tuple[Hardware, ...], tuple[str, ...]]:
    """Return the scanner as it is and each allowed change, cheapest first, and remarks.

    Args:
        scanner: The present scanner.
        allowed: Allowed changes.
        costs: Their costs; other and second scanners are those that these list.
        source: Names the costs in messages.

    Raises:
        InputError: a listed scanner cannot be loaded, or has the name of another one.
    """
    options = [Hardware("none", "", "", 0.0, scanner)]
    remarks = []
    if allowed.mount:
        assert costs.mount is not None
        moved = [
            Hardware("mount", "in the centre", change.title, costs.mount, change.scanner)
            for change in other_mounts(scanner)
        ]
        options += moved
        if not moved:
            remarks.append(
                f"No other mount is tried: {scanner.name} looks all around or sits in the robot's "
                "centre, or has several parts."
            )
    names = [scanner.name]
    if allowed.scanner or allowed.second_scanner:
        for listed, cost in costs.scanner.items():
            beside = Path(source).parent / listed
            try:
                loaded = RangeScanner.load(beside if beside.is_file() else listed)
                other = at_mount_of(scanner, loaded)
            except InputError as error:
                raise InputError(f"{source}: scanner: {error}") from error
            if other != scanner and other.name in names:
                raise InputError(
                    f"{source}: scanner: {listed} is called {other.name!r}, as another one is; "
                    "give each a `name` of its own."
                )
            names.append(other.name)
            options += _with_listed(scanner, other, cost, allowed, costs.mount)
            if allowed.scanner and other == scanner:
                remarks.append(f"{listed} of {source} is the present scanner.")
            if allowed.second_scanner and turned(other) is None:
                remarks.append(
                    f"No second scanner {other.name}: it is not a fan in a plane, which would be "
                    "turned by half a turn."
                )
    options.sort(key=lambda option: option.cost)
    return tuple(options), tuple(remarks)


def _with_listed(
    scanner: RangeScanner,
    other: RangeScanner,
    cost: float,
    allowed: Allowed,
    mount_cost: float | None,
) -> Iterator[Hardware]:
    """Yield the changes to which a listed scanner leads."""
    if allowed.scanner and other != scanner:
        reach = f"{other.max_range:g} m, {math.degrees(field_of_view(other)):.0f}°"
        title = f"Use {other.name} ({reach}) instead of {scanner.name}"
        yield Hardware("scanner", other.name, title, cost, other)
        if allowed.mount and mount_cost is not None:
            for change in other_mounts(other):
                yield Hardware(
                    "scanner", f"{other.name} in the centre",
                    f"{title}, mounted in the robot's centre", cost + mount_cost, change.scanner,
                )  # fmt: skip
    if allowed.second_scanner and (behind := turned(other)) is not None:
        title = f"Mount a second scanner, {other.name}, turned half a turn about the robot's centre"
        both = RangeScanner.mixed(scanner, behind, name=f"{scanner.name} and {other.name}")
        yield Hardware("second-scanner", f"second scanner {other.name}", title, cost, both)


def turned(scanner: RangeScanner) -> RangeScanner | None:
    """Return a scanner turned by half a turn about the robot's centre; None if it is no fan."""
    parts = []
    for part in scanner.parts:
        if not isinstance(part.layout, Planar):
            return None
        x, y, yaw = part.layout.mount
        parts.append(replace(part, layout=replace(part.layout, mount=(-x, -y, yaw + math.pi))))
    return replace(scanner, parts=tuple(parts))
