"""Fitting a calibration: known bias and deviation come back; bad tables are named."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ambinav.runtime.errors import InputError, InputWarning
from ambinav.sensing import CalibrationFit, Polynomial, RangeSensor, Table

LIMITS: dict[str, Any] = {"max_range": 4.0, "resolution": 0.001}


def measured(n: int = 6000, seed: int = 3) -> NDArray[np.float64]:
    """Pairs with bias 0.02 - 0.01 d and deviation 0.01 + 0.005 d."""
    rng = np.random.default_rng(seed)
    d = rng.uniform(0.1, 4.0, n)
    noise = (0.01 + 0.005 * d) * rng.standard_normal(n)
    return np.column_stack([d, d + 0.02 - 0.01 * d + noise])


@pytest.mark.parametrize("degree", [1, 2, None])
def test_fit_recovers_bias_and_std(degree: int | None) -> None:
    sensor = RangeSensor.fit(measured(), degree=degree, name="mine", **LIMITS)
    d = np.array([0.2, 1.0, 2.0, 3.0, 3.9])
    assert sensor.bias_at(d) == pytest.approx(0.02 - 0.01 * d, abs=2e-3)
    assert sensor.std_at(d) == pytest.approx(0.01 + 0.005 * d, rel=0.06)
    assert sensor.name == "mine"
    if degree is None:
        assert isinstance(sensor.bias, Polynomial)
        assert len(sensor.bias.coefficients) == 2


@pytest.mark.parametrize("model", ["constant", "linear", "table"])
def test_std_models(model: str) -> None:
    sensor = RangeSensor.fit(measured(), std_model=model, **LIMITS)  # type: ignore[arg-type]
    kinds = {"constant": float, "linear": Polynomial, "table": Table}
    assert isinstance(sensor.std, kinds[model])
    middle = 0.0205 if model == "constant" else 0.02
    assert sensor.std_at(2.0) == pytest.approx(middle, rel=0.06)


def test_fit_of_exact_readings() -> None:
    d = np.linspace(0.0, 4.0, 50)
    sensor = RangeSensor.fit(np.column_stack([d, 1.01 * d + 0.03]), **LIMITS)
    assert sensor.bias_at([0.0, 4.0]) == pytest.approx([0.03, 0.07])
    assert sensor.std_at([0.0, 4.0]) == pytest.approx([0.0, 0.0], abs=1e-12)


def test_linear_std_never_falls_below_zero() -> None:
    # Without noise near, a straight line through the residuals would be negative there.
    rng = np.random.default_rng(0)
    d = np.linspace(0.0, 4.0, 4000)
    e = np.maximum(0.0, d - 2.0) * 0.05 * rng.standard_normal(4000)
    sensor = RangeSensor.fit(np.column_stack([d, d + e]), **LIMITS)
    assert sensor.std_at(0.0) == 0.0
    assert sensor.std_at(4.0) > 0.05


def test_residuals_report_and_plot() -> None:
    sensor = RangeSensor.fit(measured(), **LIMITS)
    fit = sensor.calibration
    assert isinstance(fit, CalibrationFit)
    assert fit.residuals.shape == (6000,)
    assert fit.residuals.mean() == pytest.approx(0.0, abs=1e-12)
    report = fit.report()
    assert "6000 pairs" in report
    assert "fitted [mm]" in report
    assert len(report.splitlines()) == 6 + 8
    share = float(report.split("within 2 std ")[1].split(" ")[0])
    assert share == pytest.approx(95.4, abs=1.0)
    axes = fit.plot(Figure().subplots())
    assert axes.get_xlabel() == "true range [m]"


def test_calibration_stays_out_of_equality_and_yaml() -> None:
    sensor = RangeSensor.fit(measured(), **LIMITS)
    again = RangeSensor.from_plain(sensor.to_plain(), "again")
    assert again == sensor
    assert again.calibration is None


@pytest.mark.parametrize(
    "header",
    ["", "true_range,reading\n", "reading,true_range\n", "# pairs\n\nTrue_Range , Reading,who\n"],
)
def test_csv_with_and_without_header(tmp_path: Path, header: str) -> None:
    pairs = measured(500)
    columns = pairs[:, ::-1] if header.startswith("reading") else pairs
    rows = "\n".join(f"{a:.9f}, {b:.9f}" for a, b in columns.tolist())
    path = tmp_path / "pairs.csv"
    path.write_text(header + rows + "\n")
    from_file = RangeSensor.fit(path, **LIMITS)
    from_array = RangeSensor.fit(pairs, **LIMITS)
    assert from_file.std_at(2.0) == pytest.approx(from_array.std_at(2.0), rel=1e-5)
    assert from_file.source == f"fitted to {path}"


GOOD_ROWS = "".join(f"{0.5 * i},{0.5 * i + 0.01}\n" for i in range(1, 9))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "0 pairs are too few"),
        ("true_range,reading\n", "0 pairs are too few for a bias of degree 1; give at least 5"),
        ("1,1\n2,2\n3,3\n", "3 pairs are too few"),
        ("1,1\n1,2\n1,3\n1,1\n1,2\n", "1 different true ranges are too few"),
        (GOOD_ROWS + "2.0,two\n", "line 9: reading is 'two', not a number"),
        (GOOD_ROWS + "x,2.0\n", "line 9: true_range is 'x'"),
        (GOOD_ROWS + "nan,2.0\n", "line 9: true_range is nan; give metres"),
        (GOOD_ROWS + "2.0,inf\n", "line 9: reading is inf"),
        (GOOD_ROWS + "2.0\n", "line 9: '2.0' has too few cells"),
        (GOOD_ROWS + "2.0,\n", "line 9: reading is ''"),
        (GOOD_ROWS + "-1,1\n", "line 9: true_range is -1.0; give at least 0"),
        (GOOD_ROWS + "5,5\n", "line 9: true_range is 5, outside the sensor's 0 to 4 metres"),
        ("distance,value\n" + GOOD_ROWS, "line 1: the header is 'distance,value'; name"),
        ("1;1.0\n2;2.0\n", "line 1: the header is '1;1.0'"),
    ],
)
def test_bad_csv_names_file_line_and_value(tmp_path: Path, text: str, sentence: str) -> None:
    path = tmp_path / "pairs.csv"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        RangeSensor.fit(path, **LIMITS)
    assert str(caught.value).startswith(str(path))
    assert sentence in str(caught.value)


def test_bad_arguments() -> None:
    with pytest.raises(InputError, match="the file cannot be read"):
        RangeSensor.fit("nowhere.csv", **LIMITS)
    with pytest.raises(InputError, match=r"shape \(3,\)"):
        RangeSensor.fit([1.0, 2.0, 3.0], **LIMITS)
    with pytest.raises(InputError, match="degree is -1"):
        RangeSensor.fit(measured(), degree=-1, **LIMITS)
    with pytest.raises(InputError, match="std_model is 'cubic'"):
        RangeSensor.fit(measured(), std_model="cubic", **LIMITS)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="max_range is 1"):
        RangeSensor.fit(measured(), max_range=1.0, min_range=2.0, resolution=0.1)


def test_readings_far_beyond_the_range_warn() -> None:
    pairs = measured()
    pairs[:3, 1] += 10.0
    with pytest.warns(InputWarning, match=r"3 of \d+ readings lie far beyond max_range"):
        RangeSensor.fit(pairs, **LIMITS)


def test_readings_of_zero_warn() -> None:
    """Drivers report 0 where there is no echo."""
    pairs = measured()
    pairs[5:9, 1] = 0.0
    with pytest.warns(InputWarning, match=r"4 of \d+ readings are 0"):
        RangeSensor.fit(pairs, **LIMITS)


def test_readings_without_an_echo_warn() -> None:
    """Drivers report them as the largest range; ordinary ones are never called odd."""
    rng = np.random.default_rng(5)
    d = np.linspace(0.1, 5.5, 400)
    reading = d + 0.02 + 0.01 * d + rng.normal(0.0, 0.01 + 0.004 * d)
    pairs = np.column_stack([d, reading])
    with warnings.catch_warnings():
        warnings.simplefilter("error", InputWarning)
        CalibrationFit.fit(pairs, limits=(0.02, 5.6))
        CalibrationFit.fit(np.column_stack([d, np.round(d, 2)]), limits=(0.02, 5.6))
    pairs[::40, 1] = 5.6
    with pytest.warns(InputWarning, match=r"10 of 400 readings differ .*: 5.6 m at 0.1 m\)"):
        CalibrationFit.fit(pairs, limits=(0.02, 5.6))


def test_pairs_over_a_part_of_the_range_warn() -> None:
    pairs = measured()
    with pytest.warns(InputWarning, match="extrapolated"):
        RangeSensor.fit(pairs[pairs[:, 0] < 2.0], **LIMITS)
