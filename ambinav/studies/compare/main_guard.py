"""Detection of scripts without `if __name__ == "__main__":`, which must not start processes.

Fresh processes import the script that started them. One that is not guarded would begin the same
work again in each of them, which multiprocessing forbids: they die while the first one waits for
them to read their task, for ever.
"""

from __future__ import annotations

import ast
import inspect
import sys
from pathlib import Path

from ambinav.runtime.errors import InputError


def check_guarded(name: str) -> None:
    """Raise an error if the call comes from unguarded lines of a script.

    Args:
        name: Name of the call that starts processes, for the message.

    Raises:
        InputError: fresh processes would run this call again.
    """
    main = sys.modules.get("__main__")
    file, spec = getattr(main, "__file__", None), getattr(main, "__spec__", None)
    # Fresh processes import no package's __main__.py, and nothing where a user types.
    if file is None or (spec is not None and spec.name.endswith("__main__")):
        return
    frame = inspect.currentframe()
    while frame is not None:
        if frame.f_code.co_name == "<module>" and frame.f_globals is vars(main):
            break
        frame = frame.f_back
    if frame is None or _guarded(Path(file), frame.f_lineno):
        return
    raise InputError(
        f"{file}: line {frame.f_lineno}: {name} starts processes, and each of them would run this "
        'line again; put it under `if __name__ == "__main__":`.'
    )


def _guarded(file: Path, line: int) -> bool:
    """Return whether a line is inside an `if` that tests `__name__`.

    Files that are not Python count as guarded.
    """
    try:
        tree = ast.parse(file.read_bytes())
    except (OSError, SyntaxError, ValueError):
        return True
    return any(
        isinstance(node, ast.If)
        and "__name__" in (getattr(part, "id", "") for part in ast.walk(node.test))
        and node.body[0].lineno <= line <= (node.body[-1].end_lineno or line)
        for node in ast.walk(tree)
    )
