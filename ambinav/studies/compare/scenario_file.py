"""Loader of scenario files: YAML, with files named relative to the scenario file."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from ambinav.ambiguity.cost_layer import cost_layer
from ambinav.casting.scans import check_rays
from ambinav.config import checked, parse_yaml, read_text
from ambinav.drive.localizer_spec import suited
from ambinav.runtime.errors import InputError, InputWarning
from ambinav.runtime.input_suggestions import SCENARIO, kind_of, kind_of_path, refuse
from ambinav.studies.compare.scenario import Scenario

_KEYS = {
    "`--extrude M`": "space: extrude",
    "`--in-space`": "space: in_space",
    "`--scanner-height M` on the command line": "scanner_height",
    "--scanner-height": "scanner_height",
    "--level NAME": "level",
    "--level": "level",
    "--unit": "unit",
    "--cad-layer NAME=walls (layers={...} in Python)": "plan: layers",
}
"""Keys of a scenario for options that messages of readers name."""

if TYPE_CHECKING:
    from ambinav.geometry.environment import Environment
    from ambinav.sensing.scanner import RangeScanner


@dataclass(frozen=True)
class ScenarioBundle:
    """A scenario with the files that it names.

    Attributes:
        scenario: Contents of the file.
        path: The file.
        environment: The building.
        scanner: The scanner.
        force: Let policies drive another scanner or robot than they were trained with.
        trust: Run policies that are code, and a localizer that is a program.
    """

    scenario: Scenario
    path: Path
    environment: Environment
    scanner: RangeScanner
    force: bool = False
    trust: bool = False

    @property
    def folder(self) -> Path:
        """Folder of the file."""
        return self.path.parent

    @contextmanager
    def named(self) -> Iterator[None]:
        """Add the file to error messages."""
        try:
            yield
        except InputError as error:
            raise InputError(f"{self.path}: {error}") from error


def load_scenario(
    path: str | Path, *, runs: int | None = None, force: bool = False, trust: bool = False
) -> ScenarioBundle:
    """Read a scenario with its building and scanner.

    Missing settings of map and localizer are those that suit the scanner. An `InputWarning` says so
    where the localizer that it names cannot use the scanner.

    Args:
        path: The file.
        runs: Instead of the file's.
        force: See `ScenarioBundle`.
        trust: The same.

    Raises:
        InputError: a file is missing or cannot be used; the message names file, key and value.
    """
    path = Path(path)
    refuse(str(path), kind_of_path(path), "a scenario")
    plain = parse_yaml(read_text(path), str(path), "docs/compare.md lists all keys")
    refuse(str(path), kind_of(plain), "a scenario", SCENARIO)
    scenario = parse_scenario(plain, str(path), path.stem, runs=runs)
    scanner = _scanner(scenario, path)
    if scenario.map.layer is None:
        read = scenario.map.model_copy(update={"layer": cost_layer(scanner)})
        scenario = scenario.model_copy(update={"map": read})
    scenario = scenario.model_copy(update={"localizer": suited(scenario.localizer, scanner)})
    localizer = scenario.chosen_localizer
    if localizer.spec.runs_command and not trust:
        raise InputError(
            f"{path}: localizer: {localizer.title} would run with your rights; if you trust it, "
            "add --trust (trust=True in Python)."
        )
    note = localizer.note(scanner)
    if note is not None:
        warnings.warn(f"{path}: {note}", InputWarning, stacklevel=2)
    environment = _environment(scenario, path, scanner)
    try:
        localizer.check(environment, scanner)
    except InputError as error:
        raise InputError(f"{path}: localizer: {error}") from error
    return ScenarioBundle(scenario, path, environment, scanner, force, trust)


def parse_scenario(
    plain: object, where: str, default_name: str, *, runs: int | None = None
) -> Scenario:
    """Create a scenario from plain values; `where` names their source in messages.

    Raises:
        InputError: a key is unknown or missing, or a value of no use.
    """
    if not isinstance(plain, Mapping):
        raise InputError(
            f"{where}: this is not a mapping of keys, such as `pairs: ...`; give a scenario."
        )
    keys: dict[str, Any] = {"name": default_name, **plain}
    if isinstance(keys.get("pairs"), list):
        keys["pairs"] = [
            {"name": f"pair {i + 1}", **pair} if isinstance(pair, Mapping) else pair
            for i, pair in enumerate(keys["pairs"])
        ]
    if runs is not None and isinstance(keys.get("drive", {}), Mapping):
        keys["drive"] = {**keys.get("drive", {}), "runs": runs}
    return checked(Scenario, keys, where)


def _environment(scenario: Scenario, path: Path, scanner: RangeScanner) -> Environment:
    building = path.parent / scenario.environment
    if not building.exists():
        raise InputError(
            f"{path}: environment: the file {building} does not exist; give a path relative to the "
            "scenario."
        )
    try:
        environment = scenario.load(building, scanner, scenario.robot.radius)
        height, elevation = scanner.upright.T
        check_rays(environment, height, elevation)
    except InputError as error:
        raise InputError(f"{path}: environment: {_keys_for(str(error))}") from error
    return environment


def _keys_for(message: str) -> str:
    """Replace the options of other commands by a scenario's keys in a message."""
    for option, key in _KEYS.items():
        message = message.replace(option, f"the key {key}")
    return message


def _scanner(scenario: Scenario, path: Path) -> RangeScanner:
    """Return the scanner at its height."""
    chosen = _named_scanner(scenario, path)
    height = scenario.scanner_height
    return chosen if height is None else chosen.raised(height)


def _named_scanner(scenario: Scenario, path: Path) -> RangeScanner:
    from ambinav.sensing.presets import preset_names
    from ambinav.sensing.scanner import RangeScanner

    chosen = scenario.scanner
    if not isinstance(chosen, str):
        text = yaml.safe_dump(chosen, sort_keys=False)
        return RangeScanner.from_yaml_text(text, file=f"{path}: scanner")
    if chosen in preset_names():
        return RangeScanner.from_preset(chosen)
    beside = path.parent / chosen
    try:
        return RangeScanner.load(beside if beside.exists() else chosen)
    except InputError as error:
        raise InputError(f"{path}: scanner: {error}") from error
