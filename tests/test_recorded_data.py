"""What becomes of a test that reads recorded data, with and without `AMBINAV_DATA`."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

READS = """
def test_reads(data_dir):
    assert (data_dir / "maps").is_dir()

def test_reads_nothing():
    pass
"""


@pytest.mark.slow(kept=(".-1-messages1",))
@pytest.mark.parametrize(
    ("data", "status", "messages"),
    [
        (None, 0, ["1 passed, 1 skipped", "AMBINAV_DATA is not set: 1 skipped", "1 test_reads.py"]),
        (".", 1, ["1 failed, 1 passed"]),
        ("none", 1, ["1 error", "AMBINAV_DATA names none, which is not a folder"]),
    ],
)
def test_a_missing_file_fails_and_a_missing_folder_is_reported(
    tmp_path: Path, data: str | None, status: int, messages: list[str]
) -> None:
    shutil.copy(Path(__file__).with_name("conftest.py"), tmp_path)
    (tmp_path / "test_reads.py").write_text(READS)
    env = {name: value for name, value in os.environ.items() if name != "AMBINAV_DATA"}
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-p", "no:cacheprovider"],
        cwd=tmp_path,
        env=env if data is None else {**env, "AMBINAV_DATA": data},
        capture_output=True,
        text=True,
    )
    assert done.returncode == status, done.stdout
    for words in messages:
        assert words in done.stdout
