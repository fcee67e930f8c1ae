"""Reading of YAML files: errors are reported with file, line and remedy."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final, cast

import yaml

from ambinav.runtime.errors import InputError


def read_text(path: Path) -> str:
    """Return the text of a file in UTF-8.

    Raises:
        InputError: there is no such file, it is a folder, or it is not text.
    """
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path}: byte {error.start} is not UTF-8 text; save the file as UTF-8."
        ) from error
    except OSError as error:
        raise InputError(
            f"{path}: the file cannot be read ({error.strerror}); check the path."
        ) from error


MERGE: Final = "tag:yaml.org,2002:merge"
"""Tag of the key `<<`, which takes in another mapping."""


class _Loader(yaml.SafeLoader):
    """Safe loader that refuses a key that stands twice in a mapping, of which one would win."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """Construct a mapping whose keys differ."""
        seen = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode) or key.tag == MERGE:
                continue
            # With its type: 1 and "1" are two keys.
            word = key.tag, key.value
            if word in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f"the key {key.value!r} is given twice", key.start_mark
                )
            seen.add(word)
        return super().construct_mapping(node, deep)


def parse_yaml(text: str, where: str, example: str) -> object:
    """Parse YAML text into plain Python values.

    Args:
        text: The text.
        where: Names it in messages.
        example: Where to find one, named if it is empty.

    Raises:
        InputError: the text is not YAML, or holds nothing.
    """
    try:
        plain = yaml.load(text, Loader=_Loader)
    except yaml.MarkedYAMLError as error:
        line = f"line {error.problem_mark.line + 1}: " if error.problem_mark else ""
        raise InputError(
            f"{where}: {line}not valid YAML ({error.problem}); correct the file there."
        ) from error
    # PyYAML's constructors raise whatever an odd tagged value leads to.
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{where}: not valid YAML ({reason}); correct the file.") from error
    if plain is None:
        raise InputError(f"{where}: the file is empty; {example}.")
    return cast(object, plain)
