"""The files of configs/rl-zoo: every key is one of the Zoo, the algorithm or the environment."""

from __future__ import annotations

import inspect
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import yaml

pytest.importorskip("gymnasium")

from ambinav_envs.registration import IDS
from ambinav_envs.scenario import scenario
from ambinav_envs.tasks import SUITES_WITH_IDS

FOLDER = Path(__file__).parents[3] / "configs" / "rl-zoo"
ZOO = {"n_envs", "n_timesteps", "policy", "normalize", "policy_kwargs", "env_kwargs"}
"""Keys that `ExperimentManager` takes before the rest goes to the algorithm; those used here."""
FILES = ("ppo", "sac", "ppo_lstm")


@cache
def entries(algorithm: str) -> dict[str, dict[str, Any]]:
    text = (FOLDER / f"{algorithm}.yml").read_text(encoding="utf-8")
    found: dict[str, dict[str, Any]] = yaml.safe_load(text)
    return found


def test_every_file_is_checked() -> None:
    assert sorted(path.stem for path in FOLDER.glob("*.yml")) == sorted(FILES)


@pytest.mark.parametrize("algorithm", FILES)
def test_ids_are_known_and_none_of_the_plain_ones_is_missing(algorithm: str) -> None:
    listed = set(entries(algorithm)) - {"default"}
    plain = {f"ambinav/{name.capitalize()}-v1" for name in (*SUITES_WITH_IDS, "navigation")}
    assert plain <= listed <= set(IDS)


@pytest.mark.parametrize("algorithm", FILES)
def test_arguments_of_the_environments_are_known(algorithm: str) -> None:
    for name, entry in entries(algorithm).items():
        given = {**IDS.get(name, {}), **entry["env_kwargs"]}
        places = {key: given.pop(key, None) for key in ("suite", "map", "buildings")}
        _, parameters = scenario(*places.values(), 0, None, given)
        assert all(getattr(parameters, key) is not None for key in given)


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", FILES)
def test_the_algorithms_take_what_is_left(algorithm: str) -> None:
    stable = pytest.importorskip("stable_baselines3")
    if algorithm == "ppo_lstm":
        kind = pytest.importorskip("sb3_contrib").RecurrentPPO
    else:
        kind = getattr(stable, algorithm.upper())
    from ambinav_envs.sb3 import make_sb3

    known = set(inspect.signature(kind.__init__).parameters)
    for name, entry in entries(algorithm).items():
        rest = {key: value for key, value in entry.items() if key not in ZOO}
        assert set(rest) <= known, name
        if "batch_size" in rest and "n_steps" in rest:
            assert rest["n_steps"] * entry["n_envs"] % rest["batch_size"] == 0
        assert float(entry["n_timesteps"]) >= 1e5
        normalize = eval(entry.get("normalize", "dict()"))
        assert set(normalize) <= {"norm_obs", "norm_reward"}
    # The Zoo's own: "lin_5e-4" falls from that to 0.
    rate = rest["learning_rate"]
    if isinstance(rate, str):
        kind_of_rate, begin = rate.split("_")
        assert kind_of_rate == "lin"
        rest["learning_rate"] = float(begin)
    small = {"n_steps": 8, "batch_size": 16, "buffer_size": 100}
    rest |= {key: value for key, value in small.items() if key in rest}
    envs = make_sb3("ambinav/Hall-v1", 2, **entry["env_kwargs"])
    policy_kwargs = eval(entry["policy_kwargs"])
    model = kind(entry["policy"], envs, policy_kwargs=policy_kwargs, device="cpu", **rest)
    assert model.gamma == 0.998
    envs.close()


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", FILES)
def test_the_reader_of_the_zoo_reads_them(algorithm: str, tmp_path: Path) -> None:
    manager = pytest.importorskip("rl_zoo3.exp_manager")
    from types import SimpleNamespace

    import ambinav_envs  # noqa: F401 - its ids

    for name in IDS:
        experiment = manager.ExperimentManager(
            SimpleNamespace(),
            algorithm,
            name,
            str(tmp_path),
            config=str(FOLDER / f"{algorithm}.yml"),
        )
        read, _ = experiment.read_hyperparameters()
        rest, wrapper, callbacks, vec_wrapper = experiment._preprocess_hyperparams(dict(read))
        wanted = entries(algorithm).get(name, entries(algorithm)["default"])
        assert experiment.env_kwargs == wanted["env_kwargs"]
        assert set(rest) == set(wanted) - ZOO | {"policy", "policy_kwargs"}
        assert (wrapper, callbacks, vec_wrapper) == (None, [], None)
