"""Own scenes in files: what is written is read again, what is left out has its default, a mistake has its sentence."""

from __future__ import annotations

import hashlib
import re
import sys
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from mtp_bench.cards import Card, with_detector, with_files, with_scenes, with_split
from mtp_bench.cards.own import folder_digest
from mtp_bench.errors import CardError, DataError, MtpBenchError, UnknownNameError
from mtp_bench.files import file_stem
from mtp_bench.sources import describe, load_scenes, open_source
from mtp_bench.sources.files.archive import read_archive
from mtp_bench.sources.files.writing import Form, save_scene
from mtp_bench.types import Detections, Scene, StoredTracks, Truth, starts_of
from tests.support.broken_files import cut_head, flips
from tests.support.own_scenes import (
    BOX,
    CLASSES,
    DETECTIONS,
    EGO,
    TRUTH,
    assert_same,
    small_card,
    whole_scene,
    write_tables,
)
from tests.support.small_scenes import make_scene

FORMS: tuple[Form, ...] = ("npz", "csv", "parquet")


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Card:
    return small_card(tmp_path_factory.mktemp("card"))


def only(card: Card, folder: Path) -> Scene:
    """The only scene of a folder."""
    (scene,) = load_scenes(with_files(card, folder))
    return scene


# --- what is written is read again -----------------------------------------------------------------------------------


def test_a_whole_scene_is_read_as_it_was_written(tmp_path: Path, base: Card) -> None:
    scene = whole_scene()
    path = save_scene(scene, tmp_path / "own", CLASSES)
    assert path == tmp_path / "own" / "one.npz"
    assert_same(only(base, tmp_path / "own"), scene)
    (again,) = load_scenes(with_scenes(base, [scene]))
    assert_same(again, scene)


def test_the_same_scene_is_the_same_file(tmp_path: Path) -> None:
    first, second = (save_scene(whole_scene(), tmp_path / name, CLASSES).read_bytes() for name in "ab")
    assert first == second


@pytest.mark.parametrize("form", FORMS)
def test_every_form_holds_a_plain_scene(form: Form, tmp_path: Path, base: Card) -> None:
    scene = replace(make_scene(frames=6, empty=(0, 2, 5)), detector="pointrcnn, stored detections")
    save_scene(scene, tmp_path, CLASSES, form)
    assert_same(only(base, tmp_path), scene)


@pytest.mark.parametrize("form", FORMS)
@given(data=st.data())
def test_any_scene_comes_back(
    form: Form, tmp_path_factory: pytest.TempPathFactory, base: Card, data: st.DataObject
) -> None:
    scene = data.draw(scenes())
    folder = tmp_path_factory.mktemp("own")
    save_scene(scene, folder, CLASSES, form)
    assert_same(only(base, folder), scene)


@st.composite
def scenes(draw: st.DrawFn) -> Scene:
    """Scenes with any number of rows in each frame."""
    counts = draw(st.lists(st.tuples(st.integers(0, 3), st.integers(0, 3)), min_size=1, max_size=5))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    truth, seen = (starts_of(column) for column in zip(*counts, strict=True))
    rows, found = int(truth[-1]), int(seen[-1])
    return Scene(
        name=draw(st.text(st.characters(min_codepoint=32, max_codepoint=0x2FF), min_size=1, max_size=8)),
        time=draw(st.sampled_from([0.0, 1.5e9])) + 0.1 * np.arange(len(counts)),
        ego=rng.normal(size=(len(counts), 4)),
        truth=Truth(
            truth, boxes(rng, rows), velocities(rng, rows), rng.integers(0, 2, rows), rng.permutation(rows),
            rng.random(rows) < 0.5, rng.random(rows) < 0.5,
        ),
        detections=Detections(
            seen, boxes(rng, found), velocities(rng, found), rng.integers(0, 2, found), rng.normal(size=found)
        ),
        detector="pointrcnn, stored detections",
    )  # fmt: skip


def boxes(rng: np.random.Generator, rows: int) -> NDArray[np.float64]:
    place, yaw = rng.normal(scale=1e3, size=(rows, 3)), rng.normal(scale=np.pi, size=(rows, 1))
    return np.hstack([place, yaw, rng.exponential(size=(rows, 3)) + 1e-5])


def velocities(rng: np.random.Generator, rows: int) -> NDArray[np.float64]:
    return np.where(rng.random((rows, 1)) < 0.5, np.nan, rng.normal(size=(rows, 2)))


def test_names_that_are_no_names_of_files() -> None:
    assert file_stem("a/b") == "a%2Fb"
    assert file_stem("..") == "%2E."
    assert file_stem("0001") == "0001"


def test_what_no_table_can_hold_is_not_written_to_one(tmp_path: Path) -> None:
    with pytest.raises(MtpBenchError, match="scene 'one' has image, world, lanes, recording, which no table can hold"):
        save_scene(whole_scene(), tmp_path, CLASSES, "csv")
    with pytest.raises(UnknownNameError, match="unknown form of a scene 'cvs': did you mean 'csv'"):
        save_scene(make_scene(), tmp_path, CLASSES, "cvs")  # type: ignore[arg-type]
    assert not any(tmp_path.iterdir())


