"""The data as a cause: planted faults of two cars take the blame, and the numbers stay."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mtp_bench
from mtp_bench import load_card
from mtp_bench.cards.source import DataSection
from mtp_bench.core import NO_PROGRESS
from mtp_bench.doubts import Doubt
from mtp_bench.running import doctor, open_run
from mtp_bench.scoring import BELOW_THRESHOLD, PARTS, named_parts
from mtp_bench.viz import Focus, find_incident, replays, sentence, study
from mtp_bench.viz.doubted import blamed_parts, doubt_numbers
from tests.support.command_line import CommandLine, read_json

ENV = "MTP-nuScenes-v0"
FRAMES = 30
PADDED_FROM = 21
HUNG = (12, 13, 14)  # frames with the detections of frame 11


def write_log(folder: Path, fault: str) -> Path:
    """Write two cars at 2 m/s with exact detections, and a fault in one of the tables."""
    truth = ["frame,id,class,x,y,yaw,l,w,h"]
    detections = ["frame,class,x,y,yaw,l,w,h"]
    for frame in range(FRAMES):
        for number, (x, y) in enumerate([(0.0, 0.0), (10.0, 8.0)]):
            true_frame = frame + 1 if fault == "late truth" else frame
            place = f"{x + frame},{y}"
            if fault == "padded" and number == 1 and frame >= PADDED_FROM:
                place = "0.0,0.0"
            truth.append(f"{true_frame},{number},car,{place},0.0,4.5,1.8,1.6")
            seen = 11 if fault == "hung" and frame in HUNG else frame
            detections.append(f"{frame},car,{x + seen},{y},0.0,4.5,1.8,1.6")
    (folder / "log").mkdir(parents=True)
    (folder / "log" / "truth.csv").write_text("\n".join(truth) + "\n")
    (folder / "log" / "detections.csv").write_text("\n".join(detections) + "\n")
    return folder


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("runs")
    made = {}
    for fault in ("healthy", "late truth", "padded", "hung"):
        made[fault] = folder / fault
        mtp_bench.run("stp", ENV, made[fault], files=write_log(folder / f"{fault} log", fault))
    return made


def worst(cli: CommandLine, run: Path, *words: str) -> tuple[str, Any]:
    printed = cli.ok("worst", run, "--json", run.parent / "worst.json", *words)
    return " ".join(printed.split()), read_json(run.parent / "worst.json")


def doubted_frames(run: Path) -> Iterator[tuple[int, int]]:
    """Yield object and frame of the targets whose error is the data's."""
    opened = open_run(run)
    for played in replays(opened, None, NO_PROGRESS):
        data = played.part[:, PARTS.index("data")]
        truth = played.scene.truth
        for row in np.flatnonzero(data > 0).tolist():
            yield int(truth.object_id[row]), int(truth.frame_of_rows[row])


@pytest.mark.parametrize(
    ("fault", "quote"),
    [
        ("late truth", "detections are 0.50 s early (1.0 frames)"),
        ("padded", "true car 1 is at x = y = 0 in 9 frames from frame 21 on: padded rows? Cure: delete the rows"),
        ("hung", "3 frames, the first of them 12, repeat the detections of the frame before: did the detector hang?"),
    ],
)
def test_a_planted_fault_takes_the_blame(cli: CommandLine, runs: dict[str, Path], fault: str, quote: str) -> None:
    printed, content = worst(cli, runs[fault])
    assert [moment["fault"] for moment in content["moments"][:1]] == ["data"]
    assert quote in printed
    trusting, plain = worst(cli, runs[fault], "--no-doctor")
    assert "data" not in {moment["fault"] for moment in plain["moments"]} | plain["parts"].keys()
    assert quote not in trusting
    for key in ("error", "cost"):
        assert content[key] == pytest.approx(plain[key], abs=1e-12), "numbers stay"
    (played,) = replays(open_run(runs[fault]), None, NO_PROGRESS)
    at = find_incident(played, content["moments"][0]["moment"])
    assert quote in sentence(Focus(played, at))


