"""JUnit XML and SARIF of a gate, held against their schemas, read by parsers of their own."""

from __future__ import annotations

import json
from pathlib import Path
from urllib.parse import unquote, urlparse
from xml.etree import ElementTree

import jsonschema
import pytest
import xmlschema

from ambinav.reports.conditions import Outcome, Quantity, catalogue, judge, parse_condition
from ambinav.reports.junit import write_junit
from ambinav.reports.sarif import write_sarif

SCHEMAS = Path(__file__).parent / "schemas"
KNOWN = catalogue(
    Quantity("open", "%", "share of the floor", lambda report: 5.0, lambda report: "At <x> & y."),
    Quantity("places", "", "number of places", lambda report: 3.0),
)


def outcomes(*texts: str) -> list[Outcome]:
    return [judge(parse_condition(text, KNOWN), None) for text in texts]


CASES = {
    "both": outcomes("open > 2 %", "open > 10 %", "places > 1"),
    "twice": outcomes("open > 2 %", "open > 3 %"),
    "passed": outcomes("places > 7"),
}


@pytest.mark.parametrize("case", CASES)
def test_junit_keeps_to_the_schema_of_jenkins(case, tmp_path):
    path = tmp_path / "junit.xml"
    write_junit(CASES[case], "ambinav audit maps/büro & <co>\x01.yaml", path)
    xmlschema.XMLSchema(SCHEMAS / "junit-10.xsd").validate(str(path))
    root = ElementTree.parse(path).getroot()
    cases = root.findall("./testsuite/testcase")
    assert [one.get("name") for one in cases] == [f"not: {one.condition}" for one in CASES[case]]
    failed = [one.find("failure") is not None for one in cases]
    assert failed == [one.holds for one in CASES[case]]
    assert root.get("tests") == str(len(failed)) and root.get("failures") == str(sum(failed))


@pytest.mark.parametrize("case", CASES)
def test_sarif_keeps_to_the_schema(case, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path, building = tmp_path / "gate.sarif", Path("maps") / "büro 1.yaml"
    write_sarif(CASES[case], "audit", building, path)
    log = json.loads(path.read_text(encoding="utf-8"))
    schema = json.loads((SCHEMAS / "sarif-2.1.0-rtm.5.json").read_text(encoding="utf-8"))
    jsonschema.Draft4Validator(schema).validate(log)
    (run,) = log["runs"]
    rules = [rule["id"] for rule in run["tool"]["driver"]["rules"]]
    assert len(set(rules)) == len(rules)
    held = [one for one in CASES[case] if one.holds]
    assert [one["message"]["text"] for one in run["results"]] == [one.text for one in held]
    prints = {one["partialFingerprints"]["condition/v1"] for one in run["results"]}
    assert len(prints) == len(held)
    for result in run["results"]:
        assert rules[result["ruleIndex"]] == result["ruleId"]
        place = result["locations"][0]["physicalLocation"]
        assert unquote(place["artifactLocation"]["uri"]) == "maps/büro 1.yaml"
        assert place["region"]["startLine"] == 1


def test_sarif_says_what_could_not_be_checked(tmp_path):
    (held, *_) = CASES["both"]
    write_sarif([], "audit", "site", tmp_path / "gate", [(held.condition, "needs a map")])
    log = json.loads((tmp_path / "gate").read_text())
    schema = json.loads((SCHEMAS / "sarif-2.1.0-rtm.5.json").read_text(encoding="utf-8"))
    jsonschema.Draft4Validator(schema).validate(log)
    (invocation,) = log["runs"][0]["invocations"]
    (said,) = invocation["toolExecutionNotifications"]
    assert not invocation["executionSuccessful"]
    assert said["message"]["text"] == f'"{held.condition}" needs a map'


def test_a_map_elsewhere_is_named_by_its_whole_address(tmp_path, monkeypatch):
    (tmp_path / "here").mkdir()
    (tmp_path / "map.zarr").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    write_sarif(CASES["both"], "diff", tmp_path / "map.zarr", Path("gate.sarif"))
    log = json.loads(Path("gate.sarif").read_text())
    place = log["runs"][0]["results"][0]["locations"][0]["physicalLocation"]
    assert Path(urlparse(place["artifactLocation"]["uri"]).path) == tmp_path / "map.zarr"
    assert "region" not in place


def test_a_map_is_named_without_detours(tmp_path, monkeypatch):
    """A relative address that climbs out of the folder would be nowhere in a repository."""
    work = tmp_path / "repository"
    work.mkdir()
    monkeypatch.chdir(work)
    for given, address in (
        ("maps/../office.yaml", "office.yaml"),
        ("../office.yaml", (tmp_path / "office.yaml").as_uri()),
    ):
        write_sarif(CASES["both"], "audit", Path(given), Path("gate.sarif"))
        run = json.loads(Path("gate.sarif").read_text())["runs"][0]
        for result in run["results"]:
            artifact = result["locations"][0]["physicalLocation"]["artifactLocation"]
            assert artifact["uri"] == address
            assert ("uriBaseId" in artifact) == (address == "office.yaml")
