"""The distribution itself: quick import, lazy names, versions that agree, pinned dependencies."""

from __future__ import annotations

import importlib.metadata
import itertools
import json
import os
import re
import runpy
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path
from typing import Any

import pytest
import yaml
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


@pytest.mark.slow
def test_import_costs_no_more_than_importing_numpy():
    assert seconds("import ambinav") < 1.5 * seconds("import numpy")


# ambinav_envs makes its ids known to Gymnasium.
@pytest.mark.slow
@pytest.mark.parametrize(
    ("statement", "allowed"),
    [("import ambinav, ambinav_planners", ()), ("import ambinav_envs", ("gymnasium",))],
)
def test_import_pulls_in_nothing_heavy(statement, allowed):
    loaded = python(f"{statement}; import sys; print(*sys.modules)").split()
    assert not (set(HEAVY) - set(allowed)) & set(loaded)


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


@pytest.mark.slow
def test_constraints_pin_what_the_dependencies_need():
    pinned = pins()
    waiting, seen, missing = [needed.name for needed in declared()], set(), set()
    while waiting:
        name = canonicalize_name(waiting.pop())
        if name in seen:
            continue
        seen.add(name)
        if name not in pinned:
            # A torch that the index has for accelerators brings these; its CPU build does not.
            if not name.startswith(("cuda-", "nvidia-", "triton")):
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


REPOSITORY = "https://github.com/ambinav/ambinav"
LINK = re.compile(r"\]\(([^)\s]+)\)")


def hatchling(*arguments: str) -> str:
    done = subprocess.run(
        [sys.executable, "-m", "hatchling", *arguments],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout


@pytest.fixture(scope="module")
def metadata() -> dict[str, Any]:
    """What the index is told."""
    found: dict[str, Any] = json.loads(hatchling("metadata"))
    return found


@pytest.fixture(scope="module")
def recipe() -> dict[str, Any]:
    found: dict[str, Any] = yaml.safe_load((ROOT / "recipe" / "recipe.yaml").read_text())
    return found


def test_links_of_the_long_description_hold_in_the_index(metadata):
    links = LINK.findall(metadata["readme"]["text"])
    assert len(links) == len(LINK.findall((ROOT / "README.md").read_text()))
    for link in links:
        found = re.fullmatch(rf"{REPOSITORY}/(blob|raw)/v{ambinav.__version__}/([^#]+)(#.*)?", link)
        assert found, link
        assert (ROOT / found[2]).is_file()
        assert (found[1] == "raw") == (Path(found[2]).suffix == ".png")


def test_the_long_description_has_no_other_kind_of_link(metadata):
    assert not re.search(r"<(a|img)\b|^\[[^]]+\]:", metadata["readme"]["text"], re.MULTILINE)


def test_the_repository_has_one_address(metadata):
    assert metadata["urls"]["Homepage"] == REPOSITORY
    assert all(address.startswith(REPOSITORY) for address in metadata["urls"].values())
    assert f'repository-code: "{REPOSITORY}"\n' in (ROOT / "CITATION.cff").read_text()


def test_every_licence_of_what_is_shipped_is_named(metadata):
    assert metadata["license"] == "Apache-2.0 AND BSD-2-Clause"
    notice = (ROOT / "NOTICE").read_text()
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert all((ROOT / name).is_file() for name in project["license-files"])
    for extra in re.findall(r'extra "(\w+)"', notice):
        assert extra in project["optional-dependencies"]


def test_only_what_films_brings_a_program_under_the_gpl(metadata):
    extras = {k: v for k, v in metadata["optional-dependencies"].items() if k != "video"}
    assert "moviepy" not in json.dumps([extras, metadata["dependencies"]])


def test_the_recipe_asks_for_what_the_distribution_does(metadata, recipe):
    assert recipe["context"]["version"] == ambinav.__version__
    assert recipe["about"]["license"] == metadata["license"]
    assert recipe["about"]["summary"] == metadata["description"]
    needed = recipe["requirements"]
    built = tomllib.loads((ROOT / "pyproject.toml").read_text())["build-system"]["requires"]
    assert bounds(needed["host"]) == bounds(["python>=3.11", "pip", *built])
    python_bound = "python" + metadata["requires-python"]
    assert bounds(needed["run"]) == bounds(["__unix", python_bound, *metadata["dependencies"]])


def bounds(lines: list[str]) -> dict[str, set[str]]:
    """Of each package its bounds; conda has a matplotlib without windows."""
    found = {}
    for line in lines:
        name, rest = re.fullmatch(r"([\w-]+)\s*(.*)", line).groups()
        name = "matplotlib" if name == "matplotlib-base" else name
        found[name] = set(rest.split(",")) - {""}
    return found


def test_a_release_is_tried_on_every_python_that_is_promised(metadata):
    flow = yaml.safe_load((ROOT / ".github" / "workflows" / "release.yml").read_text())
    name = "Programming Language :: Python :: 3."
    promised = [c.split(" :: ")[-1] for c in metadata["classifiers"] if c.startswith(name)]
    assert flow["jobs"]["test"]["strategy"]["matrix"]["python"] == promised
    assert flow["jobs"]["publish"]["needs"] == "test"


def test_requirements_have_the_hashes_of_a_report_and_nothing_local():
    def item(name: str, digest: str, direct: bool = False) -> dict:
        about = {"name": name, "version": "1.2"}
        info = {"archive_info": {"hashes": {"sha256": digest}}}
        return {"metadata": about, "download_info": info, "is_direct": direct}

    made = {"python_version": "3.11", "sys_platform": "linux", "platform_machine": "x86_64"}
    report = {"environment": made, "install": [item("b", "0b"), item("A", "0a"),
              item("ambinav", "00", direct=True)]}  # fmt: skip
    lines = runpy.run_path(str(ROOT / "recipe" / "hashed_requirements.py"))["requirements"](report)
    assert lines.splitlines()[1:] == ["A==1.2 --hash=sha256:0a", "b==1.2 --hash=sha256:0b"]
    assert "Python 3.11 on linux x86_64" in lines


@pytest.mark.slow
def test_the_source_distribution_is_small_and_makes_the_wheel(tmp_path):
    hatchling("build", "-t", "sdist", "-d", str(tmp_path))
    (packed,) = tmp_path.glob("*.tar.gz")
    assert packed.stat().st_size < 4e6
    shutil.unpack_archive(packed, tmp_path, filter="data")
    source = tmp_path / packed.name.removesuffix(".tar.gz")
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", "wheel"], cwd=source, check=True
    )
    (wheel,) = (source / "dist").glob("*.whl")
    packages = {Path(name).parts[0] for name in zipfile.ZipFile(wheel).namelist()}
    assert packages == {*PACKAGES, f"ambinav-{ambinav.__version__}.dist-info"}
