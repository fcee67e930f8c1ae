"""Effects of the ablation are what is put in, and a second start does nothing twice."""

from __future__ import annotations

import importlib
import types
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from ambinav.drive.bootstrap import share
from ambinav_envs.evaluation import Episodes
from ambinav_envs.simulation.layout import ARRIVED, COLLIDED

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"


@pytest.fixture
def effects(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    return importlib.import_module("ablation_effects")


def episodes(lost: Any, arrived: Any = True, travelled: Any = 1.0, each: int = 1) -> Episodes:
    """Episodes with this much in common, `each` of them in a building."""
    count = len(lost)
    plain: dict[str, Any] = {item.name: np.zeros(count) for item in fields(Episodes)}
    plain["outcome"] = np.where(arrived, ARRIVED, COLLIDED) + np.zeros(count, dtype=np.int64)
    plain["was_lost"] = np.asarray(lost, dtype=np.bool_)
    plain["travelled"] = travelled * np.ones(count)
    plain["shortest"] = np.ones(count)
    plain["building"] = np.array([f"b{k // each}" for k in range(count)])
    return Episodes(**plain)


def found(effects: ModuleType, runs: Mapping[Any, list[Episodes]]) -> Any:
    """A setting where all cells but those of `runs` are lost in every second episode."""
    (first,) = {len(one) for one in runs.values()} or {3}
    size = len(next(iter(runs.values()))[0]) if runs else 8
    usual = [episodes(np.arange(size) % 2 == 0)] * first
    cells = {cell: [[run] for run in runs.get(cell, usual)] for cell in effects.CELLS}
    return effects.Found("halls, disturbed", "ekf", tuple(range(first)), cells)


def test_effects_compare_like_with_like(effects: ModuleType) -> None:
    every = {**effects.MAIN_EFFECTS, **effects.SHARES, **effects.SIMPLE, **effects.INTERACTIONS}
    assert all(sum(effect.values()) == 0.0 for effect in every.values())
    shares = [effects.SHARES[f"share of the {what}"] for what in ("reward", "route")]
    assert effects.combined(*((1.0, share) for share in shares)) == effects.SHARES["whole"]


def test_no_difference_is_no_difference(effects: ModuleType) -> None:
    same = found(effects, {})
    for effect in effects.MAIN_EFFECTS.values():
        value = same.effect(effect, "lost", effects.MAIN_LEVEL)
        assert (value.value, value.low, value.high) == (0.0, 0.0, 0.0)
        assert effects.verdict(same, effect) == "at most 5 points"


def test_a_difference_in_every_episode_is_certain(effects: ModuleType) -> None:
    never = [episodes(np.zeros(20))] * 3
    always = [episodes(np.ones(20))] * 3
    cells = {effects.Cell("ambiguity", 0): never, effects.Cell("shortest", 0): always}
    some = found(effects, cells)
    effect = effects.MAIN_EFFECTS["reward by itself"]
    value = some.effect(effect, "lost", effects.MAIN_LEVEL)
    assert (value.value, value.low, value.high) == (-100.0, -100.0, -100.0)
    assert effects.verdict(some, effect) == "helps"
    assert some.ratio(effect, "lost", 0.95).value == 0.0
    turned = {effects.Cell("ambiguity", 0): always, effects.Cell("shortest", 0): never}
    assert effects.verdict(found(effects, turned), effect) == "harms"
    few = found(effects, {cell: runs[:2] for cell, runs in cells.items()})
    assert effects.verdict(few, effect) == "none, too few replicates"


def test_who_arrives_less_is_not_helped(effects: ModuleType) -> None:
    cells = {
        effects.Cell("ambiguity", 0): [episodes(np.zeros(20), arrived=np.arange(20) < 5)] * 3,
        effects.Cell("shortest", 0): [episodes(np.ones(20))] * 3,
    }
    effect = effects.MAIN_EFFECTS["reward by itself"]
    assert effects.verdict(found(effects, cells), effect) == "no difference shown"


def test_length_is_of_those_that_arrive_on_both_sides(effects: ModuleType) -> None:
    lost = np.zeros(4)
    cells = {
        effects.Cell("ambiguity", 0): [
            episodes(lost, arrived=np.array([1, 1, 0, 1]) > 0, travelled=np.array([2, 3, 9, 9.0]))
        ],
        effects.Cell("shortest", 0): [
            episodes(lost, arrived=np.array([1, 1, 1, 0]) > 0, travelled=np.array([1, 1, 1, 1.0]))
        ],
    }
    some = found(effects, cells)
    value = some.effect(effects.reward_effect("ambiguity", 0), "length", 0.95)
    assert value.value == pytest.approx(1.5)
    assert value.count == 2


@pytest.mark.parametrize("each", [1, pytest.param(5, marks=pytest.mark.slow)])
def test_intervals_are_as_wide_as_theory_has_them(effects: ModuleType, each: int) -> None:
    # All episodes of a building are alike: there are as many samples as buildings.
    rng = np.random.default_rng(5)
    buildings, share = 400, 0.3
    lost = np.repeat(rng.random(buildings) < share, each)
    cells = {
        effects.Cell("ambiguity", 0): [episodes(lost, each=each)] * 2,
        effects.Cell("shortest", 0): [episodes(np.zeros(len(lost)), each=each)] * 2,
    }
    value = found(effects, cells).effect(effects.reward_effect("ambiguity", 0), "lost", 0.95)
    half = 1.96 * 100.0 * np.sqrt(lost.mean() * (1.0 - lost.mean()) / buildings)
    assert value.high - value.low == pytest.approx(2.0 * half, rel=0.08)


def test_seeds_that_differ_widen_the_interval(effects: ModuleType) -> None:
    runs = [episodes(np.full(50, seed)) for seed in (1.0, 0.0, 1.0)]
    cells = {
        effects.Cell("ambiguity", 0): runs,
        effects.Cell("shortest", 0): [episodes(np.zeros(50))] * 3,
    }
    value = found(effects, cells).effect(effects.reward_effect("ambiguity", 0), "lost", 0.95)
    assert (value.low, value.high) == (0.0, 100.0)


def test_maps_are_not_drawn(effects: ModuleType) -> None:
    # One map where all are lost, one where none is: with drawn maps the interval would be wide.
    runs = [[episodes(np.ones(30), each=30), episodes(np.zeros(30), each=30)]] * 3
    cells = {cell: runs for cell in effects.CELLS}
    some = effects.Found("recorded maps, disturbed", "ekf", (0, 1, 2), cells)
    value = some.figure(effects.CELLS[0], "lost")
    assert value.value == 50.0
    assert (value.low, value.high) == pytest.approx((25.0, 75.0), abs=2.0)
    length = some.figure(effects.CELLS[0], "length")
    assert (length.value, length.low, length.high) == (1.0, 1.0, 1.0)


def test_shares_have_score_intervals(effects: ModuleType) -> None:
    nothing = found(effects, {})
    value = nothing.figure(effects.Cell("fisher", 5), "collided")
    assert value.low == 0.0 and value.high > 5.0
    # Alike within buildings, and the same in all seeds: there are as many samples as buildings.
    lost = np.repeat(np.arange(40) < 12, 5)
    cells = {effects.CELLS[0]: [episodes(lost, each=5)] * 20}
    one = found(effects, cells).figure(effects.CELLS[0], "lost")
    buildings = share(np.arange(40) < 12).scaled(100.0)
    assert (one.low, one.high) == pytest.approx((buildings.low, buildings.high), abs=2.0)


def test_what_is_kept_is_what_the_study_reads(effects: ModuleType, tmp_path: Path) -> None:
    module = importlib.import_module("ablation_kept")
    rng = np.random.default_rng(3)
    first = episodes(rng.random(9) < 0.5, rng.random(9) < 0.5, rng.random(9), each=3)
    other = episodes(rng.random(9) < 0.5, each=3)
    driven = {
        module.Key(run, "hall", "disturbed"): one for run, one in (("a", first), ("b", other))
    }
    module.keep(tmp_path / "new" / "seed-0.npz", driven)
    found = module.kept(tmp_path / "new" / "seed-0.npz")
    assert set(found) == set(driven)
    for key, one in driven.items():
        assert np.array_equal(found[key].outcome, one.outcome)
        assert np.array_equal(found[key].was_lost, one.was_lost)
        assert np.array_equal(found[key].building, one.building)
        assert found[key].travelled == pytest.approx(one.travelled, rel=1e-6)
        assert np.isnan(found[key].reward).all()
    assert module.kept(tmp_path / "none.npz") == {}
    driven[module.Key("c", "hall", "disturbed")] = episodes(np.zeros(9), each=1)
    with pytest.raises(ValueError, match="building is not the same in all runs"):
        module.keep(tmp_path / "odd.npz", driven)


@pytest.mark.sweep
def test_a_second_start_does_nothing_twice(
    effects: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ablation = importlib.import_module("bench_ablation")
    # Intervals are looked at elsewhere.
    monkeypatch.setattr(effects, "DRAWS", 50)
    results = tmp_path / "results"
    trained: list[str] = []
    driven: list[str] = []

    class Training:
        def __init__(self, config: Any, folder: Path, *rest: Any) -> None:
            self.folder, self.model = folder, self
            self.policy = self

        def load_state_dict(self, weights: Any) -> None:
            assert weights == "weights"

        def go(self) -> None:
            self.folder.mkdir()
            if len(trained) == 3 and not (tmp_path / "stopped").exists():
                (tmp_path / "stopped").touch()
                raise KeyboardInterrupt
            trained.append(self.folder.name)
            (self.folder / ablation.FINAL).touch()

    def evaluate(policy: Any, source: str, *rest: Any, chunk: int) -> Episodes:
        driven.append(source)
        return episodes(np.zeros(chunk))

    policy = types.SimpleNamespace(seeing={})
    policy.model = types.SimpleNamespace(state_dict=lambda: "weights")
    monkeypatch.setattr(ablation, "Run", Training)
    monkeypatch.setattr(ablation, "evaluate_in", evaluate)
    monkeypatch.setattr(ablation, "load_policy", lambda source: policy)
    monkeypatch.setattr(ablation.Study, "_source", lambda self, place: place)
    with pytest.raises(KeyboardInterrupt):
        ablation.Study(tmp_path, results).make(0)
    assert len(trained) == 3 and not list(results.glob("*.npz"))
    study = ablation.Study(tmp_path, results)
    study.make(0)
    assert len(trained) == len(set(trained)) == 20
    assert len(driven) == 16 * 10
    study.make(0)
    assert len(trained) == 20 and len(driven) == 160
    # A file that is damaged is driven again; what is there is not.
    (victim,) = (tmp_path / "driven" / "ekf-fisher-5-seed-0").glob("aces, disturbed.npz")
    victim.write_bytes(b"")
    whole = (results / "seed-0.npz").read_bytes()
    (results / "seed-0.npz").unlink()
    ablation.Study(tmp_path, results).make(0)
    assert driven[160:] == ["aces"]
    assert (results / "seed-0.npz").read_bytes() == whole
    study.follow()
    study = ablation.Study(tmp_path / "elsewhere", results)
    study.follow()
    study.make(0)  # what is kept suffices
    assert not (tmp_path / "elsewhere").exists()
    (one, *_) = found = list(ablation.found_in(study, [0, 1]))
    assert len(found) == 8
    assert one.seeds == (0,)
    tables = importlib.import_module("ablation_tables")
    text = tables.body(found)
    assert "none, too few replicates" in text
    tables.plot_effects(found)
    # Another configuration is refused.
    (tmp_path / "trained" / "ekf-shortest-0-seed-0.yaml").write_text("steps: 1\n")
    (results / "seed-0.npz").unlink()
    with pytest.raises(SystemExit, match="another --folder"):
        ablation.Study(tmp_path, results).make(0)
