"""Forecasts of other programs as a stored run: what is refused, what is counted and said, and that the run is scored."""

import json
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mtp_bench.cards import Card, load_card, with_classes
from mtp_bench.core import DataError, MtpBenchError, RolloutError, UnknownNameError, card_ids, file_digest
from mtp_bench.core.errors import CardError
from mtp_bench.running import RunOptions, import_forecasts, load_run, open_run, run, score
from mtp_bench.running.stored import run_scores
from mtp_bench.sources import mapped, open_source, write_table
from tests.support.command_line import CommandLine
from tests.support.forecast_files import (
    MODES,
    SCENE,
    STEPS,
    WEIGHTS,
    Record,
    av2,
    driving,
    mounted,
    results,
    stamp,
    straight,
    uniad,
    vad,
    vip3d,
    write_log,
    write_results,
)
from tests.support.nuscenes_root import nuscenes_card, sample, write_root
from tests.support.source_files import with_source, with_task

ENV = "MTP-nuScenes-mini-v0"
Content = dict[str, list[Record]]


@pytest.fixture
def data(tmp_path: Path) -> Path:
    return write_root(tmp_path / "data")


def imported(data: Path, content: Content, form: str = "mfeval", **options: Any) -> list[str]:
    """Import a file into the folder ``run`` beside the data; lines that are said."""
    path = write_results(data.parent / "mine.json", content)
    env = options.pop("env", nuscenes_card())
    run_options = RunOptions(str(data), names=options.pop("names", None))
    return import_forecasts(path, env, form, data.parent / "run", run_options, **options)


def refused(data: Path, content: Content, message: str, form: str = "mfeval", **options: Any) -> None:
    with pytest.raises(DataError, match=message) as caught:
        imported(data, content, form, **options)
    assert "\n" not in str(caught.value)
    assert not (data.parent / "run").exists()


def moved(content: Content, change: Callable[[Any, Record], Any]) -> Content:
    """Change the samples [6, 12, 2] of every object."""
    for objects in content.values():
        for item in objects:
            item["traj"] = change(np.array(item["traj"]), item).tolist()
    return content


# ---- what is stored and said
def test_the_run_and_what_is_said(data: Path) -> None:
    lines = imported(data, driving())
    expected = """
        mine.json, form mfeval: 12 steps at 2 Hz (6 s), 6 samples an object; \
MTP-nuScenes-mini-v0 takes 12 steps at 2 Hz and 10 samples
        fewer samples have larger errors: `mtp-bench score RUNS --samples 6` cuts all runs alike
        24 objects in 12 frames of 3 scenes, the least confidence is 0.5
        no tracks: identity switches, MOTA and HOTA are not measured
        the detector's part of the error is that of megvii; --own-detections takes the objects of the file as detections
    """
    assert lines == [line.strip() for line in expected.strip().splitlines()]
    stored = load_run(data.parent / "run")
    assert (stored.info.agent, stored.info.observe, stored.info.samples) == ("mine.mfeval", "file", 6)
    assert stored.info.parameters == {
        "form": "mfeval", "sha256": file_digest(data.parent / "mine.json"), "modes": 6, "seconds": 6.0,
        "least_confidence": 0.5, "own_detections": False,
    }  # fmt: skip
    assert str(data.parent) not in (data.parent / "run/run.json").read_text()
    rollout = next(each for each in stored.rollouts if each.scene == SCENE)
    # frame 1: the car at (10, 2), 2 m along y in each period, its last sample half as fast; then the walker
    rows = slice(rollout.object_start[1], rollout.object_start[2])
    np.testing.assert_allclose(rollout.object_box[rows, :2], [[10, 2], [5, 5]])
    np.testing.assert_allclose(rollout.object_confidence[rows], [0.8, 0.5])
    assert rollout.forecast[rows][0, 0, [0, 11]].tolist() == [[0, 200], [0, 2400]]  # cm
    assert rollout.forecast[rows][0, 5, [0, 11]].tolist() == [[0, 100], [0, 1200]]
    np.testing.assert_allclose(np.exp(rollout.forecast_log_weight[rows]), [WEIGHTS] * 2, rtol=1e-6)


