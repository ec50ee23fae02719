"""``mtp-bench video``: files that hold every frame, cut around an event, complete or not there at all."""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

import mtp_bench
from mtp_bench.core import Drive, Lane, boxes_meet
from mtp_bench.running.stored import open_run
from mtp_bench.traffic.drive_record import rows_from
from mtp_bench.traffic.highway.source import pack
from mtp_bench.traffic.highway.world import World
from mtp_bench.viz.drawing.birds_eye import DETECTED, FALSE_DETECTION, SIZE, TRACKED, UNTRACKED, VEHICLE
from mtp_bench.viz.drawing.canvas import Canvas
from mtp_bench.viz.drawing.column import Mark, Text, column
from mtp_bench.viz.drawing.video import pictures, write_video
from mtp_bench.viz.framing import AROUND_SECONDS, Window, frames_around
from mtp_bench.viz.run_replay import Replay, replay
from tests.support.command_line import CommandLine
from tests.support.scoring_scenes import Thing, make_card, make_rollout, make_scene, with_detections
from tests.support.small_scenes import write_short_card

NO_PYAV = pytest.mark.skipif(find_spec("av") is None, reason="PyAV is not installed: pip install av")
ENCODERS = [".gif", pytest.param(".mp4", marks=NO_PYAV)]


def frames_of(path: Path) -> tuple[list[NDArray[Any]], float]:
    """Pictures [height, width, 3] of a video, and how many there are per second."""
    if path.suffix == ".gif":
        with Image.open(path) as image:
            pictures = []
            for i in range(getattr(image, "n_frames", 1)):
                image.seek(i)
                pictures.append(np.asarray(image.convert("RGB")))
            return pictures, 1000 / image.info["duration"]
    import av

    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        pictures = [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]
        assert stream.average_rate is not None
        return pictures, float(stream.average_rate)


@pytest.fixture(scope="module")
def drawn(card: str, kitti: str, events_run: Path) -> Callable[[str], Replay]:
    opened = open_run(events_run, kitti)
    return lambda scene: replay(opened.scene(scene), opened.first(scene), opened.card, "drawn")


@pytest.mark.parametrize("suffix", ENCODERS)
def test_a_video_holds_every_frame_of_the_first_scene(
    suffix: str, cli: CommandLine, events_run: Path, tmp_path: Path, drawn: Callable[[str], Replay], kitti: str
) -> None:
    path = tmp_path / f"a{suffix}"
    path.write_text("earlier")
    printed = cli.ok("video", events_run, "-o", path, "--data", kitti)
    assert printed == f"{path}: scene 0001, frames 0 to 8, 10 per second\n"
    shown, rate = frames_of(path)
    assert (len(shown), rate) == (9, 10.0)
    expected = next(pictures(drawn("0001"), [4]))
    assert shown[4].shape == (SIZE[1], SIZE[0], 3) == expected.shape
    assert np.abs(shown[4].astype(int) - expected).mean() < 4
    assert [path.name for path in tmp_path.iterdir()] == [f"a{suffix}"]


def test_an_event_is_shown_with_what_is_around_it(drawn: Callable[[str], Replay]) -> None:
    played = drawn("0001")
    t = played.incident("ids-0").frame
    assert frames_around(played.scene, t) == range(9), "the scene is shorter than what would be shown"
    time = 10 * played.scene.time
    assert frames_around(replace(played.scene, time=time), t) == range(2, 7)
    assert (time[6] - time[4]) < AROUND_SECONDS < (time[7] - time[4])


def test_what_broke_leaves_no_file(tmp_path: Path) -> None:
    def broken() -> Any:
        yield np.zeros((4, 4, 3), dtype=np.uint8)
        raise RuntimeError("no more")

    with pytest.raises(RuntimeError, match="no more"):
        write_video(tmp_path / "a.gif", broken(), 10.0)
    assert list(tmp_path.iterdir()) == []


# ---- drives

CONTACT = 13  # state in which the ego meets car 5; decisions are in states 0, 5 and 10, answered at 2 Hz
EGO_SIZE_M = (4.5, 1.8)


def cars(state: int) -> list[Thing]:
    """Car 5 comes towards the ego at 3 m/s; car 6 drives beside it and has left after state 11."""
    return [Thing(5, 20.0 - 0.3 * state, 0.3), *[Thing(6, 5.0 + state, 8.0)] * (state < 12)]


