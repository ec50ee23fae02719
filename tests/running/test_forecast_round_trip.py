"""Forecasts of a run, written to a file and read back: nothing is lost that the form can hold."""

from pathlib import Path

import numpy as np
import pytest

from mtp_bench import import_forecasts, run, score
from mtp_bench.core import Rollout
from mtp_bench.running import RunOptions, export_forecasts, load_run, open_run
from mtp_bench.running.stored import heaviest_samples

# by form: samples that it holds
SAMPLES = {"mfeval": 10, "uniad": 6, "table": 10}
MFEVAL_CLASSES = 3  # car, truck and bus, the first of the task


def rollouts(folder: Path) -> dict[str, Rollout]:
    return {rollout.scene: rollout for rollout in load_run(folder).rollouts}


def assert_equal(here: Rollout, back: Rollout, rows: np.ndarray) -> None:
    """Every centimetre, weight, place and confidence of the objects ``rows`` [S]."""
    np.testing.assert_array_equal(here.forecast[rows], back.forecast)
    np.testing.assert_allclose(np.exp(here.forecast_log_weight[rows]), np.exp(back.forecast_log_weight), atol=1e-6)
    np.testing.assert_array_equal(here.object_box[rows, :2], back.object_box[:, :2])
    np.testing.assert_array_equal(here.object_confidence[rows], back.object_confidence)
    np.testing.assert_array_equal(here.object_class[rows], back.object_class)


def error_of(*folders: Path, data: Path, samples: int | None = None) -> list[float | None]:
    report = score(folders, data=data, samples=samples).report
    return [row.error for row in report.rows if row.subset == "all"]


@pytest.mark.data
def test_nuscenes_forms_lose_nothing(data_root: Path, tmp_path: Path) -> None:
    env, options = "MTP-nuScenes-mini-v0", RunOptions(str(data_root), split="mini_val")
    run("stp", env, tmp_path / "stp", options)
    for form, samples in SAMPLES.items():
        file = tmp_path / ("tables" if form == "table" else f"{form}.json")
        export_forecasts(open_run(tmp_path / "stp", str(data_root)), file, form)  # type: ignore[arg-type]
        import_forecasts(file, env, form, tmp_path / form, options)
        for name, rollout in rollouts(tmp_path / "stp").items():
            stated = rollout if form == "table" else heaviest_samples(rollout, samples)
            rows = stated.object_class < (MFEVAL_CLASSES if form == "mfeval" else 99)
            assert_equal(stated, rollouts(tmp_path / form)[name], rows)
    written, read = error_of(tmp_path / "stp", tmp_path / "table", data=data_root)
    assert written == read
    written, read = error_of(tmp_path / "stp", tmp_path / "uniad", data=data_root, samples=6)
    assert written == read
    tracks = [np.unique(each.track_id).size for each in rollouts(tmp_path / "uniad").values()]
    assert min(tracks) > 20


@pytest.mark.data
def test_tables_of_argoverse_lose_nothing(data_root: Path, tmp_path: Path) -> None:
    options = RunOptions(str(data_root), scenes=1)
    run("mtp", "MTP-AV2-v0", tmp_path / "mtp", options)
    export_forecasts(open_run(tmp_path / "mtp", str(data_root)), tmp_path / "tables")
    import_forecasts(tmp_path / "tables", "MTP-AV2-v0", "table", tmp_path / "back", options)
    for name, here in rollouts(tmp_path / "mtp").items():
        assert_equal(here, rollouts(tmp_path / "back")[name], np.ones(len(here.object_class), dtype=bool))
    written, read = error_of(tmp_path / "mtp", tmp_path / "back", data=data_root)
    assert written == read