def test_tracks_of_a_file_that_has_them(data: Path) -> None:
    mounted(data)
    lines = imported(data, results(uniad()), "uniad", names=(SCENE,))
    assert "objects without a forecast, taken to stand: 1" in lines
    assert not any(line.startswith("no tracks") for line in lines)
    rollout = load_run(data.parent / "run").rollouts[0]
    assert rollout.track_start.tolist() == [0, 0, 3, 3, 3]
    assert len(set(rollout.track_id.tolist())) == 3
    assert not rollout.forecast[2].any()
    assert np.isfinite(rollout.forecast_log_weight[2]).tolist() == [True] + [False] * 5
    # as a file that writes its place six times
    (data.parent / "other").mkdir()
    other = write_root(data.parent / "other/data")
    imported(other, results(vip3d()), "vip3d", names=(SCENE,))
    np.testing.assert_allclose(load_run(other.parent / "run").rollouts[0].forecast, rollout.forecast, atol=1)


def test_a_scene_without_any_forecast(data: Path) -> None:
    content = driving()
    for t in range(4):
        for item in content[sample("scene-0001", t)]:
            item["traj"] = []
    assert "objects without a forecast, taken to stand: 8" in imported(data, content)


def test_a_dry_run_says_the_same_and_writes_nothing(data: Path) -> None:
    lines = imported(data, driving())
    path = data.parent / "mine.json"
    before = sorted(data.parent.iterdir())
    assert import_forecasts(path, nuscenes_card(), "mfeval", None, RunOptions(str(data))) == lines
    assert sorted(data.parent.iterdir()) == before


def test_a_longer_forecast_is_cut(data: Path) -> None:
    imported(data, driving(), env=with_task(nuscenes_card(), future=6))
    assert load_run(data.parent / "run").rollouts[0].forecast.shape[2] == 6


def test_steps_of_10_hz(data: Path) -> None:
    """Every fifth step, the last one of each period; the number of the step stands in its place."""
    content = driving()
    for objects in content.values():
        for item in objects:
            x, y = item["translation"][:2]
            item["traj"] = [[[x, y + step / 100] for step in range(1, 61)]] * MODES
    lines = imported(data, content, rate=10.0)
    assert lines[0].startswith("mine.json, form mfeval: 60 steps at 10 Hz (6 s)")
    forecast = load_run(data.parent / "run").rollouts[0].forecast
    assert forecast[0, 0, :, 1].tolist() == [5 * step for step in range(1, STEPS + 1)]


def test_the_heaviest_samples_are_kept_in_their_order(data: Path) -> None:
    card = with_task(nuscenes_card(), samples=2)
    content = driving(traj_prob=[0.1, 0.2, 0.05, 0.4, 0.1, 0.15])
    assert "the 2 heaviest samples of each object are kept" in imported(data, content, env=card)
    rollout = load_run(data.parent / "run").rollouts[0]
    # samples 1 and 3 of the car are 0.9 and 0.7 times as fast
    assert rollout.forecast[0, :, 0, 1].tolist() == [180, 140]
    np.testing.assert_allclose(np.exp(rollout.forecast_log_weight[0]), [1 / 3, 2 / 3], rtol=1e-6)


def test_other_classes_and_samples_are_counted(data: Path) -> None:
    content: Content = {**driving(), "elsewhere": [], "and-there": []}
    content[sample(SCENE, 0)] += [{**content[sample(SCENE, 0)][0], "class_name": name} for name in ("police", "")]
    lines = imported(data, content, names=(SCENE,))
    assert "2 objects of 2 other classes, left out: police, without a name" in lines
    assert "samples or logs of other scenes: 10" in lines  # 8 of the other two scenes
    assert any(line.startswith("8 objects in 4 frames of 1 scene, the least confidence is") for line in lines)


