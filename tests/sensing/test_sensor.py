"""The range sensor against closed forms and Monte Carlo."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import ndtr
from scipy.stats import chisquare

from ambinav.runtime.errors import InputError
from ambinav.sensing import Polynomial, RangeSensor, Table

PLAIN = RangeSensor(max_range=4.0, std=0.03, resolution=0.001)
COARSE = RangeSensor(
    name="coarse",
    min_range=0.2,
    max_range=3.0,
    resolution=0.15,  # does not divide the span: the last bin is narrower
    bias=Polynomial((0.01, 0.02)),
    std=Table((0.5, 2.5), (0.05, 0.2)),
    random_share=0.05,
    lost_share=0.1,
)


def test_keywords_of_the_design_and_defaults() -> None:
    assert (PLAIN.aperture, PLAIN.min_range, PLAIN.random_share) == (0.0, 0.0, 0.01)
    assert PLAIN.bins == 4000
    assert PLAIN.edges[[0, -1]].tolist() == [0.0, 4.0]
    assert COARSE.bins == 19
    assert COARSE.edges[-1] == 3.0
    assert np.diff(COARSE.edges)[-1] == pytest.approx(0.1)


@given(
    d=st.one_of(st.floats(0, 50), st.just(math.inf), st.floats(2.9, 3.1)),
    std=st.one_of(st.just(0.0), st.floats(1e-6, 5.0)),
    resolution=st.floats(0.01, 2.8),
    random_share=st.floats(0, 0.5),
    lost_share=st.floats(0, 0.4),
)
def test_probabilities_sum_to_one(
    d: float, std: float, resolution: float, random_share: float, lost_share: float
) -> None:
    sensor = RangeSensor(
        min_range=0.2,
        max_range=3.0,
        resolution=resolution,
        std=std,
        bias=0.01,
        random_share=random_share,
        lost_share=lost_share,
    )
    row = sensor.reading_probabilities(d)
    assert row.shape == (sensor.bins + 2,)
    assert row.min() >= -1e-15
    assert row.sum() == pytest.approx(1.0, abs=1e-12)


def test_no_echo_is_certain_at_infinity_but_for_the_random_share() -> None:
    row = COARSE.reading_probabilities(np.inf)
    assert row[0] == 0.0
    assert row[-1] == pytest.approx(0.95)
    assert row[1:-1] == pytest.approx(np.full(19, 0.05 / 19))


def test_probabilities_are_normal_integrals() -> None:
    sensor = RangeSensor(
        min_range=0.5, max_range=2.5, resolution=0.5, std=0.3, bias=0.1, random_share=0.0
    )
    cuts = ndtr((np.array([0.5, 1.0, 1.5, 2.0, 2.5]) - 1.3) / 0.3)
    expected = np.diff(np.concatenate([[0.0], cuts, [1.0]]))
    assert sensor.reading_probabilities(1.2) == pytest.approx(expected, abs=1e-14)


def test_without_noise_the_reading_is_certain_and_j_is_the_triangle() -> None:
    # Averaged over the phase of the bins, two noise-free ranges fall into the same bin with the
    # probability max(0, 1 - |D| / delta).
    sensor = RangeSensor(max_range=2.0, std=0.0, resolution=0.1, random_share=0.0)
    assert set(np.unique(sensor.reading_probabilities([0.0, 0.05, 1.234]))) == {0.0, 1.0}
    phases = 1.0 + (np.arange(1000) + 0.5) * 1e-4
    for apart in (0.0, 0.03, 0.08, 0.1, 0.15):
        p, q = sensor.reading_probabilities(phases), sensor.reading_probabilities(phases + apart)
        assert np.mean(np.sum(p * q, axis=-1)) == pytest.approx(max(0, 1 - apart / 0.1), abs=2e-3)


def test_j_of_equal_ranges_of_the_design() -> None:
    # J(d, d) = 0.486 for a resolution of 1 cm and a deviation of 5 mm.
    sensor = RangeSensor(max_range=2.0, std=0.005, resolution=0.01, random_share=0.0)
    phases = 1.0 + (np.arange(500) + 0.5) * 2e-5
    j = np.mean(np.sum(sensor.reading_probabilities(phases) ** 2, axis=-1))
    t = 0.005 * math.sqrt(2)

    def f(u: float) -> float:
        return float(u * ndtr(u / t)) + t / math.sqrt(2 * math.pi) * math.exp(-((u / t) ** 2) / 2)

    assert j == pytest.approx((f(0.01) - 2 * f(0.0) + f(-0.01)) / 0.01, abs=1e-6)
    assert j == pytest.approx(0.486, abs=1e-3)


@pytest.mark.parametrize("d", [0.15, 0.3, 1.7, 2.95, 3.2, math.inf])
@pytest.mark.parametrize("sensor", [COARSE, RangeSensor(max_range=3.0, std=0.3, resolution=0.25)])
def test_readings_are_distributed_as_the_probabilities_say(sensor: RangeSensor, d: float) -> None:
    n = 50_000
    reading = sensor.read(np.full(n, d), np.random.default_rng(7))
    seen = np.bincount(sensor.column(reading), minlength=sensor.bins + 2)
    expected = n * sensor.reading_probabilities(d)
    rare = expected < 5  # chi-square needs filled cells: the rare ones are one cell together
    seen_cells = np.append(seen[~rare], seen[rare].sum())
    expected_cells = np.append(expected[~rare], expected[rare].sum())
    if expected_cells[-1] == 0:
        assert seen_cells[-1] == 0
        seen_cells, expected_cells = seen_cells[:-1], expected_cells[:-1]
    if len(seen_cells) > 1:
        assert chisquare(seen_cells, expected_cells).pvalue > 1e-4


def test_read_gives_bin_centres_in_float32_and_rep_117_infinities() -> None:
    sensor = RangeSensor(min_range=0.2, max_range=3.05, resolution=0.1, std=0.0, random_share=0.0)
    d = np.array([[0.0, 0.2, 0.27], [3.01, 3.06, np.inf]])
    reading = sensor.read(d, np.random.default_rng(0))
    assert reading.dtype == np.float32
    assert reading == pytest.approx(np.array([[-np.inf, 0.25, 0.25], [3.025, np.inf, np.inf]]))
    assert sensor.read(1.04, np.random.default_rng(0)).shape == ()


def test_read_without_random_share_loses_the_lost_share() -> None:
    sensor = RangeSensor(max_range=3.0, resolution=0.1, std=0.0, random_share=0.0, lost_share=0.25)
    reading = sensor.read(np.full(40_000, 1.0), np.random.default_rng(1))
    assert np.isinf(reading).mean() == pytest.approx(0.25, abs=0.01)


def test_curves_are_held_beyond_the_limits() -> None:
    assert COARSE.std_at([0.0, 0.5, 1.5, 9.0, np.inf]) == pytest.approx(
        [0.05, 0.05, 0.125, 0.2, 0.2]
    )
    assert COARSE.bias_at([0.0, 1.0, np.inf]) == pytest.approx([0.014, 0.03, 0.07])


def test_constant_polynomial_is_a_number_and_sensors_are_hashable() -> None:
    one = RangeSensor(max_range=4, std=Polynomial((0.03,)), resolution=0.001)
    assert one == PLAIN
    assert len({one, PLAIN, COARSE}) == 2


@pytest.mark.parametrize("sensor", [PLAIN, COARSE])
def test_yaml_round_trip(sensor: RangeSensor, tmp_path: Path) -> None:
    sensor.to_yaml(tmp_path / "sensor.yaml")
    assert RangeSensor.from_yaml(tmp_path / "sensor.yaml") == sensor


def test_yaml_angles_are_degrees_and_1e_3_is_a_number(tmp_path: Path) -> None:
    path = tmp_path / "sonar.yaml"
    path.write_text(
        "max_range: 5\nstd: 1e-3\nresolution: 0.01\naperture_deg: 30\nmax_incidence_deg: 25\n"
    )
    sonar = RangeSensor.from_yaml(path)
    assert sonar.aperture == math.radians(30)
    assert sonar.max_incidence == math.radians(25)
    assert sonar.std == 1e-3


BAD_FIELDS: list[tuple[dict[str, object], str]] = [
    ({"max_range": 0.1, "min_range": 0.5}, "max_range is 0.1; it must exceed min_range (0.5)"),
    ({"max_range": 0.5, "min_range": 0.5}, "max_range is 0.5; it must exceed"),
    ({"max_range": math.nan}, "max_range is nan; give a finite number"),
    ({"max_range": math.inf}, "max_range is inf; give a finite number"),
    ({"min_range": -1}, "min_range is -1.0; give at least 0"),
    ({"std": -0.1}, "std is -0.1 at a true range of 0 metres; it must be at least 0"),
    ({"std": Polynomial((0.1, -0.05))}, "std is -0.1 at a true range of 4 metres"),
    ({"std": Polynomial((0.9, -1.0, 0.25))}, "std is -0.1 at a true range of 2 metres"),
    ({"std": Table((1.0, 2.0, 3.0), (0.1, -0.2, 0.1))}, "std is -0.2 at a true range of 2"),
    ({"std": "much"}, "std is 'much'; give a finite number"),
    ({"std": math.nan}, "std is nan"),
    ({"resolution": 0}, "resolution is 0.0; give more than 0"),
    ({"resolution": math.nan}, "resolution is nan"),
    ({"resolution": 5}, "resolution is 5.0; give more than 0 and at most the span"),
    ({"resolution": 1e-12}, "give a coarser one"),
    ({"random_share": 1.0}, "random_share is 1.0; give a share of at least 0 and below 1"),
    ({"lost_share": -0.1}, "lost_share is -0.1"),
    ({"random_share": 0.6, "lost_share": 0.5}, "together they must be below 1"),
    ({"aperture": 4.0}, "aperture is 229.183 degrees"),
    ({"max_incidence": 0.0}, "max_incidence is 0 degrees"),
    ({"max_range": True}, "max_range is True"),
]


@pytest.mark.parametrize(("fields", "sentence"), BAD_FIELDS)
def test_bad_fields_are_named(fields: dict[str, object], sentence: str) -> None:
    good: dict[str, object] = {"max_range": 4.0, "std": 0.03, "resolution": 0.001}
    with pytest.raises(InputError) as caught:
        RangeSensor(name="probe", **{**good, **fields})  # type: ignore[arg-type]
    assert sentence in str(caught.value)
    assert str(caught.value).startswith("sensor 'probe': ")
    assert "\n" not in str(caught.value)


GOOD_YAML = "max_range: 4\nresolution: 0.01\n"


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "the file is empty"),
        ("[1, 2", "line 1: not valid YAML"),
        ("std: !!bool maybe", "not valid YAML ('maybe'); correct"),
        ("just words", "is 'just words'; give a mapping"),
        (GOOD_YAML, "the key 'std' is missing; add it"),
        (GOOD_YAML + "std: 0.1\nmax_rnge: 3", "'max_rnge' is unknown; did you mean max_range"),
        (GOOD_YAML + "std: [1]", "std is [1]; give a finite number"),
        (GOOD_YAML + "std: .nan", "std is nan"),
        (GOOD_YAML + "std: -1", "std is -1"),
        (GOOD_YAML + "std: {polynomial: [0.1, x]}", "std: polynomial[1] is 'x'"),
        (GOOD_YAML + "std: {polynomial: []}", "std: polynomial is []; give a list of numbers"),
        (GOOD_YAML + "std: {tabel: 1}", "'tabel' is unknown; did you mean table"),
        (GOOD_YAML + "std: {}", "give either 'polynomial' or 'table'"),
        (GOOD_YAML + "std: {table: {range: [1, 1], value: [0, 0]}}", "table range 1.0 follows 1.0"),
        (GOOD_YAML + "std: {table: {range: [1], value: [0, 0]}}", "1 ranges but 2 values"),
        (GOOD_YAML + "std: 0.1\nname: 3", "name is 3; give a text"),
    ],
)
def test_bad_yaml_names_file_and_field(tmp_path: Path, text: str, sentence: str) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        RangeSensor.from_yaml(path)
    assert str(caught.value).startswith(str(path))
    assert sentence in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_and_binary_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.yaml: the file cannot be read"):
        RangeSensor.from_yaml(tmp_path / "none.yaml")
    with pytest.raises(InputError, match="cannot be read"):
        RangeSensor.from_yaml(tmp_path)
    (tmp_path / "binary.yaml").write_bytes(b"a: \xff\xfe")
    with pytest.raises(InputError, match="not UTF-8"):
        RangeSensor.from_yaml(tmp_path / "binary.yaml")


@given(st.text(max_size=60))
def test_any_text_gives_a_sensor_or_a_sentence(text: str) -> None:
    from ambinav.config import parse_yaml

    try:
        RangeSensor.from_plain(parse_yaml(text, "f.yaml", "see another"), "f.yaml")
    except InputError as error:
        assert str(error).startswith("f.yaml")


@pytest.mark.parametrize("value", [math.nan, -0.1])
def test_bad_true_ranges(value: float) -> None:
    with pytest.raises(InputError, match="true range is"):
        PLAIN.reading_probabilities([1.0, value])
    with pytest.raises(InputError, match="true range is"):
        PLAIN.read([1.0, value], np.random.default_rng(0))
    with pytest.raises(InputError, match="reading is NaN"):
        PLAIN.column(math.nan)
