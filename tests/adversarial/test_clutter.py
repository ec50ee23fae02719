"""False detections in an own log: an agent that is run on them never gets a better number."""

import shutil
from pathlib import Path

import numpy as np
import pytest

import mtp_bench
from mtp_bench.scoring.rows import Row

from ..support.planted_faults import FRAMES, write_log

ENV = "MTP-nuScenes-mini-v0"


def with_clutter(log: Path, folder: Path, cars: int, ghost: int) -> Path:
    """Copy own scenes, with standing false cars of score .05 to .15, and one of score .9 in ``ghost`` frames."""
    shutil.copytree(log, folder)
    rng = np.random.default_rng(0)
    places = rng.uniform((-60, -60), (90, -30), (cars, 2))
    rows = []
    for frame in range(FRAMES):
        for x, y in places + rng.normal(0, 0.1, (cars, 2)):
            rows.append(f"{frame},car,{x:.4f},{y:.4f},0,4.5,1.8,1.6,{rng.uniform(0.05, 0.15):.3f}")
        if 20 <= frame < 20 + ghost:
            rows.append(f"{frame},car,-20,60,0,4.5,1.8,1.6,0.9")
    with (folder / "log" / "detections.csv").open("a") as file:
        file.write("".join(f"{row}\n" for row in rows))
    return folder


def row_of_all(files: Path) -> Row:
    return mtp_bench.evaluate("stp", ENV, files=str(files), seeds=[0]).rows[0]


@pytest.mark.usefixtures("few_event_runs")
def test_false_detections_lower_no_number(tmp_path: Path) -> None:
    log = write_log(tmp_path / "clean")
    clean = row_of_all(log)
    assert clean.error is not None
    assert clean.plain_error is not None
    assert clean.error <= 1.02 * clean.plain_error  # a clean log is not judged at hardly any false forecast
    for cars, ghost in ((1, 0), (8, 0), (8, 20)):
        cluttered = row_of_all(with_clutter(log, tmp_path / f"{cars}-{ghost}", cars, ghost))
        assert cluttered.error is not None
        assert cluttered.error >= clean.error - 1e-9, (cars, ghost)
