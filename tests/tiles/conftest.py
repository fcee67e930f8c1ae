"""The building, the laser and the map that the tests of the ambiguity use too."""

from tests.ambiguity.conftest import demo, laser

__all__ = ["demo", "laser"]
