"""Points from PLY, PCD and text, in chunks."""

from __future__ import annotations

import codecs
import itertools
import re
import reprlib
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import BinaryIO, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambinav.runtime.errors import InputError
from ambinav.runtime.kernels import kernel

Points = NDArray[np.float64]
Field = tuple[str, str] | tuple[str, str, tuple[int, ...]]
"""Name and NumPy type of a column; how many numbers it holds, if it does not hold one."""

AT_ONCE: Final = 1_000_000
"""Points that are held at a time."""
_NUMBER: Final = rb"(?:[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|[-+]?inf|nan)"
_POINT: Final = re.compile(rb"\s*%b(?:[\s,;]+%b){2}(?![^\s,;])" % (_NUMBER, _NUMBER))
# Lines of text take more time and memory than numbers do.
_LINES_AT_ONCE: Final = 200_000
_LONGEST_HEADER: Final = 1000
_LONGEST_LINE: Final = 1000
_PLY_TYPES: Final = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4",
    "float": "f4", "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2",
    "int32": "i4", "uint32": "u4", "float32": "f4", "float64": "f8",
}  # fmt: skip
_PLY_ORDER: Final = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_SURFACES: Final = frozenset(("face", "tristrips"))
_PCD_TYPES: Final = {"F": "f", "I": "i", "U": "u"}
_UNMOVED: Final = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]


class Element(NamedTuple):
    """Element of a PLY file.

    Attributes:
        name: "vertex", "face" and the like.
        size: How many there are.
        fields: Name and NumPy type of each property; None if one of them is a list.
    """

    name: str
    size: int
    fields: list[Field] | None


def ply_elements(file: BinaryIO, path: Path) -> tuple[str, list[Element]]:
    """Read format and elements of a PLY file; leave the file at the end of its header.

    Raises:
        InputError: it has no such header.
    """
    lines = [file.readline().split()]
    while lines[-1] != [b"end_header"] and len(lines) < _LONGEST_HEADER:
        lines.append(file.readline().split())
    words = [[word.decode("latin-1") for word in line] for line in lines]
    kind, elements = "", []
    try:
        if words[0] != ["ply"] or words[-1] != ["end_header"]:
            raise ValueError("its header has no end")
        for line in words[1:-1]:
            if line[:1] == ["format"]:
                kind = line[1]
            elif line[:1] == ["element"]:
                elements.append(Element(line[1], _count(line[2], f"element {line[1]}"), []))
            elif line[:2] == ["property", "list"]:
                elements[-1] = elements[-1]._replace(fields=None)
            elif line[:1] == ["property"] and elements[-1].fields is not None:
                elements[-1].fields.append((line[2], _PLY_ORDER[kind] + _PLY_TYPES[line[1]]))
        if kind not in _PLY_ORDER:
            raise ValueError(f"its format is {kind!r}")
    except (ValueError, IndexError, KeyError) as error:
        raise InputError(
            f"{path}: it has no header of a PLY file ({error}); export it again."
        ) from error
    return kind, elements


def _count(word: str, field: str) -> int:
    """Return the number in a header; a ValueError says that it is none."""
    if not word.isdecimal():
        raise ValueError(f"{field} is {word!r}")
    return int(word)


def ply_without_faces(path: Path) -> bool:
    """Return whether a PLY file holds only points; False if it is not a PLY file."""
    try:
        with path.open("rb") as file:
            _, elements = ply_elements(file, path)
    except (OSError, InputError):
        return False
    filled = {element.name for element in elements if element.size > 0}
    return "vertex" in filled and not filled & _SURFACES


def ply_points(path: Path, notes: list[str]) -> Iterator[Points]:
    """Yield the vertices of a PLY file."""
    with path.open("rb") as file:
        kind, elements = ply_elements(file, path)
        if any(element.size and element.name in _SURFACES for element in elements):
            raise InputError(f"{path}: it has faces; read it as a mesh, with read_mesh.")
        for element in elements:
            if element.name == "vertex":
                break
            if kind == "ascii":
                for _ in itertools.islice(content_lines(file), element.size):
                    pass
            elif element.fields is not None:
                file.seek(element.size * np.dtype(element.fields).itemsize, 1)
            elif element.size:
                raise InputError(f"{path}: its vertices are not first in it; export it again.")
        else:
            raise InputError(f"{path}: there are no vertices in it; give a cloud of points.")
        if element.fields is None:
            raise InputError(f"{path}: its vertices have lists; export it without them.")
        yield from _rows(file, path, element.fields, element.size, kind == "ascii")


