"""Stored tracks of other programs: the three forms, there and back, and one clear error for each wrong file."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mtp_bench.cards import Card, load_card
from mtp_bench.core import Scene, StoredTracks
from mtp_bench.core.errors import DataError
from mtp_bench.running.track_export import write_tracks
from mtp_bench.sources import open_source, with_tracks
from tests.support.nuscenes_root import SCENES, detection, nuscenes_card, sample, write_json, write_root


def tracks_of(card: Card, data: str | Path, path: Path, name: str) -> StoredTracks:
    return tracked_scene(card, data, path, name)[0]


def tracked_scene(card: Card, data: str | Path, path: Path, name: str) -> tuple[StoredTracks, Scene]:
    scene = with_tracks(open_source(card, data), card, data, path).load(name)
    assert scene.tracks is not None
    return scene.tracks, scene


def true_rows(scene: Scene) -> StoredTracks:
    """The true boxes as tracks, with scores that tell the rows apart."""
    truth = scene.truth
    score = np.linspace(0.1, 0.9, len(truth.box))
    return StoredTracks(truth.start, truth.box, truth.velocity, truth.class_id, score, truth.object_id)


def test_a_submission_has_what_the_official_form_asks_for(tmp_path: Path) -> None:
    data, card = write_root(tmp_path / "data"), nuscenes_card()
    scene = open_source(card, data).load("scene-0003")
    write_tracks([(scene, true_rows(scene))], card, str(data), tmp_path / "t.json")
    content = json.loads((tmp_path / "t.json").read_text())
    assert set(content["meta"]) == {"use_camera", "use_lidar", "use_radar", "use_map", "use_external"}
    assert list(content["results"]) == [sample("scene-0003", t) for t in range(4)]
    car = next(each for each in content["results"][sample("scene-0003", 1)] if each["tracking_name"] == "car")
    assert set(car) == {
        "sample_token", "translation", "size", "rotation", "velocity",
        "tracking_id", "tracking_name", "tracking_score",
    }  # fmt: skip
    assert (car["translation"], car["size"]) == ([10.0, 2.0, 1.0], [2.0, 4.0, 1.5])
    np.testing.assert_allclose(car["velocity"], [0, 4])  # 2 m in 0.5 s


def test_ids_of_two_classes_are_two_identities_with_one_name(kitti: str, card: str, tmp_path: Path) -> None:
    rows = [line(0, 7, "Car"), line(0, 7, "Pedestrian"), line(1, 7, "Car"), line(1, 2, "Van"), line(1, -1, "DontCare")]
    one = load_card(card)
    (tmp_path / "in").mkdir()
    tracks, scene = tracked_scene(one, kitti, kitti_folder(tmp_path / "in", rows), "0001")
    assert (tracks.object_id.tolist(), scene.track_names) == ([0, 1, 0], {0: "7", 1: "7"})


def test_kitti_tracks_without_a_score_have_1_and_are_counted(kitti: str, card: str, tmp_path: Path) -> None:
    one, folder = load_card(card), kitti_folder(tmp_path, [line(0, 1, more=""), line(1, 1, more="")])
    tracks, scene = tracked_scene(one, kitti, folder, "0001")
    assert (tracks.score.tolist(), scene.skipped) == ([1.0, 1.0], {"track without a score, taken as 1": 2})


@pytest.mark.parametrize("form", ["txt", "csv", "json"])
def test_flat_tracks_are_left_out_and_counted(form: str, kitti: str, card: str, tmp_path: Path) -> None:
    one, data, path, name = load_card(card), Path(kitti), tmp_path, "0001"
    if form == "txt":
        kitti_folder(tmp_path, [line(0, 1), line(1, 1, size="1.5 0 4"), line(2, 1, size="1.5 1 -4")])
    elif form == "csv":
        rows = "0,1,car,1,1,1,0,4,1,1,1\n1,1,car,1,1,1,0,0,1,1,1\n2,1,car,1,1,1,0,1,-1,1,1"
        (tmp_path / "0001.csv").write_text(csv(rows))
    else:
        one, data, path, name = nuscenes_card(), write_root(tmp_path / "data"), tmp_path / "t.json", "scene-0003"
        flat = {sample(name, 1): [2, 0, 1], sample(name, 2): [2, -4, 1]}
        results = {sample(name, t): [tracked(sample(name, t))] for t in range(3)} | {sample(name, 3): []}
        results |= {token: [tracked(token, size=size)] for token, size in flat.items()}
        write_json(path, {"meta": {}, "results": results})
    tracks, scene = tracked_scene(one, data, path, name)
    assert (tracks.frame_of_rows.tolist(), tracks.object_id.tolist()) == ([0], [0])
    assert scene.skipped == {"track size not above 0": 2}


# ---- wrong files
def line(frame: float, identity: int, kind: str = "Car", size: str = "1.5 1.8 4", more: str = "0.9") -> str:
    return f"{frame} {identity} {kind} -1 -1 -10 0 0 50 50 {size} 1 1.5 20 0 {more}"


def kitti_folder(folder: Path, lines: list[str]) -> Path:
    """A folder of results: these lines for sequence 0001, nothing for the others."""
    for name in ("0001", "0006", "0008"):
        (folder / f"{name}.txt").write_text("\n".join(lines) if name == "0001" else "")
    return folder


KITTI: dict[str, tuple[list[str], str]] = {  # lines, what the error says; the rest is as of any text
    "no score in some lines": (
        [line(0, 1), line(1, 1, more="")],
        r"0001.txt, line 2: 17 columns, expected 18 .*; column 18 \(score\) is missing",
    ),
    "a score in some lines": ([line(0, 1, more=""), line(1, 1)], "line 2: 18 columns, expected 17 .* 18 is '0.9'"),
    "a number not finite": ([line(0, 1, size="nan 1.8 4")], "line 1, column 'height': nan, expected a finite number"),
    "commas": ([line(0, 1).replace(" ", ",")], "line 1: this file is separated by commas, expected blanks"),
    "a box twice": ([line(0, 1), line(0, 1)], "line 2: a second box of object 1 in frame 0"),
    "after the end": ([line(99, 1)], "line 1: frame 99, but the last one of sequence 0001 is 8"),
    "before the start": ([line(-1, 1)], "line 1: frame -1, but the last one"),
    "an unknown type": ([line(0, 1, "car")], "line 1: type 'car', expected one of Car, Van"),
}


@pytest.mark.parametrize("case", KITTI)
def test_a_wrong_kitti_result(case: str, card: str, kitti: str, tmp_path: Path) -> None:
    lines, message = KITTI[case]
    with pytest.raises(DataError, match=message):
        tracks_of(load_card(card), kitti, kitti_folder(tmp_path, lines), "0001")


def csv(row: str, header: str = "frame,id,class,x,y,z,yaw,l,w,h,score") -> str:
    return f"{header}\n{row}\n"


TABLE: dict[str, tuple[str, str]] = {  # content, what the error says; the rest is as of any table of own scenes
    "after the end": (csv("9,1,car,1,1,1,0,4,2,1,1"), "line 2, column 'frame': frame 9"),
    "no class of the task": (csv("0,1,van,1,1,1,0,4,2,1,1"), "no other row of the tracks has a class of the task"),
    "a class in capitals": (
        csv("0,1,pedestrian,1,1,1,0,4,2,1,1\n0,2,Car,1,1,1,0,4,2,1,1"),
        "line 3, column 'class': 'Car' is not a class of the task; did you mean 'car'"),
    "a box twice": (
        csv("0,a,car,1,1,1,0,4,2,1,1\n0,a,car,2,1,1,0,4,2,1,1"),
        "line 3: a second box of object a in frame 0"),
}  # fmt: skip


@pytest.mark.parametrize("case", TABLE)
def test_a_wrong_table(case: str, card: str, kitti: str, tmp_path: Path) -> None:
    content, message = TABLE[case]
    (tmp_path / "0001.csv").write_text(content)
    with pytest.raises(DataError, match=message):
        tracks_of(load_card(card), kitti, tmp_path, "0001")


def test_a_table_without_scores_and_with_other_classes(card: str, kitti: str, tmp_path: Path) -> None:
    rows = "0,a,car,1,2,3,0.5,4,2,1\n0,b,tram,1,1,1,0,4,2,1"
    (tmp_path / "0001.csv").write_text(csv(rows, "frame,id,class,x,y,z,yaw,l,w,h"))
    tracks = tracks_of(load_card(card), kitti, tmp_path, "0001")
    assert (tracks.box.tolist(), tracks.score.tolist()) == ([[1, 2, 3, 0.5, 4, 2, 1]], [1.0])
    (tmp_path / "0001.csv").write_text(csv("0,2007,car,1,2,3,0,4,2,1,1\n0,30,car,9,1,1,0,4,2,1,1"))
    tracks, scene = tracked_scene(load_card(card), kitti, tmp_path, "0001")
    assert (tracks.object_id.tolist(), scene.track_names) == ([1, 0], {0: "30", 1: "2007"}), "ordered as numbers"


@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_an_id_in_two_classes_and_unknown_velocities(form: str, card: str, kitti: str, tmp_path: Path) -> None:
    columns: dict[str, list[Any]] = {
        "frame": [1, 0, 0], "id": ["7", "7", "7"], "class": ["car", "pedestrian", "car"],
        **{name: [1.0, 2.0, 3.0] for name in ("x", "y", "z", "yaw", "l", "w", "h")},
        "vx": [0.5, None, 1.5], "vy": [0.0, None, 2.0],
    }  # fmt: skip
    if form == "csv":
        rows = zip(*columns.values(), strict=True)
        text = "\n".join(",".join("" if cell is None else str(cell) for cell in row) for row in rows)
        (tmp_path / "0001.csv").write_text(csv(text, ",".join(columns)))
    else:
        pyarrow = pytest.importorskip("pyarrow")
        pytest.importorskip("pyarrow.parquet").write_table(pyarrow.table(columns), tmp_path / "0001.parquet")
    tracks = tracks_of(load_card(card), kitti, tmp_path, "0001")
    assert tracks.frame_of_rows.tolist() == [0, 0, 1]
    assert (tracks.object_id[0] != tracks.object_id[1], tracks.object_id[1] == tracks.object_id[2]) == (True, True)
    np.testing.assert_array_equal(tracks.velocity, [[np.nan, np.nan], [1.5, 2.0], [0.5, 0.0]])


def tracked(token: str, **changes: Any) -> dict[str, Any]:
    box = {k: v for k, v in detection(token).items() if not k.startswith("detection")}
    return {**box, "tracking_id": "7", "tracking_name": "car", "tracking_score": 0.5, **changes}


def submission(change: Callable[[dict[str, Any]], Any]) -> dict[str, Any]:
    """A submission that tracks one car in each sample, changed."""
    tokens = [sample(scene, t) for scene in SCENES for t in range(4)]
    content = {"meta": {}, "results": {token: [tracked(token)] for token in tokens}}
    change(content["results"])
    return content


TOKEN = sample("scene-0003", 1)
NUSCENES: dict[str, tuple[Callable[[dict[str, Any]], Any], str]] = {  # change, what the error names
    "a sample missing": (lambda r: r.pop(TOKEN), f"no entry for sample '{TOKEN}' of scene-0003"),
    "no id": (lambda r: r[TOKEN][0].pop("tracking_id"), f"sample '{TOKEN}', \\[0\\]: .*`tracking_id`"),
    "an id without end": (lambda r: r[TOKEN][0].update(tracking_id="a" * 201), "tracking_id: .*<= 200"),
    "a box twice": (lambda r: r[TOKEN].append(tracked(TOKEN)), f"sample '{TOKEN}': a second box of tracking_id '7'"),
    "detections": (lambda r: r.update({TOKEN: [detection(TOKEN)]}), "expected a submission to the tracking task"),
    "a class": (lambda r: r[TOKEN][0].update(tracking_name="auto"), "tracking_name: .*'auto'"),
    "a score": (lambda r: r[TOKEN][0].update(tracking_score=None), "tracking_score: expected `float`"),
}


@pytest.mark.parametrize("case", NUSCENES)
def test_a_wrong_submission(case: str, tmp_path: Path) -> None:
    change, message = NUSCENES[case]
    data = write_root(tmp_path / "data")
    write_json(tmp_path / "tracks.json", submission(change))
    with pytest.raises(DataError, match=message):
        tracks_of(nuscenes_card(), data, tmp_path / "tracks.json", "scene-0003")


def test_a_changed_file_is_read_again(tmp_path: Path) -> None:
    data, path = write_root(tmp_path / "data"), tmp_path / "tracks.json"
    counts = []
    for kept in (1, 0):
        write_json(path, submission(lambda r, kept=kept: r.update({TOKEN: r[TOKEN][:kept]})))  # type: ignore[misc]
        tracks, scene = tracked_scene(nuscenes_card(), data, path, "scene-0003")
        counts.append(len(tracks.box))
        assert scene.track_names == {0: "7"}
    assert counts == [4, 3]