def test_a_class_in_another_spelling_is_refused(data: Path) -> None:
    content = driving()
    content[sample(SCENE, 0)] += [{**content[sample(SCENE, 0)][0], "class_name": "Car"}]
    with pytest.raises(DataError, match=r"class 'Car' in scene .*, expected 'car' as in the task"):
        imported(data, content)


def test_a_class_that_is_missing_is_named(data: Path) -> None:
    content = driving()
    for objects in content.values():
        del objects[1]
    said = "no object is a pedestrian: such targets count as missed; --classes scores the classes that it has"
    assert said in imported(data, content)
    lines = imported(data, content, classes=["car"], force=True)
    assert not any("--classes" in line for line in lines)
    assert open_run(data.parent / "run", str(data)).card.task.classes == ("car",)


REJECTED: dict[str, Record] = {
    "NaN": {"detection_score": float("nan")},
    "a place unknown": {"translation": [None, 1.0]},
    "a sample unknown": {"traj": [[[None, 1.0]] * STEPS] * MODES},
    "a size of 0": {"size": [2.0, 0.0, 1.0]},
    "far": {"traj": straight((10, 400), (0, 0))},
    "infinite": {"traj": straight((float("inf"), 0), (0, 0))},
    "a weight unknown": {"traj_prob": [None] * MODES},
    "no weight": {"traj_prob": [0.0] * MODES},
    "no probability": {"detection_score": 1.5},
    "no score": {"detection_score": None},
}


@pytest.mark.parametrize("case", REJECTED)
def test_rows_that_cannot_be_used_are_counted(case: str, data: Path) -> None:
    content = driving()
    content[sample(SCENE, 2)][0] |= REJECTED[case]
    lines = imported(data, content)
    assert "rejected rows: 1" in lines
    assert any(line.startswith("23 objects in 12 frames of 3 scenes, the least confidence is") for line in lines)


def test_an_identity_twice_in_a_frame_is_counted(data: Path) -> None:
    objects = uniad()
    objects[1]["tracking_id"] = "7"
    lines = imported(mounted(data), results(objects), "uniad", names=(SCENE,))
    assert not any(line.startswith("rejected rows") for line in lines), "an id in two classes is two tracks"
    objects[1]["tracking_name"] = objects[0]["tracking_name"]
    lines = imported(data, results(objects), "uniad", names=(SCENE,), force=True)
    assert any(line.startswith("rejected rows: ") for line in lines)
    assert any(
        line.startswith("3 objects in 4 frames of 1 scene, the least confidence is") for line in lines
    )  # the forecasts stay


def test_the_most_confident_objects_of_a_full_frame(data: Path) -> None:
    size = nuscenes_card().size.model_copy(update={"objects": 1})
    card = nuscenes_card().model_copy(update={"size": size})
    content = driving()
    content[sample(SCENE, 0)][1]["detection_score"] = 0.95
    content[sample(SCENE, 1)][0]["detection_score"] = None
    lines = imported(data, content, env=card)
    assert "objects beyond those that fit in a frame: 12" in lines
    rollout = next(each for each in load_run(data.parent / "run").rollouts if each.scene == SCENE)
    assert rollout.object_confidence.tolist() == pytest.approx([0.95, 0.5, 0.7, 0.6])


# ---- what is refused
def test_another_frame_of_reference(data: Path) -> None:
    refused(
        data, moved(driving(), lambda traj, _: traj + np.array([0, 25])),
        "24 of 24 objects are forecast more than 20 m away after one step: the places are likely in another frame of "
        "reference than this --form has, or of another --form",
    )  # fmt: skip


def test_a_frame_of_reference_is_judged_by_most_objects_and_the_nearest_sample(data: Path) -> None:
    def half(traj: Any, item: Record) -> Any:
        if item["class_name"] == "car":
            return traj + np.array([0, 25])
        traj[1:] += 25
        return traj

    imported(data, moved(driving(), half))


