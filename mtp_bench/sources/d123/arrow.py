"""Arrow files of 123D: the columns that are asked for and the metadata.

Nothing else of a file is read.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from ...core import open_regular
from ..text import LIMIT, reading

FORM = "a file of 123D"


def read_arrow(
    path: Path, columns: Mapping[str, int], prefix: str = ""
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Read columns by name, less the ``prefix`` of those in the file, and metadata.

    ``columns``: their names, and how many numbers [R, n] each entry is; 0 for words or
    bytes [R]. Entries of lists stand one after the other, and "row" [R] has the row of
    each. Raises DataError for a file that is wrong.
    """
    from pyarrow import compute, ipc

    with reading(path, FORM), open_regular(path) as stream:
        schema = ipc.open_file(stream).schema
        content = (schema.metadata or {})[b"metadata"]
        metadata = msgspec.msgpack.decode(content, type=dict[str, Any])
        arrays: dict[str, Any] = {}
        if not columns:
            return arrays, metadata
        for name in columns:
            if prefix + name not in schema.names:
                names = ", ".join(schema.names)
                raise ValueError(f"no column {prefix + name!r}, found: {names}")
        index = [schema.get_field_index(prefix + name) for name in columns]
        options = ipc.IpcReadOptions(included_fields=index)
        table = ipc.open_file(stream, options=options).read_all()
        for name, width in columns.items():
            column = table.column(prefix + name).combine_chunks()
            column.validate(full=True)  # offsets of a broken file may point anywhere
            if str(column.type).startswith("list"):
                rows = compute.list_parent_indices(column).to_numpy()
                column = column.flatten()
                if not np.array_equal(rows, arrays.setdefault("row", rows)):
                    raise ValueError(
                        f"{prefix + name} has other lengths of its lists than the "
                        "columns before"
                    )
            arrays[name] = _to_numpy(column, width, prefix + name)
        return arrays, metadata


def _to_numpy(column: Any, width: int, name: str) -> Any:
    """Return numbers [R, width] of a column, or its words or bytes [R]."""
    from pyarrow import float64, list_

    if width > 1:
        column = column.cast(list_(float64(), width)).flatten()
    values = column.to_numpy(zero_copy_only=False)
    if not width:
        return values
    numbers = np.asarray(values, dtype=np.float64).reshape(-1, width)
    if width > 1 and not (np.abs(numbers) <= LIMIT).all():
        raise ValueError(f"{name} has a number that is not finite, or beyond {LIMIT:g}")
    return numbers
