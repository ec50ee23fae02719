"""Recordings: what is read back from a file equals the rollout, and two of them are equal."""

import subprocess
from collections.abc import Iterator
from dataclasses import replace as changed
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mtp_bench import MtpBenchError
from mtp_bench.core import Rollout
from mtp_bench.viz.answers import Answers
from mtp_bench.viz.causes import cause_text, causes_of, happened
from mtp_bench.viz.focus import Focus
from mtp_bench.viz.rerun.entities import TOP_SAMPLES
from mtp_bench.viz.rerun.recording import save_recording
from mtp_bench.viz.rerun.sdk import rr
from mtp_bench.viz.rerun.shown import TOP_HYPOTHESES
from mtp_bench.viz.rerun.viewer import viewer_program
from mtp_bench.viz.run_replay import Replay, replay
from tests.support import scoring_scenes
from tests.support.focus_scenes import EVENT, crowd
from tests.support.recordings import Rows, assert_recorded, boxes, read
from tests.support.scoring_scenes import at, make_card
from tests.support.small_scenes import make_scene

CARD = make_card()
FRAMES, H, K, T = 8, 6, 4, 3


@pytest.fixture(scope="module", autouse=True)
def strict() -> Iterator[None]:
    """A wrong shape is an error, not a warning."""
    rr.set_strict_mode(True)
    yield
    rr.set_strict_mode(False)


def make_rollout() -> Rollout:
    """Two tracks per frame, on the two cars; hypothesis 0 changes the id on car 7 at frame 4 (10 to 12).

    The other hypotheses keep it: a leaf of its own (id 10, 0.1 m to the right). From frame 6 on there are only two.
    """
    rng = np.random.default_rng(0)
    tracks, objects, weight = [], [], []
    for t in range(FRAMES):
        alive = tuple(range(H if t < 6 else 2))
        car, other = (20.0 + 0.8 * t, 10.0), (40.0, 5.0 + 0.5 * t)
        keeps = at(14 if t < 4 else 10, (car[0] + 0.1, 10.0), hypotheses=alive[1:])
        tracks.append([at(10 if t < 4 else 12, car), keeps, at(11, other, hypotheses=alive)])
        logs = np.log(rng.dirichlet(np.ones(K), 2)) if t else [[0.0, -np.inf, -np.inf, -np.inf]] * 2
        said = zip((car, other), rng.uniform(-30, 30, (2, K, T, 2)), logs, strict=True)
        objects.append([at(0, xy, forecast=path, log_weight=log) for xy, path, log in said])
        weight.append(np.where(np.arange(H) < len(alive), -0.5 * np.arange(H), -np.inf))
    return scoring_scenes.make_rollout(tracks, objects, weight, "one", K, T, H)


@pytest.fixture(scope="module")
def run() -> Replay:
    return replay(make_scene(), make_rollout(), CARD, "mtp")


def save(path: Path, *runs: Replay, **options: Any) -> Path:
    save_recording(path, runs, **options)
    return path


@pytest.fixture(scope="module")
def top(run: Replay, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Rows]:
    return read(save(tmp_path_factory.mktemp("top") / "top.rrd", run))


def test_what_is_recorded_is_what_was_said(run: Replay, top: dict[str, Rows], tmp_path: Path) -> None:
    assert_recorded(top, run.scene, run.rollout, range(TOP_HYPOTHESES), TOP_SAMPLES)
    assert top["world/hyp/03/box"][7]["centers"] == []  # a hypothesis that has ended leaves nothing behind
    assert len(top["world/forecast"][0]["strips"]) == 2  # one sample of each object
    for t in range(FRAMES):
        np.testing.assert_allclose(boxes(top["world/ego"], t)[0, :4], run.scene.ego[t], rtol=1e-6)
        seconds = top["world/gt"][t]["time"].total_seconds()
        assert seconds == pytest.approx(run.scene.time[t] - run.scene.time[0], abs=1e-6)
    everything = read(save(tmp_path / "all.rrd", run, is_all=True))
    assert {path for path in everything if path.endswith("/box")} == {f"world/hyp/{h:02d}/box" for h in range(H)}
    assert_recorded(everything, run.scene, run.rollout, range(H), K)


def test_the_default_has_the_heaviest(top: dict[str, Rows]) -> None:
    assert {"world/gt", "world/det", "world/events", "marks/ids", "identity/car-7", "key", "curves/0/00"} <= set(top)
    assert {path for path in top if "hyp" in path} == {
        f"world/hyp/{h:02d}/{kind}" for h in range(TOP_HYPOTHESES) for kind in ("box", "name", "trail")
    }
    assert not any("focus" in path for path in top), "without an event no view is of one"


def test_trails_follow_the_identity_along_the_lineage(run: Replay, top: dict[str, Rows]) -> None:
    x = make_scene().truth.box[::3, 0].astype(np.float32)  # of car 7
    new = np.array(top["world/hyp/00/trail"][5]["strips"][0], dtype=np.float32)[:, 0]
    assert set(new.tolist()) == {x[5], x[4]}  # a new identity has no older past
    earlier = run.answers.earlier
    assert earlier[12, 0] == -1  # the first box of track 12
    assert earlier[15, 0] == 12
    assert (earlier[2] == -1).all()
    assert (earlier[5] == 2).all()  # shared by all hypotheses
    assert (earlier[16, 1:6] == 13).all()


