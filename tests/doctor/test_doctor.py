"""The doctor: healthy scenes have no doubt, and each planted fault is named, undone and gone."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mtp_bench
from benchmarks.doctor_faults import ALONE, FITTED, Fault
from mtp_bench import Card, MtpBenchError, Scene, evaluate, load_card, load_scenes
from mtp_bench.core import Detections, Lane, Truth, starts_of_sorted
from mtp_bench.doubts import Examination, examine, kinds
from mtp_bench.doubts.signs import mean_of_others
from mtp_bench.running import checkup
from mtp_bench.sources import save_scene
from tests.support.command_line import CommandLine, read_json

ENV = "MTP-Intersection-v0"
CARD = load_card(ENV)
OWN = "MTP-nuScenes-v0"  # whose rate the scene has, and which takes own scenes
FAULTS = (*FITTED, *ALONE)
CURED = (
    "late",
    "mirrored",
    "offset",
    "turn",
    "pose late",
    "rear axle",
    "axes exchanged",
    "detections in feet",
    "detections in the ego frame",
    "detections doubled",
    "classes exchanged",
)
# at the middle strength in this scene: too few slow people, twice the speed of a car in a town
UNSEEN = ("detected heading turned 180", "rate too low by 2", "rate too low by 5", "both in the ego frame")
# the last strength is one that a person sees
SEEN = [fault for fault in FAULTS if fault.name not in UNSEEN]


@pytest.fixture(scope="module")
def scenes() -> list[Scene]:
    return list(load_scenes(CARD, names=["intersection-010001", "intersection-010004"]))


def test_healthy_scenes_have_no_doubt(scenes: list[Scene]) -> None:
    for scene in scenes:
        found = examine(scene, CARD)
        assert [doubt.line for doubt in found.doubts] == []
        assert all(found.powers.values()), "a small delay, offset or turn would be told"


@pytest.mark.parametrize("fault", SEEN, ids=lambda fault: fault.name.replace(" ", "-"))
def test_a_planted_fault_is_named(fault: Fault, scenes: list[Scene]) -> None:
    draw = np.random.default_rng(len(fault.name))
    found = examine(fault.plant(scenes[0], fault.strengths[-1], draw), CARD)
    told = [doubt.kind for doubt in found.doubts]
    assert any(kind in fault.expected for kind in told), told


@pytest.mark.parametrize("fault", FITTED, ids=lambda fault: fault.name.replace(" ", "-"))
def test_a_cured_scene_is_healthy(fault: Fault, scenes: list[Scene]) -> None:
    draw = np.random.default_rng(len(fault.name))
    scene = fault.plant(scenes[0], fault.strengths[-1], draw)
    cured = examine(scene, CARD).cure(scene)
    assert [doubt.line for doubt in examine(cured, CARD).doubts] == []


@pytest.fixture(scope="module")
def vehicles(scenes: list[Scene]) -> Scene:
    """A scene with the classes that MTP-nuScenes-v0 has, too: car, truck, bus."""
    truth = scenes[0].truth
    detections = scenes[0].detections
    return replace(
        scenes[0],
        truth=truth.select(truth.class_id <= 2),
        detections=detections.select(detections.class_id <= 2),
    )


@pytest.fixture(scope="module")
def healthy_error(vehicles: Scene) -> float:
    return error_of(vehicles)


def error_of(scene: Scene) -> float:
    error = evaluate("stp", OWN, scenes=[scene]).rows[0].error
    assert error is not None
    return error


@pytest.mark.parametrize("name", CURED)
def test_a_cured_scene_scores_like_its_healthy_twin(name: str, vehicles: Scene, healthy_error: float) -> None:
    fault = next(fault for fault in FAULTS if fault.name == name)
    planted = fault.plant(vehicles, fault.strengths[-1], np.random.default_rng(1))
    assert error_of(planted) > 1.1 * healthy_error
    cured = examine(planted, load_card(OWN)).cure(planted)
    assert error_of(cured) == pytest.approx(healthy_error, rel=0.02)


def test_one_object_alone_makes_no_fault_of_the_recording(scenes: list[Scene]) -> None:
    assert mean_of_others(np.array([9.0, 9.0, 1.0, 1.0, 4.0]), np.array([1, 1, 2, 2, 3])) == 2.0
    assert mean_of_others(np.array([9.0]), np.array([1])) == 0.0
    truth = scenes[0].truth
    often = np.bincount(truth.object_id[truth.class_id == 0]).argmax()
    turned = np.where(truth.object_id == often, truth.box[:, 3] + np.pi, truth.box[:, 3])
    box = truth.box.copy()
    box[:, 3] = np.arctan2(np.sin(turned), np.cos(turned))
    assert not examine(replace(scenes[0], truth=replace(truth, box=box)), CARD).doubts


def shifted(rows: Detections, shift: tuple[float, ...]) -> Detections:
    return replace(rows, box=rows.box + np.array(shift))


def test_detections_of_another_place_are_a_doubt(scenes: list[Scene]) -> None:
    far = replace(scenes[0], detections=shifted(scenes[0].detections, (3000.0, 200.0, 0, 0, 0, 0, 0)))
    (doubt,) = examine(far, CARD).doubts
    assert doubt.kind == "apart"
    assert "have no detection of their class within one gate" in doubt.line


def test_half_a_frame_is_undone_for_all_rows(scenes: list[Scene]) -> None:
    fault = next(fault for fault in FITTED if fault.name == "late")
    late = fault.plant(of_truth(scenes[1]), 0.5, np.random.default_rng(0))
    cured = examine(late, CARD).cure(late)
    assert len(cured.detections.box) == len(late.detections.box), "no frame at the end is lost"
    assert not examine(cured, CARD).doubts
    far_before, far_after = (
        (distances(scene.detections.box, scene.detections.frame_of_rows, scene.truth) > 0.3).sum()
        for scene in (late, cured)
    )
    assert far_before > 200
    assert far_after < 0.1 * far_before, "also rows that the fit did not sample; not where tracks begin and end"


def distances(box: Any, frame: Any, truth: Truth) -> Any:
    """Distance of each box to the nearest true one of its frame, m."""
    nearest = [
        np.hypot(*(truth.box[truth.rows(t), :2] - place).T).min() for t, place in zip(frame, box[:, :2], strict=True)
    ]
    return np.array(nearest)


def of_truth(scene: Scene) -> Scene:
    """The scene with exact detections of everything."""
    truth = scene.truth
    rows = {name: getattr(truth, name) for name in ("start", "box", "velocity", "class_id")}
    return replace(scene, detections=replace(scene.detections, score=np.ones(len(truth.box)), **rows))


def test_headings_that_go_round_are_no_degrees(scenes: list[Scene]) -> None:
    around = (0, 0, 0, 2 * np.pi, 0, 0, 0)
    truth = scenes[0].truth
    turned = replace(
        scenes[0],
        detections=shifted(scenes[0].detections, around),
        truth=replace(truth, box=truth.box + np.array(around)),
    )
    assert not examine(turned, CARD).doubts


def test_a_hole_in_time_is_no_jump(scenes: list[Scene]) -> None:
    kept = (np.arange(scenes[0].frames) < 20) | (np.arange(scenes[0].frames) > 24)
    number = np.cumsum(kept) - 1

    def without(rows: Any) -> Any:
        left = rows.select(kept[rows.frame_of_rows])
        frame = number[rows.frame_of_rows[kept[rows.frame_of_rows]]]
        return replace(left, start=starts_of_sorted(frame, int(kept.sum())))

    scene = scenes[0]
    hole = replace(
        scene,
        time=scene.time[kept],
        ego=scene.ego[kept],
        truth=without(scene.truth),
        detections=without(scene.detections),
    )
    assert not examine(hole, CARD).doubts


@pytest.mark.parametrize("name", ["truth jumps", "ids exchanged"])
def test_motion_between_annotated_frames_is_checked(name: str, scenes: list[Scene]) -> None:
    fault = next(fault for fault in FAULTS if fault.name == name)
    planted = fault.plant(scenes[0], fault.strengths[-1], np.random.default_rng(4))
    annotated = np.arange(planted.frames) % 2 == 0
    truth = planted.truth.select(annotated[planted.truth.frame_of_rows])
    kinds_told = {doubt.kind for doubt in examine(replace(planted, truth=truth, annotated=annotated), CARD).doubts}
    assert kinds_told & set(fault.expected), kinds_told


def test_exact_detections_of_what_stands_are_no_hanging_detector(scenes: list[Scene]) -> None:
    scene = of_truth(scenes[0])
    row = scene.truth.frame_of_rows == 0
    box = np.tile(scene.truth.box[row], (scene.frames, 1))
    start = np.arange(scene.frames + 1) * row.sum()
    columns = {
        name: np.tile(getattr(scene.truth, name)[row], scene.frames)
        for name in ("class_id", "object_id", "eligible", "neutral")
    }
    velocity = np.zeros((len(box), 2))
    truth = replace(scene.truth, start=start, box=box, velocity=velocity, **columns)
    score = np.linspace(0.1, 1.0, len(box))
    detections = replace(
        scene.detections, start=start, box=box, velocity=velocity, class_id=columns["class_id"], score=score
    )
    still = replace(scene, truth=truth, detections=detections)
    assert "hangs" not in {doubt.kind for doubt in examine(still, CARD).doubts}


def test_velocities_are_cured_with_places(scenes: list[Scene]) -> None:
    fault = next(fault for fault in FAULTS if fault.name == "axes exchanged")
    detections = replace(scenes[0].detections, velocity=np.tile([3.0, 0.5], (len(scenes[0].detections.box), 1)))
    planted = fault.plant(replace(scenes[0], detections=detections), 1, np.random.default_rng(0))
    planted = replace(planted, detections=replace(planted.detections, velocity=planted.detections.velocity[:, ::-1]))
    cured = examine(planted, CARD).cure(planted).detections
    np.testing.assert_allclose(cured.velocity, detections.velocity)


def test_single_rows_and_broken_results_stop_nothing(
    scenes: list[Scene], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    truth = scenes[0].truth
    _, first = np.unique(truth.object_id, return_index=True)
    alone = np.isin(np.arange(len(truth.box)), first[:2]) | (truth.object_id == truth.object_id[first[2]])
    assert examine(replace(scenes[0], truth=truth.select(alone)), CARD).near >= 0.0
    monkeypatch.setenv("MTP_BENCH_CACHE", str(tmp_path))
    mtp_bench.doctor(ENV, scenes=scenes[:1])
    (file,) = (tmp_path / "doctor").iterdir()
    for broken in (b"\xff\xfe", b"", b'{"scene": 1}'):
        file.write_bytes(broken)
        assert mtp_bench.doctor(ENV, scenes=scenes[:1]).doubts == []


def test_a_delay_of_whole_frames_is_undone_by_their_numbers(scenes: list[Scene]) -> None:
    late = FITTED[0].plant(scenes[0], 1.0, np.random.default_rng(0))
    cured = examine(late, CARD).cure(late).detections
    frame = late.detections.frame_of_rows
    np.testing.assert_array_equal(cured.box, late.detections.box[frame > 0])
    np.testing.assert_array_equal(cured.frame_of_rows, frame[frame > 0] - 1)


def test_detections_say_that_an_object_really_stands(scenes: list[Scene]) -> None:
    fault = next(fault for fault in FAULTS if fault.name == "padded with the last position")
    padded = fault.plant(scenes[0], 20, np.random.default_rng(2))
    (doubt,) = examine(padded, CARD).doubts
    assert doubt.kind == "padded_last"
    truth = padded.truth
    stands = np.isin(truth.object_id, doubt.objects) & (truth.frame_of_rows >= doubt.first)
    detections = replace(
        padded.detections,
        start=truth.select(stands).start,
        box=truth.box[stands],
        velocity=truth.velocity[stands],
        class_id=truth.class_id[stands],
        score=np.ones(stands.sum()),
    )
    seen = joined_by_frame(padded.detections, detections)
    assert not [
        doubt for doubt in examine(replace(padded, detections=seen), CARD).doubts if doubt.kind == "padded_last"
    ]


def joined_by_frame(first: Detections, second: Detections) -> Detections:
    frame = np.concatenate([first.frame_of_rows, second.frame_of_rows])
    order = np.argsort(frame, kind="stable")
    columns = {
        name: np.concatenate([column, vars(second)[name]])[order]
        for name, column in vars(first).items()
        if isinstance(column, np.ndarray) and len(column) == len(first.box)
    }
    start = starts_of_sorted(frame[order], len(first.start) - 1)
    return replace(first, start=start, **{name: columns[name] for name in ("box", "velocity", "class_id", "score")})


def test_every_kind_has_a_sentence_without_a_hole() -> None:
    for name, kind in kinds().items():
        assert kind.says, name
        assert kind.least > 0, name


def test_a_log_is_cured(tmp_path: Path, cli: CommandLine, scenes: list[Scene]) -> None:
    late = FITTED[0].plant(scenes[0], 1.0, np.random.default_rng(0))
    save_scene(late, tmp_path / "logs", CARD.task.classes)
    words = ("doctor", "--files", tmp_path / "logs")
    said = cli(*words, "--cure", tmp_path / "cured", "--json", tmp_path / "found.json")
    assert said.status == 1
    assert "s late (1.0 frames): misfit" in said.out.replace("\n", " ")
    found: Any = read_json(tmp_path / "found.json")
    assert [doubt["kind"] for doubt in found["scenes"][0]["doubts"]] == ["late"]
    before, after = (float(word) for word in said.out.split("bADE of stp ")[1].replace("m", "").split("->"))
    assert after < before
    healed = cli("doctor", "--files", tmp_path / "cured")
    assert healed.status == 0
    assert "data fit together" in healed.out


def test_a_copy_says_which_rows_it_lacks(tmp_path: Path, cli: CommandLine, scenes: list[Scene]) -> None:
    late = FITTED[0].plant(scenes[0], 1.0, np.random.default_rng(0))
    classes = ("car", "spaceship", *CARD.task.classes[2:])
    save_scene(late, tmp_path / "logs", classes)
    said = cli("doctor", "--files", tmp_path / "logs", "--cure", tmp_path / "cured")
    assert "detections of class 'spaceship', which the task does not have" in said.err
    assert "--env says which classes are kept" in said.err


def test_simulated_detections_are_not_those_of_a_log(tmp_path: Path, cli: CommandLine, scenes: list[Scene]) -> None:
    save_scene(scenes[0], tmp_path / "logs", CARD.task.classes)
    said = cli("doctor", "--files", tmp_path / "logs", "--env", ENV)
    assert said.status == 2
    assert "such as MTP-nuScenes-v0 (2 Hz) and MTP-KITTI-v0 (10 Hz)" in said.err


def test_errors_have_status_2(tmp_path: Path, cli: CommandLine) -> None:
    said = cli("doctor", "--env", ENV, "--files", tmp_path / "nowhere")
    assert said.status == 2
    assert said.err.startswith("error: ")


def test_a_folder_of_scenes_is_no_run(tmp_path: Path, cli: CommandLine, scenes: list[Scene]) -> None:
    save_scene(scenes[0], tmp_path / "logs", CARD.task.classes)
    said = cli("doctor", tmp_path / "logs")
    assert said.status == 2
    assert said.err.rstrip().endswith("own scenes are named with --files")


def test_results_are_kept_until_the_scene_or_its_map_changes(
    scenes: list[Scene], monkeypatch: pytest.MonkeyPatch
) -> None:
    examined = []

    def counted(scene: Scene, card: Card) -> Examination:
        examined.append(scene.name)
        return examine(scene, card)

    monkeypatch.setattr(checkup, "examine", counted)
    moved = replace(scenes[0], time=scenes[0].time + 5.0)  # no other test has it
    for _ in range(2):
        mtp_bench.doctor(ENV, scenes=[moved])
    assert len(examined) == 1
    lane = Lane(np.zeros((2, 2)), np.ones((2, 2)), np.zeros((2, 2)))
    monkeypatch.setattr(checkup, "with_map", lambda scene, card, data: replace(scene, lanes=(lane,)))
    for _ in range(2):
        mtp_bench.doctor(ENV, scenes=[moved])
    assert len(examined) == 2


def test_comparisons_state_doubts_in_their_numbers(tmp_path: Path, cli: CommandLine, scenes: list[Scene]) -> None:
    late = FITTED[0].plant(scenes[0], 1.0, np.random.default_rng(0))
    save_scene(late, tmp_path / "logs", CARD.task.classes)
    words = (
        "compare",
        "blind",
        "--env",
        OWN,
        "--files",
        tmp_path / "logs",
        "--seeds",
        1,
        "--json",
        tmp_path / "a.json",
    )
    assert cli(*words).status == 0
    (doubt,) = read_json(tmp_path / "a.json")["doubts"]
    assert doubt.startswith("intersection-010001: detections are 0.49 s late")


def test_data_lists_doubts_once_per_state_of_the_files(
    tmp_path: Path, cli: CommandLine, scenes: list[Scene], repository: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    late = FITTED[0].plant(scenes[0], 1.0, np.random.default_rng(0))
    save_scene(late, tmp_path / "logs", CARD.task.classes)
    _, _, task = (repository / "envs" / f"{OWN}.toml").read_text().partition("[task]")
    card = tmp_path / "MTP-Own-v0.toml"
    source = '[source]\nname = "files"\nfolder = "logs"\n'
    card.write_text(f'id = "MTP-Own-v0"\nsummary = "own"\n\n{source}\n[task]{task}')
    doubt = "doubt: intersection-010001: detections are 0.49 s late"
    assert doubt not in cli.ok("data", "--env", card, "--no-doctor")
    assert doubt in cli.ok("data", "--env", card)
    monkeypatch.setattr(checkup, "scene_digest", None)  # what is kept needs no scene
    assert doubt in cli.ok("data", "--env", card)


def test_runs_tell_doubts_first_and_once(tmp_path: Path, cli: CommandLine, scenes: list[Scene]) -> None:
    late = FITTED[0].plant(scenes[0], 1.0, np.random.default_rng(0))
    save_scene(late, tmp_path / "logs", CARD.task.classes)
    words = ("run", "blind", "--env", "MTP-nuScenes-v0", "--files", tmp_path / "logs", "-o")
    assert "doubt: intersection-010001: detections are 0.49 s late (1.0 frames)" in cli(*words, tmp_path / "a").err
    assert cli(*words, tmp_path / "b", "--no-doctor").err == ""


def test_from_python(scenes: list[Scene]) -> None:
    found = mtp_bench.doctor(ENV, scenes=scenes)
    assert found.doubts == []
    assert "2 scenes: data fit together" in found.lines()[0]
    assert len(found.lines()) <= 3


def test_a_card_that_switches_the_doctor_off_says_why(tmp_path: Path, repository: Path) -> None:
    path = tmp_path / "MTP-WILDTRACK-v0.toml"
    text = (repository / "envs" / path.name).read_text()
    path.write_text(f'{text}\n[data]\ndoctor = "off"\n')
    with pytest.raises(MtpBenchError, match="expected a sentence that says why the doctor is off"):
        load_card(path)
    path.write_text(f'{text}\n[data]\ndoctor = "off"\nreason = "shifted on purpose"\n')
    assert load_card(path).is_trusted


@pytest.mark.data
def test_errors_that_are_asked_for_are_no_doubts(cli: CommandLine, tmp_path: Path, data_root: Path) -> None:
    """Detections two frames late are what the doctor finds, unless `--perturb` made them so."""
    words = ("run", "stp", "--env", "MTP-nuScenes-mini-v0", "--data", data_root, "--scenes", 1, "--jobs", 1)
    said = cli(*words, "--perturb", "delay=2", "-o", tmp_path / "late")
    assert (said.status, "late" in said.err.replace(str(tmp_path), "")) == (0, False)