def test_only_moments_that_the_doubt_touches_are_of_the_data(runs: dict[str, Path]) -> None:
    task = load_card(ENV).task
    assert {number for number, _ in doubted_frames(runs["late truth"])} == {0, 1}
    padded = list(doubted_frames(runs["padded"]))
    assert {number for number, _ in padded} == {1}
    assert min(frame for _, frame in padded) == PADDED_FROM - task.future
    hung = list(doubted_frames(runs["hung"]))
    assert {number for number, _ in hung} == {0, 1}
    assert max(frame for _, frame in hung) < HUNG[-1] + task.past
    assert not list(doubted_frames(runs["healthy"]))


def test_healthy_data_have_no_part_in_it(cli: CommandLine, runs: dict[str, Path]) -> None:
    printed, content = worst(cli, runs["healthy"])
    assert "data" not in printed
    assert content["faults"]["data"] == 0
    assert cli.ok("worst", runs["healthy"]) == cli.ok("worst", runs["healthy"], "--no-doctor")
    assert cli.ok("events", runs["healthy"]) == cli.ok("events", runs["healthy"], "--no-doctor")
    assert "0 of " in cli.ok("worst", runs["healthy"], "--cause", "data")


def test_the_study_quotes_doubts_and_sums_their_part(runs: dict[str, Path], tmp_path: Path) -> None:
    files = runs["padded"].parent / "padded log"
    doubts = doctor(ENV, files=files).doubts
    made = study(["stp"], ENV, tmp_path / "study", doubts=doubts, files=files)
    assert "padded rows? Cure: delete the rows" in made.findings[0]
    assert "padded rows?" in made.page.read_text()
    (row,) = [row for row in made.tables["parts"].rows if row["agent"] == "stp"]
    (played,) = replays(open_run(runs["padded"]), None, NO_PROGRESS)
    parts = played.part[np.isfinite(played.part[:, 0])].mean(axis=0)
    assert [row[name] for name in PARTS] == pytest.approx(parts.tolist())
    assert not {"parts_with_forecast", "parts_without_forecast"} & made.tables.keys()
    assert "parts" not in [figure.name for figure in made.figures]


def test_who_trusts_the_data_has_no_doubt(runs: dict[str, Path]) -> None:
    opened = open_run(runs["padded"])
    section = DataSection(doctor="off", reason="rows at zero are right here")
    trusting = replace(opened, card=opened.card.model_copy(update={"data": section}))
    for run, kinds in ((opened, ["padded_zeros"]), (trusting, [])):
        (played,) = replays(run, None, NO_PROGRESS)
        assert [doubt.kind for doubt in played.doubts] == kinds
    assert load_card("MTP-Intersection-v0").is_trusted, "simulated"
    assert not load_card(ENV).is_trusted


def doubt(first: int, last: int, *objects: int) -> Doubt:
    return Doubt.model_construct(first=first, last=last, objects=objects)


def test_which_targets_a_doubt_touches() -> None:
    card = load_card(ENV)
    past, future = card.task.past, card.task.future
    frame = np.array([20 - future - 1, 20 - future, 22 + past - 1, 22 + past] * 2)
    object_id = np.repeat([1, 2], 4)

    def touched(*doubts: Doubt) -> list[int]:
        numbers: list[int] = doubt_numbers(doubts, card, frame, object_id).tolist()
        return numbers

    assert touched() == [-1] * 8
    assert touched(doubt(-1, -1)) == [0] * 8, "the whole scene"
    assert touched(doubt(-1, -1, 2)) == [-1] * 4 + [0] * 4
    assert touched(doubt(20, 22)) == [-1, 0, 0, -1] * 2
    assert touched(doubt(20, 22, 1)) == [-1, 0, 0, -1] + [-1] * 4
    assert touched(doubt(20, -1)) == [-1, 0, 0, 0] * 2, "until the end"
    assert touched(doubt(20, 22, 1), doubt(-1, -1)) == [1, 0, 0, 1] + [1] * 4, "the gravest first"


def test_below_threshold_stays_and_parts_add_up() -> None:
    part = np.arange(22.0).reshape(2, 11) + 1.0
    moved = blamed_parts(np.vstack([part, np.full(11, np.nan)]), np.array([True, False, True]))
    first = named_parts(moved[0])
    assert first == {"data": 66.0 - first[BELOW_THRESHOLD], BELOW_THRESHOLD: 6.0}
    assert (moved[1, :-1] == part[1]).all()
    assert moved[1, -1] == 0
    assert np.isnan(moved[2]).all(), "no target"
