"""Bad scenarios through the command: exit status 2, one sentence, and nothing half-written."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from ambinav.cli import app
from tests.studies.compare.conftest import write

Plain = dict[str, Any]

BAD: dict[str, tuple[Callable[[Plain], object], str]] = {
    "unknown key": (lambda p: p.update(rout=[]), "the key 'rout' is unknown; did you mean rout"),
    "in map": (lambda p: p["map"].update(spacin=1), "map: the key 'spacin' is unknown; did you"),
    "in robot": (lambda p: p["robot"].update(radus=1), "robot: the key 'radus' is unknown"),
    "in follower": (lambda p: p.update(follower={"lookahead": 1}), "did you mean lookahead_"),
    "in odometry": (lambda p: p.update(odometry={"alpa1": 1}), "did you mean alpha1"),
    "in people": (lambda p: p.update(people={"cont": 1}), "did you mean count"),
    "in planning": (lambda p: p.update(planning={"planer": 1}), "did you mean planner"),
    "in a pair": (lambda p: p["pairs"][0].update(goals=[1, 1]), "did you mean goal"),
    "in a route": (lambda p: p["routes"][1].update(wait=1), "did you mean weight"),
    "in drive": (lambda p: p["drive"].update(run=1), "did you mean runs"),
    "in exports": (lambda p: p.update(exports={"rums": 1}), "did you mean runs"),
    "in the localizer": (lambda p: p["localizer"].update(alfa1=1), "did you mean alpha1"),
    "in the scanner": (lambda p: p["scanner"].update(part=1), "the key 'part' is unknown"),
    "no environment": (lambda p: p.update(environment="no.yaml"), "does not exist"),
    "no scanner": (lambda p: p.update(scanner="hokuyo-urg"), "scanner preset 'hokuyo-urg'"),
    "zero runs": (lambda p: p["drive"].update(runs=0), "drive.runs is 0; it should be greater"),
    "negative seed": (lambda p: p["drive"].update(seed=-1), "drive.seed is -1; it should be"),
    "parameter out of range": (
        lambda p: p["localizer"].update(z_hit=1.5),
        "localizer: z_hit is 1.5; give 0 to 1",
    ),
    "reflectors without intensities": (
        lambda p: p.update(localizer="reflectors"),
        "localizer: scanner 'laser' recognises no reflectors: it measures no intensities",
    ),
    "no reflectors": (
        lambda p: (
            p.update(localizer="reflectors"),
            p["scanner"]["parts"][0].update(intensity={"wall": 0.3, "reflector": 1, "std": 0.1}),
        ),
        "localizer: flat: it has no reflectors, and the localizer 'reflectors' knows nothing else",
    ),
    "start in a wall": (
        lambda p: p["pairs"][0].update(start=[3.5, 1.5]),
        "pair 'there', route 'shortest': start (3.5, 1.5) is behind a wall, 0.30 m",
    ),
    "goal outside": (
        lambda p: p["pairs"][0].update(goal=[70, 2]),
        "goal (70, 2) is outside of the map, which reaches from (0.00, 0.00) to (8.00, 3.00)",
    ),
    "a radius below the spacing": (
        lambda p: p["map"].update(spacing=50),
        "map: radius is 0.5 m and spacing 50 m; give a radius",
    ),
    "an unknown layer": (lambda p: p["map"].update(layer="nope"), "map: layer 'nope' is unknown"),
    "an unknown planner for all": (
        lambda p: p.update(planning={"planner": "rrtstr"}),
        "planning: there is no planner 'rrtstr'; did you mean rrtstar",
    ),
    "unknown planner": (
        lambda p: p["routes"].append({"kind": "planner", "planner": "rrtstr"}),
        "did you mean rrtstar",
    ),
    "planner of another space": (
        lambda p: p.update(
            planning={"space": "se2"}, pairs=[{"start": [1, 1, 0], "goal": [7, 2, 0]}]
        ),
        "planner 'reference' does not plan in se2; it knows r2",
    ),
    "unknown layer": (
        lambda p: p["map"].update(layer="fischer"),
        "map: layer 'fischer' is unknown; did you mean fisher",
    ),
    "one number": (
        lambda p: p["pairs"][0].update(start=[3]),
        "pairs[0].start: give x and y in metres, and a heading in degrees if it matters",
    ),
    "pairs that are none": (lambda p: p.update(pairs="A"), "pairs is 'A'; it should be a list."),
    "no pair": (lambda p: p.update(pairs=[]), "pairs is []; it should have at least 1 item."),
    "nowhere to go": (
        lambda p: p["pairs"][0].update(goal=p["pairs"][0]["start"]),
        "pairs[0]: start and goal are the same point; give two",
    ),
    "no route file": (
        lambda p: p["routes"].append({"kind": "file", "file": "no.csv"}),
        "no.csv: the file cannot be read",
    ),
}


@pytest.mark.parametrize(("spoil", "message"), BAD.values(), ids=BAD.keys())
def test_refused_before_anything_is_written(
    scenario: Plain, tmp_path: Path, spoil: Callable[[Plain], object], message: str
) -> None:
    spoil(scenario)
    out = tmp_path / "out"
    check(write(tmp_path, scenario), out, message)
    assert not out.exists()


def check(path: Path, out: Path, message: str) -> None:
    found = CliRunner().invoke(app, ["compare", str(path), "-o", str(out), "-j", "1", "--no-store"])
    assert found.exit_code == 2, found.output
    assert message in found.stderr
    assert found.stderr.startswith("ambinav: error: ") and found.stderr.count("\n") == 1


@pytest.mark.slow
def test_no_way(scenario: Plain, tmp_path: Path) -> None:
    """That there is none is found out on the map, which is kept: it is whole."""
    scenario["planning"] = {"margin": 0.35}
    scenario["pairs"][0] = {"name": "there", "start": [1, 1.5], "goal": [7, 1.5]}
    path = write(tmp_path, scenario)
    building = tmp_path / "flat.geojson"
    building.write_text(building.read_text().replace("1.2]", "0.8]").replace("2.0]", "2.2]"))
    text = building.read_text()
    building.write_text(text.replace("[3, 2]", "[3, 2.2]").replace("[4, 2]", "[4, 2.2]"))
    out = tmp_path / "out"
    check(path, out, "pair 'there', route 'shortest': ")
    assert [item.name for item in out.iterdir()] == ["work"]
    assert not list((out / "work").glob("*.npz"))
    assert not [item for item in (out / "work").iterdir() if item.name.startswith(".")]
