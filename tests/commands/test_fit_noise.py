"""``mtp-bench fit-noise``: a card section from the detections of an env."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest

from mtp_bench._bundle import bundled
from mtp_bench.cards import load_card, parse_card
from mtp_bench.detector import Profile
from tests.support.command_line import CommandLine

ENV = "MTP-Roundabout-v0"
SCENES = 2  # of any split they hold enough cars; the search for false positives is of tests/detector/test_fit.py


@pytest.fixture(scope="module")
def section(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The file of a fit, made once."""
    from mtp_bench.running.options import RunOptions
    from mtp_bench.training.noise_profile import fit_noise

    path = tmp_path_factory.mktemp("fit") / "mine.toml"
    path.write_text(fit_noise(ENV, RunOptions(scenes=SCENES), name="mine-2026"))
    return path


def test_the_section_makes_a_card(section: Path) -> None:
    content: dict[str, Any] = tomllib.loads((bundled("envs") / f"{ENV}.toml").read_text())
    content["detector"] = tomllib.loads(section.read_text())["detector"]
    content["detector"]["noise"]["alike"] = dict.fromkeys(("truck", "bus", "motorcycle"), "car")
    card = parse_card({**content, "id": "MTP-Mine-v0"})
    assert card.detector is not None
    assert card.detector_name == "mine-2026"
    assert (card.detector.reach, card.detector.field_of_view) == (60.0, 360.0)
    assert card.velocity


def test_the_fit_finds_the_noise_that_made_the_detections(section: Path) -> None:
    found = tomllib.loads(section.read_text())["detector"]["noise"]
    detector = load_card(ENV).detector
    assert detector is not None
    noise = detector.resolved
    assert isinstance(noise, Profile)
    car = noise.noise("car")
    assert found["dt"] == 0.5
    fitted = found["classes"]["car"]
    assert fitted["quality"]["floor"] == pytest.approx(0.3, abs=0.01)
    assert fitted["radial"]["s0"] + 3 * fitted["radial"]["s1"] == pytest.approx(
        car.radial.s0 + 3 * car.radial.s1, rel=0.2
    )
    assert fitted["heading"]["scale"] == pytest.approx(car.heading.scale, rel=0.15)
    assert fitted["velocity"] == pytest.approx(0.25, rel=0.1)
    assert fitted["radial"]["quality"] == pytest.approx(car.radial.quality, abs=0.15)


def test_the_command_writes_and_prints(cli: CommandLine, tmp_path: Path) -> None:
    path = tmp_path / "noise.toml"
    arguments = ("fit-noise", "--env", ENV, "--scenes", "1", "--reach", "40", "--field-of-view", "180")
    assert cli(*arguments, "-o", path).out == ""
    printed = cli(*arguments).out
    assert printed == path.read_text()
    detector = tomllib.loads(printed)["detector"]
    assert (detector["reach"], detector["field_of_view"]) == (40.0, 180.0)
    assert detector["noise"]["name"] == "nuscenes_megvii-refit"
    assert "too few detections to fit: " in printed


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
