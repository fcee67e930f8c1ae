"""A small frozen benchmark, and a submission to it that tests do not change."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from ambinav_envs.leaderboard.frozen import FrozenBenchmark


@pytest.fixture(scope="session")
def submission_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with policies that do not navigate, and the hidden seed."""
    from tests.envs.sharing.submissions import ATTACKS, SECRET

    folder = tmp_path_factory.mktemp("submission")
    (folder / "attacks.py").write_text(ATTACKS)
    (folder / "secret.json").write_text(SECRET)
    return folder


@pytest.fixture(scope="session")
def frozen(submission_folder: Path) -> FrozenBenchmark:
    from tests.envs.sharing.submissions import small

    return small(submission_folder)


@pytest.fixture(scope="session")
def record(frozen: FrozenBenchmark, submission_folder: Path) -> dict[str, Any]:
    """A submission of an untrained network in one task and of a baseline in the other."""
    from ambinav_envs.leaderboard.submission import entries_for, make_record
    from tests.envs.policies.models import saved
    from tests.envs.sharing.submissions import PLAIN, ignore

    policies = [f"{PLAIN}={saved(submission_folder / 'mine.zip')}", "vfh"]
    return make_record(frozen, entries_for(frozen, policies, False), ignore)
