"""The GitHub Action: its file is consistent, and its script audits what it is told to."""

from __future__ import annotations

import os
import re
import stat
import subprocess
from pathlib import Path
from urllib.parse import unquote

import pytest
import yaml

ROOT = Path(__file__).parents[1]
ACTION = yaml.safe_load((ROOT / "action.yml").read_text(encoding="utf-8"))
SCRIPT = ROOT / ".github" / "actions" / "audit-maps.sh"
STUB = """#!/usr/bin/env bash
printf '%s\\n' "$*" >> "$CALLS"
case "$2" in *worse*) exit 3;; *broken*) exit 2;; *) exit 0;; esac
"""
MAP = "image: office.pgm\nresolution: 0.05\norigin: [0, 0, 0]\n"


@pytest.fixture
def repository(tmp_path, monkeypatch):
    """A repository of maps as slam_toolbox and nav2 leave them, and a stub of the command."""
    for name in ("maps/office.yaml", "maps/hall 2/worse.yaml", "maps/hall 2/broken.yml"):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(MAP)
    (tmp_path / "maps" / "nav2_params.yaml").write_text("amcl:\n  ros__parameters: {}\n")
    (tmp_path / "maps" / "office.pgm").write_bytes(b"P5 1 1 255\n\0")
    stub = tmp_path / "bin" / "ambinav"
    stub.parent.mkdir()
    stub.write_text(STUB)
    stub.chmod(stub.stat().st_mode | stat.S_IXUSR)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(repository: Path, maps: str, conditions: str = "", options: str = ""):
    inputs = {
        "AMBINAV": str(repository / "bin" / "ambinav"), "MAPS": maps, "SCANNER": "robot.yaml",
        "CONDITIONS": conditions, "OUTPUT": "out", "OPTIONS": options, "CALLS": "calls",
    }  # fmt: skip
    done = subprocess.run(
        ["bash", str(SCRIPT)],
        env={**os.environ, **inputs, "GITHUB_STEP_SUMMARY": ""},
        capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    calls = repository / "calls"
    return done, calls.read_text().splitlines() if calls.exists() else []


def test_a_map_is_audited_with_its_conditions(repository):
    done, calls = run(
        repository,
        "maps/office.yaml",
        "open > 2 %\n\n  places > 3\n",
        "--spacing 0.2 --no-aliasing",
    )
    assert done.returncode == 0, done.stderr
    assert calls == [
        "audit maps/office.yaml --scanner robot.yaml -o out/maps__office.yaml --spacing 0.2 "
        "--no-aliasing --fail-if open > 2 % --fail-if   places > 3 "
        "--junit out/junit/maps__office.yaml.xml --sarif out/sarif/maps__office.yaml.sarif"
    ]


@pytest.mark.parametrize(
    "options", ["--spacing 0.2 --title 'My hall'", '\n--spacing 0.2\r\n\n--title "My hall"\n']
)
def test_options_may_be_on_several_lines_and_have_blanks(repository, options):
    done, calls = run(repository, "maps/office.yaml", options=options)
    assert done.returncode == 0, done.stderr
    assert calls[0].endswith("-o out/maps__office.yaml --spacing 0.2 --title My hall")
    done, calls = run(repository, "maps/office.yaml", options="--title 'My hall")
    assert done.returncode == 2 and "a quotation mark has no other" in done.stderr


def test_a_map_that_is_named_twice_is_audited_once(repository):
    (repository / 'maps/a,b%:"c.yaml').write_text(MAP)
    done, calls = run(
        repository, "maps\nmaps/office.yaml\n./maps/office.yaml\n./maps/hall 2/worse.yaml"
    )
    assert len(calls) == 4
    assert "out/maps__a,b%25%3A%22c.yaml" in " ".join(calls)
    assert "::error file=maps/hall 2/worse.yaml::" in done.stdout


def test_no_two_maps_share_a_folder(repository):
    paths = [
        "a/b.yaml", "a__b.yaml", "a_/b.yaml", "a/_b.yaml", "a___b.yaml", "a_b.yaml", "a/__b.yaml",
        "a_%5F/b.yaml", "a%5F%5Fb.yaml", "a/b_c.yaml", "a_b/c.yaml", "a____b.yaml", "a_/_b.yaml",
    ]  # fmt: skip
    for path in paths:
        (repository / path).parent.mkdir(exist_ok=True)
        (repository / path).write_text(MAP)
    done, calls = run(repository, "\n".join(paths), "open > 2 %")
    assert done.returncode == 0, done.stderr
    for pattern in (r" -o (\S+)", r"--junit (\S+)", r"--sarif (\S+)"):
        names = [re.search(pattern, call)[1] for call in calls]
        assert len(set(names)) == len(paths)
        # The name says the path.
        plain = [name.removeprefix("out/").replace("__", "/") for name in names]
        ends = ("junit/", "sarif/", ".xml", ".sarif")
        for end in ends:
            plain = [name.removeprefix(end).removesuffix(end) for name in plain]
        assert [unquote(name) for name in plain] == paths


def test_without_conditions_there_is_no_gate(repository):
    done, calls = run(repository, "maps/office.yaml\n")
    assert done.returncode == 0
    assert calls == ["audit maps/office.yaml --scanner robot.yaml -o out/maps__office.yaml"]


@pytest.mark.parametrize("maps", ["maps", "maps/", "  ./maps  \n"])
def test_of_a_folder_only_maps_are_audited_and_all_of_them(repository, maps):
    done, calls = run(repository, maps)
    names = {re.search(r"audit (.*) --scanner", call)[1] for call in calls}
    assert {Path(name) for name in names} == {
        Path("maps/office.yaml"), Path("maps/hall 2/worse.yaml"), Path("maps/hall 2/broken.yml")
    }  # fmt: skip
    assert done.returncode == 3
    assert "::error file=" in done.stdout and "ended with status 2" in done.stdout


def test_plans_in_a_folder_are_named_and_audited_by_their_name(repository):
    (repository / "maps" / "hall.geojson").write_text("{}")
    done, calls = run(repository, "maps/")
    assert len(calls) == 3
    assert done.stderr.count("note: ") == 1
    assert "maps/hall.geojson: plans in a folder" in done.stderr
    done, calls = run(repository, "maps/hall.geojson")
    assert calls[-1] == "audit maps/hall.geojson --scanner robot.yaml -o out/maps__hall.geojson"
    assert not done.stderr


@pytest.mark.parametrize(
    ("maps", "status", "number"),
    [
        ("maps/**/*.yaml", 3, 2),  # the parameters of a node are no map
        ("maps/office.*", 0, 2),  # other formats are taken by their name
        ("maps/hall 2/*.yaml", 3, 1),
        ("maps/hall 2/broken.yml\nmaps/office.yaml", 2, 2),
    ],
)
def test_patterns_and_status(repository, maps, status, number):
    done, calls = run(repository, maps)
    assert (done.returncode, len(calls)) == (status, number)


@pytest.mark.parametrize("maps", ["", " \n", "map/*.yaml", "maps/office.yaml\nmissing.yaml", "bin",
                                  "maps/nav2_params.yaml", "maps/nav2*"])  # fmt: skip
def test_no_map_is_no_passed_gate(repository, maps):
    done, calls = run(repository, maps)
    assert done.returncode == 2 and not calls
    assert done.stderr.count("\n") == 1 and "name a map file, a pattern or a folder" in done.stderr


def test_nothing_of_the_caller_is_run_as_code(repository):
    done, calls = run(repository, "$(touch hit)", "$(touch hit)`touch hit`", "$(touch hit)")
    assert done.returncode == 2 and not calls
    done, _ = run(repository, "maps/office.yaml", "open > $(touch hit) %", "`touch hit`")
    assert not (repository / "hit").exists()


def test_the_action_uses_what_it_declares():
    text = (ROOT / "action.yml").read_text(encoding="utf-8")
    assert ACTION["runs"]["using"] == "composite"
    used = set(re.findall(r"inputs\.([a-z-]+)", text))
    assert used == set(ACTION["inputs"])
    for entry in (*ACTION["inputs"].values(), *ACTION["outputs"].values()):
        assert entry["description"]
    for name, entry in ACTION["inputs"].items():
        assert entry.get("required") or "default" in entry, name
    for step in ACTION["runs"]["steps"]:
        assert ("run" in step) != ("uses" in step)
        if "run" in step:
            # What a caller writes reaches the shell as a variable, never as its text.
            assert step["shell"] == "bash" and "${{" not in step["run"]
        else:
            assert "@" in step["uses"]


@pytest.mark.parametrize(
    "path", [ROOT / "action.yml", *(ROOT / ".github" / "workflows").glob("*.yml")], ids=str
)
def test_actions_are_pinned_to_commits(path):
    """A tag can be moved; the comment says which one it was."""
    used = re.findall(r"uses: (.+)", path.read_text(encoding="utf-8"))
    assert used
    for line in used:
        assert re.fullmatch(r"[\w-]+/[\w/-]+@[0-9a-f]{40} # v[\d.]+", line), line


def test_the_script_is_given_all_that_it_reads():
    (step,) = (one for one in ACTION["runs"]["steps"] if SCRIPT.name in one.get("run", ""))
    read = set(re.findall(r"\$\{?([A-Z]{3,})\b", SCRIPT.read_text(encoding="utf-8")))
    assert read - {"GITHUB", "RUNNER"} <= set(step["env"])