def pcd_points(path: Path, notes: list[str]) -> Iterator[Points]:
    """Yield the points of a PCD file; add a note if it says that the sensor has moved."""
    with path.open("rb") as file:
        head: dict[str, list[str]] = {}
        for _ in range(_LONGEST_HEADER):
            words = file.readline().decode("latin-1").split()
            if words and not words[0].startswith("#"):
                head[words[0]] = words[1:]
            if "DATA" in head:
                break
        try:
            sizes = zip(head["TYPE"], head["SIZE"], strict=True)
            types = [f"<{_PCD_TYPES[letter]}{size}" for letter, size in sizes]
            repeated = [_count(n, "COUNT") for n in head.get("COUNT", ["1"] * len(types))]
            parts = zip(head["FIELDS"], types, repeated, strict=True)
            # Fields of padding share a name.
            fields: list[Field] = [
                (
                    name if name in ("x", "y", "z") else f"{k} {name}",
                    code,
                    () if times == 1 else (times,),
                )
                for k, (name, code, times) in enumerate(parts)
            ]
            count = _count(head["POINTS"][0], "POINTS") if "POINTS" in head else (
                _count(head["WIDTH"][0], "WIDTH") * _count(head["HEIGHT"][0], "HEIGHT")
            )  # fmt: skip
            (kind,) = head["DATA"]
            moved = list(map(float, head.get("VIEWPOINT", _UNMOVED))) != _UNMOVED
        except (KeyError, ValueError, IndexError) as error:
            raise InputError(
                f"{path}: it has no header of a PCD file ({type(error).__name__}: {error}); "
                "export it again."
            ) from error
        if moved:
            notes.append(
                f"{path}: its VIEWPOINT, {' '.join(head['VIEWPOINT'])}, is not used; its points "
                "count as those of the building."
            )
        if kind == "binary_compressed":
            yield from _pcd_compressed(file, path, fields, count)
        elif kind in ("ascii", "binary"):
            yield from _rows(file, path, fields, count, kind == "ascii")
        else:
            raise InputError(f"{path}: DATA is {kind!r}; export it as ascii or binary.")


def text_points(path: Path, notes: list[str]) -> Iterator[Points]:
    """Yield x, y and z, the first three numbers of each line; skip lines before the first."""
    with path.open("rb") as file:
        for line in file:
            line = line.removeprefix(codecs.BOM_UTF8).partition(b"#")[0]
            if _POINT.match(line):
                break
            if b"\0" in line or len(line) > _LONGEST_LINE:
                raise InputError(
                    f"{path}: this is not a text of numbers; give lines of x, y and z."
                )
        else:
            raise InputError(f"{path}: there is no point in it; give lines of x, y and z.")
        separator = "," if b"," in line else ";" if b";" in line else None
        remaining_lines = itertools.chain([line], file)
        yield from _lines(content_lines(remaining_lines), path, [0, 1, 2], None, separator)


def _rows(
    file: BinaryIO, path: Path, fields: list[Field], count: int, text: bool
) -> Iterator[Points]:
    """Yield points of rows with these fields."""
    dtype = _with_xyz(fields, path)
    if text:
        # Fields that hold several numbers are so many columns.
        width = [int(np.prod(dtype[name].shape, dtype=int)) for name in dtype.names or ()]
        first = dict(zip(dtype.names or (), np.cumsum([0, *width]).tolist(), strict=False))
        yield from _lines(
            itertools.islice(content_lines(file), count), path, [first[a] for a in "xyz"], count
        )
        return
    for start in range(0, count, AT_ONCE):
        row_count = min(AT_ONCE, count - start)
        rows = np.fromfile(file, dtype, row_count)
        if len(rows) < row_count:
            raise cut_off(path, start + len(rows), count)
        yield np.stack([rows[axis].astype(np.float64) for axis in "xyz"], axis=1)


