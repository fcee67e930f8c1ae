"""What works where OMPL is not installed, and what the rest says: OMPL is hidden, in a process."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.compare.conftest import SCENARIO, write

HIDDEN = "import sys; sys.modules['ompl'] = None; "
ENDS = ("--start", "1", "1", "--goal", "10", "2")


def without_ompl(code: str, folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", HIDDEN + code], capture_output=True, text=True, cwd=folder
    )


def command(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return without_ompl(
        f"sys.argv = ['ambinav', *{arguments!r}]; from ambinav.cli import main; main()", folder
    )


@pytest.mark.parametrize("name", ["reference", "belief"])
def test_a_planner_of_our_own_plans(plan_folder: Path, name: str) -> None:
    done = command(plan_folder, "plan", "map.zarr", *ENDS, "-p", name, "-o", "r.csv")
    assert done.returncode == 0, done.stderr
    assert (plan_folder / "r.csv").is_file()


@pytest.mark.parametrize("more", [["-p", "rrtstar"], ["-p", "belief-roadmap"], ["--space", "se2"]])
def test_a_planner_of_ompl_says_what_to_install(plan_folder: Path, more: list[str]) -> None:
    done = command(plan_folder, "plan", "map.zarr", *ENDS, *more, "-o", "r.csv")
    assert done.returncode == 2
    (error,) = done.stderr.splitlines()
    name = more[1] if more[0] == "-p" else "prmstar"
    assert error == (
        f"ambinav: error: planner '{name}' needs OMPL; run: pip install \"ambinav[planners]\", or "
        "give reference or belief."
    )


def test_planners_are_listed_with_a_note(tmp_path: Path) -> None:
    done = command(tmp_path, "plan", "--list-planners")
    assert [line.split()[0] for line in done.stdout.splitlines()] == ["belief", "reference"]
    assert "further planners need OMPL" in done.stderr


def test_public_names_say_what_to_install(tmp_path: Path) -> None:
    done = without_ompl("from ambinav_planners import AmbiguityObjective", tmp_path)
    assert done.stderr.splitlines()[-1] == (
        'ImportError: AmbiguityObjective needs OMPL; run: pip install "ambinav[planners]".'
    )


def test_routes_are_compared(tmp_path: Path) -> None:
    scenario = write(tmp_path, {**SCENARIO, "routes": ["shortest", "reference", "belief"]})
    done = command(tmp_path, "compare", str(scenario), "-o", "out", "--jobs", "1")
    assert done.returncode == 0, done.stderr
    assert len(list((tmp_path / "out").rglob("*.csv"))) >= 3


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