def collision(at_fault: bool = True, seen: bool = False) -> Replay:
    """The ego drives along x at 10 m/s into car 5, which is detected and forecast if ``seen``; car 6 is detected."""
    recorded = make_scene([cars(state) for state in range(CONTACT + 1)])
    last = 10  # state of the last decision
    frame = recorded.truth.frame_of_rows
    truth = replace(recorded.truth.select(frame <= last), start=recorded.truth.start[: last + 2])
    line = np.array([[-50.0, 0.0], [50.0, 0.0]])
    station = np.arange(CONTACT + 1.0)
    ego = np.column_stack([station, np.zeros((CONTACT + 1, 3))])
    world = World(recorded.time[: last + 1], ego[: last + 1], truth, (Lane(line, line, line),), np.ones(len(truth.box)))
    drive = Drive(
        way=float(CONTACT), seconds=CONTACT / 10, goal=False, collision="car", at_fault=at_fault, near_misses=1,
        phantom_brakes=0, comfortable=True, acceleration=np.zeros(CONTACT), risk=np.full(3, 0.25), cause=np.full(3, -1),
        plan=np.stack([[[5.0 * t, 0.0], [5.0 * t + 5, 0.0]] for t in range(3)]), hit=5, size=np.array(EGO_SIZE_M),
        station=station, route=np.array([[0.0, 0.0, 0.0, 0.0], [99.0, 99.0, 0.0, 0.0]]),
        world={**pack(world), "ending": rows_from(recorded.truth, last + 1)},
    )  # fmt: skip
    decisions = [cars(state) for state in (0, 5, 10)]
    detected = decisions if seen else [things[1:] for things in decisions]
    scene = with_detections(make_scene(decisions), detected)
    # 1.5 m beyond the place of the last decision, and 2.4 m beyond that of the contact: the gate is 2 m
    ahead = [[[18.5, 0.3]] * 3]
    forecasts = [[replace(things[0], forecast=ahead)] if seen else [] for things in decisions]
    scene = replace(scene, time=0.5 * np.arange(3), ego=ego[:11:5])
    card = make_card()
    card = card.model_copy(update={"task": card.task.model_copy(update={"rate": 2.0})})
    rollout = make_rollout([things[1:] for things in decisions], forecasts)
    return replay(scene, replace(rollout, drive=drive), card, "blind")


@dataclass
class Drawn:
    """What is drawn in one picture."""

    boxes: dict[Any, Any] = field(default_factory=dict)  # [n, 7] by outline
    rings: list[Any] = field(default_factory=list)  # [2] pixels
    texts: str = ""  # of the heading
    canvas: Any = None


@pytest.fixture
def watched(monkeypatch: pytest.MonkeyPatch) -> Callable[[Replay, int], Drawn]:
    """Draw one picture of a run and return what is in it."""
    drawn = Drawn()
    draw_boxes, draw_ring = Canvas.boxes, Canvas.ring

    def boxes(canvas: Canvas, box: Any, outline: Any) -> None:
        if outline in (VEHICLE, TRACKED, UNTRACKED, DETECTED, FALSE_DETECTION):
            drawn.canvas = drawn.canvas or canvas
            drawn.boxes.setdefault(outline, box)  # those of the key come last
        draw_boxes(canvas, box, outline)

    def ring(canvas: Canvas, pixel: Any, radius_px: float) -> None:
        if canvas.window != Window(0.0, 0.0, canvas.width, canvas.height):  # that of the key
            drawn.rings.append(pixel)
        draw_ring(canvas, pixel, radius_px)

    def draw_column(size_px: Any, heading: Sequence[Text], marks: Sequence[Mark]) -> Any:
        drawn.texts = "\n".join(text for text, _, _ in heading)
        return column(size_px, heading, marks)

    monkeypatch.setattr(Canvas, "boxes", boxes)
    monkeypatch.setattr(Canvas, "ring", ring)
    monkeypatch.setattr("mtp_bench.viz.drawing.birds_eye.column", draw_column)

    def draw(run: Replay, state: int) -> Drawn:
        drawn.__init__()  # type: ignore[misc]
        (image,) = pictures(run, [state])
        assert image.shape == (SIZE[1], SIZE[0], 3)
        return drawn

    return draw


