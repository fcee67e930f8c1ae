"""The file of an environment's building, and the options for reading it."""

from __future__ import annotations

from pathlib import Path

from ambinav.sensing.building_file import BuildingPart


class MapFile(BuildingPart):
    """Value of the argument `map`, such as {"file": "office.ifc", "space": {"in_space": True}}."""

    file: Path
