"""What the tests of the store share."""

from __future__ import annotations

from pathlib import Path

import pytest

from ambinav.store.map_store import MapStore


@pytest.fixture
def store(tmp_path: Path) -> MapStore:
    return MapStore(tmp_path / "maps")
