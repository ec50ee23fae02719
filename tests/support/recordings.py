"""Recordings read back from their files, as rerun itself reads them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Rows = dict[int, dict[str, Any]]


def read(path: Path) -> dict[str, Rows]:
    """Values by entity, frame (-1: static) and component."""
    from rerun.chunk import RrdReader

    found: dict[str, Rows] = {}
    for chunk in RrdReader(path).stream():
        batch = chunk.to_record_batch()
        rows = found.setdefault(chunk.entity_path.removeprefix("/"), {})
        columns = {name: batch.column(i).to_pylist() for i, name in enumerate(batch.schema.names)}
        for i in range(batch.num_rows):
            frame = -1 if chunk.is_static else columns["frame"][i]
            row = rows.setdefault(frame, {})
            values = {name.split(":")[-1]: column[i] for name, column in columns.items() if column[i] is not None}
            row.update(values)
    return found


def boxes(rows: Rows, frame: int) -> NDArray[np.float64]:
    """Boxes [n, 7] of a frame; yaw from the quaternion."""
    row = rows[frame]
    if not row["centers"]:
        return np.zeros((0, 7))
    turn = np.array(row["quaternions"])
    yaw = 2 * np.arctan2(turn[:, 2], turn[:, 3])
    return np.column_stack([row["centers"], yaw, 2 * np.array(row["half_sizes"])])
