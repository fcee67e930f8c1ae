"""Print the requirements of an installation with the hash of each file, for `--require-hashes`.

    pip install --dry-run --ignore-installed --report report.json ambinav
    python recipe/hashed_requirements.py report.json > requirements.txt

What has no hash, such as a folder or a wheel of our own, is left out: it is not from an index.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any


def requirements(report: dict[str, Any]) -> str:
    """Return the lines of a requirements file, by name, for the environment of a pip report."""
    environment = report["environment"]
    platform = f"{environment['sys_platform']} {environment['platform_machine']}"
    lines = []
    for item in report["install"]:
        digest = item["download_info"].get("archive_info", {}).get("hashes", {}).get("sha256")
        if digest and not item["is_direct"]:
            metadata = item["metadata"]
            lines.append(f"{metadata['name']}=={metadata['version']} --hash=sha256:{digest}")
    head = f"# Python {environment['python_version']} on {platform}; other files have other hashes."
    return "\n".join([head, *sorted(lines, key=str.lower)]) + "\n"


if __name__ == "__main__":
    print(requirements(json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))), end="")
