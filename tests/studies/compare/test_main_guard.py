"""Scripts that compare without a guard: refused in one sentence, and never left hanging."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

CALL = (
    "from ambinav.studies.compare.main_guard import check_guarded\n\n"
    "def work():\n    check_guarded('it')\n"
)


def run(folder: Path, text: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    (folder / "script.py").write_text(CALL + text)
    return subprocess.run(
        [sys.executable, *(arguments or ("script.py",))],
        cwd=folder, capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip


@pytest.mark.parametrize(
    "text",
    ["work()\n", "if True:\n    work()\n", "if __name__ == 'x':\n    pass\nelse:\n    work()\n"],
)
def test_unguarded(tmp_path: Path, text: str) -> None:
    done = run(tmp_path, text)
    last = text.count("\n") + CALL.count("\n")
    assert done.returncode == 1
    message = done.stderr.splitlines()[-1]
    assert f"script.py: line {last}: it starts processes" in message
    assert message.endswith('put it under `if __name__ == "__main__":`.')


@pytest.mark.parametrize(
    ("text", "arguments"),
    [
        ("if __name__ == '__main__':\n    print()\n    work()\n", ()),
        ("if '__main__' == __name__:\n    work()\n", ()),
        ("if __name__ == '__main__':\n    work()\n", ("-m", "script")),
        ("", ("-c", "import script; script.work()")),
    ],
)
def test_guarded(tmp_path: Path, text: str, arguments: tuple[str, ...]) -> None:
    done = run(tmp_path, text, *arguments)
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_a_comparison_does_not_hang(tmp_path: Path) -> None:
    """Without the check the first process waits for ever for the second one."""
    code = (
        "from pathlib import Path\n"
        "from ambinav.studies.compare.report import compare_routes\n"
        "compare_routes(None, 'out')\n"
    )
    (tmp_path / "compares.py").write_text(code)
    done = run(tmp_path, "", "compares.py")
    assert done.returncode == 1 and "compares.py: line 3: compare_routes starts" in done.stderr
    assert not (tmp_path / "out").exists()