def test_no_file_of_a_user_is_lost(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = replace(make_scene(), detector="mine")
    folder = save_scene(scene, tmp_path, CLASSES, "csv")
    assert save_scene(scene, tmp_path, CLASSES, "parquet") == folder
    (folder / "notes.txt").write_text("mine")
    with pytest.raises(MtpBenchError, match=r"one holds 'notes\.txt', which would be lost: choose another folder"):
        save_scene(scene, tmp_path, CLASSES, "csv")
    assert (folder / "notes.txt").read_text() == "mine"
    (folder / "notes.txt").unlink()
    (tmp_path / "two").write_text("mine")
    with pytest.raises(MtpBenchError, match="two is a file, which would be lost"):
        save_scene(replace(scene, name="two"), tmp_path, CLASSES, "csv")
    assert (tmp_path / "two").read_text() == "mine"
    monkeypatch.chdir(folder)
    with pytest.raises(MtpBenchError, match="is the working folder"):
        save_scene(scene, tmp_path, CLASSES, "csv")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"detections": None}, "detections is NoneType, expected Detections; one without rows stands for none"),
        ({"truth": None}, "truth is NoneType, expected Truth"),
        ({"class_id": np.zeros(5)}, "truth.class_id is float64 [5], expected a row of whole numbers"),
        ({"start": np.arange(5.0)}, "truth.start is float64 [5], expected a row of whole numbers"),
    ],
)
def test_what_is_no_scene_is_one_clear_error(change: dict[str, Any], said: str, base: Card) -> None:
    scene = replace(make_scene(), detector="mine")
    rows = {name: value for name, value in change.items() if name in ("class_id", "start")}
    wrong = replace(scene, truth=replace(scene.truth, **rows)) if rows else replace(scene, **change)
    with pytest.raises(DataError, match=re.escape(f"scene 'one': {said}")):
        list(load_scenes(with_scenes(base, [wrong])))


# --- what is left out ------------------------------------------------------------------------------------------------


def test_tables_with_numbered_frames(tmp_path: Path, base: Card) -> None:
    scene = only(base, write_tables(tmp_path))
    np.testing.assert_array_equal(scene.time, [0, 0.1, 0.2])
    np.testing.assert_array_equal(scene.truth.start, [0, 1, 2, 3])
    np.testing.assert_array_equal(scene.detections.start, [0, 1, 1, 2])  # nothing was detected in frame 1
    np.testing.assert_array_equal(scene.truth.velocity[1:], [[10, 0], [10, 0]])
    assert np.isnan(scene.truth.velocity[0]).all()
    assert np.isnan(scene.detections.velocity).all()
    assert scene.truth.eligible.all()
    assert not scene.truth.neutral.any()
    assert not scene.ego.any()
    assert (scene.detector, scene.truth_complete) == ("pointrcnn, stored detections", True)


def test_frames_beyond_the_known_times_come_at_the_rate(tmp_path: Path, base: Card) -> None:
    """A table with times does not know those of the frames that only another has."""
    seen = ["frame,time,class,x,y,yaw,l,w,h", "1,7.1,car,2,0,0,4,1.8,1.5", "2,7.25,car,2,0,0,4,1.8,1.5"]
    scene = only(base, write_tables(tmp_path, truth=[*TRUTH, f"4,1,car,4,0,{BOX}"], detections=seen))
    np.testing.assert_allclose(scene.time, [7, 7.1, 7.25, 7.35, 7.45])


def test_a_table_of_timed_rows_that_has_none(tmp_path: Path, base: Card) -> None:
    scene = only(base, write_tables(tmp_path, detections=["frame,time,class,x,y,yaw,l,w,h"]))
    np.testing.assert_allclose(scene.time, [0, 0.1, 0.2])


def test_the_ego_table_says_which_frames_there_are(tmp_path: Path, base: Card) -> None:
    longer = [*EGO, "3,0.31,5,3,1,0.1"]
    scene = only(base, write_tables(tmp_path, ego=longer))
    np.testing.assert_array_equal(scene.time, [0, 0.1, 0.2, 0.31])
    np.testing.assert_array_equal(scene.ego[3], [5, 3, 1, 0.1])
    np.testing.assert_array_equal(scene.truth.counts, [1, 1, 1, 0])


def test_rows_say_their_frame_by_its_time(tmp_path: Path, base: Card) -> None:
    timed = [line.replace("frame", "time") for line in TRUTH]
    timed = [timed[0], *(f"{0.1 * i + 7}{line[1:]}" for i, line in enumerate(timed[1:]))]
    seen = ["time,class,x,y,yaw,l,w,h", "7.2004,car,2,0,0,4,1.8,1.5"]
    scene = only(base, write_tables(tmp_path, truth=timed, detections=seen))
    np.testing.assert_allclose(scene.time, [7, 7.1, 7.2])
    np.testing.assert_array_equal(scene.detections.start, [0, 0, 0, 1])
    assert (scene.detections.box[0, 2], scene.detections.score[0]) == (0.75, 1)  # on the ground; sure


def test_words_are_ids_and_rows_come_in_any_order(tmp_path: Path, base: Card) -> None:
    truth = [TRUTH[0], f"1,van b,car,1,0,{BOX}", f"0,van b,car,0,0,{BOX}", f"1,a,pedestrian,9,9,{BOX}"]
    scene = only(base, write_tables(tmp_path, truth=truth, detections=DETECTIONS[:2]))
    np.testing.assert_array_equal(scene.truth.object_id, [1, 1, 0])
    np.testing.assert_array_equal(scene.truth.class_id, [0, 0, 1])


def test_flags_in_words(tmp_path: Path, base: Card) -> None:
    said = ("True", "false", "1")
    truth = [TRUTH[0] + ",eligible", *(f"{line},{word}" for line, word in zip(TRUTH[1:], said, strict=True))]
    scene = only(base, write_tables(tmp_path, truth=truth))
    np.testing.assert_array_equal(scene.truth.eligible, [True, False, True])