def test_the_switch_is_an_event_a_mark_and_a_lane(run: Replay, top: dict[str, Rows]) -> None:
    switch = next(i for i in run.incidents if i.kind == "ids")
    assert (switch.frame, switch.object_id, switch.old_id, switch.new_id) == (4, 7, 10, 12)
    marks = {t: row["labels"] for t, row in top["world/events"].items() if row.get("labels")}
    assert "ids-0: ids 10 > 12" in marks[4]
    assert not any("ids-0: ids 10 > 12" in marks.get(t, []) for t in range(4))
    states = {path: {t: row["state"][0] for t, row in top[path].items() if "state" in row} for path in top}
    assert states["identity/car-7"] == {0: "track 10", 4: "track 12"}
    assert states["identity/pedestrian-5"][0] == "untracked"
    assert states["marks/ids"] == {0: "", 4: "ids-0"}  # until the end of the scene, which is nearer than a second
    error = [row["scalars"] for t, row in top["curves/0/00"].items() if t >= 0]
    assert error == [pytest.approx(run.part[rows].sum(axis=1)[~np.isnan(run.part[rows, 0])].mean(keepdims=True))
                     if np.isfinite(run.part[rows, 0]).any() else []
                     for rows in map(run.scene.truth.rows, range(FRAMES))]  # fmt: skip


def test_several_agents_share_the_scene(run: Replay, tmp_path: Path) -> None:
    renamed = changed(run.rollout, track_id=run.rollout.track_id + 100)
    other = changed(run, agent="stp", answers=Answers(renamed, run.card))
    both = read(save(tmp_path / "both.rrd", run, other, changed(run, agent="mtp")))
    assert both["world/hyp/00/name"][0]["labels"] == ["10", "11"]
    assert both["agents/2-stp/world/hyp/00/name"][0]["labels"] == ["110", "111"]
    assert "agents/3-mtp/world/hyp/00/box" in both
    shared = {path for path in both if path.endswith(("/gt", "/det", "/ego", "/gt_future"))}
    assert shared == {"world/gt", "world/det", "world/ego", "world/gt_future"}
    assert "agents/2-stp/curves/0/00" in both


def test_runs_of_different_scenes_share_no_recording(run: Replay, tmp_path: Path) -> None:
    other = changed(run, scene=changed(run.scene, name="two"))
    with pytest.raises(MtpBenchError, match="one scene, got one, two"):
        save(tmp_path / "a.rrd", run, other)
    assert not list(tmp_path.iterdir())


def test_two_recordings_of_a_run_are_equal(run: Replay, tmp_path: Path) -> None:
    moved = changed(run.rollout, track_box=run.rollout.track_box + np.float32(0.01))
    again = replay(make_scene(), make_rollout(), CARD, "mtp")
    first = save(tmp_path / "first.rrd", run, at=run.incident("ids-0"))
    for other, equal in ((again, True), (changed(run, answers=Answers(moved, run.card)), False)):
        second = save(tmp_path / "second.rrd", other, at=run.incident("ids-0"))
        command = [viewer_program(), "rrd", "compare", "--unordered", str(first), str(second)]
        assert (subprocess.run(command, capture_output=True, check=False).returncode == 0) == equal


def test_an_event_has_its_picture_causes_and_curves(tmp_path: Path) -> None:
    crowded = crowd(ahead=12.0)
    focus = Focus(crowded, crowded.incident("ids-0"))
    found = read(save(tmp_path / "at.rrd", crowded, at=focus.at))
    text = found["focus/text"][-1]["text"][0]
    assert happened(focus) in text
    assert all(f"| {cause.title} | {cause.cost_m:.1f} | {cause_text(cause)} |" in text for cause in causes_of(focus))
    assert "event gate of the scorer (within 2 m)" in found["key"][-1]["text"][0]
    np.testing.assert_allclose(np.mean(found["world/at"][-1]["strips"][0], axis=0)[:2], focus.at.position[:2], atol=0.1)
    curves = {(path[:8], row["names"][0]): {t: each["scalars"] for t, each in found[path].items() if t >= 0}
              for path in found if path.startswith("curves/") for row in [found[path][-1]]}  # fmt: skip
    assert curves["curves/0", "largest error, c"][EVENT] == [10.0]
    assert curves["curves/0", "error"][EVENT] == pytest.approx([focus.at.error])
    assert curves["curves/0", "error"] == curves["curves/0", "rest"], "without references one part is all"
    assert curves["curves/0", "error"][9] == [], "no target, and no value"
    assert [curves["curves/1", f"track {i}"][EVENT][0] for i in (1, 2)] == pytest.approx([1.5, 0.0])
    assert (curves["curves/1", "track 2"][EVENT - 1], curves["curves/1", "event gate"][0]) == ([], [2.0])


def test_signs_that_the_viewer_cannot_draw_are_replaced(run: Replay, tmp_path: Path) -> None:
    named = changed(run, scene=changed(run.scene, object_names={7: "車 1", 3: "人 1", 5: "Zoë"}))
    found = read(save(tmp_path / "a.rrd", named))
    assert found["world/gt"][0]["labels"] == ["car ? 1", "car ? 1", "pedestrian Zoë"]
    lanes = {path for path in found if path.startswith("identity/")}
    assert lanes == {"identity/car-1-7", "identity/car-1-3", "identity/pedestrian-Zo"}


def test_forecasts_of_nothing_have_a_place_of_their_own(tmp_path: Path) -> None:
    crowded = crowd()
    far = [at(80, (90.0, 90.0), forecast=[[[90.0, 90.0]] * 3] * 2)]
    rollout = scoring_scenes.make_rollout([[]] * 10, [far] * 10, samples=2)
    found = read(save(tmp_path / "a.rrd", changed(replay(crowded.scene, rollout, crowded.card), agent="mtp")))
    live = range(1, 7)  # frames with targets
    assert [len(found["world/false_forecast"][t]["strips"]) for t in live] == [2] * 6
    assert [len(found["world/forecast"][t]["strips"]) for t in live] == [0] * 6
