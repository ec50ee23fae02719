"""The environment of nuScenes on real data, through the commands."""

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