def from_now(traj: Any, item: Record) -> Any:
    now = np.broadcast_to(item["translation"][:2], (MODES, 1, 2))
    return np.concatenate([now, traj[:, :-1]], axis=1)


def test_a_file_that_begins_at_the_present(data: Path) -> None:
    message = "the file seems to begin at the present, since the first step of most moving objects is their present"
    refused(data, moved(driving(), from_now), message)


def test_a_sample_that_stands_is_no_present(data: Path) -> None:
    """A sample of each object stands, and another one begins at the present: the others begin one period later."""

    def standing(traj: Any, item: Record) -> Any:
        traj[0] = item["translation"][:2]
        traj[1] = from_now(traj, item)[1]
        return traj

    imported(data, moved(driving(), standing))


@pytest.mark.parametrize("rate", [1.0, 3.0, 5.0, float("nan"), float("inf"), -2.0])
def test_a_rate_that_is_no_multiple(rate: float, data: Path) -> None:
    message = f"its steps are at {rate:g} Hz, those of MTP-nuScenes-mini-v0 at 2 Hz: expected a multiple; --rate"
    refused(data, driving(), message, rate=rate)


@pytest.mark.parametrize("rate", [2.0, 4.0])
def test_a_short_forecast_names_the_card_of_3_s(rate: float, data: Path) -> None:
    steps = {2.0: 11, 4.0: 23}[rate]
    content = driving()
    for objects in content.values():
        for item in objects:
            item["traj"] = straight(tuple(item["translation"][:2]), (0, 1), steps)
    message = f"its forecasts end after {steps / rate:g} s, MTP-nuScenes-mini-v0 scores 6 s; MTP-nuScenes-3s-v0 and"
    refused(data, content, message, rate=rate)


def test_vad_needs_a_card_of_3_s(data: Path) -> None:
    mounted(data)
    refused(
        data,
        results(vad()),
        "end after 3 s, .* scores 6 s; MTP-nuScenes-3s-v0 and MTP-AV2-3s-v0 score 3 s",
        "vad",
        names=(SCENE,),
    )
    imported(data, results(vad()), "vad", names=(SCENE,), env=with_task(nuscenes_card(), future=6))
    rollout = load_run(data.parent / "run").rollouts[0]
    assert rollout.forecast[0, 0, [0, 5]].tolist() == [[0, 200], [0, 1200]]


def test_a_constant_confidence(data: Path) -> None:
    content = driving(detection_score=0.4)
    message = "each object has the confidence 0.4, so that none can be left out first .* pass --constant-confidence"
    refused(data, content, message)
    imported(data, content, constant_confidence=True)


def test_no_confidence_at_all(data: Path) -> None:
    refused(
        data,
        driving(detection_score=None),
        "no object of car, pedestrian with a box, a confidence from 0 to 1 and a forecast",
    )


def test_no_object_of_the_task(data: Path) -> None:
    refused(
        data,
        driving(class_name="tram"),
        "no object of car, pedestrian with a box, a confidence from 0 to 1 and a forecast",
    )
    refused(
        data,
        {token: [] for token in driving()},
        "no object of car, pedestrian with a box, a confidence from 0 to 1 and a forecast",
    )


def test_a_missing_sample_and_a_missing_scene(data: Path) -> None:
    content = driving()
    del content[sample("scene-0001", 3)]
    refused(data, content, "no entry for sample 'scene-0001-t3', expected one for each of 4 samples")
    for t in range(3):
        del content[sample("scene-0001", t)]
    refused(data, content, "no entry for .* for scene 'scene-0001'; --split names another split, --scenes N takes")


def test_a_huge_file(data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mapped, "MAX_BYTES", 1000)
    refused(data, driving(), "above 0 GiB unpacked, the limit")


