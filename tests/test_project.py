"""The distribution itself: quick import, lazy names, versions that agree, pinned dependencies."""

from __future__ import annotations

import importlib.metadata
import itertools
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import ambinav

ROOT = Path(__file__).parents[1]
PACKAGES = {
    "ambinav": ROOT / "ambinav",
    "ambinav_envs": ROOT / "envs" / "ambinav_envs",
    "ambinav_planners": ROOT / "planners" / "ambinav_planners",
}
HEAVY = ("torch", "ompl", "gymnasium", "stable_baselines3", "numba", "matplotlib")


def python(code: str) -> str:
    """What a fresh interpreter prints that sees the three packages."""
    path = os.pathsep.join(str(folder.parent) for folder in PACKAGES.values())
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": path},
        cwd=ROOT.anchor,
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout


def seconds(code: str) -> float:
    """Processor time of the quickest of five fresh interpreters."""
    times = []
    for _ in range(5):
        before = os.times()
        python(code)
        after = os.times()
        times.append(sum(after[2:4]) - sum(before[2:4]))
    return min(times)


def pins() -> dict[str, str]:
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    pairs = (line.split("==") for line in lines if line and not line.startswith("#"))
    return {canonicalize_name(name): version for name, version in pairs}


def test_import_costs_no_more_than_importing_numpy():
    assert seconds("import ambinav") < 1.5 * seconds("import numpy")


# ambinav_envs makes its ids known to Gymnasium.
@pytest.mark.parametrize(
    ("statement", "allowed"),
    [("import ambinav, ambinav_planners", ()), ("import ambinav_envs", ("gymnasium",))],
)
def test_import_pulls_in_nothing_heavy(statement, allowed):
    loaded = python(f"{statement}; import sys; print(*sys.modules)").split()
    assert not (set(HEAVY) - set(allowed)) & set(loaded)


def test_optional_packages_stay_out_when_the_public_names_are_used():
    code = (
        "import ambinav, sys; [getattr(ambinav, n) for n in ambinav.__all__]; print(*sys.modules)"
    )
    loaded = python(code).split()
    assert not {"torch", "ompl", "gymnasium", "stable_baselines3", "fastapi"} & set(loaded)


def test_public_names():
    for name in ambinav.__all__:
        assert name in dir(ambinav)
        assert getattr(ambinav, name) is not None
    # Each name comes from where it is defined, not from a module that happens to import it.
    for name, module in ambinav._HOME.items():
        assert getattr(ambinav, name).__module__ == module


@pytest.mark.parametrize("package", ["ambinav", "ambinav_planners", "ambinav_envs"])
def test_dir_shows_what_is_public_and_no_more(package):
    if package == "ambinav_envs":
        pytest.importorskip("gymnasium")
    module = importlib.import_module(package)
    assert dir(module) == sorted(module.__all__)


def test_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'build_mop'"):
        _ = ambinav.build_mop


def test_versions_agree():
    cff = re.search(r"^version: (\S+)$", (ROOT / "CITATION.cff").read_text(), re.MULTILINE)
    log = re.search(r"^## \[(\d\S*)\]", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert cff is not None and cff[1] == ambinav.__version__
    assert log is not None and log[1] == ambinav.__version__


@pytest.mark.parametrize("name", PACKAGES)
def test_packages_are_typed(name):
    assert (PACKAGES[name] / "py.typed").is_file()
    assert python(f"import {name}; print({name}.__file__)").strip() == str(
        PACKAGES[name] / "__init__.py"
    )


def declared() -> list[Requirement]:
    """What the distribution and its development ask for."""
    data = tomllib.loads((ROOT / "pyproject.toml").read_text())
    extras = itertools.chain(*data["project"]["optional-dependencies"].values())
    groups = itertools.chain(*data["dependency-groups"].values())
    lines = [
        *data["build-system"]["requires"],
        *data["project"]["dependencies"],
        *extras,
        *(line for line in groups if isinstance(line, str)),
    ]
    return [needed for needed in map(Requirement, lines) if needed.name != "ambinav"]


def test_constraints_pin_every_dependency_within_its_bounds():
    pinned = pins()
    for needed in declared():
        assert needed.specifier.contains(pinned[canonicalize_name(needed.name)]), needed


def test_constraints_pin_what_the_dependencies_need():
    pinned = pins()
    waiting, seen, missing = [needed.name for needed in declared()], set(), set()
    while waiting:
        name = canonicalize_name(waiting.pop())
        if name in seen:
            continue
        seen.add(name)
        if name not in pinned:
            missing.add(name)
        else:
            needs = map(Requirement, importlib.metadata.requires(name) or ())
            waiting += [n.name for n in needs if not n.marker or n.marker.evaluate({"extra": ""})]
    assert not missing


def test_constraints_name_no_index():
    assert not re.search(r"://|--|\+", (ROOT / "constraints.txt").read_text())
    assert pins()["torch"] == "2.13.0"


def test_all_is_every_extra_but_the_one_that_brings_a_program_under_the_gpl():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"][
        "optional-dependencies"
    ]
    (everything,) = map(Requirement, extras["all"])
    assert everything.extras == set(extras) - {"all", "video"}