def _with_xyz(fields: list[Field], path: Path) -> np.dtype[np.void]:
    """Return the dtype of rows, if they have x, y and z."""
    try:
        dtype: np.dtype[np.void] = np.dtype(fields)
    except (ValueError, TypeError) as error:
        raise InputError(
            f"{path}: its fields cannot be used ({error}); export it again."
        ) from error
    if not {"x", "y", "z"} <= set(dtype.names or ()):
        raise InputError(f"{path}: its points have no x, y and z; export it again.")
    return dtype


def content_lines(lines: Iterable[bytes]) -> Iterator[bytes]:
    """Yield lines that are neither empty nor comments."""
    return (line for line in lines if line.strip() and not line.lstrip().startswith(b"#"))


def _lines(
    lines: Iterator[bytes],
    path: Path,
    columns: list[int],
    count: int | None,
    separator: str | None = None,
) -> Iterator[Points]:
    """Yield points of lines of numbers with this separator; None: spaces."""

    def parsed(lines: list[bytes]) -> Points:
        texts = (line.decode("latin-1") for line in lines)
        return np.loadtxt(texts, usecols=columns, delimiter=separator, ndmin=2, comments="#")

    seen = 0
    while chunk := list(itertools.islice(lines, _LINES_AT_ONCE)):
        try:
            rows = parsed(chunk)
        except ValueError as error:
            bad = _first_bad(chunk, parsed)
            if count is not None and bad == len(chunk) - 1 and next(lines, None) is None:
                raise cut_off(path, seen + bad, count) from error
            line = reprlib.repr(chunk[bad].decode("latin-1").strip())
            raise InputError(
                f"{path}: after {seen + bad} points a line is not x, y and z, {line}; give numbers "
                "with decimal points."
            ) from error
        seen += len(rows)
        yield rows
    if count is not None and seen < count:
        raise cut_off(path, seen, count)


def _first_bad(lines: list[bytes], parsed: Callable[[list[bytes]], Points]) -> int:
    """Return the index of the first line that cannot be parsed; one cannot."""
    low, high = 0, len(lines)
    while high - low > 1:
        middle = (low + high) // 2
        try:
            parsed(lines[low:middle])
        except ValueError:
            high = middle
        else:
            low = middle
    return low


def cut_off(path: Path, present: int, count: int) -> InputError:
    """Return the error for a file that holds fewer points than it states."""
    return InputError(
        f"{path}: it is cut off: there are {present} points of {count} in it; copy it again."
    )


def _pcd_compressed(
    file: BinaryIO, path: Path, fields: list[Field], count: int
) -> Iterator[Points]:
    """Yield points of a PCD file whose columns are packed one after the other."""
    dtype = _with_xyz(fields, path)
    packed, size = [*np.fromfile(file, "<u4", 2).tolist(), 0, 0][:2]
    source = np.fromfile(file, np.uint8, packed)
    plain = np.empty(size, np.uint8)
    if size != count * dtype.itemsize or len(source) < packed or not _unpack(source, plain):
        raise InputError(f"{path}: it is cut off or damaged; copy it again.")
    assert dtype.fields is not None
    columns = []
    for axis in "xyz":
        kind, first = dtype.fields[axis][:2]
        columns.append(plain[first * count :][: kind.itemsize * count].view(kind))
    for start in range(0, count, AT_ONCE):
        part = slice(start, start + AT_ONCE)
        yield np.stack([column[part].astype(np.float64) for column in columns], axis=1)


@kernel
def _unpack(source, plain):
    """Unpack data packed by liblzf (lzf_d.c); return whether it fills `plain`."""
    read = written = 0
    while read < source.size:
        control = np.int64(source[read])
        read += 1
        if control < 32:
            length = control + 1
            if read + length > source.size or written + length > plain.size:
                return False
            for _ in range(length):
                plain[written] = source[read]
                read += 1
                written += 1
            continue
        length = control >> 5
        back = (control & 31) << 8
        if length == 7:
            if read >= source.size:
                return False
            length += np.int64(source[read])
            read += 1
        if read >= source.size:
            return False
        back += np.int64(source[read]) + 1
        read += 1
        if back > written or written + length + 2 > plain.size:
            return False
        for _ in range(length + 2):
            plain[written] = plain[written - back]
            written += 1
    return written == plain.size
