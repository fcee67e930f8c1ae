"""`ambinav store`: the stored maps, opened instead of computed again."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ambinav.cli import printing
from ambinav.cli.options import AsJson, documented
from ambinav.cli.running import reporting

if TYPE_CHECKING:
    from ambinav.store.upkeep import Kept

DAMAGE = 3
"""Exit status of `verify` where an entry was damaged."""

store = typer.Typer(
    name="store",
    no_args_is_help=True,
    rich_markup_mode="markdown",
    help="Manage the maps stored in the user's cache folder ($AMBINAV_CACHE; if that is empty, no "
    "maps are stored).",
)


@store.command("list")
def list_maps(as_json: AsJson = False) -> None:
    """List the stored maps, the most recently used first.

    Example: `ambinav store list`
    """
    with reporting():
        from ambinav.store.map_store import MapStore
        from ambinav.store.settings import size_text
        from ambinav.store.upkeep import entries_of

        place = MapStore.of_user()
        entries = entries_of(place)
        total = sum(entry.size for entry in entries)
        if as_json:
            result = {
                "folder": str(place.place),
                "bytes": total,
                "limit_bytes": place.limit,
                "maps": [_row(entry) for entry in entries],
            }
            typer.echo(json.dumps(result, indent=2))
            return
        _table(entries)
        typer.echo(
            f"{len(entries)} in {place.place}: {size_text(total)} of at most "
            f"{size_text(place.limit)}"
        )


@store.command("show")
@documented
def show(key: Annotated[str, typer.Argument()], as_json: AsJson = False) -> None:
    """Show the input and the parameters of a stored map.

    Example: `ambinav store show 9730e8`

    Parameters:
        key (KEY): A map's key, or its beginning; see list.
    """
    with reporting():
        from ambinav.store.map_store import MapStore
        from ambinav.store.upkeep import find

        entry = _row(find(MapStore.of_user(), key))
        if as_json:
            typer.echo(json.dumps(entry, indent=2))
            return
        for name, value in entry.items():
            if isinstance(value, dict):
                value = ", ".join(f"{name} {each}" for name, each in value.items())
            elif isinstance(value, list):
                value = ", ".join(map(str, value))
            typer.echo(f"{name}: {value}")


@store.command("verify")
@documented
def verify_maps(
    keys: Annotated[list[str] | None, typer.Argument()] = None, as_json: AsJson = False
) -> None:
    """Read stored maps in full, and set damaged ones aside; exit status 3 if there are any.

    Example: `ambinav store verify`

    Parameters:
        keys ([KEY]...): Keys, or their beginnings. [default: all]
    """
    with reporting():
        from ambinav.store.map_store import MapStore
        from ambinav.store.upkeep import verify

        intact, damaged = [], {}
        for entry, reason in verify(MapStore.of_user(), keys or None):
            if reason is None:
                intact.append(entry.key)
            else:
                damaged[entry.key] = reason
                if not as_json:
                    typer.echo(f"{entry.path}: damaged ({reason}), set aside")
        if as_json:
            typer.echo(json.dumps({"whole": intact, "damaged": damaged}, indent=2))
        else:
            typer.echo(f"{len(intact)} intact, {len(damaged)} damaged")
        if damaged:
            raise typer.Exit(DAMAGE)


@store.command("prune")
@documented
def prune_maps(
    limit: str | None = None,
    other_code: bool = False,
    every: Annotated[bool, typer.Option("--all")] = False,
    as_json: AsJson = False,
) -> None:
    """Remove stored maps, and the remains of killed runs.

    Example: `ambinav store prune --limit "1 GB"`

    Parameters:
        limit (SIZE): Size to keep, e.g. 500 MB; the least recently used maps are removed first.
            [default: $AMBINAV_CACHE_LIMIT, or 5 GB]
        other_code: Remove maps computed by other versions or libraries.
        every: Remove all maps, except those of a newer ambinav.
    """
    with reporting():
        from ambinav.store.map_store import MapStore
        from ambinav.store.settings import parse_size, size_text
        from ambinav.store.upkeep import entries_of, prune

        place = MapStore.of_user()
        max_bytes = place.limit if limit is None else parse_size(limit, "--limit")
        count, size = prune(place, max_bytes, other_code=other_code, every=every)
        remaining = entries_of(place)
        if as_json:
            result = {
                "removed": count,
                "removed_bytes": size,
                "left": len(remaining),
                "left_bytes": sum(entry.size for entry in remaining),
            }
            typer.echo(json.dumps(result, indent=2))
        else:
            typer.echo(f"{count} removed ({size_text(size)}), {len(remaining)} left")


def _row(entry: Kept) -> dict[str, Any]:
    """Return an entry as plain values."""
    row: dict[str, Any] = {
        "key": entry.key,
        "state": entry.state,
        "path": str(entry.path),
        "bytes": entry.size,
        "used": entry.used,
    }
    if entry.about is not None:
        from ambinav.store.entry import cells

        attrs = entry.about.attrs
        row |= {
            "environment": attrs["environment"],
            "environment_source": attrs["environment_source"],
            "scanner": attrs["scanner"],
            "parameters": json.loads(attrs["parameters"]),
            "layers": [
                name for name, _, attributes, *_ in entry.about.variables if "worse" in attributes
            ],
            "cells": cells(entry.about),
            "made": entry.about.made,
            "ambinav_version": attrs["ambinav_version"],
            "versions": json.loads(attrs["versions"]),
        }
    return row


def _table(entries: list[Kept]) -> None:
    from ambinav.store.settings import size_text

    def texts(entry: Kept) -> tuple[str, ...]:
        row = _row(entry)
        parameters = row.get("parameters", {})
        return (
            entry.key[:8],
            row.get("environment", ""),
            row.get("scanner", ""),
            f"{parameters['spacing']:g} m" if parameters else "",
            f"{row['cells']:,}" if "cells" in row else "",
            size_text(entry.size),
            entry.used[:16].replace("T", " "),
            entry.state,
        )

    columns = "key", "environment", "scanner", "spacing", "cells", "size", "used", "state"
    left = "key", "environment", "scanner", "used", "state"
    if entries:
        printing.show(printing.table(columns, map(texts, entries), left=left, fold=True))