@pytest.mark.parametrize("state", range(CONTACT + 1))
def test_boxes_move_in_every_state_and_answers_at_decisions(
    state: int, watched: Callable[[Replay, int], Drawn]
) -> None:
    drawn = watched(collision(), state)
    np.testing.assert_allclose(drawn.boxes[VEHICLE], [[state, 0.0, 0.0, 0.0, *EGO_SIZE_M, 1.6]])
    np.testing.assert_allclose(drawn.boxes[UNTRACKED][:, 0], [20.0 - 0.3 * state])
    shown = drawn.boxes[TRACKED][drawn.canvas.inside(drawn.boxes[TRACKED][:, :2])]
    np.testing.assert_allclose(shown[:, 0], [5.0 + state] * (state < 12), err_msg="it has left after state 11")
    np.testing.assert_allclose(drawn.boxes[DETECTED][:, 0], [5.0 + state // 5 * 5], err_msg="of the latest decision")
    assert f"frame {state // 5} of 2   {0.5 * (state // 5):.1f} s" in drawn.texts
    assert f"now {state / 10:.1f} s" in drawn.texts
    meets = boxes_meet(drawn.boxes[VEHICLE], drawn.boxes[UNTRACKED])
    assert (meets.tolist(), len(drawn.rings)) == ([state == CONTACT], int(state == CONTACT))
    assert ("hits" in drawn.texts) == (state == CONTACT)


@pytest.mark.parametrize("at_fault", [True, False])
def test_the_last_picture_shows_the_contact_and_its_cause(
    at_fault: bool, watched: Callable[[Replay, int], Drawn]
) -> None:
    drawn = watched(collision(at_fault), CONTACT)
    fault = "at fault" if at_fault else "not at fault"
    assert drawn.texts.endswith(
        f"collision-0: at 1.3 s the ego hits car 5, {fault}, planned risk 25%. "
        "detector: not detected before: detected in 0 and forecast in 0 of the 2 frames before"
    )
    (met,) = drawn.boxes[UNTRACKED]
    np.testing.assert_allclose(drawn.rings, [drawn.canvas.pixels(met[:2])], err_msg="on the car that is met")
    ends = np.array([[CONTACT - 2.25, 0.0], [met[0] + 2.0, 0.3]])
    assert drawn.canvas.inside(ends).all()
    assert drawn.canvas.scale > 20, "pixels per metre: the contact is drawn from near"


def test_the_cause_is_that_of_the_last_decision(watched: Callable[[Replay, int], Drawn]) -> None:
    drawn = watched(collision(seen=True), CONTACT)
    assert drawn.texts.endswith(". planner: plan: detected in 2 and forecast in 2 of the 2 frames before")


def test_the_contact_stays() -> None:
    shown = list(pictures(collision(), range(CONTACT - 1, CONTACT + 4)))
    assert [image is shown[-1] for image in shown] == [False, True, True, True, True]


@pytest.mark.parametrize(
    ("env_id", "frame_states"), [("MTP-Drive-Intersection-v0", 5), ("MTP-Drive-Intersection-10Hz-v0", 1)]
)
def test_a_video_of_a_drive_lasts_a_second_longer(
    env_id: str, frame_states: int, cli: CommandLine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    counter = itertools.count(2)
    small = lambda *_: np.full((4, 4, 3), next(counter), dtype=np.uint8)  # noqa: E731
    monkeypatch.setattr("mtp_bench.viz.drawing.video.draw_frame", small)
    run, path = tmp_path / "run", tmp_path / "a.gif"
    mtp_bench.run("blind", write_short_card(tmp_path, env_id, 8.0), run, scenes=1)
    rollout = open_run(run).first()
    assert rollout.drive is not None
    states = len(rollout.drive.station)
    assert rollout.frames == np.ceil((states - 1) / frame_states)
    for options, rate in (((), 10), (("--fps", 20), 20)):
        printed = cli.ok("video", run, "-o", path, *options)
        assert f"frames 0 to {states + 9}, {rate} per second" in printed
        with Image.open(path) as image:
            durations = []
            for i in range(getattr(image, "n_frames", 1)):  # equal pictures are stored once
                image.seek(i)
                durations.append(image.info["duration"])
        assert sum(durations) == (states + 10) * 1000 / rate
        assert len(durations) == states


def test_a_drive_without_the_end_of_its_recording_is_one_error(cli: CommandLine, tmp_path: Path) -> None:
    run = tmp_path / "run"
    mtp_bench.run("blind", write_short_card(tmp_path, "MTP-Drive-Intersection-v0", 8.0), run, scenes=1)
    (file,) = run.glob("*.npz")
    with np.load(file) as stored:
        kept: Any = {name: array for name, array in stored.items() if name != "world_ending"}
    np.savez(file, **kept)
    said = cli("video", run, "-o", tmp_path / "a.gif")
    assert "the recording of a drive cannot be read ('ending')" in said.error
    assert not (tmp_path / "a.gif").exists()
