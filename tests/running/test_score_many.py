"""Several stored runs in one table."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mtp_bench import RolloutError, run, score
from mtp_bench.running import load_run, save_run
from mtp_bench.running.stored import heaviest_samples, open_runs

ENV = "MTP-Intersection-v0"
Folders = tuple[Path, Path]


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> Folders:
    """Runs of stp and of standing objects."""
    root = tmp_path_factory.mktemp("runs")
    for agent in ("stp", "standing"):
        run(agent, ENV, root / agent, scenes=3)
    return root / "stp", root / "standing"


def test_each_pair_of_runs_is_tested_once(folders: Folders) -> None:
    report = score(folders).report
    pairs = {(row.agent, row.other) for row in report.paired}
    assert pairs == {("stp", "standing")}
    everything = next(row for row in report.paired if row.subset == "all")
    by_agent = {row.agent: row.error for row in report.rows if row.subset == "all"}
    assert everything.error is not None
    assert everything.error == pytest.approx((by_agent["stp"] or 0) - (by_agent["standing"] or 0))
    assert everything.error < 0


def test_one_agent_twice_has_the_names_of_its_folders(folders: Folders, tmp_path: Path) -> None:
    stored = load_run(folders[0])
    save_run(tmp_path / "again", stored.info, stored.rollouts)
    report = score([folders[0], tmp_path / "again"]).report
    names = [row.agent for row in report.rows if row.subset == "all"]
    assert names == [f"{folders[0].parent.name}/stp", "again"], "stp is the name of an agent"
    assert {row.error for row in report.paired if row.subset == "all"} == {0.0}


def test_folders_of_one_name_and_a_folder_given_twice(folders: Folders, tmp_path: Path) -> None:
    stored = load_run(folders[0])
    paths = [tmp_path / "a/my run", tmp_path / "b/my run"]
    for path in paths:
        save_run(path, stored.info, stored.rollouts)
    assert [opened.run.info.agent for opened in open_runs(paths)] == ["a/my_run", "b/my_run"]
    with pytest.raises(RolloutError, match="my run: named twice, expected each run once"):
        open_runs([paths[0], paths[0]])


def test_other_scenes_are_one_error(folders: Folders, tmp_path: Path) -> None:
    run("blind", ENV, tmp_path / "blind", scenes=2)
    with pytest.raises(RolloutError, match="were scored on different scenes"):
        score([folders[0], tmp_path / "blind"])


def test_another_task_is_one_error(folders: Folders, tmp_path: Path) -> None:
    run("blind", "MTP-Roundabout-v0", tmp_path / "blind", scenes=3)
    with pytest.raises(RolloutError, match="made for MTP-Roundabout-v0 with another"):
        score([folders[0], tmp_path / "blind"])


def test_no_run_is_one_error() -> None:
    with pytest.raises(RolloutError, match="no run, expected the folder of at least one"):
        score([])


def test_samples_cuts_every_run_alike(folders: Folders) -> None:
    report = score(folders, samples=2).report
    assert {row.samples for row in report.rows} == {2}
    assert {row.samples for row in report.paired} == {2}
    whole = score(folders).report
    assert (report.rows[0].minADE or 0) > (whole.rows[0].minADE or 0)
    assert "2 samples per object" in (report.rows[0].unranked_because or "")


@pytest.mark.parametrize("samples", [-1, 11])
def test_a_wrong_number_of_samples_is_one_error(folders: Folders, samples: int) -> None:
    with pytest.raises(RolloutError, match="expected 1 to the 10 that it has"):
        score(folders, samples=samples)


def test_the_heaviest_samples_stay_in_the_order_of_their_weights(folders: Folders) -> None:
    rollout = load_run(folders[0]).rollouts[0]
    log_weight = np.full_like(rollout.forecast_log_weight, -np.inf)
    log_weight[:, [7, 3, 5]] = np.log([0.2, 0.5, 0.3])
    cut = heaviest_samples(replace(rollout, forecast_log_weight=log_weight), 2)
    np.testing.assert_array_equal(cut.forecast, rollout.forecast[:, [3, 5]])
    np.testing.assert_allclose(np.exp(cut.forecast_log_weight), [[0.625, 0.375]] * len(log_weight), rtol=1e-6)
    faint = heaviest_samples(replace(rollout, forecast_log_weight=log_weight), 5)
    assert np.isfinite(faint.forecast_log_weight).sum(axis=1).tolist() == [3] * len(log_weight)
