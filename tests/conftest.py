"""Fixtures that several parts of the tests share."""

from __future__ import annotations

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """The folder of recorded maps and logs; without AMBINAV_DATA the test is skipped.

    If the variable is set, a file that is missing there fails the test.
    """
    name = os.environ.get("AMBINAV_DATA")
    if not name:
        pytest.skip("AMBINAV_DATA is not set")
    folder = Path(name)
    assert folder.is_dir(), f"AMBINAV_DATA names {folder}, which is not a folder"
    return folder