def test_an_unknown_form_and_an_unknown_class(data: Path) -> None:
    with pytest.raises(UnknownNameError, match=r"form of forecasts on nuscenes.*'mfevil'"):
        imported(data, driving(), "mfevil")
    with pytest.raises(UnknownNameError, match="'cars'"):
        imported(data, driving(), classes=["cars"])
    assert not (data.parent / "run").exists()


def test_a_closed_loop_has_no_forecasts(tmp_path: Path) -> None:
    env = next(name for name in card_ids() if load_card(name).drive is not None)
    with pytest.raises(CardError, match="closed loop, which has no stored forecasts"):
        import_forecasts(tmp_path / "f", env, "table", tmp_path / "run")


def test_a_folder_that_is_no_run(data: Path) -> None:
    folder = data.parent / "run"
    folder.mkdir()
    (folder / "notes.txt").write_text("mine")
    for force in (False, True):
        with pytest.raises(RolloutError, match=r"is not empty and holds 'notes\.txt', so it is not a run"):
            imported(data, driving(), force=force)
    assert [path.name for path in folder.iterdir()] == ["notes.txt"]


def test_an_earlier_run_is_replaced_by_force_alone(data: Path) -> None:
    imported(data, driving())
    digest = file_digest(data.parent / "run/run.json")
    with pytest.raises(MtpBenchError, match="holds an earlier run: choose another folder, or replace it"):
        imported(data, driving(detection_score=0.4), constant_confidence=True)
    with pytest.raises(DataError):
        imported(data, driving(detection_score=0.4), force=True)
    assert file_digest(data.parent / "run/run.json") == digest
    imported(data, driving(detection_score=0.4), constant_confidence=True, force=True)
    assert file_digest(data.parent / "run/run.json") != digest


# ---- Argoverse 2
def av2_import(tmp_path: Path, content: Any, card: Card, folder: Path | None) -> list[str]:
    data = write_log(tmp_path)
    (tmp_path / "f.pkl").write_bytes(pickle.dumps(content))
    return import_forecasts(tmp_path / "f.pkl", card, "av2", folder, RunOptions(str(data)))


def test_a_pickle_of_argoverse2(tmp_path: Path) -> None:
    card = with_source("MTP-AV2-v0", detector=None)
    with pytest.raises(
        DataError, match="end after 3 s, MTP-AV2-v0 scores 6 s; MTP-nuScenes-3s-v0 and MTP-AV2-3s-v0 score 3 s"
    ):
        av2_import(tmp_path, av2(), card, tmp_path / "run")
    assert not (tmp_path / "run").exists()
    lines = av2_import(tmp_path, av2(), with_task(card, future=6), tmp_path / "run")
    assert any(line.startswith("3 objects in 3 frames of 1 scene, the least confidence is") for line in lines)
    assert "1 object of 1 other class, left out: skipped" in lines
    assert "samples or logs of other scenes: 1" in lines
    rollout = load_run(tmp_path / "run").rollouts[0]
    assert rollout.track_start.tolist() == [0, 1, 3, 3]
    assert rollout.forecast[0, 0, [0, 5]].tolist() == [[-250, 0], [-1500, 0]]  # in the order of the file


def test_steps_of_2_hz_do_not_fit_10_hz(tmp_path: Path) -> None:
    card = with_source("MTP-AV2-10Hz-v0", detector=None)
    with pytest.raises(DataError, match="its steps are at 2 Hz, those of MTP-AV2-10Hz-v0 at 10 Hz: expected a mult"):
        av2_import(tmp_path, av2(), card, None)


def test_a_missing_frame_of_a_log(tmp_path: Path) -> None:
    content = av2()
    del content["a-log"][stamp(2)]
    with pytest.raises(DataError, match=f"time {stamp(2)}: no list of up to 10000 objects"):
        av2_import(tmp_path, content, with_source("MTP-AV2-v0", detector=None), None)


