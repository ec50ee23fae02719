"""Windows as a data set of torch."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from torch.utils.data import Dataset

if TYPE_CHECKING:
    from .tracklets import Windows


class WindowDataset(Dataset[dict[str, torch.Tensor]]):
    """Every item is a window: tensors by the names of the columns of `Windows`."""

    def __init__(self, windows: Windows) -> None:
        from .tracklets import BY_WINDOW

        self._columns = {name: torch.from_numpy(getattr(windows, name)) for name in BY_WINDOW}
        self._count = len(windows)

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, row: int) -> dict[str, torch.Tensor]:
        return {name: column[row] for name, column in self._columns.items()}
