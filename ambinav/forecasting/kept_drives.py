"""File of the outcomes of drives, so that an interrupted study goes on where it was."""

from __future__ import annotations

import json
from pathlib import Path

from ambinav.runtime.files import writable_parent


class KeptDrives:
    """Number of lost robots of each driven route, by the digest of all that it depends on.

    Each line of the file is a JSON object with the keys `drive` and `lost`; a line that was cut off
    by an interruption does not count.

    Args:
        path: The file, which need not exist; None: keep nothing.

    Raises:
        InputError: its folder cannot be made or written to.
    """

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self._lost: dict[str, int] = {}
        if path is not None:
            writable_parent(path)
            self._lost = dict(_read(path))

    def __len__(self) -> int:
        """Return the number of drives."""
        return len(self._lost)

    def get(self, drive: str) -> int | None:
        """Return how many robots got lost on a drive; None: it is not kept."""
        return self._lost.get(drive)

    def add(self, drive: str, lost: int) -> None:
        """Keep how many robots got lost on a drive."""
        self._lost[drive] = lost
        if self._path is not None:
            with self._path.open("a", encoding="utf-8") as file:
                # The line break comes first: what was cut off before is a line of its own.
                file.write("\n" + json.dumps({"drive": drive, "lost": lost}))

    def remove(self) -> None:
        """Remove the file."""
        if self._path is not None:
            self._path.unlink(missing_ok=True)


def _read(path: Path) -> list[tuple[str, int]]:
    drives = []
    for line in (
        path.read_text(encoding="utf-8", errors="replace").splitlines() if path.is_file() else ()
    ):
        try:
            plain = json.loads(line)
            drives.append((str(plain["drive"]), int(plain["lost"])))
        except (ValueError, KeyError, TypeError):
            continue
    return drives
