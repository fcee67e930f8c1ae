"""The result of a gate as SARIF 2.1.0: one result for each condition that holds.

OASIS, "Static Analysis Results Interchange Format (SARIF) Version 2.1.0", 2020. Code scanning of
repositories reads it.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

from ambinav.reports.conditions import Condition, Outcome, Unchecked
from ambinav.runtime.files import write_text
from ambinav.version import __version__

SCHEMA: Final = "https://docs.oasis-open.org/sarif/sarif/v2.1.0/os/schemas/sarif-schema-2.1.0.json"


def sarif(
    outcomes: Sequence[Outcome], command: str, map_file: str | Path, unchecked: Unchecked = ()
) -> dict[str, Any]:
    """Return the document as plain values.

    Args:
        outcomes: Outcomes of the conditions, in their order.
        command: Command on the command line, such as "audit"; rules are named after it.
        map_file: Source of the results: a file, a folder or a URL; relative to the working
            folder if it lies in it.
        unchecked: Notifications of the run, whose execution then was not successful.
    """
    rules = list(dict.fromkeys(_rule_id(command, outcome.condition) for outcome in outcomes))
    described = {_rule_id(command, outcome.condition): outcome.condition for outcome in outcomes}
    location = _location(map_file)
    where = location["artifactLocation"]["uri"]
    return {
        "$schema": SCHEMA,
        "version": "2.1.0",
        "runs": [
            {
                "tool": {
                    "driver": {
                        "name": "ambinav",
                        "version": __version__,
                        "rules": [_rule(name, described[name]) for name in rules],
                    }
                },
                # Results of several maps are kept apart by the part before the last slash.
                "automationDetails": {"id": f"ambinav-{command}/{where}/"},
                "columnKind": "unicodeCodePoints",
                "invocations": [_invocation(unchecked)],
                "results": [
                    _result(outcome, command, rules, location)
                    for outcome in outcomes
                    if outcome.holds
                ],
            }
        ],
    }


def write_sarif(
    outcomes: Sequence[Outcome],
    command: str,
    map_file: str | Path,
    path: Path,
    unchecked: Unchecked = (),
) -> None:
    """Write the document atomically; raises as `ambinav.runtime.files.replacing` does."""
    log = sarif(outcomes, command, map_file, unchecked)
    write_text(path, json.dumps(log, indent=2) + "\n")


def _invocation(unchecked: Unchecked) -> dict[str, Any]:
    said = [
        {"level": "error", "message": {"text": f'"{condition}" {why}'}}
        for condition, why in unchecked
    ]
    return {"executionSuccessful": not said, "toolExecutionNotifications": said}


def _rule_id(command: str, condition: Condition) -> str:
    return f"{command}/{condition.quantity.name.replace(' ', '-')}"


def _rule(name: str, condition: Condition) -> dict[str, Any]:
    quantity = condition.quantity
    unit = f", in {quantity.unit}" if quantity.unit else ""
    return {
        "id": name,
        "shortDescription": {"text": f"Limit on: {quantity.name}."},
        "fullDescription": {"text": f"{quantity.meaning[0].upper()}{quantity.meaning[1:]}{unit}."},
        "defaultConfiguration": {"level": "error"},
    }


def _result(
    outcome: Outcome, command: str, rules: list[str], location: dict[str, Any]
) -> dict[str, Any]:
    name = _rule_id(command, outcome.condition)
    where = location["artifactLocation"]["uri"]
    same = hashlib.sha256(f"{where}\n{outcome.condition}".encode()).hexdigest()
    return {
        "ruleId": name,
        "ruleIndex": rules.index(name),
        "level": "error",
        "message": {"text": outcome.text},
        "locations": [{"physicalLocation": location}],
        "partialFingerprints": {"condition/v1": same},
    }


def _location(place: str | Path) -> dict[str, Any]:
    """Return a file's location; a map stored as a folder or URL has no line numbers."""
    if "://" in str(place):
        return {"artifactLocation": {"uri": str(place)}}
    path = Path(place)
    absolute, here = Path(os.path.normpath(path.absolute())), Path.cwd()  # without ".."
    line = {} if path.is_dir() else {"region": {"startLine": 1}}
    if absolute.is_relative_to(here):
        uri = quote(absolute.relative_to(here).as_posix())
        return {"artifactLocation": {"uri": uri, "uriBaseId": "%SRCROOT%"}, **line}
    return {"artifactLocation": {"uri": absolute.as_uri()}, **line}
