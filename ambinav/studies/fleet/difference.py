"""The difference of two audits of a fleet, by site and scanner."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Final, Literal, get_args

from pydantic import Field, ValidationError

from ambinav.maps.address import Address
from ambinav.reports.conditions import Quantities, Quantity, catalogue
from ambinav.reports.fields import Part, SquareMetres, rounded
from ambinav.reports.number_text import metres2
from ambinav.runtime.errors import InputError
from ambinav.studies.fleet.document import FILE, FleetDocument, FleetFigures

Change = Literal[
    "worse", "better", "other figures", "failed", "not judged", "audited", "appeared", "vanished"
]

LEAST: Final = 0.01
"""Square metres by which bad floor must change to be worse or better: documents are rounded."""


NOTHING: Final = (
    "because a site that was judged in A failed or has no judged floor in B, or no site has "
    "figures in both; see the table, and check that names and scanners are the same"
)
"""Reason why there is no change of bad floor."""


class SiteChange(Part):
    """A site and scanner whose figures differ."""

    site: str
    scanner: str
    change: Change = Field(
        description="other figures: with as much bad floor; failed: in B, but not in A; audited: "
        "failed in A; appeared, vanished: only in B, only in A"
    )
    before_m2: SquareMetres | None = Field(description="bad floor in A; null: not known")
    after_m2: SquareMetres | None = Field(description="bad floor in B; null: not known")
    change_m2: Annotated[float, rounded(2)] | None
    advice: str | None = Field(description="first advice in B")


class FleetDifference(Part):
    """All that differs between two fleets."""

    format: Literal["ambinav-fleet-diff/1"] = "ambinav-fleet-diff/1"
    summary: str
    before: str
    after: str
    same: int = Field(description="number of results with the same figures")
    compared: int = Field(description="number of results with figures in both")
    changes: tuple[SiteChange, ...] = Field(description="the largest change first")


def open_fleet(place: str) -> FleetDocument:
    """Read the document of a fleet's output, a folder or a URL.

    Raises:
        InputError: there is none, or it cannot be read.
    """
    content = Address.of(place).read(FILE)
    if content is None:
        raise InputError(
            f"{place}: there is no {FILE}; give the output of `ambinav fleet audit`, and if that "
            "was interrupted, run it again first."
        )
    try:
        return FleetDocument.model_validate_json(content)
    except ValidationError as error:
        first = error.errors()[0]
        is_json = first["type"] != "json_invalid"
        fault = (
            "is not of this version of `ambinav fleet audit`"
            if is_json
            else "is cut off or no JSON"
        )
        raise InputError(
            f"{place}: {FILE} {fault} ({first['msg']}); run the audit again."
        ) from error


def fleet_difference(
    before: FleetDocument, after: FleetDocument, places: tuple[str, str]
) -> FleetDifference:
    """Compare two fleets.

    Args:
        before: The earlier one.
        after: The later one.
        places: Where they are, for the document.
    """
    old, new = ({(row.site, row.scanner): row for row in each.figures} for each in (before, after))
    changes = [
        change
        for key in sorted({*old, *new})
        if (change := _change(key, old.get(key), new.get(key))) is not None
    ]
    changes.sort(key=lambda change: -abs(change.change_m2 or 0.0))
    same = len({*old, *new}) - len(changes)
    compared = sum(
        old[key].bad_m2 is not None and new[key].bad_m2 is not None for key in old.keys() & new
    )
    counts = {kind: sum(each.change == kind for each in changes) for kind in get_args(Change)}
    parts = [f"{count} {kind}" for kind, count in counts.items() if count]
    sentences = [f"{', '.join(parts) or 'No changes'}; {same} the same."]
    failed = sum(old[key].status == new[key].status == "failed" for key in old.keys() & new)
    if failed:
        sentences.append(f"{failed} failed in both.")
    if parts:
        sentences.append(f"Bad floor at sites in both: {_signed(_total(changes))}.")
    for name in ("spacing_m", "radius_m", "robot_radius_m"):
        values = getattr(before, name), getattr(after, name)
        if values[0] != values[1]:
            sentences.append(f"{name} is not the same: {values[0]} and {values[1]}.")
    return FleetDifference(
        summary=" ".join(sentences), before=places[0], after=places[1], same=same,
        compared=compared, changes=tuple(changes),
    )  # fmt: skip


def _change(
    key: tuple[str, str], old: FleetFigures | None, new: FleetFigures | None
) -> SiteChange | None:
    """Return what differs at a site; None: nothing but the digest."""
    if old is not None and new is not None:
        ignored = {"digest", "building"}
        if old.model_dump(exclude=ignored) == new.model_dump(exclude=ignored):
            return None
    bad = [None if row is None else row.bad_m2 for row in (old, new)]
    rise = None if bad[0] is None or bad[1] is None else bad[1] - bad[0]
    kind: Change = "other figures"
    if new is None:
        kind = "vanished"
    elif new.status == "failed" and (old is None or old.status != "failed"):
        kind = "failed"
    elif old is None:
        kind = "appeared"
    elif old.status != new.status:
        kind = "audited"
    elif bad[0] is not None and bad[1] is None:
        kind = "not judged"
    elif rise is not None and abs(rise) >= LEAST:
        kind = "worse" if rise > 0.0 else "better"
    return SiteChange(
        site=key[0], scanner=key[1], change=kind, before_m2=bad[0], after_m2=bad[1],
        change_m2=rise, advice=None if new is None else new.advice,
    )  # fmt: skip


def _total(changes: list[SiteChange] | tuple[SiteChange, ...]) -> float:
    return sum(change.change_m2 or 0.0 for change in changes)


def _signed(area: float) -> str:
    return f"{'-' if area < 0.0 else '+'}{metres2(abs(area))}"


def _lacking(report: FleetDifference) -> bool:
    """Return whether bad floor of A is not known in B, though the site is there."""
    return any(
        each.before_m2 is not None and each.change in ("failed", "not judged")
        for each in report.changes
    )


def _worst(report: FleetDifference) -> float | None:
    if _lacking(report):
        return None
    rises = [each.change_m2 for each in report.changes if each.change_m2 is not None]
    # What has not changed at all is no change of the report.
    return max([*rises, 0.0][: report.compared], default=None)


def _named_sites(kind: str) -> Callable[[FleetDifference], str]:
    def names(report: FleetDifference) -> str:
        listed = [f"{each.site} ({each.scanner})" for each in report.changes if each.change == kind]
        return f"{kind.capitalize()}: {', '.join(listed)}." if listed else ""

    return names


def _count(kind: str, meaning: str) -> Quantity:
    return Quantity(
        kind, "", f"number of sites and scanners {meaning}",
        lambda report: float(sum(each.change == kind for each in report.changes)),
        _named_sites(kind),
    )  # fmt: skip


QUANTITIES: Final[Quantities] = catalogue(
    Quantity(
        "bad change", "m²", "largest rise of the bad floor at a site; negative if all fall",
        _worst, _named_sites("worse"), NOTHING, least=-float("inf"),
    ),
    Quantity(
        "total bad change", "m²", "bad floor of all sites in both, after minus before",
        lambda report: (
            _total(report.changes) if report.compared and not _lacking(report) else None
        ),
        _named_sites("worse"), NOTHING, least=-float("inf"),
    ),
    _count("worse", "with more bad floor"),
    _count("failed", "that failed in B and not in A"),
    _count("not judged", "of which some floor was judged in A and none in B"),
    _count("vanished", "that only A has"),
    _count("appeared", "that only B has, and that did not fail there"),
)  # fmt: skip
"""Figures for conditions, by their names."""
