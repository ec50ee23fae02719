"""Arrow files of 123D: the columns that are asked for and the metadata; nothing else of a file is read."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from ...core import DataError, open_regular
from ..text import LIMIT


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Turn an error about the content of a file into a DataError that names it."""
    from pyarrow import ArrowException

    wrong = (
        OSError,
        ValueError,
        TypeError,
        LookupError,
        RecursionError,
        msgspec.MsgspecError,
        ArrowException,
    )
    try:
        yield
    except wrong as error:
        problem = (
            "there is no such file"
            if isinstance(error, FileNotFoundError)
            else str(error).partition("\n")[0]
        )
        raise DataError(f"{path} cannot be read as a file of 123D: {problem}") from None


def read_arrow(
    path: Path, columns: Mapping[str, int], prefix: str = ""
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Columns by name, less the ``prefix`` of those in the file, and the metadata.

    ``columns``: their names, and how many numbers [R, n] each entry is; 0 for words or bytes [R]. Entries of lists
    stand one after the other, and "row" [R] has the row of each. Raises DataError for a file that is wrong.
    """
    from pyarrow import compute, float64, ipc, list_

    with reading(path), open_regular(path) as stream:
        schema, found = ipc.open_file(stream).schema, dict[str, Any]()
        about = msgspec.msgpack.decode(
            (schema.metadata or {})[b"metadata"], type=dict[str, Any]
        )
        if not columns:
            return found, about
        if lost := [name for name in columns if prefix + name not in schema.names]:
            raise ValueError(
                f"no column {prefix + lost[0]!r}, found: {', '.join(schema.names)}"
            )
        index = [schema.get_field_index(prefix + name) for name in columns]
        table = ipc.open_file(
            stream, options=ipc.IpcReadOptions(included_fields=index)
        ).read_all()
        for name, width in columns.items():
            column = table.column(prefix + name).combine_chunks()
            column.validate(full=True)  # offsets of a broken file may point anywhere
            if str(column.type).startswith("list"):
                row, column = (
                    compute.list_parent_indices(column).to_numpy(),
                    column.flatten(),
                )
                if not np.array_equal(row, found.setdefault("row", row)):
                    raise ValueError(
                        f"{prefix + name} has other lengths of its lists than the columns before"
                    )
            if width > 1:
                column = column.cast(list_(float64(), width)).flatten()
            values = column.to_numpy(zero_copy_only=False)
            found[name] = (
                np.asarray(values, dtype=np.float64).reshape(-1, width)
                if width
                else values
            )
            if width > 1 and not (np.abs(found[name]) <= LIMIT).all():
                raise ValueError(
                    f"{prefix + name} has a number that is not finite, or beyond {LIMIT:g}"
                )
        return found, about
