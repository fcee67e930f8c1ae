"""Cards of data sets: the figures of the stored episodes, in the form of the Hub."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

pytest.importorskip("gymnasium")
pytest.importorskip("minari")
pytest.importorskip("h5py")

import ambinav as an
from ambinav_envs.file_arguments import files_of, with_absolute_files
from ambinav_envs.leaderboard.dataset import record_datasets
from ambinav_envs.leaderboard.dataset_card import ENDED, INFOS
from ambinav_envs.leaderboard.methods import follower_method

HALL = "ambinav/Hall-v1"


def record(
    env: str,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    author: str | None = None,
    **own: object,
) -> tuple[Any, dict[str, Any], str]:
    """Return a data set of three short episodes, the YAML of its card, and the text of it."""
    given = {"longest": 6.0, "max_steps": 30, "window": False, **own}
    (made,) = record_datasets([follower_method(0.0)], env, given, 3, 5, folder, author=author)
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(folder))
    _, head, text = (folder / made.id / "README.md").read_text().split("---\n", 2)
    minari = pytest.importorskip("minari")
    return minari.load_dataset(made.id), yaml.safe_load(head), text


def test_a_card_says_what_is_stored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stored, head, text = record(
        HALL, tmp_path / "sets", monkeypatch, "A.\nNother | Co", buildings=1
    )
    episodes = list(stored.iterate_episodes())
    ends = list(stored.storage.get_episode_metadata(range(3)))
    returns = [episode.rewards.sum() for episode in episodes]
    figures = re.search(r"sum of rewards \| (\S+) \+/- (\S+) \((\S+) to (\S+)\)", text)
    wanted = (np.mean(returns), np.std(returns), min(returns), max(returns))
    assert figures and [float(figure) for figure in figures.groups()] == pytest.approx(
        wanted, abs=6e-4
    )
    assert f"| steps | {stored.total_steps} " in text
    counts = dict.fromkeys(sorted(end["outcome"] for end in ends), 0)
    for end in ends:
        counts[end["outcome"]] += 1
    assert f"| 3: {', '.join(f'{count} {name}' for name, count in counts.items())};" in text
    assert head["license"] == "apache-2.0" and HALL in head["tags"]
    assert head["size_categories"] == ["n<1K"] and stored.total_steps < 1000
    metadata = stored.storage.metadata
    assert metadata["author"] == {"A.\nNother | Co"}
    assert "| author | A. Nother \\| Co |" in text
    for value in (
        metadata["algorithm_name"], metadata["code_permalink"], *metadata["requirements"],
        metadata["description"], stored.spec.dataset_id,
    ):  # fmt: skip
        assert value in text
    assert f"v{an.__version__}" in metadata["code_permalink"]
    for name in (*stored.observation_space, *INFOS, *ENDED):
        assert f"| `{name}` |" in text
    # Its evaluation takes buildings in which nothing was recorded.
    unseen = stored.recover_environment(eval_env=True)
    assert unseen.spec.kwargs == {
        **stored.env_spec.kwargs, "first_building": 1_000_000, "buildings": 100,
    }  # fmt: skip
    blocks = re.findall(r"```yaml\n(.*?)```", text, re.DOTALL)
    assert [yaml.safe_load(block) for block in blocks] == [
        stored.env_spec.kwargs, unseen.spec.kwargs,
    ]  # fmt: skip


def test_a_map_of_somebody_has_its_own_licence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = tmp_path / "own.geojson"
    own.write_text('{"type": "Polygon", "coordinates": [[[0, 0], [9, 0], [9, 7], [0, 7], [0, 0]]]}')
    monkeypatch.chdir(tmp_path)
    stored, head, text = record(
        "ambinav/Navigation-v1", tmp_path / "sets", monkeypatch, map=own.name
    )
    assert head["license"] == "other" and "That of the map" in text and "author" not in text
    # It is read again from any folder.
    monkeypatch.chdir("/")
    assert stored.env_spec.kwargs["map"] == str(own) and stored.recover_environment() is not None
    assert f"The map is the file `{own}`, which the data set does not hold" in text
    assert "`stored.recover_environment(map=...)`" in text
    assert stored.recover_environment(eval_env=True).spec.kwargs == stored.env_spec.kwargs


def test_names_of_files_are_made_absolute(tmp_path: Path) -> None:
    for name in ("own.geojson", "eye.yaml"):
        (tmp_path / name).touch()
    given = {"scanner": "eye.yaml", "map": {"file": "own.geojson", "level": 2}, "people": 2}
    eye, own = str(tmp_path / "eye.yaml"), str(tmp_path / "own.geojson")
    made = with_absolute_files(given, tmp_path)
    assert made == {"scanner": eye, "map": {"file": own, "level": 2}, "people": 2}
    assert files_of(made) == {"map": own, "scanner": eye}
    unchanged = {"scanner": "rplidar-a1", "map": "gone.yaml"}
    assert with_absolute_files(unchanged, tmp_path) == unchanged and files_of(unchanged) == {}
