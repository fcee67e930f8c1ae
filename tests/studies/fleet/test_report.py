"""The catalogue is valid, the page stands alone, conditions and differences name the sites."""

from __future__ import annotations

import json
import posixpath
import re
from pathlib import Path

import pytest
from jsonschema import Draft7Validator
from referencing import Registry, Resource
from typer.testing import CliRunner, Result

from ambinav.cli import app
from tests.studies.fleet.conftest import SCANNERS, audited, write_room

SCHEMAS = Path(__file__).parents[2] / "reports" / "schemas" / "stac-1.1.0"
FEATURE = {
    "type": "object",
    "required": ["type", "properties", "geometry"],
    "properties": {"type": {"const": "Feature"}, "geometry": {"type": ["null", "object"]}},
}
"""What RFC 7946 says of a feature, as far as it concerns these."""


def validator(kind: str) -> Draft7Validator:
    """What the specification's own schemas say of an item or a catalogue."""
    base = "https://schemas.stacspec.org/v1.1.0"
    geometry = {"type": "object", "required": ["type"]}
    resources = {
        "https://geojson.org/schema/Feature.json": FEATURE,
        "https://geojson.org/schema/Geometry.json": geometry,
    }
    for path in SCHEMAS.glob("*.json"):
        schema = json.loads(path.read_text())
        room = "catalog-spec" if path.stem == "catalog" else "item-spec"
        schema["$id"] = f"{base}/{room}/json-schema/{path.name}"
        resources[schema["$id"]] = schema
    registry: Registry[object] = Registry().with_resources(
        (
            uri,
            Resource.from_contents(schema | {"$schema": "http://json-schema.org/draft-07/schema#"}),
        )
        for uri, schema in resources.items()
    )
    (uri,) = (uri for uri in resources if uri.endswith(f"/{kind}.json"))
    return Draft7Validator(resources[uri], registry=registry)


