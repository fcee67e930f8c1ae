"""A test that waits for ever fails with its name, and the others go on."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
HANGING = """
import ctypes, threading

def test_python_waits():
    threading.Event().wait()

def test_c_waits_and_keeps_the_interpreter():
    lock, system = ctypes.create_string_buffer(128), ctypes.PyDLL(None)
    system.pthread_mutex_init(lock, None)
    for _ in range(2):
        system.pthread_mutex_lock(lock)

def test_all_is_well():
    pass
"""


@pytest.mark.sweep
def test_what_hangs_fails_and_is_named(tmp_path: Path) -> None:
    """With the settings of pyproject.toml and the Makefile, but limits of seconds."""
    (tmp_path / "test_hanging.py").write_text(HANGING)
    makefile = (ROOT / "Makefile").read_text()
    found = re.search(r"^PYTEST_ARGS \?= -n auto --maxprocesses 4 (.+)$", makefile, re.MULTILINE)
    assert found is not None
    done = subprocess.run(
        [
            *(sys.executable, "-m", "pytest", "-c", ROOT / "pyproject.toml", "-n", "1"),
            *found[1].split(),
            *("-p", "no:cacheprovider", "-o", "timeout=2", "-o", "faulthandler_timeout=5"),
            *("--rootdir", tmp_path, tmp_path / "test_hanging.py"),
        ],
        env={name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=240,
    )
    assert done.returncode == 1, done.stdout + done.stderr
    assert "2 failed, 1 passed" in done.stdout
    assert "test_python_waits - Failed: Timeout (>2.0s)" in done.stdout
    assert "crashed while running 'test_hanging.py::test_c_waits_and_keeps" in done.stdout
    # Where it hung.
    assert re.search(r'File ".*test_hanging.py", line \d+ in test_c_waits', done.stderr)
