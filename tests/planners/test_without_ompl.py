"""What works where OMPL is not installed, and what the rest says: OMPL is hidden, in a process."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from tests.compare.conftest import SCENARIO, write

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
        [sys.executable, "-c", HIDDEN + code, *words], capture_output=True, text=True, cwd=folder
    )


@pytest.fixture(scope="module")
def folder(plan_map: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where all commands are run."""
    folder = tmp_path_factory.mktemp("without")
    shutil.copytree(plan_map, folder / "map.zarr")
    write(folder, {**SCENARIO, "routes": ["shortest", *OWN]})
    return folder


@pytest.fixture(scope="module")
def finished(folder: Path) -> dict[str, Done]:
    """What each command says, all in one process, for a start takes longer than most of them."""
    done = without_ompl(RUN, folder, json.dumps(COMMANDS))
    assert done.returncode == 0, done.stderr
    pairs: list[Any] = [json.loads(line) for line in done.stdout.splitlines()]
    return {name: Done(*ended) for name, ended in pairs}


@pytest.mark.parametrize("name", OWN)
def test_a_planner_of_our_own_plans(finished: dict[str, Done], folder: Path, name: str) -> None:
    assert finished[name].returncode == 0, finished[name].stderr
    assert (folder / f"{name}.csv").is_file()


@pytest.mark.parametrize("more", OF_OMPL)
def test_a_planner_of_ompl_says_what_to_install(
    finished: dict[str, Done], more: tuple[str, str]
) -> None:
    done = finished[more[1]]
    assert done.returncode == 2
    (error,) = done.stderr.splitlines()
    name = more[1] if more[0] == "-p" else "prmstar"
    assert error == (
        f"ambinav: error: planner '{name}' needs OMPL; run: pip install \"ambinav[planners]\", or "
        "give reference or belief."
    )


def test_planners_are_listed_with_a_note(finished: dict[str, Done]) -> None:
    done = finished["list"]
    assert [line.split()[0] for line in done.stdout.splitlines()] == ["belief", "reference"]
    assert "further planners need OMPL" in done.stderr


def test_routes_are_compared(finished: dict[str, Done], folder: Path) -> None:
    assert finished["compare"].returncode == 0, finished["compare"].stderr
    assert len(list((folder / "out").rglob("*.csv"))) >= 3


def test_public_names_say_what_to_install(tmp_path: Path) -> None:
    done = without_ompl("from ambinav_planners import AmbiguityObjective", tmp_path)
    assert done.stderr.splitlines()[-1] == (
        'ImportError: AmbiguityObjective needs OMPL; run: pip install "ambinav[planners]".'
    )


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
