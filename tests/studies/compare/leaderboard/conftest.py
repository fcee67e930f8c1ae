"""What the tests of the leaderboard share."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture(autouse=True)
def cache_of_its_own(
    tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> Path:
    """Maps of buildings are kept in a folder of the tests."""
    folder = tmp_path_factory.getbasetemp() / "ambinav-cache"
    monkeypatch.setenv("AMBINAV_CACHE", str(folder))
    return folder
