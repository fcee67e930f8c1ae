"""What works where OMPL is not installed, and what the rest says: OMPL is hidden, in a process."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from tests.studies.compare.conftest import SCENARIO, write

PATHS = os.pathsep.join(str(Path(__file__).parents[2] / name) for name in ("", "planners"))
HIDDEN = "import sys; sys.modules['ompl'] = None; "
ENDS = ("--start", "1", "1", "--goal", "10", "2")
OWN = ("reference", "belief")
OF_OMPL = (("-p", "rrtstar"), ("-p", "belief-roadmap"), ("--space", "se2"))
COMMANDS = {
    **{name: ("plan", "map.zarr", *ENDS, "-p", name, "-o", f"{name}.csv") for name in OWN},
    **{more[1]: ("plan", "map.zarr", *ENDS, *more, "-o", "r.csv") for more in OF_OMPL},
    "list": ("plan", "--list-planners"),
    "compare": ("compare", "flat.yaml", "-o", "out", "--jobs", "1"),
}
RUN = """
import json
from typer.testing import CliRunner
from ambinav.cli import app
from tests.inline import inline_drives
with inline_drives():
    for name, words in json.loads(sys.argv[1]).items():
        done = CliRunner().invoke(app, words)
        print(json.dumps([name, [done.exit_code, done.stdout, done.stderr]]))
"""


class Done(NamedTuple):
    returncode: int
    stdout: str
    stderr: str


def without_ompl(code: str, folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", HIDDEN + code, *words], capture_output=True, text=True, cwd=folder,
        env={**os.environ, "PYTHONPATH": PATHS},
    )  # fmt: skip


@pytest.fixture
def folder(plan_map: Path, tmp_path: Path) -> Path:
    """Where all commands are run."""
    shutil.copytree(plan_map, tmp_path / "map.zarr")
    write(tmp_path, {**SCENARIO, "routes": ["shortest", *OWN]})
    return tmp_path


@pytest.mark.slow
def test_what_needs_no_ompl_works_and_the_rest_names_it(folder: Path) -> None:
    """All commands in one process, for a start takes longer than most of them."""
    run = without_ompl(RUN, folder, json.dumps(COMMANDS))
    assert run.returncode == 0, run.stderr
    pairs: list[Any] = [json.loads(line) for line in run.stdout.splitlines()]
    done = {name: Done(*ended) for name, ended in pairs}
    for name in OWN:
        assert done[name].returncode == 0, done[name].stderr
        assert (folder / f"{name}.csv").is_file()
    for option, value in OF_OMPL:
        assert done[value].returncode == 2
        (error,) = done[value].stderr.splitlines()
        name = value if option == "-p" else "prmstar"
        assert error == (
            f"ambinav: error: planner '{name}' needs OMPL; run: pip install \"ambinav[planners]\", "
            "or give reference or belief."
        )
    assert [line.split()[0] for line in done["list"].stdout.splitlines()] == ["belief", "reference"]
    assert "further planners need OMPL" in done["list"].stderr
    assert done["compare"].returncode == 0, done["compare"].stderr
    assert len(list((folder / "out").rglob("*.csv"))) >= 3


def test_public_names_say_what_to_install(tmp_path: Path) -> None:
    done = without_ompl("from ambinav_planners import AmbiguityObjective", tmp_path)
    assert done.stderr.splitlines()[-1] == (
        'ImportError: AmbiguityObjective needs ompl; run: pip install "ambinav[planners]".'
    )


@pytest.mark.slow
def test_ompl_is_not_imported_unless_a_planner_of_it_is_used(plan_folder: Path) -> None:
    arguments = ("plan", "map.zarr", *ENDS, "-p", "reference", "-o", "r.csv")
    code = (
        f"import sys; sys.argv = ['ambinav', *{arguments!r}]; from ambinav.cli import app; "
        "app(standalone_mode=False); assert 'ompl' not in sys.modules"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=plan_folder
    )
    assert done.returncode == 0, done.stderr
