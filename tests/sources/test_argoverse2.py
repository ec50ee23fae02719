"""Argoverse 2 source: a made-up log by hand, broken files, and the official reader's figures of real logs."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mtp_bench import MTPEnv
from mtp_bench.agent import load_submission
from mtp_bench.cards import load_card, with_detections
from mtp_bench.core import StoredTracks
from mtp_bench.core.bundle import bundled
from mtp_bench.core.errors import DataError
from mtp_bench.running.playing import run_scene
from mtp_bench.running.track_export import write_tracks
from mtp_bench.scoring import find_targets
from mtp_bench.scoring.weights import tracking_events as events_of
from mtp_bench.sources import open_source, with_tracks
from mtp_bench.sources.argoverse2 import PACKAGE
from mtp_bench.sources.argoverse2.files import ANNOTATIONS, BOX, Sweeps, read_feather
from mtp_bench.sources.argoverse2.source import Argoverse2
from tests.support.drawn_recordings import Recording, Row
from tests.support.layouts import AV2_CARD, CITY, av2_columns, stamps, write_argoverse2, write_feather

LOG, FRAMES = "a-log", 24
# Where the ego is at (0, 0.5 k): the car is beyond reach from sweep 16 on, the truck until 12; the walker has no lidar
# point in sweep 5.
PATHS = {"REGULAR_VEHICLE": (10, 20, 3), "BOX_TRUCK": (12, 90, -2), "PEDESTRIAN": (-5, 30, 0)}  # x, y, m per sweep
RECORDING = Recording(
    time=0.1002 * np.arange(FRAMES),
    pose=np.array([[0, 0.5 * k, 0, *np.radians([90, 2, -3])] for k in range(FRAMES)]),  # tilted with the road
    truth=[
        Row(k, i, kind, np.array([x, y + step * k, 1, np.pi / 2, 4, 2, 1.5]), seen=(k, kind) != (5, "PEDESTRIAN"))
        for k in range(FRAMES)
        for i, (kind, (x, y, step)) in enumerate(PATHS.items())
    ],
    detections=[],
)


def make_root(data: Path) -> Path:
    root = write_argoverse2(data, RECORDING)
    left, right = ([dict(zip("xyz", CITY + np.array([i, i * j, 0]), strict=True)) for i in range(3)] for j in (0, 1))
    lanes = {7: ("VEHICLE", [8, 9, 4], right), 8: ("BUS", [], right[:1]), 9: ("BIKE", [7], right)}
    parts = {
        i: {"id": i, "is_intersection": i == 8, "lane_type": kind, "successors": after, "left_lane_boundary": left,
            "right_lane_boundary": border}
        for i, (kind, after, border) in lanes.items()
    }  # fmt: skip
    folder = root / f"sensor/val/{LOG}/map"
    folder.mkdir()
    (folder / f"log_map_archive_{LOG}____PIT_city_1.json").write_text(json.dumps({"lane_segments": parts}))
    return root


def test_truth_within_reach_and_its_targets(root: Path) -> None:
    scene = Argoverse2(AV2_CARD, root).load(LOG)
    truth, frame = scene.truth, scene.truth.frame_of_rows
    frames = [frame[truth.object_id == i].tolist() for i in range(3)]
    assert frames == [list(range(FRAMES)), list(range(13, FRAMES)), list(range(FRAMES))]
    neutral = [frame[(truth.object_id == i) & truth.neutral].tolist() for i in range(3)]
    assert neutral == [list(range(16, FRAMES)), [], [5]]
    targets = find_targets(scene, AV2_CARD)  # the truck never has ten past and ten future frames
    assert frame[targets.row].tolist() == np.repeat(range(9, 14), 2).tolist()
    assert targets.object_id.tolist() == [0, 2] * 5


def test_truth_in_every_fifth_sweep(root: Path, tmp_path: Path) -> None:
    """Detections are simulated from the whole truth; the walker has no lidar point in sweep 5."""
    text = (bundled("envs") / f"{AV2_CARD.id}.toml").read_text()
    text = text.replace(AV2_CARD.id, "MTP-AV2-keys-v0").replace("rate = 10.0", "rate = 10.0\nannotated_every = 5")
    (tmp_path / "MTP-AV2-keys-v0.toml").write_text(text)
    card = load_card(tmp_path / "MTP-AV2-keys-v0.toml")
    whole, scene = (open_source(one, root).load(LOG) for one in (AV2_CARD, card))
    for name, column in vars(whole.detections).items():
        np.testing.assert_array_equal(getattr(scene.detections, name), column)
    assert scene.annotated_frames.tolist() == [0, 5, 10, 15, 20]
    np.testing.assert_array_equal(scene.truth.box, whole.truth.box[whole.truth.frame_of_rows % 5 == 0])
    targets = find_targets(scene, card)  # 2 annotated sweeps of ten past ones, 2 of ten future ones
    assert (targets.frame.tolist(), targets.object_id.tolist()) == ([5, 10, 10], [0, 0, 2])
    assert targets.step.tolist() == [[4, 9]] * 3


def test_lanes_of_the_map(root: Path) -> None:
    """One that widens, one about a point; neither bicycles nor loose ends."""
    scene = Argoverse2(AV2_CARD, root).load(LOG)
    wide, turn = PACKAGE.lanes(AV2_CARD, root, scene)
    assert (wide.following, turn.following, wide.junction, turn.junction) == ((1,), (), False, True)
    np.testing.assert_allclose(wide.center, np.linspace(0, 2, 10)[:, None] * [1, 0.5], atol=1e-9)
    np.testing.assert_allclose(turn.center, np.array([[0, 0], [0.5, 0], [1, 0]]), atol=1e-9)


def test_submissions_are_read_as_they_were_written(root: Path, tmp_path: Path) -> None:
    """The car gets another id in frame 11, the walker is lost in 8 and 9: events of a run on these tracks."""
    scene, path = open_source(AV2_CARD, root).load(LOG), tmp_path / "tracks.feather"
    frame, walker = scene.truth.frame_of_rows, scene.truth.object_id == 2
    kept = scene.truth.select(~scene.truth.neutral & ~(walker & np.isin(frame, (8, 9))))
    ids = kept.object_id + 10 * ((kept.object_id == 0) & (kept.frame_of_rows >= 11))
    rows = StoredTracks(kept.start, kept.box, kept.velocity, kept.class_id, np.linspace(0, 1, len(ids)), ids)
    assert write_tracks([(scene, rows)], AV2_CARD, str(root), path) == len(ids)
    env = MTPEnv(AV2_CARD, str(root), evaluation=True, observe="tracks", tracks=str(path))
    rollout = run_scene(load_submission("given_tracks").build(env.task), env, LOG, 0, "given_tracks")
    tracks = env.scene.tracks
    assert tracks is not None
    np.testing.assert_allclose(tracks.box, kept.box, atol=1e-9)
    np.testing.assert_array_equal(tracks.score, rows.score)
    row, kind = np.nonzero(events_of(scene, rollout, AV2_CARD)[:, :3])
    found = sorted(zip(frame[row].tolist(), scene.truth.object_id[row].tolist(), kind.tolist(), strict=True))
    assert found == [(8, 2, 1), (10, 2, 2), (11, 0, 0)], "lost, reacquired, identity switch"
    again = open_source(with_detections(AV2_CARD, path), root).load(LOG)
    assert (again.detector, len(again.detections.box)) == ("tracks, stored detections", len(ids))


STAMP = stamps(RECORDING)
BROKEN: dict[str, tuple[dict[str, Any], str]] = {
    "no column": ({"score": None}, "no column 'score': known are "),
    "another log": ({"log_id": ["b"] * 3}, f"tracks of log {LOG}, expected those of each log that is run"),
    "another time": ({"timestamp_ns": STAMP[:3] + 1}, f"expected a sweep of the log {LOG}"),
    "time as a float": ({"timestamp_ns": STAMP[:3] * 1.0}, "is double, expected int64"),
    "a class of ours": ({"category": ["bus"] * 3}, "'bus' is not a category of Argoverse 2: did you mean 'BUS'"),
    "a wrong turn": ({"qw": [2.0] * 3}, "row 1: rotation is .*, expected a unit quaternion"),
    "twice": ({"track_id": [1, 1, 1], "category": ["BUS"] * 3}, "row 2: a second box of object 1 in frame 14"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_submission_is_one_error(root: Path, tmp_path: Path, name: str) -> None:
    columns = {
        **av2_columns(RECORDING.of(14), RECORDING),
        "log_id": [LOG] * 3,
        "score": [0.5] * 3,
        "track_id": [1, 2, 3],
    }
    change, text = BROKEN[name]
    path = write_feather(tmp_path / "a.feather", {k: v for k, v in {**columns, **change}.items() if v is not None})
    with pytest.raises(DataError, match=text) as caught:
        with_tracks(open_source(AV2_CARD, root), AV2_CARD, root, path).load(LOG)
    assert str(path) in str(caught.value)


OFFICIAL = json.loads(Path(__file__).with_name("argoverse2_official.json").read_text(encoding="utf-8"))


@pytest.mark.data
@pytest.mark.parametrize("log", sorted(set(OFFICIAL) - {"about"}))
def test_boxes_and_lanes_are_those_of_the_official_reader(data_root: Path, log: str) -> None:
    sweeps, expected = Sweeps.read(data_root / "argoverse2/sensor/val" / log, 5), OFFICIAL[log]
    boxes, stamp = read_feather(sweeps.folder / ANNOTATIONS, BOX)
    frame = sweeps.frame_of(boxes, stamp)
    box = sweeps.boxes(boxes.select(frame >= 0), frame[frame >= 0])
    weight = 1 + np.arange(len(box)) % 7
    np.testing.assert_allclose(weight @ box / weight.sum(), expected["mean_box"], atol=1e-9)
    lanes = PACKAGE.lanes(load_card("MTP-AV2-v0"), data_root, SimpleNamespace(name=log))  # type: ignore[arg-type]
    links = [(i % 7 + 1) * after for i, lane in enumerate(lanes) for after in lane.following]
    counts = {"lanes": len(lanes), "links": len(links), "link_sum": sum(links), "boxes": len(box)}
    assert {**counts, "junctions": sum(lane.junction for lane in lanes)}.items() <= expected.items()
    part = (1 + np.arange(len(lanes)) % 7)[:, None] * (1 + np.arange(10))
    middle = np.einsum("ln,lnd->d", part, np.array([lane.center for lane in lanes])) / part.sum()
    np.testing.assert_allclose(middle, expected["mean_center"], atol=1e-9)


@pytest.mark.data
def test_real_boxes_on_two_logs_and_simulated_ones_on_the_others(data_root: Path) -> None:
    source = open_source(load_card("MTP-AV2-v0"), data_root)
    scenes = [source.load(name) for name in source.names]
    assert [(scene.simulated, scene.frames) for scene in scenes] == [(False, 32)] * 2 + [(True, 32)] * 2