# ---- a run as tables, and back
def as_tables(folder: Path, data: str, into: Path, ids: bool = True) -> Path:
    """Write the rollouts of a run as own tables; tracks by the boxes that they share with objects."""
    opened = open_run(folder, data)
    into.mkdir()
    for rollout in opened.run.rollouts:
        frame = np.repeat(np.arange(rollout.frames), np.diff(rollout.object_start))
        shape = rollout.forecast_log_weight.shape
        rows = np.repeat(np.arange(shape[0]), shape[1])
        box = rollout.object_box.astype(float)
        name = np.array(opened.card.task.classes)[rollout.object_class]
        place = box[:, None, None, :2] + rollout.forecast / 100
        columns: dict[str, Any] = {"frame": frame[rows], "object": rows, "class": name[rows]}
        if ids:
            columns["id"] = track_of_objects(rollout, frame)[rows]
        columns |= {key: box[rows, at] for at, key in enumerate(("x", "y", "z", "yaw", "l", "w", "h"))}
        columns["confidence"] = rollout.object_confidence[rows]
        columns["weight"] = np.exp(rollout.forecast_log_weight.reshape(-1))
        for step in range(place.shape[2]):
            for at, axis in enumerate("xy"):
                columns[f"{axis}{step + 1}"] = place[:, :, step, at].reshape(-1)
        present = columns["weight"] > 0
        columns = {key: values[present] for key, values in columns.items()}
        write_table(into / f"{rollout.scene}.parquet", columns)
    return into


def track_of_objects(rollout: Any, frame: Any) -> Any:
    tracks = np.repeat(np.arange(rollout.frames), np.diff(rollout.track_start))
    names = []
    for row, t in enumerate(frame.tolist()):
        rows = np.flatnonzero(tracks == t)
        distance = np.abs(rollout.track_box[rows] - rollout.object_box[row]).max(axis=1)
        assert distance.min() == 0
        names.append(f"t{rollout.track_id[rows[distance.argmin()]]}")
    return np.array(names)


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory, card: str, kitti: str) -> tuple[Path, Path]:
    """A run of standing objects with tracks, and the same as tables, imported."""
    root = tmp_path_factory.mktemp("pair")
    run("stp", card, root / "stp", data=kitti)
    tables = as_tables(root / "stp", kitti, root / "tables")
    import_forecasts(tables, card, "table", root / "file", RunOptions(kitti))
    return root / "stp", root / "file"


def row_of(folder: Path, kitti: str) -> dict[str, Any]:
    report = score(folder, data=kitti).report
    return next(vars(row) for row in report.rows if row.subset == "all")


def test_a_run_as_tables_has_the_same_score(pair: tuple[Path, Path], kitti: str) -> None:
    first, second = (row_of(folder, kitti) for folder in pair)
    assert second["agent"] == "tables.table"
    for name in ("error", "minADE", "minFDE", "coverage", "switches", "IDS", "MOTA"):
        if name in first:
            assert first[name] == second[name], name
    assert first["error"] is not None


def test_such_a_run_is_listed_and_explained(pair: tuple[Path, Path], kitti: str, cli: CommandLine) -> None:
    for command in ("events", "score", "worst"):
        assert cli.ok(command, pair[1], "--data", kitti)


def test_own_detections_stand_in_for_those_of_the_env(
    pair: tuple[Path, Path], card: str, kitti: str, tmp_path: Path
) -> None:
    lines = import_forecasts(
        pair[0].parent / "tables", card, "table", tmp_path / "own", RunOptions(kitti), own_detections=True
    )
    assert lines[-1] == "the objects of the file stand in for the detections"
    opened = open_run(tmp_path / "own", kitti)
    rollout = opened.first()
    recorded = opened.recorded(rollout.scene)
    assert recorded.detector == "objects of the file"
    assert recorded.detections.start.tolist() == rollout.object_start.tolist()
    np.testing.assert_allclose(recorded.detections.box, rollout.object_box)
    assert row_of(tmp_path / "own", kitti)["error"] == row_of(pair[1], kitti)["error"]
    given = open_source(opened.card, kitti).load(rollout.scene)
    assert given.detections.score.tolist() != recorded.detections.score.tolist()


