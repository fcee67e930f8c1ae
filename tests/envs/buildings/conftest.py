"""Maps are kept in a folder of the test's own."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder that maps are kept in."""
    folder = tmp_path / "cache"
    monkeypatch.setenv("AMBINAV_CACHE", str(folder))
    return folder
