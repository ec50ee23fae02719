"""Forecasts of `stp` in a table, changed as other programs may write them: what shows that they are read in a wrong way."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pyarrow import parquet, table

from mtp_bench import run
from mtp_bench.core import DataError
from mtp_bench.running import export_forecasts, import_forecasts, open_run

ENV = "MTP-Intersection-v0"
SCENES = 4
Columns = dict[str, Any]


@pytest.fixture(scope="module")
def tables(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("signs")
    run("stp", ENV, root / "run", scenes=SCENES)
    export_forecasts(open_run(root / "run"), root / "tables")
    return root / "tables"


def imported(tables: Path, folder: Path, change: Callable[[Columns], None]) -> list[str]:
    folder.mkdir()
    for path in tables.iterdir():
        content = parquet.read_table(path)
        columns = {name: content[name].to_numpy().copy() for name in content.column_names}
        change(columns)
        parquet.write_table(table(columns), folder / path.name)
    return import_forecasts(folder, ENV, "table", None, scenes=SCENES)


def places(columns: Columns) -> list[tuple[str, str]]:
    steps = range(1, sum(name[1:].isdigit() for name in columns) // 2 + 1)
    return [("x", "y"), *((f"x{step}", f"y{step}") for step in steps)]


def turned(columns: Columns) -> None:
    """Everything is turned by 30 degrees, as the ego's own axes may be."""
    cos, sin = np.cos(0.5), np.sin(0.5)
    for x, y in places(columns):
        columns[x], columns[y] = cos * columns[x] - sin * columns[y], sin * columns[x] + cos * columns[y]


def stretched(columns: Columns, pace: float) -> None:
    """Steps are ``pace`` times as long as a period of the task."""
    for x, y in places(columns)[1:]:
        columns[x] = columns["x"] + pace * (columns[x] - columns["x"])
        columns[y] = columns["y"] + pace * (columns[y] - columns["y"])


def confident(columns: Columns) -> None:
    """Less sure objects, half of them, are in places without a detection."""
    is_far = columns["confidence"] < np.median(columns["confidence"])
    for x, _ in places(columns):
        columns[x][is_far] += 100


def test_a_sound_file_has_no_sign(tables: Path, tmp_path: Path) -> None:
    assert "objects in" in imported(tables, tmp_path / "same", lambda columns: None)[1]


def test_ghosts_that_are_less_sure_are_no_other_frame(tables: Path, tmp_path: Path) -> None:
    imported(tables, tmp_path / "ghosts", confident)


def test_another_frame_of_reference(tables: Path, tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"surer objects lie within 1 m of a detection .* another frame of reference"):
        imported(tables, tmp_path / "turned", turned)


@pytest.mark.parametrize("pace", [0.5, 2.0])
def test_steps_of_another_rate(pace: float, tables: Path, tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"times as far in their forecasts of a second .* at another --rate"):
        imported(tables, tmp_path / "pace", lambda columns: stretched(columns, pace))


@pytest.mark.parametrize("pace", [0.0, 0.8, 1.2])
def test_slow_forecasts_and_such_that_stand_are_no_other_rate(pace: float, tables: Path, tmp_path: Path) -> None:
    imported(tables, tmp_path / "pace", lambda columns: stretched(columns, pace))
