"""The file of an environment's building, with how it is read."""

from __future__ import annotations

from pathlib import Path

from ambinav.sensing.building_file import BuildingPart


class MapFile(BuildingPart):
    """What the argument `map` may say: {"file": "office.ifc", "space": {"in_space": True}}."""

    file: Path
