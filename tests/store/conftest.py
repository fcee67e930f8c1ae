"""What the tests of the store share."""

from __future__ import annotations

from pathlib import Path

import pytest

from ambinav.ambiguity import build as build_module
from ambinav.store.map_store import MapStore


@pytest.fixture
def store(tmp_path: Path) -> MapStore:
    return MapStore(tmp_path / "maps")


@pytest.fixture
def computes(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Counts the maps that are computed."""
    calls: list[int] = []
    compute = build_module._compute

    def counted(*arguments):
        calls.append(1)
        return compute(*arguments)

    monkeypatch.setattr(build_module, "_compute", counted)
    return calls