def test_the_catalogue_is_valid_and_its_links_hold(sites: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    audited(sites, out)
    catalogue = json.loads((out / "catalog.json").read_text())
    assert not [*validator("catalog").iter_errors(catalogue)]
    hrefs = [link["href"] for link in catalogue["links"] if link["rel"] == "item"]
    assert hrefs == ["./items/broken.json", "./items/north/corridor.json", "./items/room.json"]
    check = validator("item")
    for href in hrefs:
        item = json.loads((out / href).read_text())
        assert not [*check.iter_errors(item)]
        targets = [link["href"] for link in item["links"]]
        targets += [asset["href"] for asset in item["assets"].values()]
        for target in targets:
            assert (
                out / posixpath.normpath(posixpath.join(posixpath.dirname(href), target))
            ).is_file()
        assert len(item["assets"]) == (2 if "broken" in href else 4)
        broken = item | {"properties": {}}
        assert [*check.iter_errors(broken)], "the schemas see nothing"


def test_the_page_opens_alone_and_ranks_by_bad_floor(sites: Path, tmp_path: Path) -> None:
    audited(sites, tmp_path / "out")
    page = (tmp_path / "out" / "index.html").read_text()
    assert not re.findall(r"""(?:src|href)=["'](?!data:)""", page) and "http" not in page
    order = re.findall(r'<tr data-site="([^"]+)" data-scanner="([^"]+)"', page)
    assert order[0] == ("north/corridor", "turtlebot3-lds")
    assert {site for site, _ in order[-2:]} == {"broken"}
    assert page.count("data:image/png") == 4


def run(*words: object) -> Result:
    return CliRunner().invoke(app, ["fleet", *map(str, words)])


def audit(sites: Path, out: Path, *words: str) -> Result:
    scanners = [word for name in SCANNERS for word in ("-s", name)]
    options = ["--spacing", "0.5", "--no-advice", "--workers", "0"]
    return run("audit", sites, *scanners, *options, "-o", out, *words)


@pytest.mark.slow
def test_conditions_name_the_sites_and_failures_are_not_passed(sites: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    plain = audit(sites, out)
    assert plain.exit_code == 0 and "2 of 6 audits failed, broken (rplidar-a1)" in plain.stderr
    holds = audit(sites, out, "--fail-if", "bad > 50 %", "--junit", str(tmp_path / "j.xml"))
    assert holds.exit_code == 3
    assert re.search(r"At 1 of 6: north/corridor \(turtlebot3-lds\) \d", holds.stdout)
    assert 'failures="1"' in (tmp_path / "j.xml").read_text()
    unknown = audit(sites, out, "--fail-if", "bad > 99.9 %", "--junit", str(tmp_path / "j.xml"))
    assert 'tests="1" failures="0" errors="1"' in (tmp_path / "j.xml").read_text()
    assert unknown.exit_code == 2 and "cannot be checked at 2 of 6, broken" in unknown.stderr
    assert "passed" not in unknown.output
    both = audit(sites, out, "--fail-if", "bad > 50 %", "--fail-if", "bad > 99.9 %")
    assert both.exit_code == 3 and "cannot be checked at 2 of 6, broken" in both.stderr
    (sites / "broken.wkt").unlink()
    assert audit(sites, out, "--fail-if", "bad > 99.9 %").exit_code == 0
    least = audit(sites, out, "--fail-if", "counted area < 10 m2")
    assert least.exit_code == 3 and "At 2 of 4: room" in least.stdout
    refused = audit(sites, out, "--fail-if", "aliased pairs > 0")
    assert refused.exit_code == 2 and "is not searched for in a fleet" in refused.stderr
    for name in ("room.geojson", "north/corridor.geojson"):
        (sites / name).write_text("{")
    nothing = audit(sites, out, "--fail-if", "bad > 5 %", "--junit", str(tmp_path / "j.xml"))
    assert "none of 4 audits succeeded" in (tmp_path / "j.xml").read_text()
    assert nothing.exit_code == 2 and "none of 4 audits succeeded" in nothing.stderr


def test_parts_write_results_and_the_last_command_the_report(sites: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    for part, failed in (("1/2", 1), ("2/2", 1)):
        outcome = audit(sites, out, "--batch", part)
        assert outcome.exit_code == 0 and f"Part {part}: 3 audits made." in outcome.stdout
        assert f"{failed} of 3 audits failed, broken" in outcome.stderr
    again = audit(sites, out, "--batch", "2/2")
    assert "Part 2/2: 1 audit made, 2 were there." in again.stdout
    assert not (out / "index.html").exists()
    assert "2 audits made, 4 were there" in audit(sites, out).stdout
    assert (out / "index.html").exists()
    for more in (("--fail-if", "bad > 5 %"), ("--json",)):
        refused = audit(sites, out, "--batch", "1/2", *more)
        assert refused.exit_code == 2 and f"{more[0]}: it is about the whole" in refused.stderr
    assert audit(sites, out, "--batch", "3").exit_code == 2


@pytest.mark.slow
def test_a_difference_lists_what_became_of_each_site(sites: Path, tmp_path: Path) -> None:
    first, second = tmp_path / "a", tmp_path / "b"
    audited(sites, first)
    (sites / "broken.wkt").write_text("POLYGON((0 0,3 0,3 3,0 3,0 0))")
    (sites / "room.geojson").rename(sites / "new.geojson")
    (sites / "cut.wkt").write_text("POLYGON((0 0,3 0")
    write_room(sites / "north" / "corridor.geojson", 40.0, 2.0)
    audited(sites, second)
    same = run("diff", first, first, "--fail-if", "worse > 0")
    assert same.exit_code == 0 and "No changes; 6 the same" in same.stdout
    result = run("diff", first, second, "--json")
    report = json.loads(result.stdout)
    kinds = {(each["site"], each["change"]) for each in report["changes"]}
    assert kinds >= {("room", "vanished"), ("new", "appeared"), ("broken", "audited")}
    assert ("cut", "failed") in kinds
    change = next(each for each in report["changes"] if each["scanner"] == "turtlebot3-lds")
    assert change["site"] == "north/corridor" and change["change"] == "worse"
    rise = change["after_m2"] - change["before_m2"]
    assert rise == pytest.approx(change["change_m2"]) and rise > 10.0
    gate = run("diff", first, second, "--fail-if", "bad change > 1 m2")
    assert gate.exit_code == 3 and "(rplidar-a1), north/corridor (turtlebot3-lds)" in gate.stdout
    for words in (("--fail-if", "bad change < 0 m2"), ("--fail-if", "total bad change < 0 m2")):
        assert run("diff", second, second, *words).exit_code == 0
    (second / "fleet.json").write_text(
        json.dumps(json.loads((second / "fleet.json").read_text()) | {"figures": []})
    )
    for figure in ("bad change", "total bad change"):
        lacking = run("diff", first, second, "--fail-if", f"{figure} > 1 m2")
        assert lacking.exit_code == 2 and "no site has figures in both" in lacking.stderr
    none = run("diff", tmp_path, second)
    assert none.exit_code == 2 and "there is no fleet.json" in none.stderr
