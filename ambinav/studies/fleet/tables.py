"""The tables of a fleet in Parquet."""

from __future__ import annotations

import typing
from collections.abc import Sequence
from typing import Any

from ambinav.reports.fields import Part


def parquet(rows: Sequence[dict[str, Any]], *kinds: type[Part]) -> bytes:
    """Return a table as a Parquet file; the same rows give the same bytes.

    Args:
        rows: Values by column.
        kinds: Parts that have the columns as fields, of text or numbers, in order.
    """
    import pyarrow as pa
    from pyarrow import parquet as files

    columns = {
        name: (_arrow_type(pa, info.annotation), info.description)
        for kind in kinds
        for name, info in kind.model_fields.items()
    }
    schema = pa.schema(
        [
            pa.field(name, arrow, metadata={"description": text} if text else None)
            for name, (arrow, text) in columns.items()
        ]
    )
    sink = pa.BufferOutputStream()
    files.write_table(pa.Table.from_pylist(list(rows), schema=schema), sink)
    return bytes(sink.getvalue())


def _arrow_type(pa: Any, annotation: Any) -> Any:
    """Return the type of a column: text, whole numbers, or numbers."""
    options = {annotation, *typing.get_args(annotation)}
    if str in options:
        return pa.string()
    return pa.int64() if int in options else pa.float64()
