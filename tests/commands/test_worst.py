"""The worst moments of a run: found, blamed, named in every way, and adding up to bADE."""

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import mtp_bench
from docs.generate import json_keys
from mtp_bench.core.errors import MtpBenchError, RolloutError, UnknownNameError
from mtp_bench.core.files import cache_root
from mtp_bench.running.causes import run_parts
from mtp_bench.running.stored import open_run
from mtp_bench.scoring.parts import BELOW_THRESHOLD, PART_NAMES, named_parts, parts_text, plain_parts
from mtp_bench.viz.evidence import borrowed
from mtp_bench.viz.moment_list import find_incident, moments
from mtp_bench.viz.played import PlayedRun
from mtp_bench.viz.run_replay import Replay, replay

from ..support.command_line import CommandLine, read_json
from ..support.planted_faults import write_log
from ..support.scoring_scenes import Thing, make_card, make_rollout, make_scene, with_detections

FAULTS = {"mistaken": "detector", "missed": "detector", "turning": "predictor"}
CAUSES = {"mistaken": "other class", "missed": "not detected now", "turning": "predictor"}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("planted")
    mtp_bench.run("stp", "MTP-nuScenes-mini-v0", folder / "run", files=write_log(folder / "logs"))
    return folder / "run"


@pytest.fixture(scope="module")
def played(run: Path) -> Replay:
    opened = open_run(run)
    return PlayedRun(opened).replay(opened.first())


@pytest.mark.usefixtures("few_event_runs")
def test_the_parts_of_all_targets_add_up_to_the_error_of_the_run(run: Path) -> None:
    (parts,) = run_parts(open_run(run)).values()
    row = next(row for row in mtp_bench.score(run).report.rows if row.subset == "all")
    assert row.error is not None
    assert parts.part.sum(axis=1).mean() == pytest.approx(row.error, abs=1e-9)
    part = parts.part
    for content in (None, b"", b"PK\x03\x04 and no more", part[:5], part[:, :3], part * np.nan, part[0]):
        for kept in (cache_root() / "causes").iterdir():  # kept, and made again where it is broken
            if isinstance(content, bytes):
                kept.write_bytes(content)
            elif content is not None:
                np.savez(kept, part=content, count=np.array([len(part)]), distance=parts.distance)
        again = run_parts(open_run(run))["log"]
        assert (again.part == parts.part).all()
        assert again.usual == parts.usual


def test_every_fault_is_a_moment_with_its_cause(played: Replay) -> None:
    worst = moments(played)
    assert {moment.at.name.split("@")[0]: moment.cause for moment in worst[:3]} == CAUSES
    costs = [moment.cost for moment in worst]
    assert costs == sorted(costs, reverse=True)
    for moment in worst:
        assert moment.at.first <= moment.at.frame <= moment.at.until
        assert moment.at.blame > played.mean_blame_m
    assert not {moment.at.name.split("@")[0] for moment in worst[:3]} & {"parked"}


def test_a_forecast_is_below_threshold_where_its_confidence_is(played: Replay) -> None:
    assert played.thresholds is not None
    targets = np.isfinite(played.worth[:, 0]) & np.isfinite(played.part[:, 0])
    below = played.part[targets, list(PART_NAMES.values()).index(BELOW_THRESHOLD)]
    assert ((below > 1e-9) == (played.worth[targets, 1] < played.thresholds.max())).all()
    assert (np.diff(played.thresholds) <= 0).all(), "larger budgets keep less sure forecasts"


def test_the_summary_of_a_run_names_the_parts_that_were_planted(cli: CommandLine, run: Path, tmp_path: Path) -> None:
    printed = " ".join(cli.ok("worst", run, "--json", tmp_path / "a.json").split())
    content = read_json(tmp_path / "a.json")
    assert set(list(content["faults"])[:2]) == {"detector", "predictor"}
    assert content["faults"]["confidence"] < 0.05 * content["error"]
    assert re.search(r"All targets of 1 scene: \S+ m: (detector|predictor) \d+%, (detector|predictor) \d+%", printed)


def test_moments_have_many_names(played: Replay) -> None:
    missed = next(moment.at for moment in moments(played) if moment.at.name.startswith("missed"))
    for text in ("missed", "car missed", "miss", f"missed@{missed.frame}", f"car missed@{missed.frame}"):
        assert find_incident(played, text).object_id == missed.object_id, text
    assert find_incident(played, f"missed@{missed.frame}").parts == missed.parts
    worst = max((moment.at for moment in moments(played)), key=lambda at: at.blame)
    assert (
        find_incident(played, str(worst.frame)).blame
        == find_incident(played, f"{worst.frame / 2}s").blame
        >= worst.blame
    )
    assert find_incident(played, "lost-0") == played.incident("lost-0")
    for wrong in ("truck missed", "nobody", "nobody@3"):
        with pytest.raises(UnknownNameError, match="missed"):
            find_incident(played, wrong)
    for wrong in ("0", "missed@99", "900s"):
        with pytest.raises(MtpBenchError, match="frame"):
            find_incident(played, wrong)


