"""Where datasets are looked for: the given root, else MTP_BENCH_DATA, else the user data folder."""

from __future__ import annotations

import os
from pathlib import Path

VARIABLE = "MTP_BENCH_DATA"


def data_root(data: str | Path | None) -> tuple[Path, str]:
    """The data root and, for messages, where its name comes from."""
    if data is not None:
        return Path(data).expanduser(), "given as data root"
    if os.environ.get(VARIABLE):
        return Path(os.environ[VARIABLE]).expanduser(), f"from {VARIABLE}"
    from platformdirs import user_data_path

    return user_data_path("mtp_bench", appauthor=False), "the user data folder"
