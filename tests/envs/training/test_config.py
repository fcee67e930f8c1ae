"""Configurations: what is written out, and that what is wrong is named."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from ambinav.runtime.errors import InputError
from ambinav_envs.training.config_file import (
    difference,
    load_training_config,
    parse_config,
    source_of,
    write_config,
)
from tests.envs.training.cases import TINY, tiny

ROOT = Path(__file__).parents[3]


@pytest.mark.parametrize("name", ["ppo", "sac", "recurrent-ppo", "corrected-vfh"])
def test_those_that_are_shipped_can_be_used(name: str) -> None:
    config = load_training_config(ROOT / "configs" / f"{name}.yaml")
    assert (config.base, config.algorithm) == {"corrected-vfh": ("vfh", "ppo")}.get(
        name, (None, name)
    )
    train, judged = source_of(config.arguments)[0], source_of(config.judged)[0]
    assert train.count is not None and train.first + train.count <= judged.first


def test_written_out_and_read_again(tmp_path: Path) -> None:
    config = parse_config(
        {"minutes": 2, "environment": {"id": "ambinav/Office-v1", "buildings": 10}}, "here"
    )
    assert config.hyperparameters["gamma"] == 0.99 and config.threads is not None
    assert config.evaluation.environment == {"first_building": 500_000, "buildings": 100}
    assert config.judged == {"suite": "office", "first_building": 500_000, "buildings": 100}
    write_config(config, tmp_path / "config.yaml")
    assert load_training_config(tmp_path / "config.yaml") == config


@pytest.mark.parametrize(
    ("envs", "n_steps", "batch"),
    [(64, 128, 2048), (8, 64, 512), (64, 33, 1056), (3, 700, 1050), (1, 2053, 2053)],
)
def test_a_batch_that_nobody_asked_for_divides_the_rollout(
    envs: int, n_steps: int, batch: int
) -> None:
    settings = {"steps": 9, "envs": envs, "environment": {"id": "ambinav/Hall-v1"}}
    config = parse_config(settings | {"hyperparameters": {"n_steps": n_steps}}, "here")
    assert config.hyperparameters["batch_size"] == batch
    assert envs * n_steps % batch == 0


def test_judged_in_other_buildings_whatever_else_differs(tmp_path: Path) -> None:
    settings = {"steps": 9, "environment": {"id": "ambinav/Hall-v1", "buildings": 40}}
    config = parse_config(settings | {"evaluation": {"environment": {"people": 2}}}, "here")
    assert config.judged == {
        "suite": "hall", "buildings": 100, "first_building": 500_000, "people": 2
    }  # fmt: skip
    same = parse_config(settings | {"evaluation": {"environment": {"buildings": 40}}}, "here")
    assert (same.judged["buildings"], same.judged["first_building"]) == (40, 500_000)
    for one in (config, same):
        write_config(one, tmp_path / "config.yaml")
        assert load_training_config(tmp_path / "config.yaml") == one


def test_files_are_found_from_anywhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    demo = (ROOT / "configs" / "demo.geojson").read_bytes()
    (tmp_path / "house.geojson").write_bytes(demo)
    (tmp_path / "a.yaml").write_text(
        "{steps: 10000, environment: {id: ambinav/Navigation-v1, map: house.geojson}}"
    )
    monkeypatch.chdir("/")
    config = load_training_config(tmp_path / "a.yaml")
    assert config.environment["map"] == str(tmp_path / "house.geojson")
    assert config.judged == config.arguments


def test_the_call_may_say_seed_and_limits(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(
        "{steps: 10000, minutes: 3, environment: {id: ambinav/Hall-v1, buildings: 2}}"
    )
    config = load_training_config(tmp_path / "a.yaml", seed=7, limits={"steps": 5, "minutes": None})
    assert (config.seed, config.steps, config.minutes) == (7, 5, None)
    for limits, wanted in (
        ({"steps": 5}, (5, None)),
        ({"minutes": 1}, (None, 1)),
        ({}, (10000, 3)),
    ):
        config = load_training_config(tmp_path / "a.yaml", limits=limits)
        assert (config.steps, config.minutes) == wanted


@pytest.mark.parametrize(
    ("suite", "first", "shares"),
    [
        ("cluttered+hall", 1, True),
        ("standard", 1, True),
        ("loop+standard", 1, True),
        ("cluttered+hall", 2, False),
        ("cluttered+loop", 1, False),
    ],
)
def test_a_mixture_has_the_buildings_of_its_members(suite: str, first: int, shares: bool) -> None:
    judged = {"environment": {"suite": suite, "first_building": first, "buildings": 4}}
    if not shares:
        assert tiny(evaluation=judged).judged["suite"] == suite
        return
    with pytest.raises(InputError, match=r"partly those of training, 2 from 0 on .*suite hall\)"):
        tiny(evaluation=judged)


WRONG: list[tuple[dict[str, Any], str]] = [
    ({"algoritm": "ppo"}, "the key 'algoritm' is unknown; did you mean algorithm"),
    ({"algorithm": "pop"}, "algorithm is 'pop'"),
    ({"steps": None}, "it has no end; give steps, minutes or both"),
    ({"steps": 0}, "steps is 0; it should be greater"),
    ({"minutes": -1}, "minutes is -1"),
    ({"envs": 0}, "envs is 0"),
    ({"threads": 10_000}, "threads is 10000"),
    ({"environment": {"id": "ambinav/Offize-v0"}}, "did you mean ambinav/Office-v1"),
    ({"environment": {}}, "environment: the key id is missing"),
    ({"environment": {"id": "ambinav/Hall-v1", "longst": 3}}, "did you mean longest"),
    ({"environment": {"id": "ambinav/Hall-v1", "num_envs": 3}}, "num_envs cannot be given"),
    ({"environment": {"id": "ambinav/Hall-v1", "map": "x.geojson"}}, "give one of the two"),
    ({"evaluation": {"environment": {"id": "ambinav/Hall-v1"}}}, "is that of training"),
    ({"evaluation": {"environment": {"rewart": 1}}}, "evaluation.environment: .*did you mean"),
    ({"evaluation": {"environment": {"first_building": 1}}},
     "the buildings from 1 on, 100 of them, are partly those of training, 2 from 0 on"),
    ({"evaluation": {"episodes": 0}}, "evaluation.episodes is 0"),
    ({"evaluation": {"environment": {"discrete": True}}},
     "evaluation.environment does not fit that of training: it gives 2 numbers"),
    ({"evaluation": {"environment": {"declare": ["arrived"]}}},
     "evaluation.environment does not fit that of training: it gives 2 numbers"),
    ({"evaluation": {"environment": {"scanner": "rplidar-a1"}}},
     "evaluation.environment does not fit that of training: .*scan"),
    ({"base": "vfh", "environment": {"id": "ambinav/Hall-v1", "discrete": True}},
     "base: vfh has continuous actions alone"),
    ({"normalize": {"rewards": True}}, "normalize: the key 'rewards' is unknown"),
    ({"policy": {"scan": "cnn"}}, "policy.scan is 'cnn'; it should be 'conv' or 'dense'"),
    ({"policy": {"net_arch": [0]}}, r"policy.net_arch\[0\] is 0"),
    ({"hyperparameters": {"lr": 1}}, "hyperparameters: 'lr' is unknown"),
    ({"hyperparameters": {"n_step": 1}}, "did you mean n_steps"),
    ({"hyperparameters": {"gamma": 1.5}}, "hyperparameters.gamma is 1.5; give 0 to 1"),
    ({"hyperparameters": {"gamma": "high"}}, "give a finite number"),
    ({"hyperparameters": {"n_steps": 1.5}}, "give a whole number"),
    (
        {"hyperparameters": {"n_steps": 33, "batch_size": 2048}},
        "batch_size is 2048, which does not divide",
    ),
    ({"hyperparameters": {"use_sde": 1}}, "give true or false"),
    ({"hyperparameters": {"learning_rate": {"from": 1}}}, "a mapping of from and to"),
    ({"hyperparameters": {"learning_rate": {"from": 1, "to": -1}}}, "learning_rate.to is -1"),
    ({"curriculum": [{"longest": 4}]}, r"curriculum\[0\]: the stage has no end"),
    ({"curriculum": [{"longest": 1, "share": 0.5}]}, "more than the environment's shortest, 2"),
    ({"curriculum": [{"longest": 4, "share": 2}]}, r"curriculum\[0\].share is 2"),
    ({"checkpoints": {"keep": 0}}, "checkpoints.keep is 0"),
    (
        {"algorithm": "sac", "hyperparameters": {},
         "environment": {"id": "ambinav/Hall-v1", "discrete": True}},
        "sac has continuous actions alone",
    ),
    ({"algorithm": "sac", "hyperparameters": {"n_epochs": 3}}, "'n_epochs' is unknown"),
]  # fmt: skip


@pytest.mark.parametrize(("other", "expected"), WRONG, ids=lambda value: str(value)[:40])
def test_what_is_wrong_is_named(other: dict[str, Any], expected: str) -> None:
    with pytest.raises(InputError, match=expected) as caught:
        parse_config(TINY | other, "here.yaml")
    message = str(caught.value)
    assert message.startswith("here.yaml") and message.endswith(".") and "\n" not in message


@pytest.mark.parametrize("text", ["", "just words", "- 1", "{steps: [}"])
def test_files_that_are_none(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.yaml").write_text(text)
    with pytest.raises(InputError, match=r"a\.yaml"):
        load_training_config(tmp_path / "a.yaml")


def test_texts_that_are_numbers_count_as_such() -> None:
    """YAML 1.1 reads 3e-4 as text."""
    assert tiny(hyperparameters={"n_steps": 256, "learning_rate": "3e-4"}).hyperparameters[
        "learning_rate"
    ] == pytest.approx(3e-4)


def test_differences() -> None:
    assert difference(tiny(steps=9, minutes=1.0), tiny()) is None
    assert difference(tiny(seed=9), tiny()) == "seed is 9 and was 3"
    other = tiny(environment=TINY["environment"] | {"people": 2})
    assert difference(other, tiny()) == "environment.people is 2 and was None"
    assert difference(tiny(), other) == "environment.people is None and was 2"
