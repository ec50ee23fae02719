"""Own scenes in files: what is written is read again, what is left out has its default, a mistake has its sentence."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow
import pytest
from hypothesis import given, settings, strategies as st
from numpy.typing import NDArray
from pyarrow import parquet

from mtp_bench.cards import Card, load_card, with_detector, with_files, with_scenes, with_split
from mtp_bench.cards.card import LaneSection
from mtp_bench.cards.own import own_digest
from mtp_bench.core import Detections, Scene, StoredTracks, Truth, starts_of
from mtp_bench.core.errors import CardError, DataError, MtpBenchError, UnknownNameError
from mtp_bench.scoring import find_targets, unlabelled
from mtp_bench.sources import camera_images, load_scenes, open_source
from mtp_bench.sources.cache import scene_digest
from mtp_bench.sources.files.save import TableForm, save_scene
from tests.support.own_scenes import (
    BOX,
    CLASSES,
    DETECTIONS,
    EGO,
    TRUTH,
    assert_same,
    whole_scene,
    write_long_log,
    write_tables,
)  # fmt: skip
from tests.support.small_scenes import make_scene

FORMS: tuple[TableForm, ...] = ("csv", "parquet")


@pytest.fixture(scope="module")
def base(card: str) -> Card:
    return load_card(card)


def only(card: Card, folder: Path) -> Scene:
    (scene,) = load_scenes(with_files(card, folder))
    return scene


# --- what is written is read again -----------------------------------------------------------------------------------
def test_a_scene_in_memory_keeps_all_its_fields(base: Card) -> None:
    scene = whole_scene()
    (again,) = load_scenes(with_scenes(base, [scene]))
    assert_same(again, scene)


@settings(max_examples=20, derandomize=True)
@given(data=st.data())
@pytest.mark.parametrize("form", FORMS)
def test_any_scene_comes_back(
    form: TableForm, tmp_path_factory: pytest.TempPathFactory, base: Card, data: st.DataObject
) -> None:
    scene = data.draw(scenes())
    folder = tmp_path_factory.mktemp("own")
    save_scene(scene, folder, CLASSES, form)
    assert_same(only(base, folder), scene)


@st.composite
def scenes(draw: st.DrawFn) -> Scene:
    counts = draw(st.lists(st.tuples(st.integers(0, 3), st.integers(0, 3)), min_size=1, max_size=5))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    counts[0] = counts[0][0] + 1, counts[0][1]  # a truth without rows is refused
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
        object_names={row: f"word {row:02}" for row in range(rows)} if draw(st.booleans()) else {},
        lanes=whole_scene().lanes if draw(st.booleans()) else (),
    )  # fmt: skip


def boxes(rng: np.random.Generator, rows: int) -> NDArray[np.float64]:
    place, yaw = rng.normal(scale=1e3, size=(rows, 3)), rng.normal(scale=np.pi, size=(rows, 1))
    return np.hstack([place, yaw, rng.exponential(size=(rows, 3)) + 1e-5])


def velocities(rng: np.random.Generator, rows: int) -> NDArray[np.float64]:
    return np.where(rng.random((rows, 1)) < 0.5, np.nan, rng.normal(size=(rows, 2)))


def test_fields_that_tables_cannot_hold_are_not_dropped_silently(tmp_path: Path) -> None:
    with pytest.raises(MtpBenchError, match="scene 'one' has image, world, recording, which tables cannot"):
        save_scene(whole_scene(), tmp_path, CLASSES)
    scene = make_scene()
    tracks = StoredTracks(**vars(scene.detections), object_id=np.arange(len(scene.detections.box)))
    with pytest.raises(MtpBenchError, match=r"has tracks, .* dataclasses\.replace\(scene, tracks=None\)"):
        save_scene(replace(scene, tracks=tracks), tmp_path, CLASSES)
    with pytest.raises(UnknownNameError, match="unknown form of a scene 'cvs': did you mean 'csv'"):
        save_scene(scene, tmp_path, CLASSES, "cvs")  # type: ignore[arg-type]
    for name in ("\udcff", "", "x" * 201):
        with pytest.raises(DataError, match=r"the name of a scene is .*, expected a text of 1 to 200 characters"):
            save_scene(replace(scene, name=name), tmp_path, CLASSES)
    assert not any(tmp_path.iterdir())


def test_no_file_of_a_user_is_lost(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = replace(make_scene(), detector="mine")
    folder = save_scene(scene, tmp_path, CLASSES, "csv")
    assert save_scene(scene, tmp_path, CLASSES, "parquet") == folder
    (folder / "notes.txt").write_text("mine")
    with pytest.raises(MtpBenchError, match=r"one has 'notes\.txt', which would be lost: choose another folder"):
        save_scene(scene, tmp_path, CLASSES, "csv")
    assert (folder / "notes.txt").read_text() == "mine"
    (folder / "notes.txt").unlink()
    (tmp_path / "two").write_text("mine")
    with pytest.raises(MtpBenchError, match="two is a file, which would be lost"):
        save_scene(replace(scene, name="two"), tmp_path, CLASSES, "csv")
    assert (tmp_path / "two").read_text() == "mine"
    monkeypatch.chdir(folder)
    with pytest.raises(MtpBenchError, match="the working folder"):
        save_scene(scene, tmp_path, CLASSES, "csv")


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


def test_words_are_ids_and_rows_come_in_any_order(tmp_path: Path, base: Card) -> None:
    truth = [TRUTH[0], f"1,van b,car,1,0,{BOX}", f"0,van b,car,0,0,{BOX}", f"1,a,pedestrian,9,9,{BOX}"]
    scene = only(base, write_tables(tmp_path, truth=truth, detections=DETECTIONS[:2]))
    np.testing.assert_array_equal(scene.truth.object_id, [1, 1, 0])
    np.testing.assert_array_equal(scene.truth.class_id, [0, 0, 1])
    assert (scene.object_names, scene.name_of(1), scene.name_of(7)) == ({0: "a", 1: "van b"}, "van b", "7")
    assert with_scenes(base, [scene]).digest == with_scenes(base, [replace(scene, object_names={})]).digest
    words = ["c1e6" * 8, "pedestrian of group 1", "pedestrian of group 2", "pedestrian alone"]
    long = replace(scene, object_names=dict(enumerate(words)))
    assert [long.short_name(i) for i in range(5)] == ["c1e6c1e6", "#1", "#2", "pedestrian alone", "4"]


def test_rows_of_other_classes_are_left_out_and_counted(tmp_path: Path, base: Card) -> None:
    truth = [*TRUTH, f"0,8,person,1,5,{BOX}", f"1,8,person,1,5,{BOX}"]
    scene = only(base, write_tables(tmp_path, truth=truth))
    assert len(scene.truth.box) == 3
    assert scene.skipped == {"truth of class 'person', which the task does not have: did you mean 'pedestrian'?": 2}


@pytest.mark.parametrize("name", ["Car", "cars", "vehicle.car", "CAR", "car.", "\uff43\uff41\uff52", "Pedestrain"])
@pytest.mark.parametrize("table", ["truth", "detections"])
def test_a_class_in_another_spelling_is_refused(table: str, name: str, tmp_path: Path, base: Card) -> None:
    """Its rows would be skipped, and counted where nobody looks."""
    rows = {"truth": TRUTH, "detections": DETECTIONS}
    rows[table] = [*rows[table], rows[table][1].replace("car", name)]
    message = rf"line {len(rows[table])}, column 'class': '{name}' is not a class of the task; did you mean '"
    with pytest.raises(DataError, match=message):
        only(base, write_tables(tmp_path, **rows))


@pytest.mark.parametrize("sides", ["0,1.8,1.5", "4,-1.8,1.5", "4,1.8,1e-9"])
def test_flat_detections_are_left_out_and_counted(sides: str, tmp_path: Path, base: Card) -> None:
    scene = only(base, write_tables(tmp_path, detections=[*DETECTIONS, f"1,car,5,5,0.8,0,{sides},0.9"]))
    assert (scene.detections.start.tolist(), scene.skipped) == ([0, 1, 1, 2], {"detection size not above 0": 1})


def test_lanes_and_images_are_for_pictures_alone(tmp_path: Path, base: Card) -> None:
    card = with_files(base, write_tables(tmp_path, ego=["frame", "4", "5", "6"], truth=later(TRUTH), detections=None))
    card = with_detector(card, "kitti_pointrcnn")
    for frame in (4, 6):
        (tmp_path / f"one/{frame}.png").touch()
    write_tables(tmp_path, truth=later(TRUTH), detections=None, lanes=LANES, images=IMAGES)
    (scene,) = load_scenes(card)
    turn, way = scene.lanes
    np.testing.assert_allclose(way.center, [[0, 0], [4, 0], [9, 0]])
    np.testing.assert_allclose([way.left[1], way.right[1]], [[4, 1.75], [4, -1.75]])
    assert (way.junction, turn.junction, way.following, turn.following) == (False, True, (1, 0), ())
    first, last = camera_images(scene, card)
    assert (first.frame, first.camera, first.path, first.size) == (0, "front", tmp_path / "one/4.png", (64, 48))
    assert (last.frame, last.projection.tolist()) == (2, np.arange(12.0).reshape(3, 4).tolist())
    notes: list[str] = []
    write_tables(tmp_path, truth=later(TRUTH), detections=None, images=[*IMAGES, IMAGES[1].replace("6.png", "7.png")])
    assert not camera_images(scene, card, note=notes.append)
    assert f"images.csv, line 4, column 'file': no file {tmp_path}/one/7.png" in notes[0]


LANES = [
    "lane,x,y,junction,following", "turn,9,0,true,", "turn,9,5,0,", "way,0,0,0,way turn", "way,4,0,0,",
    "way,9,0,0,turn",
]  # fmt: skip
IMAGES = [
    "frame,camera,file,width,height,p00,p01,p02,p03,p10,p11,p12,p13,p20,p21,p22,p23",
    *(f"{frame},front,{frame}.png,64,48,0,1,2,3,4,5,6,7,8,9,10,11" for frame in (6, 4)),
]


def later(lines: list[str]) -> list[str]:
    """Rows of frames 0 to 2 as those of frames 4 to 6."""
    return [lines[0], *(f"{int(line[0]) + 4}{line[1:]}" for line in lines[1:])]


def test_a_scene_with_two_objects_at_one_place_or_none_is_not_written(tmp_path: Path) -> None:
    scene = make_scene()
    box = scene.truth.box.copy()
    box[scene.truth.rows(1), :2] = 3.0
    with pytest.raises(DataError, match=r"'one': truth, frame 1: the objects \d+(, \d+)* and \d+ are all at x 3, y 3"):
        save_scene(replace(scene, truth=replace(scene.truth, box=box)), tmp_path, CLASSES)
    empty = scene.truth.select(np.zeros(len(box), dtype=bool))
    with pytest.raises(DataError, match="scene 'one': truth has no rows"):
        save_scene(replace(scene, truth=empty, visible=None), tmp_path, CLASSES)
    assert not any(tmp_path.iterdir())


def test_targets_alone_are_no_complete_truth(tmp_path: Path, base: Card) -> None:
    card = with_files(base, write_tables(tmp_path))
    card = card.model_copy(update={"source": card.source.model_copy(update={"truth": "targets"})})
    (scene,) = load_scenes(card)
    assert not scene.truth_complete
    with pytest.raises(CardError, match="would see nothing but the prediction targets"):
        with_detector(card, "kitti_pointrcnn")


# --- splits, and what the digest holds -------------------------------------------------------------------------------
def test_splits_are_sub_folders(tmp_path: Path, base: Card) -> None:
    for name in ("train", "val"):
        save_scene(replace(make_scene(name), detector="mine"), tmp_path / name, CLASSES)
    save_scene(replace(make_scene("top"), detector="mine"), tmp_path, CLASSES)
    card = with_files(base, tmp_path)
    assert (open_source(card).names, open_source(with_split(card, "train")).names) == (("top",), ("train",))
    assert len({card.digest, with_split(card, "train").digest, with_split(card, "val").digest}) == 3
    with pytest.raises(DataError, match=r"no folder .*test, expected a sub-folder for each scene"):
        open_source(with_split(card, "test"))


def test_the_digest_holds_what_the_files_hold_and_not_where_they_are(tmp_path: Path, base: Card) -> None:
    here, there = write_tables(tmp_path / "a"), write_tables(tmp_path / "b" / "deep")
    card = with_files(base, here)
    assert card.digest == with_files(base, there).digest != base.digest
    (here / "notes.txt").write_text("not a scene")
    assert with_files(base, here).digest == card.digest
    write_tables(here, detections=DETECTIONS[:2])
    assert with_files(base, here).digest != card.digest
    with pytest.raises(DataError, match="they are not those of MTP-Small-v0, or changed after a run with this card"):
        open_source(card)
    assert str(tmp_path) not in str(card.model_dump(mode="json"))
    cards = base, base.model_copy(update={"lanes": LaneSection()})
    before = [with_files(one, here).digest for one in cards]
    write_tables(here, detections=DETECTIONS[:2], lanes=LANES)
    after = [with_files(one, here).digest for one in cards]
    assert [a == b for a, b in zip(before, after, strict=True)] == [True, False], "only pictures show them, agents too"


# --- what of the truth is annotated ----------------------------------------------------------------------------------
AREAS = ["x_min,y_min,x_max,y_max", "-1.5,0,2,3"]


@pytest.mark.parametrize("form", FORMS)
def test_annotated_frames_and_neutral_areas_are_read_and_written(form: TableForm, tmp_path: Path, base: Card) -> None:
    scene = replace(make_scene(frames=6, empty=(2,)), detector="mine", annotated=np.arange(6) != 5)
    scene = replace(scene, truth=scene.truth.select(scene.truth.frame_of_rows != 5))
    scene = replace(scene, neutral_areas=np.array([[-1.5, 0.0, 2.0, 3.0], [5.0, 5.0, 6.0, 6.25]]))
    folder = save_scene(scene, tmp_path, CLASSES, form)
    assert {"annotated", "neutral_areas"} < {path.stem for path in folder.iterdir()}
    again = only(base, tmp_path)
    for name in ("annotated", "neutral_areas"):
        np.testing.assert_array_equal(getattr(again, name), getattr(scene, name))
    save_scene(again, tmp_path, CLASSES, form)
    assert_same(only(base, tmp_path), again)


def test_truth_in_other_frames_is_left_out_and_counted(tmp_path: Path, base: Card) -> None:
    """The digest of the card holds the tables; agents and their baselines see detections of every frame."""
    whole = with_files(base, write_tables(tmp_path))
    tables = {"annotated": ["frame", "2", "1"], "neutral_areas": AREAS}
    for name, lines in tables.items():
        before = with_files(base, tmp_path).digest
        write_tables(tmp_path, **{name: lines})
        assert with_files(base, tmp_path).digest != before
    scene = only(base, tmp_path)
    assert scene.annotated is not None
    assert (scene.annotated.tolist(), scene.truth.counts.tolist()) == ([False, True, True], [0, 1, 1])
    assert scene.skipped == {"true boxes in frames that are not annotated": 1}
    assert scene.detections.counts.tolist() == [1, 0, 1]
    assert scene_digest(scene) != scene_digest(replace(scene, annotated=None))
    with pytest.raises(DataError, match="sha256"):
        open_source(whole)
    write_tables(tmp_path, detections=None)
    with pytest.raises(DataError, match="scene 'one': only some of its frames are annotated, so a simulated detector"):
        only(with_detector(base, "nuscenes_megvii"), tmp_path)


def test_a_card_states_that_every_nth_frame_is_annotated(tmp_path: Path, base: Card) -> None:
    task = base.task.model_copy(update={"annotated_every": 2, "past": 3})
    card = base.model_copy(update={"task": task})
    assert (card.digest != base.digest, base.task.annotated_every) == (True, None)
    folder = write_long_log(tmp_path, frames=10)
    scene = only(card, folder)
    assert scene.annotated_frames.tolist() == [0, 2, 4, 6, 8]
    assert scene.truth.counts.tolist() == [2, 0] * 5
    write_tables(folder, truth=None, detections=None, annotated=["frame", *map(str, range(10))])
    assert only(card, folder).truth.counts.tolist() == [2] * 10  # a table says more than the card


def test_sweeps_between_keyframes(tmp_path: Path, base: Card) -> None:
    """nuScenes: ego and detections come with every sweep, at about 20 Hz, labels with keyframes, at 2 Hz."""
    keyframes = [0, 10, 19, 30, 40, 50, 61, 70]
    sweeps = range(75)
    rng = np.random.default_rng(0)
    time = 1.5e9 + 0.05 * np.arange(75) + rng.uniform(-0.005, 0.005, 75)
    truth = [TRUTH[0], *(f"{t},a1,car,{0.4 * t},0,{BOX}" for t in keyframes)]
    detections = [DETECTIONS[0], *(f"{t},car,{0.4 * t},0,{BOX},0.9" for t in sweeps)]
    ego = ["frame,time,x", *(f"{t},{time[t]:.4f},{0.3 * t}" for t in sweeps)]
    write_tables(
        tmp_path, truth=truth, detections=detections, ego=ego, annotated=["frame", *map(str, keyframes)]
    )  # fmt: skip
    task = base.task.model_copy(update={"rate": 20.0, "past": 20, "future": 30})
    card = base.model_copy(update={"task": task})
    scene = only(card, tmp_path)
    assert (scene.annotated_step, scene.annotated_frames.tolist()) == (10, keyframes)
    targets = find_targets(scene, card)  # 2 keyframes of past, 3 of future
    assert targets.frame.tolist() == keyframes[1:5]
    assert targets.step.tolist() == [[8, 19, 29], [10, 20, 29], [9, 19, 29], [9, 20, 29]]
    np.testing.assert_allclose(targets.future[:, :, 0], [[0.4 * t for t in keyframes[i : i + 3]] for i in range(2, 6)])
    missed = np.isin(sweeps, keyframes)
    assert not unlabelled(scene, np.flatnonzero(missed), np.zeros((8, 2))).any()
    assert unlabelled(scene, np.flatnonzero(~missed), np.zeros((67, 2))).all()


# --- one sentence for every mistake ----------------------------------------------------------------------------------
TABLES: dict[str, tuple[dict[str, list[str] | None], str]] = {
    "no truth": ({"truth": None}, "one: no table truth.csv or truth.parquet, which the score needs"),
    "a name in the singular": ({"detections": None, "detection": DETECTIONS}, "detection.csv is not a known table; di"),
    "a lane in the singular": ({"lane": LANES}, "lane.csv is not a known table; did you mean lanes.csv?"),
    "a lane of one point": ({"lanes": LANES[:2]}, "lanes.csv, line 2, column 'lane': the only point of this lane, exp"),
    "a lane of another map": ({"lanes": [*LANES, "way,12,0,0,turn exit"]}, "lanes.csv, line 7, column 'following': 'e"),
    "a border": ({"lanes": ["lane,x,y,left_x"]}, "lanes.csv: some of the columns 'left_x', 'left_y', 'right_x', 'r"),
    "annotated frames in the singular": ({"annotate": ["frame", "0"]}, "annotate.csv is not a known table; did you mea"),
    "an annotated frame that is not there": (
        {"annotated": ["frame", "0", "1", "3"]},
        "annotated.csv, line 4, column 'frame': no frame of the scene, which has 0 to 2",
    ),
    "annotated frames without their column": ({"annotated": ["time", "0"]}, "annotated.csv: unknown column 'time'"),
    "no border of an area": ({"neutral_areas": [*AREAS[:1], "0,,2,3"]}, "neutral_areas.csv, line 2, column 'y_min'"),
    "an area turned over": ({"neutral_areas": [*AREAS, "0,3,2,1"]}, "line 3, column 'y_min': expected less than y_max"),
    "no detections": ({"detections": None}, "one: no detections; without them a simulated detector runs at once"),
    "names alone": ({"truth": TRUTH[:1]}, "truth.csv has no rows, expected one per object and frame"),
    "one place": (
        {"truth": [*TRUTH, f"1,bob,car,3,0,{BOX}", f"1,7,tram,3,0,{BOX}", f"1,eve,pedestrian,3,0,{BOX}"]},
        "truth.csv, line 7: the objects bob and eve are all at x 3, y 0; expected a place of its own for each",
    ),
    "blanks": ({"truth": [line.replace(",", " ") for line in TRUTH]}, "truth.csv, line 1: this file is separated by b"),
    "column twice": ({"truth": [TRUTH[0] + ",x"]}, "truth.csv: column 'x' occurs twice, expected once"),
    "column lacking": ({"truth": ["frame,id,class,x"]}, "truth.csv: no column 'y': m, centre of the box; found"),
    "empty file": ({"truth": []}, "truth.csv is empty, expected a line with the names of the columns"),
    "a short row": ({"truth": [*TRUTH, "3,1,car"]}, "truth.csv, line 5: 3 columns, expected 10 (frame, id"),
    "no size": ({"truth": [*TRUTH, "3,1,car,0,0,1,0,0,1,1"]}, "line 5, column 'l': 0, expected a number from 1e-06"),
    "two boxes": ({"truth": [*TRUTH, TRUTH[1]]}, "line 5: a second box of object 1 in frame 0"),
    "degrees": ({"detections": [*DETECTIONS, "2,car,0,0,1,-90,4,2,1,1"]}, "line 4, column 'yaw': -90, expected radian"),
    "steps": (
        {"truth": [TRUTH[0], f"0,1,car,0,0,{BOX}", f"5,1,car,1,0,{BOX}"], "detections": DETECTIONS[:2]},
        "one: rows have the frames 0, 5, ..., all 5 apart; number them 0, 1, 2, ..., or define the frames by",
    ),
    "endless": ({"truth": [*TRUTH, f"99999999,1,car,0,0,{BOX}"]}, "one: frames 0 to 99999999, expected at most 100000"),
    "ego that stands still": ({"ego": [*EGO, "3,0.2,0,0,0,0"]}, "one: time 0.2 of frame 3, expected a number above th"),
    "a frame that the ego has not": ({"ego": EGO[:3]}, "truth.csv, line 4, column 'frame': no frame of the scene, whi"),
    "an object of two classes": (
        {"truth": [*TRUTH[:2], TRUTH[2].replace("car", "pedestrian"), TRUTH[3]]},
        "truth.csv, line 3, column 'class': 'pedestrian', but object '1' has another class before: did two objects exch",
    ),
    "a pose in degrees": ({"ego": [*EGO[:3], "2,0.2,0,0,0,90"]}, "yaw of the ego in frame 2 is 90, expected radians"),
    "a pose far away": ({"ego": [*EGO[:3], "2,0.2,0,0,1e6,0"]}, "z of the ego in frame 2 is "),
    "another rate": ({"ego": ["frame,time", "0,0", "1,0.02", "2,0.04"]}, "one: frames are 0.02 s apart, but MTP-Small"),
}  # fmt: skip


@pytest.mark.parametrize(("tables", "text"), TABLES.values(), ids=TABLES)
def test_a_mistake_in_a_table(tables: dict[str, list[str] | None], text: str, tmp_path: Path, base: Card) -> None:
    with pytest.raises(DataError, match=re.escape(text)) as caught:
        only(base, write_tables(tmp_path, **tables))
    assert str(tmp_path) in str(caught.value)


def test_broken_files(tmp_path: Path, base: Card) -> None:
    write_tables(tmp_path)
    table = tmp_path / "one" / "truth.csv"
    for content in (b"\xff\xfe", table.read_bytes() + b"3,\xff,car,0,0,1,0,1,1,1\n"):
        table.write_bytes(content)
        with pytest.raises(DataError, match=r"truth\.csv cannot be read as text: .*save it as UTF-8"):
            only(base, tmp_path)
    table.unlink()
    (tmp_path / "one" / "truth.parquet").write_bytes(b"PAR1 and more")
    with pytest.raises(DataError, match=r"truth\.parquet cannot be read as Parquet"):
        only(base, tmp_path)


def test_a_mark_blank_lines_quotes_and_blanks_are_fine_and_lines_are_counted(tmp_path: Path, base: Card) -> None:
    lines = [f"\ufeff{TRUTH[0]}", TRUTH[1], "", f'1,"1","car", 1 ,0,{BOX}', "", f"2,1,car,2,0,{BOX}"]
    assert only(base, write_tables(tmp_path, truth=lines)).truth.box[:, 0].tolist() == [0, 1, 2]
    with pytest.raises(DataError, match=r"truth\.csv, line 7, column 'x': 'far', expected a number"):
        only(base, write_tables(tmp_path, truth=[*lines, f"2,2,car,far,0,{BOX}"]))


@pytest.mark.parametrize("part", ["truth", "detections"])
@pytest.mark.parametrize(("stored", "x", "step"), [("float16", 1000.0, 0.5), ("float32", 1e6, 0.0625)])
def test_a_number_type_too_coarse_for_its_coordinates(
    stored: str, x: float, step: float, part: str, tmp_path: Path, base: Card
) -> None:
    save_scene(replace(make_scene(), detector="mine"), tmp_path, CLASSES, "parquet")
    path = tmp_path / "one" / f"{part}.parquet"
    rows = parquet.read_table(path).to_pydict()
    column = np.array(rows["x"])
    column[2] = x
    parquet.write_table(pyarrow.table({**rows, "x": column.astype(stored)}), path)
    text = f"{path}, row 3, column 'x': {x:g} stored as {stored}, which has steps of {step:g} there; store the original"
    with pytest.raises(DataError, match=re.escape(text)):
        only(base, tmp_path)


def test_scores_may_be_of_a_coarse_type(tmp_path: Path, base: Card) -> None:
    save_scene(replace(make_scene(), detector="mine"), tmp_path, CLASSES, "parquet")
    path = tmp_path / "one" / "detections.parquet"
    rows = parquet.read_table(path).to_pydict()
    parquet.write_table(pyarrow.table({**rows, "score": np.array(rows["score"], dtype=np.float16)}), path)
    np.testing.assert_allclose(only(base, tmp_path).detections.score, rows["score"], rtol=1e-3)


def test_names_do_not_stand_for_contents(tmp_path: Path) -> None:
    first, second = (write_tables(tmp_path / name) for name in "ab")
    (second / "one" / "truth.csv").rename(second / "one" / "ego.csv")
    assert own_digest(first, False) != own_digest(second, False)


@pytest.mark.parametrize(("first", "second"), [("5000000000", "7"), ("-5", "6"), ("01", "1")])
def test_ids_that_no_observation_could_hold_are_words(first: str, second: str, tmp_path: Path, base: Card) -> None:
    truth = [TRUTH[0], f"0,{second},car,0,0,{BOX}", f"1,{first},car,1,0,{BOX}", f"1,{second},car,2,0,{BOX}"]
    scene = only(base, write_tables(tmp_path, truth=truth, detections=DETECTIONS[:2]))
    np.testing.assert_array_equal(scene.truth.object_id, [1, 0, 1])
    largest = [line.replace(f",{second},", ",2147483647,") for line in truth[:2]]
    found = only(base, write_tables(tmp_path / "largest", truth=largest, detections=DETECTIONS[:2]))
    np.testing.assert_array_equal(found.truth.object_id, [2147483647])


def changed(part: str, **changes: object) -> Callable[[Scene], Scene]:
    return lambda scene: replace(scene, **{part: replace(getattr(scene, part), **changes)})


def with_column(part: str, name: str, row: int | list[int], value: object) -> Callable[[Scene], Scene]:
    def change(scene: Scene) -> Scene:
        column = np.array(getattr(getattr(scene, part), name))
        column[row] = value
        return replace(scene, **{part: replace(getattr(scene, part), **{name: column})})

    return change


WRONG: dict[str, tuple[Callable[[Scene], Scene], str]] = {
    "annotated of other frames": (
        lambda scene: replace(scene, annotated=np.ones(3, dtype=bool)),
        "annotated has the shape (3,) and 3 frames, expected one or more of the 8 frames of the scene",
    ),
    "nothing annotated": (
        lambda scene: replace(scene, annotated=np.zeros(8, dtype=bool)),
        "annotated has the shape (8,) and 0 frames, expected one or more of the 8 frames of the scene",
    ),
    "annotated too far apart": (
        lambda scene: replace(scene, annotated=np.arange(8) % 2 == 0),
        "annotated frames are 2 apart, but MTP-Small-v0 has windows of 2 past and 3 future frames, expected windows with",
    ),
    "an area of three borders": (lambda scene: replace(scene, neutral_areas=np.ones((2, 3))), "neutral_areas, expected"),
    "detections": (
        lambda scene: replace(scene, detections=None),  # type: ignore[arg-type]
        "detections is NoneType, expected Detections; use one without rows for none",
    ),
    "classes": (changed("truth", class_id=np.zeros(5)), "truth.class_id is float64 [5], expected a row of whole"),
    "division": (changed("truth", start=np.arange(8)), "truth.start does not divide the 24 rows into 8 frames"),
    "class": (with_column("truth", "class_id", 3, 2), "truth.class_id has 0 to 2, expected indices of 2 classes"),
    "words as ids": (changed("truth", object_id=np.array(["a"] * 24)), "truth.object_id is <U1, expected whole"),
    "a name twice": (lambda scene: replace(scene, object_names={3: "a", 5: "a"}), "object_names of object 5 is 'a'"),
    "no name": (lambda scene: replace(scene, object_names={3: " "}), "object_names of object 3 is ' ', exp"),
    "large id": (with_column("truth", "object_id", 0, 2**31), "truth.object_id has 3 to 2147483648, expected whole"),
    "second box": (with_column("truth", "object_id", [0, 1], 9), "truth, row 1: a second box of object 9 in frame 0"),
    "size": (with_column("truth", "box", 2, 0.0), "truth, row 2, column 'l': 0, expected a number from 1e-06"),
    "far away": (with_column("detections", "box", 0, [5e5, *[1.0] * 6]), "detections, row 0, column 'x': 500000, exp"),
    "not finite": (with_column("detections", "score", 0, np.nan), "detections, row 0, column 'score': nan, expected"),
    "a coarse type": (
        lambda scene: changed("truth", box=(scene.truth.box + np.eye(7)[0] * 1000).astype(np.float16))(scene),
        "truth, row 0, column 'x': 1020 stored as float16, which has steps of 0.5 there; store the original numbers as",
    ),
    "time": (lambda scene: replace(scene, time=np.zeros(8)), "time 0 of frame 1, expected a number above that of"),
    "ego": (lambda scene: replace(scene, ego=np.full((8, 4), np.nan)), "x of the ego in frame 0 is nan, expected"),
    "detector": (
        lambda scene: replace(scene, detector="", detections=scene.detections.select(scene.detections.score > 9)),
        "no detections; without them a simulated detector runs at once",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("change", "text"), WRONG.values(), ids=WRONG)
def test_a_mistake_in_a_scene_in_memory(change: Callable[[Scene], Scene], text: str, base: Card) -> None:
    wrong = change(replace(make_scene(), detector="mine"))
    with pytest.raises(DataError, match=re.escape(f"scene 'one': {text}")):
        next(load_scenes(with_scenes(base, [wrong])))


def test_lists_of_scenes_in_memory(base: Card) -> None:
    scene = replace(make_scene(), detector="mine")
    with pytest.raises(CardError, match="two scenes are called 'one', expected different names"):
        with_scenes(base, [scene, scene])
    with pytest.raises(CardError, match="scenes contains an object of type str; expected a list of Scene objects"):
        with_scenes(base, [scene, "one"])  # type: ignore[list-item]
    with pytest.raises(DataError, match="no scene in the list, expected at least one"):
        open_source(with_scenes(base, []))
    unseen = replace(scene, detections=scene.detections.select(scene.detections.score > 9))
    assert not len(next(load_scenes(with_scenes(base, [unseen]))).detections.box), "detected, and no box found"
