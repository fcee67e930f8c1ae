"""Every script of benchmarks/ can be imported: names that it takes from the packages are there."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
def test_every_script_imports() -> None:
    names = sorted(path.stem for path in (ROOT / "benchmarks").glob("*.py"))
    peers = {"peers", "peer_irsim"}  # they import what is compared with, from elsewhere
    code = "import importlib, sys\nfor name in sys.argv[1:]: importlib.import_module(name)"
    paths = [ROOT / "benchmarks", ROOT, ROOT / "envs", ROOT / "planners"]
    done = subprocess.run(
        [sys.executable, "-c", code, *(name for name in names if name not in peers)],
        env={"PYTHONPATH": ":".join(map(str, paths)), "PATH": "", "HOME": str(ROOT)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