def test_a_copy_beside_a_table_is_not_read(tmp_path: Path, base: Card) -> None:
    scene = only(base, write_tables(tmp_path, detection=["nothing"], notes=["nothing"]))
    assert len(scene.detections.box) == 2


@pytest.mark.parametrize("name", ["detections_old", "detections_pp", "my_detections", "directions", "ego2"])
def test_other_tables_of_a_user_are_left_alone(name: str, tmp_path: Path, base: Card) -> None:
    folder = write_tables(tmp_path, detections=None, **{name: DETECTIONS})
    (scene,) = load_scenes(with_detector(with_files(base, folder), "kitti_pointrcnn"))
    assert scene.simulated


def test_rows_of_other_classes_are_left_out_and_counted(tmp_path: Path, base: Card) -> None:
    truth = [*TRUTH, f"0,8,truck,1,5,{BOX}", f"1,8,truck,1,5,{BOX}"]
    scene = only(base, write_tables(tmp_path, truth=truth))
    assert len(scene.truth.box) == 3
    assert scene.skipped == {"truth of class 'truck', which is none of the task": 2}


def test_targets_alone_are_no_complete_truth(tmp_path: Path, base: Card) -> None:
    card = with_files(base, write_tables(tmp_path))
    card = card.model_copy(update={"source": card.source.model_copy(update={"truth": "targets"})})
    (scene,) = load_scenes(card)
    assert not scene.truth_complete
    with pytest.raises(CardError, match="would see nothing but the prediction targets"):
        with_detector(card, "kitti_pointrcnn")


def test_a_simulated_detector_takes_the_place_of_the_files(tmp_path: Path, base: Card) -> None:
    card = with_detector(with_files(base, write_tables(tmp_path, detections=None)), "kitti_pointrcnn")
    (scene,) = load_scenes(card)
    assert (scene.simulated, scene.detector) == (True, "kitti_pointrcnn, simulated detections")
    (memory,) = load_scenes(with_detector(with_scenes(base, [whole_scene()]), "kitti_pointrcnn"))
    assert memory.simulated


def test_a_simulated_detector_on_targets_alone_is_refused(base: Card) -> None:
    card = with_detector(with_scenes(base, [replace(whole_scene(), truth_complete=False)]), "kitti_pointrcnn")
    with pytest.raises(DataError, match="scene 'one': its truth has prediction targets only"):
        next(load_scenes(card))


def test_large_tables_are_read_in_seconds(tmp_path: Path, base: Card) -> None:
    scene = make_scene(frames=20_000)
    save_scene(replace(scene, detector="pointrcnn, stored detections"), tmp_path, CLASSES, "csv")
    found = only(base, tmp_path)
    assert (len(found.truth.box), len(found.detections.box)) == (60_000, 60_000)


# --- splits, and what the digest holds -------------------------------------------------------------------------------


def test_splits_are_sub_folders(tmp_path: Path, base: Card) -> None:
    for name in ("train", "val"):
        save_scene(replace(make_scene(name), detector="mine"), tmp_path / name, CLASSES)
    save_scene(replace(make_scene("top"), detector="mine"), tmp_path, CLASSES)
    card = with_files(base, tmp_path)
    assert open_source(card).names == ("top",)
    assert open_source(with_split(card, "train")).names == ("train",)
    assert len({card.digest, with_split(card, "train").digest, with_split(card, "val").digest}) == 3
    with pytest.raises(DataError, match=r"no folder .*test, expected NPZ files of one scene each"):
        open_source(with_split(card, "test"))


def test_the_digest_holds_what_the_files_hold_and_not_where_they_are(tmp_path: Path, base: Card) -> None:
    here, there = write_tables(tmp_path / "a"), write_tables(tmp_path / "b" / "deep")
    card = with_files(base, here)
    assert card.digest == with_files(base, there).digest != base.digest
    (here / "notes.txt").write_text("not a scene")
    assert with_files(base, here).digest == card.digest
    write_tables(here, detections=DETECTIONS[:2])
    assert with_files(base, here).digest != card.digest
    with pytest.raises(DataError, match="they are not those of MTP-Small-v0, or were changed after it was used"):
        open_source(card)
    assert str(tmp_path) not in str(card.model_dump(mode="json"))


def test_the_digest_of_scenes_in_memory_holds_everything(base: Card) -> None:
    scene = whole_scene()
    digest = with_scenes(base, [scene]).digest
    assert with_scenes(base, [whole_scene()]).digest == digest
    moved = replace(scene, truth=replace(scene.truth, box=scene.truth.box + 1e-12))
    image = scene.image
    assert image is not None
    others = [
        moved,
        replace(scene, recording="another"),
        replace(scene, lanes=scene.lanes[:2]),
        replace(scene, image=replace(image, size=(1, 2))),
    ]
    assert len({digest, *(with_scenes(base, [other]).digest for other in others)}) == 5
    assert with_scenes(base, [scene, moved_name(scene)]).digest != with_scenes(base, [moved_name(scene), scene]).digest


def test_an_array_of_objects_has_no_digest(base: Card) -> None:
    scene = whole_scene()
    with pytest.raises(CardError, match="a scene has an array of objects, expected numbers"):
        with_scenes(base, [replace(scene, time=scene.time.astype(object))])


def moved_name(scene: Scene) -> Scene:
    return replace(scene, name="two")


# --- one sentence for every mistake ----------------------------------------------------------------------------------

