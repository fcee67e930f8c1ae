"""The building, the laser and the map that the tests of the ambiguity use too."""

from tests.ambiguity.conftest import demo, demo_map, laser

__all__ = ["demo", "demo_map", "laser"]
