"""The building, the laser and the map that the tests of the ambiguity use too."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from ambinav.map_building import worth
from tests.ambiguity.conftest import demo, laser

__all__ = ["demo", "laser"]


@pytest.fixture(scope="module")
def patching() -> Iterator[None]:
    """Updates compute what sees the change, however small the map."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(worth, "SMALLEST", 0.0)
        patch.setattr(worth, "OVERHEAD", 0.0)
        patch.setattr(worth, "MARGIN", -2.0)
        yield
