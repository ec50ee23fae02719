"""``mtp-bench fit-noise``: a card section from the detections of an env."""

import tomllib
from pathlib import Path
from typing import Any

import pytest

from mtp_bench.cards import parse_card
from mtp_bench.core.bundle import bundled
from tests.support.command_line import CommandLine

ENV = "MTP-Roundabout-v0"


def test_the_command_writes_a_section_that_makes_a_card(cli: CommandLine, tmp_path: Path) -> None:
    """Of two scenes; that a fit finds the noise which made the detections is of tests/detector/test_fit.py."""
    path = tmp_path / "noise.toml"
    arguments = ("fit-noise", "--env", ENV, "--scenes", "2", "--reach", "50", "--field-of-view", "300", "-o", path)
    assert cli(*arguments).out == ""
    assert "too few detections to fit: " in path.read_text()
    content: dict[str, Any] = tomllib.loads((bundled("envs") / f"{ENV}.toml").read_text())
    content["detector"] = tomllib.loads(path.read_text())["detector"]
    content["detector"]["noise"]["alike"] = dict.fromkeys(("truck", "bus", "motorcycle"), "car")
    card = parse_card({**content, "id": "MTP-Mine-v0"})
    assert card.detector is not None
    assert card.detector_name == "nuscenes_megvii-refit"
    assert (card.detector.reach, card.detector.field_of_view) == (50.0, 300.0)
    assert card.velocity


WRONG = {
    "score": (("--min-score", "high"), "--min-score is 'high', expected a number or class=number"),
    "class": (("--min-score", "kar=0.3"), "unknown class of --min-score 'kar': did you mean 'car'?"),
    "alike": (("--alike", "bus=kar"), "unknown fitted class of --alike 'kar': did you mean 'car'?"),
    "too high a score": (("--min-score", "2.0"), "no detector profile can be fitted"),
    "split": (("--split", "vall"), "unknown split of MTP-Roundabout-v0 'vall': did you mean 'val'?"),
    "output": (("-o", "/no/such/folder/noise.toml"), "/no/such/folder"),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_options_are_one_clear_error(name: str, cli: CommandLine) -> None:
    options, text = WRONG[name]
    assert text in cli("fit-noise", "--env", ENV, "--scenes", "1", *options).error
