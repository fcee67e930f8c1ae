"""Tables of prices and powers: what is read, and what is refused."""

from __future__ import annotations

import csv

import pytest
import yaml

from ambinav.runtime.errors import InputError
from ambinav.studies.design.scanners.costs import Cost, Costs, read_costs

ROWS = {"rplidar-a1": (99.0, 2.5), "my scanner, new": (1e3, None), "other": (None, 0.0)}


def test_both_formats_say_the_same(tmp_path):
    table, mapping = tmp_path / "costs.csv", tmp_path / "costs.yaml"
    with table.open("w", newline="", encoding="utf-8-sig") as file:  # as spreadsheets write it
        lines = csv.writer(file)
        lines.writerow(["Scanner", "power", " price "])
        for name, (price, power) in ROWS.items():
            lines.writerow([name, "" if power is None else power, "" if price is None else price])
        lines.writerow(["", "", ""])
    plain = {
        name: {key: value for key, value in zip(("price", "power"), row, strict=True)}
        for name, row in ROWS.items()
    }  # fmt: skip
    mapping.write_text(yaml.safe_dump(plain))
    expected = {name: Cost(price=row[0], power=row[1]) for name, row in ROWS.items()}
    assert read_costs(table).by_name == expected == read_costs(mapping).by_name
    assert read_costs(table).of("unknown") == Cost()


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.txt", "scanner,price", r"a.txt: '.txt' is not a format of costs; give .csv or .yaml"),
        ("a.csv", "", "line 1 has no column 'scanner'"),
        ("a.csv", "name,price\na,1", "line 1 has no column 'scanner'"),
        ("a.csv", "scanner,prize\na,1", "line 1: the key 'prize' is unknown; did you mean price"),
        ("a.csv", "scanner,price,price\na,1,2", "line 1 names a column twice"),
        ("a.csv", "scanner,price\na,cheap", "line 2: price is 'cheap'; give a finite number"),
        ("a.csv", "scanner,price\na,-1", "line 2: price is -1.0; give a number of at least 0"),
        ("a.csv", "scanner,price\na,nan", "line 2: price is 'nan'; give a finite number"),
        ("a.csv", "scanner,price\na,1,2", "line 2 has 3 cells; give 2: scanner, price"),
        ("a.csv", "scanner,price\na,1\n\na,2", "line 4: 'a' is listed twice"),
        ("a.csv", "scanner,price\n,1", "line 2: the scanner has no name"),
        ("a.csv", "scanner,price\n", "no scanner is listed"),
        ("a.csv", "scanner,price\na,", "no price and no power is given"),
        ("a.csv", 'scanner,price\n"a,1', "this is not a CSV table"),
        ("a.yaml", "[a, b]", "this is not a mapping from scanners to costs"),
        ("a.yaml", "a: 3", "a is 3; give a mapping with the keys price, power"),
        ("a.yaml", "a: {cost: 3}", "a: the key 'cost' is unknown"),
        ("a.yaml", "a: {price: true}", "a: price is True"),
        ("a.yaml", "a: {price: [", "not valid YAML"),
        ("a.yaml", "", "the file is empty"),
    ],
)
def test_a_bad_table_is_refused_in_one_sentence(tmp_path, name, text, message):
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(InputError, match=message) as refused:
        read_costs(path)
    assert str(path) in str(refused.value) and "\n" not in str(refused.value)


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"nowhere\.csv: the file cannot be read"):
        read_costs(tmp_path / "nowhere.csv")


def test_what_is_not_on_both_sides_is_said():
    costs = Costs({"a": Cost(price=1.0), "b": Cost(power=2.0)}, "costs.csv")
    assert costs.remarks(["a", "b"]) == ()
    assert costs.remarks(["b", "c"]) == (
        "costs.csv: no price or power is given for: c.",
        "costs.csv: listed but not compared: a.",
    )
    with pytest.raises(InputError, match=r"costs\.csv: none of the scanners that are compared"):
        costs.remarks(["c"])


def test_prices_of_a_file_for_requirements(tmp_path):
    path = tmp_path / "costs.yaml"
    path.write_text("post: 40\nscanner: {rplidar-a1: 99}\n")
    costs = read_costs(path)
    assert costs.of("rplidar-a1") == Cost(price=99.0)