def test_causes_of_other_data_are_made_again(run: Path) -> None:
    opened = open_run(run)
    scene = opened.scene("log")
    far = replace(scene, ego=scene.ego + 5.0)
    played = PlayedRun(opened)
    assert played.replay(opened.first(), scene).mean_blame_m > 0
    with pytest.raises(RolloutError, match="other targets than when its run was scored"):
        played.replay(opened.first(), far)  # made again, from the data of the run


def test_ids_that_look_like_others() -> None:
    """Ids that are numbers of other objects, beginnings of others, or forms of ``--at``."""
    names = ["2", "3", "0", "x@y@7", "lost-0", "A" * 30 + "b", "A" * 30 + "c"]
    truth = [[Thing(number, float(t), 9.0 * number) for number in range(len(names))] for t in range(8)]
    scene = replace(with_detections(make_scene(truth), truth), object_names=dict(enumerate(names)))
    run = replay(scene, make_rollout(truth), make_card())
    shown = [scene.short_name(number) for number in range(len(names))]
    assert len({*shown}) == len(names)
    for number, short in enumerate(shown):
        assert find_incident(run, f"{short}@6").object_id == find_incident(run, f"car {short}@6").object_id == number, (
            short
        )
    assert (find_incident(run, "x@y@7").object_id, find_incident(run, "lost-0").object_id) == (3, 4)


def test_the_list_and_its_file(cli: CommandLine, run: Path, tmp_path: Path) -> None:
    printed = cli.ok("worst", run, "--json", tmp_path / "a.json")
    content = read_json(tmp_path / "a.json")
    assert content.keys() == {"env", "agent", *json_keys.WORST}
    assert sum(content["faults"].values()) == pytest.approx(content["error"], abs=1e-9)
    assert {each["object_id"]: each["fault"] for each in content["moments"][:3]} == FAULTS
    assert "turning@" not in cli.ok("worst", run, "--cause", "detector")
    first = content["moments"][0]
    assert first["view"] in printed
    assert first.keys() == json_keys.MOMENT.keys(), "the page of keys explains them"
    assert {each["object_id"]: each["cause"] for each in content["moments"][:3]} == CAUSES
    assert sum(first["parts"].values()) == pytest.approx(first["error"])
    only = cli.ok("worst", run, "--cause", "predictor", "--class", "car", "--within", "60")
    assert "turning@" in only
    assert "missed@" not in only
    assert "0 of " in cli.ok("worst", run, "--class", "bus")
    assert cli("worst", run, "--cause", "nobody").status == cli("worst", run, "--class", "cat").status == 2
    assert "moment" in cli.ok("worst", run, "--cause", "below threshold")


def test_why_errors_are_not_split(cli: CommandLine, run: Path, tmp_path: Path) -> None:
    shutil.copytree(run, tmp_path / "moved")
    info = read_json(tmp_path / "moved" / "run.json")
    info["info"] |= {"folder": str(tmp_path / "gone")}
    (tmp_path / "moved" / "run.json").write_text(json.dumps(info))
    printed = cli.ok("worst", tmp_path / "moved")
    reason = f"stands under rest: no submission '{tmp_path / 'gone'}' there any more"
    assert "".join(reason.split()) in "".join(printed.split()), "a long path breaks within a word"
    assert "predictor" not in printed


def test_a_detection_of_a_neighbour_is_no_evidence() -> None:
    """Of two cars 1.5 m apart only the second one is detected and followed."""
    truth = [[Thing(1, float(t), 0.0), Thing(2, float(t), 1.5)] for t in range(8)]
    seen = [[Thing(2, float(t), 1.5)] for t in range(8)]
    forecasts = [[replace(thing, forecast=[[(float(t), 1.5)] * 3]) for thing in frame] for t, frame in enumerate(seen)]
    run = replay(with_detections(make_scene(truth), seen), make_rollout(seen, forecasts), make_card())
    assert borrowed(run)[run.scene.truth.object_id == 1].any()
    assert not borrowed(run)[run.scene.truth.object_id == 2].any()


def test_parts_as_text() -> None:
    part = plain_parts(np.array([2.0, 4.0]), np.array([-1, 1]))
    assert [parts_text(named_parts(row)) for row in part] == ["rest 2.0 m", "other class 4.0 m"]
    said = parts_text({"predictor": 3.0, "rest": 0.01, "below threshold": 4.0})
    assert said == "predictor 3.0 m, below threshold 4.0"
    many = {"predictor": 3.0, "history": 1.0, "rest": 0.5, "localisation": 0.2, "below threshold": 4.0}
    assert parts_text(many, most=2) == "predictor 3.0 m, history 1.0, others 0.7, below threshold 4.0"
    assert (parts_text({}), parts_text({"predictor": 0.034, "rest": 0.01})) == ("nothing", "predictor 0.03 m")
