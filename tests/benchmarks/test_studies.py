"""The studies can be stopped, and what they compare is comparable."""

from __future__ import annotations

import argparse
import importlib
import itertools
import json
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from ambinav.drive.noise import OdometryNoise
from benchmarks.harness import appended, in_all, kept_rows
from benchmarks.localizers import ROBOT, between_scans

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> object:
    """Import a script of the benchmarks as it is when it runs."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))

    def found(name: str) -> ModuleType:
        return importlib.import_module(name)

    return found


def test_rows_outlive_a_writer_that_was_stopped(tmp_path: Path) -> None:
    path = tmp_path / "new" / "rows.jsonl"
    assert kept_rows(path) == []
    with appended(path) as append:
        append({"pair": 0})
        append({"pair": 1})
    with path.open("a") as file:
        file.write('{"pair": 2, "lo')
    assert [row["pair"] for row in kept_rows(path)] == [0, 1]
    with appended(path) as append:
        append({"pair": 2})
    assert [row["pair"] for row in kept_rows(path)] == [0, 1, 2]
    assert all(row["commit"] for row in kept_rows(path))
    assert len(path.read_text().splitlines()) == 3


def test_one_writer_at_a_time(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "rows.jsonl"
    with appended(path) as append:
        append({"pair": 0})
        with pytest.raises(SystemExit) as ended, appended(path):
            pass
        append({"pair": 1})
    assert ended.value.code == 2
    assert "another process" in capsys.readouterr().err
    assert len(kept_rows(path)) == 2


def test_localizers_are_compared_on_what_all_have_driven() -> None:
    found = {
        "product": [{"pair": k, "odometry": 0.5} for k in range(4)],
        "kalman": [{"pair": k, "odometry": 0.5} for k in (3, 1)],
        "amcl": [{"pair": 0, "odometry": 0.5}, {"pair": 1, "odometry": 0.5}],
        "sum": [],
    }
    shared = in_all(found, ("product", "kalman"), ("pair", "odometry"))
    pairs = {name: sorted(row["pair"] for row in rows) for name, rows in shared.items()}
    assert pairs == {"product": [1, 3], "kalman": [1, 3], "amcl": [1], "sum": []}
    # One that has driven nothing is not asked.
    alone = in_all(found, ("product", "sum"), ("pair",))
    assert len(alone["product"]) == 4


@pytest.mark.parametrize("rate", [5.0, 10.0])
def test_kalman_filter_knows_how_odometry_errs_between_scans(rate: float) -> None:
    noise = OdometryNoise(scale=0.5)
    model = between_scans(noise, rate)
    metres = 6.0
    steps = round(metres * rate / ROBOT.max_speed)
    poses = np.column_stack([np.linspace(0.0, metres, steps + 1), np.zeros((steps + 1, 2))])
    covariance = np.zeros((1, 3, 3))
    for before, after in itertools.pairwise(poses):
        covariance = model.covariances(before, covariance, before, after)
    # A Wiener process, as the head of ambinav/drive/noise.py has it.
    rate_of = noise.scale**2 * noise.distance * metres
    assert covariance[0, 2, 2] == pytest.approx(2.0 * noise.alpha2 * rate_of)
    assert covariance[0, 0, 0] == pytest.approx(noise.alpha3 * rate_of)
    across = 2.0 / 3.0 * noise.alpha2 * rate_of * metres**2
    assert covariance[0, 1, 1] == pytest.approx(across, rel=0.02)


def driven_pairs(shortest: float, aware: float, pairs: int = 12) -> list[dict[str, object]]:
    """Pairs with about these shares of lost runs, and other ones for each pair."""
    rng = np.random.default_rng(3)
    return [
        {
            "environment": "demo", "scanner": "laser", "pair": pair, "odometry": 0.5,
            "shortest": {"lost": (rng.random(30) < shortest).astype(float).tolist()},
            "aware": {"lost": (rng.random(30) < aware).astype(float).tolist()},
        }
        for pair in range(pairs)
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("product", "kalman", "sentence"),
    [
        ((0.4, 0.1), (0.5, 0.1), "a gain is shown with both."),
        ((0.0, 0.0), (0.0, 0.0), "nothing is shown with either."),
        # One interval without 0 and one with it: are the localizers shown to differ?
        ((0.4, 0.0), (0.05, 0.05), "a gain is shown with `product`, not shown with `kalman`"),
        ((0.1, 0.06), (0.3, 0.22), "which is not shown to differ from 0."),
        ((0.9, 0.1), (0.1, 0.1), "which is shown."),
        ((0.1, 0.9), (0.9, 0.1), "a gain is shown with `kalman`, a loss with `product`"),
    ],
)  # fmt: skip
def test_what_is_said_of_two_localizers(
    script: object, product: tuple[float, float], kalman: tuple[float, float], sentence: str
) -> None:
    claim = script("bench_claim")  # type: ignore[operator]
    found = {"product": driven_pairs(*product), "kalman": driven_pairs(*kalman)[::-1]}
    assert sentence in claim.sentence("laser", found)


def test_criterion_of_routes_by_two_layers(script: object) -> None:
    study = script("bench_route_layers")  # type: ignore[operator]
    lower, none, higher = (study.Interval(v, v - 1.0, v + 1.0, 9) for v in (-2.0, 0.0, 2.0))
    assert study.judged((lower, none)) == "met"
    assert study.judged((none, lower)) == "met"
    assert study.judged((none, none)) == study.judged((lower, higher)) == "not met"


@pytest.mark.sweep
@pytest.mark.parametrize("localizer", ["product", "kalman"])
def test_places_do_not_depend_on_where_a_study_was_stopped(
    script: object, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, localizer: str
) -> None:
    truth = script("truth_case")  # type: ignore[operator]
    build, maps = truth.build_map, {}

    def built(environment: object, scanner: object, **options: object) -> object:
        """Each start takes the maps that the first has computed, all of one building."""
        key = (scanner, *options.items())
        if key not in maps:
            maps[key] = build(environment, scanner, **options)
        return maps[key]

    monkeypatch.setattr(truth, "build_map", built)

    def drive(folder: str, poses: int) -> list[dict[str, object]]:
        words = ["demo", "laser-4m", "--localizer", localizer, "--poses", str(poses), "--runs", "2"]
        monkeypatch.setattr("sys.argv", ["x", *words, "--folder", str(tmp_path / folder)])
        truth.main()
        args = argparse.Namespace(localizer=localizer, world="map", start="known", runs=2, seed=23)
        path = truth.drives_path(tmp_path / folder, "demo", "laser-4m", args)
        return [json.loads(line) for line in path.read_text().splitlines()]

    assert len(drive("stopped", 1)) == 1
    assert drive("stopped", 3) == drive("whole", 3)