TABLES: dict[str, tuple[dict[str, list[str] | None], str]] = {
    "no truth": ({"truth": None}, "one: no table truth.csv or truth.parquet, without which nothing can be scored"),
    "a name in the singular": (
        {"detections": None, "detection": DETECTIONS},
        "detection.csv is no table that is read; did you mean detections.csv?",
    ),
    "no detections": ({"detections": None}, "one: no detections; without them a simulated detector runs at once"),
    "empty file": ({"truth": []}, "truth.csv is empty, expected a line with the names of the columns"),
    "no names": (
        {"truth": TRUTH[1:]},
        "truth.csv: line 1 is '0,1,car,0,0,0.8,0,4,1.8,1.5', expected the names of the columns, such as frame, id, c",
    ),
    "semicolons": ({"truth": ["frame;id;class"]}, "truth.csv, line 1: 'frame;id;class', expected names of columns"),
    "column of another table": ({"truth": [TRUTH[0] + ",scores"]}, "unknown column 'scores': known are class"),
    "column twice": ({"truth": [TRUTH[0] + ",x"]}, "truth.csv: column 'x' is there twice, expected once"),
    "column lacking": ({"truth": ["frame,id,class,x"]}, "truth.csv: no column 'y': m, centre of the box; found"),
    "no frame": ({"truth": ["id,class,x,y,yaw,l,w,h"]}, "neither a column 'frame' nor 'time', expected one of them"),
    "half a velocity": ({"truth": [TRUTH[0] + ",vx"]}, "one of the columns 'vx' and 'vy', expected both or none"),
    "a short row": ({"truth": [*TRUTH, "3,1,car"]}, "truth.csv, line 5: 3 columns, expected 10"),
    "a word": ({"truth": [*TRUTH, f"3,1,car,far,0,{BOX}"]}, "truth.csv, line 5, column 'x': 'far', expected a number"),
    "an empty cell": ({"truth": [*TRUTH, f"3,1,car,,0,{BOX}"]}, "line 5, column 'x': an empty cell, expected a number"),
    "no class": ({"truth": [*TRUTH, f"3,1,,0,0,{BOX}"]}, "line 5, column 'class': an empty cell, expected a word"),
    "not finite": ({"truth": [*TRUTH, f"3,1,car,nan,0,{BOX}"]}, "line 5, column 'x': nan, expected a finite number"),
    "far away": ({"detections": [*DETECTIONS, f"2,car,1e12,0,{BOX},1"]}, "line 4, column 'x': 1e+12, expected a"),
    "coordinates of a map": (
        {"truth": [*TRUTH, f"3,1,car,7,5400123.25,{BOX}"]},
        "line 5, column 'y': 5400123.25, expected -100000 to 100000 m: boxes are kept in single precision, so subtract",
    ),
    "detections far away": (
        {"detections": [*DETECTIONS, f"2,car,-100001,0,{BOX},1"]},
        "detections.csv, line 4, column 'x': -100001, expected -100000 to 100000 m",
    ),
    "an ego far away": (
        {"ego": [*EGO[:3], "2,0.2,500000,0,0,0"]},
        "one: x of the ego in frame 2 is 500000, expected -100000 to 100000 m",
    ),
    "half a frame": ({"truth": [*TRUTH, f"3.5,1,car,0,0,{BOX}"]}, "line 5, column 'frame': 3.5, expected a whole"),
    "no size": ({"truth": [*TRUTH, "3,1,car,0,0,1,0,0,1,1"]}, "line 5, column 'l': 0, expected a number from 1e-06"),
    "two boxes": ({"truth": [*TRUTH, TRUTH[1]]}, "line 5, column 'id': a second box of this object in this frame"),
    "other classes only": (
        {"truth": [TRUTH[0], f"0,1,cars,0,0,{BOX}"], "detections": DETECTIONS[:2]},
        "'class': 'cars', and no other row of the truth has a class of the task, one of car, pedestrian; did you mean",
    ),
    "a class like none": (
        {"truth": [TRUTH[0], f"0,1,zz,0,0,{BOX}"], "detections": DETECTIONS[:2]},
        "one of car, pedestrian; `mtp-bench envs` shows the classes of each environment",
    ),
    "degrees": (
        {"detections": [*DETECTIONS, "2,car,0,0,1,-90,4,2,1,1"]},
        "line 4, column 'yaw': -90, expected radians, such as -pi to pi; np.radians(yaw) makes radians of degrees",
    ),
    "a flag": (
        {"truth": [TRUTH[0] + ",neutral", *(f"{line},2" for line in TRUTH[1:])]},
        "truth.csv, line 2, column 'neutral': 2, expected 0 or 1",
    ),
    "a share": (
        {"truth": [TRUTH[0] + ",visible", *(f"{line},1.5" for line in TRUTH[1:])]},
        "line 2, column 'visible': 1.5, expected a number from 0 to 1",
    ),
    "a flag in other words": (
        {"truth": [TRUTH[0] + ",neutral", *(f"{line},yes" for line in TRUTH[1:])]},
        "truth.csv, line 2, column 'neutral': 'yes', expected 1, 0, true or false",
    ),
    "steps": (
        {"truth": [TRUTH[0], f"0,1,car,0,0,{BOX}", f"5,1,car,1,0,{BOX}"], "detections": DETECTIONS[:2]},
        "one: rows are of the frames 0, 5, ..., all 5 apart; number them 0, 1, 2, ..., or say by an ego table",
    ),
    "endless": (
        {"truth": [*TRUTH, f"99999999,1,car,0,0,{BOX}"]},
        "one: frames 0 to 99999999, expected at most 1000000 frames",
    ),
    "nothing": ({"truth": TRUTH[:1], "detections": DETECTIONS[:1]}, "its tables have no rows; an ego table says which"),
    "frame and time": (
        {"detections": ["time,class,x,y,yaw,l,w,h"]},
        "one: truth has frame, detections has time: give both the same column, or an ego table with both",
    ),
    "times that fall": (
        {"truth": [f"time,{TRUTH[0]}", *(f"{0.1 * (3 - i)},{line}" for i, line in enumerate(TRUTH[1:]))]},
        "truth.csv, line 3, column 'time': not after the time of the frame before",
    ),
    "two times of a frame": (
        {"truth": [f"time,{TRUTH[0]}", f"0,{TRUTH[1]}", f"0.1,{TRUTH[2]}", f"0.15,1,2,car,5,5,{BOX}"]},
        "truth.csv, line 4, column 'time': another time than that of its frame in the other rows",
    ),
    "a gap": (
        {
            "truth": ["time,id,class,x,y,z,yaw,l,w,h", *(f"{t},1,car,0,0,{BOX}" for t in (0, 0.1, 0.2, 0.4))],
            "detections": ["time,class,x,y,z,yaw,l,w,h"],
        },
        "one: no row between 0.2 s and 0.4 s, at 10 frames per second; frames without rows need an ego table",
    ),
    "ego that stands still": (
        {"ego": [*EGO, "3,0.2,0,0,0,0"]},
        "ego.csv, line 5, column 'time': expected a time after that of the row before",
    ),
    "ego with a frame twice": (
        {"ego": [*EGO, "2,0.3,0,0,0,0"]},
        "ego.csv, line 5, column 'frame': expected a number above that of the row before",
    ),
    "empty ego": ({"ego": EGO[:1]}, "ego.csv has no rows, expected one per frame"),
    "a frame that the ego has not": (
        {"ego": EGO[:3]},
        "truth.csv, line 4, column 'frame': no frame of the scene, which has 0 to 1",
    ),
    "frames without a number": (
        {"ego": ["time", "0", "0.1", "0.2"]},
        "truth.csv: frames by number, but the ego table has times only; give it a column 'frame'",
    ),
    "a time that the ego has not": (
        {"ego": ["time", "0", "0.1", "0.2"], "truth": ["time,id,class,x,y,z,yaw,l,w,h", f"0.05,1,car,0,0,{BOX}"]},
        "truth.csv, line 2, column 'time': no frame of the ego table has this time",
    ),
    "an object of two classes": (
        {"truth": [*TRUTH[:2], TRUTH[2].replace("car", "pedestrian"), TRUTH[3]]},
        "truth.csv, line 3, column 'class': 'pedestrian', but this object is of another class before",
    ),
    "a word without end": (
        {"truth": [*TRUTH, f"3,{'a' * 100_000},car,0,0,{BOX}"]},
        "truth.csv, line 5, column 'id': a word of 100000 characters, expected at most 200",
    ),
    "another rate": (
        {"ego": ["frame,time", "0,0", "1,0.02", "2,0.04"]},
        "one: frames are 0.02 s apart, but MTP-Small-v0 has 10 frames per second: keep every 5th frame, or take a card",
    ),
    "a slow log": (
        {"ego": ["frame,time", "0,0", "1,0.5", "2,1"]},
        "one: frames are 0.5 s apart, but MTP-Small-v0 has 10 frames per second: take a card with that rate",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("tables", "text"), TABLES.values(), ids=TABLES)
def test_a_mistake_in_a_table(tables: dict[str, list[str] | None], text: str, tmp_path: Path, base: Card) -> None:
    with pytest.raises(DataError, match=re.escape(text)) as caught:
        only(base, write_tables(tmp_path, **tables))
    assert str(tmp_path) in str(caught.value)


def test_the_folder_of_a_scene_instead_of_the_one_above(tmp_path: Path, base: Card) -> None:
    write_tables(tmp_path)
    with pytest.raises(DataError, match=rf"it is a scene itself: name the folder above, {re.escape(str(tmp_path))}$"):
        only(base, tmp_path / "one")


def test_two_forms_of_one_table(tmp_path: Path, base: Card) -> None:
    write_tables(tmp_path)
    (tmp_path / "one" / "truth.parquet").touch()
    with pytest.raises(DataError, match=r"one has truth\.csv and truth\.parquet, expected one of them"):
        only(base, tmp_path)


def test_a_scene_in_two_forms(tmp_path: Path, base: Card) -> None:
    save_scene(replace(make_scene("one"), detector="mine"), write_tables(tmp_path), CLASSES)
    with pytest.raises(DataError, match=r"has the scene 'one' as one and one\.npz, expected one of them"):
        only(base, tmp_path)


def test_files_that_are_none(tmp_path: Path, base: Card) -> None:
    write_tables(tmp_path)
    table = tmp_path / "one" / "truth.csv"
    table.write_bytes(b"\xff\xfe")
    with pytest.raises(DataError, match=r"truth\.csv: not valid UTF-8"):
        only(base, tmp_path)
    table.unlink()
    (tmp_path / "one" / "truth.parquet").write_bytes(b"PAR1 and more")
    with pytest.raises(DataError, match=r"truth\.parquet cannot be read as Parquet"):
        only(base, tmp_path)
    (tmp_path / "two.npz").write_bytes(b"PK and more")
    with pytest.raises(DataError, match=r"two\.npz: no NPZ file, or a broken one"):
        list(load_scenes(with_files(base, tmp_path), names=["two"]))


def test_texts_where_parquet_should_have_numbers(tmp_path: Path, base: Card) -> None:
    import pyarrow
    from pyarrow import parquet

    folder = write_tables(tmp_path, truth=None)
    names = TRUTH[0].split(",")
    columns = dict(zip(names, zip(*(line.split(",") for line in TRUTH[1:]), strict=True), strict=True))
    parquet.write_table(pyarrow.table(columns), folder / "one" / "truth.parquet")
    with pytest.raises(DataError, match=r"truth\.parquet, column 'frame': string, expected numbers"):
        only(base, folder)


def test_parquet_without_its_library(tmp_path: Path, base: Card, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = replace(make_scene(), detector="mine")
    save_scene(scene, tmp_path / "own", CLASSES, "parquet")
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    for attempt in (
        lambda: save_scene(scene, tmp_path / "other", CLASSES, "parquet"),
        lambda: only(base, tmp_path / "own"),
    ):
        with pytest.raises(MtpBenchError, match=r"Parquet needs pyarrow: pip install pyarrow, or write CSV"):
            attempt()
    assert not list((tmp_path / "other").iterdir()), "nothing half written"


def test_a_folder_without_scenes(tmp_path: Path, base: Card) -> None:
    with pytest.raises(DataError, match=r"no folder .*none, expected one with scenes"):
        with_files(base, tmp_path / "none")
    card = with_files(base, tmp_path)
    with pytest.raises(DataError, match="has no scene, expected NPZ files of one scene each, or a sub-folder for each"):
        open_source(card)
    assert describe(card).missing
    assert not describe(card).usable


ARRAYS: dict[str, tuple[dict[str, NDArray[np.generic] | None], str]] = {
    "unknown": ({"truht_box": np.zeros(3)}, "unknown array 'truht_box': did you mean 'truth_box'?"),
    "lacking": ({"truth_id": None}, "no array 'truth_id': the object, the same in all frames"),
    "lacking of some": ({"detections_box": None}, "no array 'detections_box': m and rad: x y z yaw l w h"),
    "shape": ({"truth_box": np.zeros((18, 6))}, "array 'truth_box': its shape is [18, 6], expected [R, 7], R 18"),
    "length": ({"truth_id": np.zeros(17, dtype=int)}, "array 'truth_id': its shape is [17], expected [R], R 18"),
    "type": ({"truth_id": np.zeros(18)}, "array 'truth_id': its type is float64, expected whole numbers"),
    "no texts": ({"truth_class": np.zeros(18, dtype=int)}, "array 'truth_class': its type is int64, expected texts"),
    "frame": ({"truth_frame": np.full(18, 9)}, "array 'truth_frame', row 0: frame 9, but the scene has the frames"),
    "size": ({"truth_box": np.zeros((18, 7))}, "array 'truth_box', row 0 (l): 0, expected a number from 1e-06"),
    "two boxes": ({"truth_id": np.zeros(18, dtype=int)}, "array 'truth_id', row 1: a second box of this object in"),
    "time": ({"time": np.zeros(6)}, "time 0 of frame 1, expected a number above that of the frame before"),
    "no frames": ({"time": np.zeros(0), "ego": np.zeros((0, 4))}, "its shape is"),
    "ego": ({"ego": np.full((6, 4), np.nan)}, "the ego has a place that is not finite"),
    "said": ({"said": np.array("{}}")}, "array 'said': expected JSON with some of truth_complete, listed_targets"),
    "said wrongly": ({"said": np.array('{"recording": 3}')}, "array 'said': expected JSON with some of truth_complete"),
    "counts": ({"said": np.array('{"skipped": {"a": "b"}}')}, "array 'said': skipped holds something else than counts"),
    "half an image": ({"image_size": None}, "no array 'image_size', but others of image_projection, image_height"),
    "regions": ({"image_region_frame": np.array([7, 8])}, "array 'image_region_frame': expected frames"),
    "lanes": ({"lane_of": np.full(9, 2)}, "array 'lane_of': expected the lanes 0, 1, 2, ... of 'lane_points', sorted"),
    "next lane": ({"lane_following": np.array([[0, 7]])}, "array 'lane_following': expected lanes from 0 to 2"),
    "ways of other lanes": (
        {"lane_junction": np.zeros(4, dtype=bool)}, "array 'lane_junction': 4 lanes, expected the 3 of 'lane_of'",
    ),
    "far lanes": ({"lane_of": np.array([0] * 8 + [2**50])}, "array 'lane_of': expected the lanes 0, 1, 2, ... of"),
    "lanes at no place": ({"lane_points": np.full((9, 3, 2), np.nan)}, "array 'lane_points': a number that is not"),
    "an image of nothing": ({"image_size": np.array([0, 0])}, "array 'image_size': 0 x 0 pixels, expected"),
    "an image of no place": ({"image_projection": np.full((6, 3, 4), np.inf)}, "array 'image_projection': a number"),
    "ids below 0": ({"truth_id": np.arange(18) - 3}, "'truth_id', row 0: -3, expected a whole number from 0 to 21"),
    "large ids": ({"truth_id": np.arange(18) + 5 * 10**9}, "'truth_id', row 0: 5000000000, expected a whole number"),
    "no room": ({"truth_id": np.arange(2**63, 2**63 + 18, dtype=np.uint64)}, "expected whole numbers below 2**63"),
    "endless time": ({"time": np.array([0, 0.1, 0.2, 0.3, 0.4, np.inf])}, "time inf of frame 5, expected a number"),
    "deeply said": ({"said": np.array("[" * 100_000)}, "array 'said': expected JSON with some of truth_complete"),
    "image classes": (
        {"image_classes": np.array(["car", "pedestrain"])},
        "image_classes has no 'pedestrian', which MTP-Small-v0 has; found: car, pedestrain",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("changes", "text"), ARRAYS.values(), ids=ARRAYS)
def test_a_mistake_in_an_archive(
    changes: dict[str, NDArray[np.generic] | None], text: str, tmp_path: Path, base: Card
) -> None:
    path = save_scene(whole_scene(), tmp_path, CLASSES)
    with np.load(path) as stored:
        arrays = {name: array for name, array in {**stored, **changes}.items() if array is not None}
    np.savez(path, allow_pickle=False, **arrays)
    with pytest.raises(DataError, match=re.escape(text)) as caught:
        only(base, tmp_path)
    assert str(path) in str(caught.value)


def test_what_is_no_array_in_an_archive(tmp_path: Path, base: Card) -> None:
    path = save_scene(whole_scene(), tmp_path, CLASSES)
    with np.load(path) as stored:
        np.savez(path, allow_pickle=False, **{name: array for name, array in stored.items() if name != "ego"})
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("ego.npy", b"no array")
    with pytest.raises(DataError, match=r"one\.npz: no NPZ file, or a broken one: 'ego' in it is no array"):
        only(base, tmp_path)


def test_numbers_of_any_width_and_order(tmp_path: Path, base: Card) -> None:
    scene = whole_scene()
    path = save_scene(scene, tmp_path, CLASSES)
    with np.load(path) as stored:
        turned = {name: array.astype(array.dtype.newbyteorder(">")) for name, array in stored.items()}
    np.savez(path, allow_pickle=False, **turned)
    assert_same(only(base, tmp_path), scene)


def test_names_that_two_scenes_would_have(tmp_path: Path, base: Card) -> None:
    scene = replace(make_scene(), detector="mine")
    save_scene(replace(scene, name="a/b"), tmp_path, CLASSES)
    (tmp_path / "a%2Fb.npz").rename(tmp_path / "a%2fb.npz")
    save_scene(replace(scene, name="a/b"), tmp_path, CLASSES)
    with pytest.raises(DataError, match=r"has the scene 'a/b' as a%2Fb\.npz and a%2fb\.npz, expected one of them"):
        only(base, tmp_path)


@pytest.mark.parametrize("name", ["", "x" * 201, "\udcff", 3])
def test_names_that_no_file_of_a_run_could_have(name: str, base: Card) -> None:
    with pytest.raises(DataError, match=r"a scene is called .*, expected a text of 1 to 200 characters"):
        open_source(with_scenes(base, [replace(make_scene(), detector="mine", name=name)]))


def test_what_is_hidden_is_no_scene(tmp_path: Path, base: Card) -> None:
    card = with_files(base, write_tables(tmp_path))
    write_tables(tmp_path / "other")
    (tmp_path / "other" / "one").rename(tmp_path / ".checkpoint")
    (tmp_path / "other").rmdir()
    assert open_source(with_files(base, tmp_path)).names == ("one",)
    assert with_files(base, tmp_path).digest == card.digest


def test_names_do_not_stand_for_contents(tmp_path: Path) -> None:
    first, second = (tmp_path / name for name in "ab")
    for folder in (first, second):
        folder.mkdir()
        (folder / "b.npz").write_bytes(b"two")
    (first / "a.npz").write_bytes(b"one")
    known = f"a.npz {hashlib.sha256(b'one').hexdigest()};b.npz"
    (second / "b.npz").rename(second / known)
    assert folder_digest(first) != folder_digest(second)


def test_1_and_01_are_two_objects(tmp_path: Path, base: Card) -> None:
    write_tables(tmp_path, truth=[*TRUTH, f"2,01,car,9,0,{BOX}"])
    assert len(set(only(base, tmp_path).truth.object_id.tolist())) == 2


@pytest.mark.parametrize(("first", "second"), [("5000000000", "7"), ("-5", "6")])
def test_ids_that_no_observation_could_hold_are_words(first: str, second: str, tmp_path: Path, base: Card) -> None:
    truth = [TRUTH[0], f"0,{second},car,0,0,{BOX}", f"1,{first},car,1,0,{BOX}", f"1,{second},car,2,0,{BOX}"]
    scene = only(base, write_tables(tmp_path, truth=truth, detections=DETECTIONS[:2]))
    np.testing.assert_array_equal(scene.truth.object_id, [1, 0, 1])
    largest = [line.replace(f",{second},", ",2147483647,") for line in truth[:2]]
    found = only(base, write_tables(tmp_path / "largest", truth=largest, detections=DETECTIONS[:2]))
    np.testing.assert_array_equal(found.truth.object_id, [2147483647])


@pytest.mark.parametrize("number", [-1, 2**31])
def test_ids_of_a_scene_in_memory(number: int, tmp_path: Path, base: Card) -> None:
    scene = make_scene()
    object_id = np.where(scene.truth.object_id == scene.truth.object_id[0], number, scene.truth.object_id)
    wrong = replace(scene, detector="mine", truth=replace(scene.truth, object_id=object_id))
    for attempt in (
        lambda: list(load_scenes(with_scenes(base, [wrong]))),
        lambda: save_scene(wrong, tmp_path, CLASSES),
    ):
        with pytest.raises(DataError, match=r"scene 'one': truth\.object_id has .*, expected whole numbers from 0 to"):
            attempt()
    assert not any(tmp_path.iterdir())


def test_a_scene_in_memory_far_away(base: Card) -> None:
    scene = replace(make_scene(), detector="mine")
    moved = replace(scene, truth=replace(scene.truth, box=scene.truth.box + 5e5 * np.eye(7)[0]))
    with pytest.raises(DataError, match=r"scene 'one', array 'truth_box', row 0 \(x\): 5000.*subtract a fixed origin"):
        list(load_scenes(with_scenes(base, [moved])))


def test_scenes_in_memory_have_no_splits(base: Card) -> None:
    card = with_scenes(base, [replace(make_scene(), detector="mine")])
    assert with_split(card, "all").digest == card.digest
    with pytest.raises(
        CardError, match="its scenes are objects in memory, which have no split 'train', expected 'all'"
    ):
        with_split(card, "train")


def test_an_archive_of_objects_is_not_opened(tmp_path: Path, base: Card) -> None:
    np.savez(tmp_path / "one.npz", time=np.array([print], dtype=object), allow_pickle=True)
    with pytest.raises(
        DataError, match=r"one\.npz: no NPZ file, or a broken one: it holds Python objects, which are never"
    ):
        only(base, tmp_path)


def test_one_other_byte_in_an_archive_is_no_traceback(tmp_path: Path, base: Card) -> None:
    path = save_scene(replace(make_scene(), detector="mine"), tmp_path, CLASSES)
    broken = 0
    for _ in flips(path, 200):
        try:
            read_archive(path)
        except DataError as error:
            assert str(path) in str(error)  # noqa: PT017
            broken += 1
    assert broken > 50
    cut_head(path, "time")
    with pytest.raises(DataError, match=r"one\.npz: no NPZ file, or a broken one"):
        only(base, tmp_path)


@pytest.mark.parametrize("form", ["npz", "csv"])
def test_a_name_that_no_file_could_have_is_not_written(form: Form, tmp_path: Path) -> None:
    for name in ("\udcff", "", "x" * 201):
        with pytest.raises(DataError, match=r"a scene is called .*, expected a text of 1 to 200 characters"):
            save_scene(replace(make_scene(), name=name), tmp_path, CLASSES, form)
    assert list(tmp_path.iterdir()) == []


def test_stored_tracks_are_not_dropped_unsaid(tmp_path: Path) -> None:
    scene = make_scene()
    seen = scene.detections
    tracks = StoredTracks(**vars(seen), object_id=np.arange(len(seen.box)))
    with pytest.raises(MtpBenchError, match=r"scene 'one' has stored tracks, which have files of .*tracks=None"):
        save_scene(replace(scene, tracks=tracks), tmp_path, CLASSES)
    assert list(tmp_path.iterdir()) == []


def test_ways_through_junctions_are_stored_where_there_are_any(tmp_path: Path) -> None:
    """A map of an earlier version is read as before, and one without such ways is written as before."""
    scene = whole_scene()
    path = save_scene(scene, tmp_path, CLASSES)
    assert [lane.junction for lane in read_archive(path).said["lanes"]] == [False, True, False]
    plain = tuple(replace(lane, junction=False) for lane in scene.lanes)
    path = save_scene(replace(scene, lanes=plain), tmp_path, CLASSES)
    with np.load(path) as stored:
        assert "lane_junction" not in stored.files
    assert [lane.junction for lane in read_archive(path).said["lanes"]] == [False] * 3


def test_a_scene_in_memory_that_is_wrong(base: Card) -> None:
    scene = replace(make_scene(), detector="mine")
    truth = scene.truth
    short = replace(scene, truth=replace(truth, start=truth.start[:-1]))
    with pytest.raises(DataError, match=r"scene 'one': truth\.start does not divide the 24 rows into 8 frames"):
        next(load_scenes(with_scenes(base, [short])))
    strange = replace(scene, truth=replace(truth, class_id=truth.class_id + 1))
    with pytest.raises(DataError, match=r"truth\.class_id has 1 to 2, expected places among 2 classes"):
        next(load_scenes(with_scenes(base, [strange])))
    with pytest.raises(CardError, match="two scenes are called 'one', expected a name of its own for each"):
        with_scenes(base, [scene, scene])
    with pytest.raises(CardError, match="scenes holds str, expected Scene objects only, or names only"):
        with_scenes(base, [scene, "one"])  # type: ignore[list-item]
    with pytest.raises(DataError, match="no scene in the list, expected at least one"):
        open_source(with_scenes(base, []))
    unseen = replace(scene, detections=scene.detections.select(scene.detections.score > 9))
    assert not len(next(load_scenes(with_scenes(base, [unseen]))).detections.box), "detected, and nothing found"
    with pytest.raises(DataError, match="scene 'one': no detections; without them a simulated detector runs at once"):
        next(load_scenes(with_scenes(base, [replace(unseen, detector="")])))


def test_two_clips_are_no_scene(tmp_path: Path, base: Card) -> None:
    times = ["0", "0.1", "0.2", "0.3", "60.3"]
    ego = [EGO[0], *(f"{t},{time},0,0,0,0" for t, time in enumerate(times))]
    said = r"frame 4 is 60 s after the one before, expected at most 1\.05 s; make a scene of each side"
    with pytest.raises(DataError, match=said):
        only(base, write_tables(tmp_path, ego=ego))
    ego[-1] = "4,0.6,0,0,0,0"  # two frames are lacking
    assert only(base, write_tables(tmp_path / "short", ego=ego)).frames == 5


@pytest.mark.parametrize(
    ("last", "said"),
    [
        ("0,0,0,90", r"yaw of the ego in frame 2 is 90, expected radians"),
        ("-9e4,0,0,0", r"x of the ego in frame 2 is 180000 m from that of frame 0, expected at most 100000 m"),
        ("0,0,1e6,0", r"z of the ego in frame 2 is "),
    ],
)
def test_poses_that_nobody_can_have(last: str, said: str, tmp_path: Path, base: Card) -> None:
    ego = [EGO[0], "0,0,9e4,0,0,0", "1,0.1,9e4,0,0,0", f"2,0.2,{last}"]
    if "x of" not in said:
        ego = [line.replace("9e4", "0") for line in ego]
    with pytest.raises(DataError, match=said):
        only(base, write_tables(tmp_path, ego=ego))
