"""The environments of nuScenes, WILDTRACK and 3DMOT2015 on real data, through the commands."""

import shutil
from pathlib import Path

import pytest

from tests.support.command_line import CommandLine, read_json

pytestmark = [pytest.mark.data, pytest.mark.usefixtures("few_event_runs")]


def test_false_positives_are_not_measurable_where_only_targets_are_known(cli: CommandLine, tmp_path: Path) -> None:
    arguments = ("compare", "stp", "--env", "MTP-nuScenes-v0", "--split", "train", "--scenes", 2, "--seeds", 1)
    printed = cli.ok(*arguments, "--full", "--json", tmp_path / "a.json")
    assert "false forecasts cannot be known" in " ".join(printed.split())
    content = read_json(tmp_path / "a.json")
    assert content["condition"]["truth"] == "prediction targets only: false forecasts cannot be known"
    assert content["condition"]["detections"] == "megvii, stored detections (2 scenes)"
    for row in content["details"]:
        assert [row[name] for name in ("brier", "false_per_frame", "EPA", "AP_f")] == [None] * 4
        tracking = row["tracking"]
        assert (tracking["false_positives"], tracking["false_tracks"]) == (None, None)
        assert [tracking["all"][name] for name in ("FP", "MOTA", "IDF1", "HOTA")] == [None] * 4


def test_a_detection_file(cli: CommandLine, tmp_path: Path, data_root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same detections under another name: the same scores, another digest."""
    shutil.copy(data_root / "nuscenes/detections/megvii_mini.json", tmp_path / "mine.json")
    common = ("--env", "MTP-nuScenes-mini-v0", "--split", "mini_val", "--scenes", 1)
    for name, further in (("by_name", ()), ("by_file", ("--detections", "mine.json"))):
        monkeypatch.chdir(tmp_path)
        cli.ok("run", "stp", *common, *further, "-o", tmp_path / name)
        monkeypatch.chdir("/")  # a stored run knows its file wherever it is scored
        cli.ok("score", tmp_path / name, "--json", tmp_path / f"{name}.json")
    by_name, by_file = (read_json(tmp_path / f"{name}.json") for name in ("by_name", "by_file"))
    assert by_name["rows"][0]["minADE"] == by_file["rows"][0]["minADE"]
    assert by_file["condition"]["detector"] == "megvii-mine"
    assert by_name["condition"]["card"] != by_file["condition"]["card"]
