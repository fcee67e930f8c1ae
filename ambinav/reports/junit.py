"""The result of a gate as JUnit XML: one test case for each condition, failed if it holds."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Final
from xml.etree import ElementTree

from ambinav.reports.conditions import Condition, Outcome, Unchecked
from ambinav.runtime.files import write_text

# XML 1.0 has no place for these, not even escaped; a file's name may hold them.
_NO_XML: Final = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def junit(outcomes: Sequence[Outcome], suite: str, unchecked: Unchecked = ()) -> str:
    """Return the document.

    Args:
        outcomes: Outcomes of the conditions, in their order.
        suite: Name of the suite, such as "ambinav audit maps/office.yaml".
        unchecked: What is an error there.
    """
    failures = sum(outcome.holds for outcome in outcomes)
    tests_in_all = str(len(outcomes) + len(unchecked))
    counts = {"tests": tests_in_all, "failures": str(failures), "errors": str(len(unchecked))}
    root = ElementTree.Element("testsuites", counts)
    tests = ElementTree.SubElement(root, "testsuite", {"name": _plain(suite)} | counts)

    def case_of(condition: Condition) -> ElementTree.Element:
        names = {"classname": _plain(suite), "name": f"not: {condition}"}
        return ElementTree.SubElement(tests, "testcase", names)

    for condition, why in unchecked:
        error = {"type": "unchecked", "message": _plain(why)}
        ElementTree.SubElement(case_of(condition), "error", error)
    for outcome in outcomes:
        case = case_of(outcome.condition)
        if outcome.holds:
            failure = {"type": "condition", "message": _plain(outcome.text)}
            ElementTree.SubElement(case, "failure", failure)
        else:
            ElementTree.SubElement(case, "system-out").text = _plain(outcome.text)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=False) + "\n"


def write_junit(
    outcomes: Sequence[Outcome], suite: str, path: Path, unchecked: Unchecked = ()
) -> None:
    """Write the document atomically; raises as `ambinav.runtime.files.replacing` does."""
    write_text(path, '<?xml version="1.0" encoding="UTF-8"?>\n' + junit(outcomes, suite, unchecked))


def _plain(text: str) -> str:
    return _NO_XML.sub("\ufffd", text)
