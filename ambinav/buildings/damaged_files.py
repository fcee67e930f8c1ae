"""Errors of packages that read damaged files."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ambinav.runtime.errors import InputError


@contextmanager
def reading(path: Path, kind: str) -> Iterator[None]:
    """Raise `InputError` for a damaged file, whose entities lack what its format requires.

    Raises:
        InputError: something went wrong within.
    """
    try:
        yield
    except InputError:
        raise
    except Exception as error:  # ifcopenshell and ezdxf raise many kinds of errors then
        raise InputError(
            f"{path}: this {kind} file is damaged ({type(error).__name__}: "
            f"{' '.join(str(error).split())}); export it again."
        ) from error