# ---- fewer classes
@pytest.mark.parametrize("env", card_ids())
def test_a_card_with_fewer_classes(env: str) -> None:
    card = load_card(env)
    classes = card.task.classes
    assert with_classes(card, classes[::-1]) == card
    fewer = with_classes(card, classes[:1])
    assert fewer.task.classes == classes[:1]
    assert tuple(fewer.task.miss_error) == classes[:1]
    assert fewer.source == card.source
    assert (fewer.digest == card.digest) == (len(classes) == 1)
    with pytest.raises(UnknownNameError, match="class of"):
        with_classes(card, ["tram"])


def test_a_card_needs_a_class() -> None:
    with pytest.raises(MtpBenchError):
        with_classes(load_card(ENV), [])


# ---- the command
def options(data: Path, form: str = "mfeval") -> list[Any]:
    return [data.parent / "mine.json", "--env", ENV, "--data", data, "--form", form]


def test_the_command(data: Path, cli: CommandLine) -> None:
    path = write_results(data.parent / "mine.json", driving())
    folder = data.parent / "run"
    said = cli.ok("import", "forecasts", *options(data), "--dry-run")
    assert "24 objects in 12 frames of 3 scenes" in said
    assert not folder.exists()
    said = cli.ok("import", "forecasts", *options(data), "-o", folder, "--classes", "car,pedestrian")
    assert f"mtp-bench score {folder}" in said.replace("\n", " ")
    assert json.loads((folder / "run.json").read_text())["info"]["parameters"]["form"] == "mfeval"
    assert path.exists()


def test_a_wrong_file_is_one_line_and_writes_nothing(data: Path, cli: CommandLine) -> None:
    write_results(data.parent / "mine.json", driving(detection_score=0.5))
    before = sorted(data.parent.iterdir())
    output = cli("import", "forecasts", *options(data), "-o", data.parent / "run")
    assert "pass --constant-confidence" in output.error
    assert sorted(data.parent.iterdir()) == before


@pytest.mark.parametrize("extra", [[], ["--dry-run", "-o", "run"]])
def test_a_folder_or_a_dry_run(extra: list[str], data: Path, cli: CommandLine) -> None:
    write_results(data.parent / "mine.json", driving())
    output = cli("import", "forecasts", *options(data), *extra)
    assert output.status == 2
    assert "name a folder, or --dry-run" in output.err
    assert not Path("run").exists()


# ---- the official data
@pytest.mark.data
def test_stp_of_the_official_evaluation(data_root: Path, tmp_path: Path) -> None:
    """The file that the official script scored gives the same minADE as the run that it was made of."""
    path = data_root.parent / "oracles/forecast_files/stp_mini_val_mfeval.json.gz"
    if not path.exists():
        pytest.skip(f"no {path.name}")
    import_forecasts(path, ENV, "mfeval", tmp_path / "file", RunOptions(str(data_root), split="mini_val"))
    run("stp", ENV, tmp_path / "stp", data=str(data_root), split="mini_val")
    totals = []
    opened = [open_run(tmp_path / folder, str(data_root)) for folder in ("stp", "file")]
    for first, second in zip(*(run_scores(each).seeds[0] for each in opened), strict=True):
        # the file has the classes of the official script alone
        is_shared = np.isin(first.class_id, [first.classes.index(name) for name in ("car", "truck", "bus")])
        np.testing.assert_array_equal(first.covered[is_shared], second.covered[is_shared])
        rows = is_shared & first.covered
        np.testing.assert_allclose(first.min_ade[rows], second.min_ade[rows], atol=0.011)  # centimetres
        totals.append([rows.sum(), first.min_ade[rows].sum(), second.min_ade[rows].sum()])
    targets, stp, file = np.sum(totals, axis=0)
    assert targets > 500
    assert abs(stp - file) / targets < 5e-4
