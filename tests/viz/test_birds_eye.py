"""Bird's-eye pictures: what is in them, what is not, and that nothing of the truth is in those of an evaluation."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env
from gymnasium.utils.passive_env_checker import env_render_passive_checker
from gymnasium.wrappers import RenderCollection
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from mtp_bench.env import MTPEnv
from mtp_bench.types import Detections, Lane, Scene
from mtp_bench.viz.drawing import palette
from mtp_bench.viz.drawing.birds_eye import SIZE, draw_frame, picture
from mtp_bench.viz.drawing.camera import LARGEST, camera
from mtp_bench.viz.drawing.canvas import Canvas, Viewport
from mtp_bench.viz.drawing.labels import label, scale_bar, sign
from mtp_bench.viz.drawing.panel import fitting, legend
from mtp_bench.viz.frame_view import EVENT_SECONDS, replay_view
from mtp_bench.viz.replay import Replay, replay
from tests.support import small_scenes
from tests.support.scoring_scenes import Thing, make_card, make_rollout, make_scene
from tests.support.small_scenes import EchoAgent, MemorySource, write_card

CARD = make_card()
MarkedColors = {
    "truth": palette.TRUTH,
    "detection": palette.DETECTION,
    "track": palette.TRACK,
    "other hypothesis": palette.OTHER_TRACK,
    "forecast": palette.FORECAST,
    "false": palette.FALSE,
    "event": palette.EVENT,
}
Picture = NDArray[np.uint8]


def car(id: int, t: int, y: float, **more: Any) -> Thing:
    return Thing(id, 5.0 + t, y, **more)


def ahead(thing: Thing) -> Thing:
    """With a forecast that goes on along x."""
    return replace(thing, forecast=[[[thing.x + 3 * s, thing.y] for s in (1, 2, 3)]], log_weight=[0.0])


def seen(scene: Scene, things: list[list[Thing]]) -> Scene:
    """The scene with these things as detections."""
    box = make_scene(things).truth
    score = np.ones(len(box.box))
    return replace(scene, detections=Detections(box.start, box.box, box.velocity, box.class_id, score))


PARTS = ("truth", "detection", "track", "other hypothesis", "forecast", "false", "event")


def scene_with(*parts: str, frames: int = 6, complete: bool = False) -> Replay:
    """One car or thing per part, each on a line of its own; the ego is in the origin."""
    span = range(frames)
    truth = [[car(1, t, 0.0)] if "truth" in parts else [] for t in span]
    found = [[car(1, t, 6.0)] if "detection" in parts else [] for t in span]
    tracks: list[list[Thing]] = [[] for _ in span]
    said: list[list[Thing]] = [[] for _ in span]
    for t in span:
        if "track" in parts:  # on the true car, where it is the same track all the time
            tracks[t].append(car(2, t, 0.8, hypotheses=(0, 1)))
        if "other hypothesis" in parts:
            tracks[t].append(car(3, t, -6.0, hypotheses=(1,)))
        if "false" in parts:
            tracks[t].append(car(4, t, -12.0, hypotheses=(0, 1)))
        if "forecast" in parts:
            said[t].append(ahead(car(2, t, 0.0)))
        if "event" in parts and t > 2:
            tracks[t] = [replace(thing, id=9) if thing.id == 2 else thing for thing in tracks[t]]
    weight = np.log([[0.7, 0.3]] * frames)
    scene = make_scene(truth, truth_complete=complete or "false" in parts)
    scene = replace(seen(scene, found), ego=np.tile([0.0, 0.0, 0.0, 0.0], (frames, 1)))
    return replay(scene, make_rollout(tracks, said, weight, hypotheses=2), CARD, "mtp")


def amount(image: Picture, color: palette.Color) -> int:
    """Pixels of nearly this colour in the map, beside the panel and above the scale bar."""
    part = image[: SIZE[1] - 60, : round(0.76 * SIZE[0])].astype(int)
    return int((np.abs(part - np.array(color)).max(axis=-1) < 24).sum())


def looked(played: Replay, t: int = 3) -> Picture:
    return picture(played, t)


def test_an_empty_scene_is_a_picture_too() -> None:
    image = looked(scene_with())
    assert image.shape == (SIZE[1], SIZE[0], 3)
    assert image.dtype == np.uint8
    assert all(amount(image, color) == 0 for color in MarkedColors.values())
    assert (image[:, : round(0.7 * SIZE[0])] == 255).mean() > 0.95


BESIDES = {"forecast": ("truth", "track"), "event": ("truth", "track"), "track": ("truth",)}


@pytest.mark.parametrize("part", PARTS)
def test_each_mark_is_there_with_its_thing_only(part: str) -> None:
    beside = BESIDES.get(part, ())
    without, given = looked(scene_with(*beside)), looked(scene_with(*beside, part))
    color = MarkedColors[part]
    assert amount(without, color) == 0
    assert amount(given, color) >= 10


def test_the_marks_differ_by_more_than_colour() -> None:
    """In grey, a true box is not a detection, and a missed true box is not a tracked one."""
    view = replay_view(scene_with("truth", "track", complete=True), 3)
    assert view.judged is not None
    missed = replace(view, judged=replace(view.judged, truth_missed=np.array([True])))
    assert amount(draw_frame(view), palette.TRUTH) > 1.3 * amount(draw_frame(missed), palette.TRUTH) > 0
    texts = [text for _, text in legend(view)]
    assert texts == [
        "true box", "true box, missed", "detection", "detection of nothing", "track, where it was", "track of nothing",
        "other hypotheses", "forecast", "forecast of nothing", "event", "ego",
    ]  # fmt: skip


def test_the_legend_names_only_what_this_kind_of_picture_can_show() -> None:
    view = replay_view(scene_with("truth", "track"), 3)
    assert not [text for _, text in legend(view) if "nothing" in text], "the truth is not complete"
    hidden = replace(view, truth_box=None, judged=None, ego=None)
    assert [text for _, text in legend(hidden)] == ["detection", "track, where it was", "other hypotheses", "forecast"]


def test_the_same_frame_is_the_same_picture() -> None:
    played = scene_with(*PARTS)
    first, second, other = looked(played), looked(played), looked(played, 4)
    assert np.array_equal(first, second)
    assert not np.array_equal(first, other)


@pytest.mark.parametrize("size", [(960, 720), (1280, 720), (600, 400), (320, 240), (64, 64)])
def test_any_size(size: tuple[int, int]) -> None:
    image = picture(scene_with(*PARTS), 3, size)
    assert image.shape == (size[1], size[0], 3)
    assert len(np.unique(image.reshape(-1, 3), axis=0)) > 20


def test_an_event_stays_for_a_while() -> None:
    played = scene_with("truth", "track", "event", frames=30)
    (event,) = played.incidents
    held = round(EVENT_SECONDS * CARD.task.rate)
    yellow = [amount(looked(played, event.frame + t), palette.EVENT) for t in (-1, 0, held - 1, held)]
    assert yellow[0] == yellow[3] == 0
    assert min(yellow[1], yellow[2]) > 0


def test_lanes_lie_under_everything() -> None:
    played = scene_with("truth")
    center = np.array([[-50.0, 0.0], [50.0, 0.0]])
    lane = Lane(center, center + np.array([0.0, 2.0]), center - np.array([0.0, 2.0]))
    with_road = looked(replace(played, scene=replace(played.scene, lanes=(lane,))))
    assert amount(with_road, (240, 240, 240)) > 1000
    assert amount(with_road, palette.TRUTH) == amount(looked(played), palette.TRUTH)


# ---- texts


def blank(viewport: Viewport | None = None) -> tuple[Canvas, ImageDraw.ImageDraw]:
    canvas = Canvas.blank(400, 300, viewport or Viewport(0.0, 0.0, 40.0, 30.0))
    return canvas, ImageDraw.Draw(canvas.finished())


def disjoint(canvas: Canvas) -> bool:
    inside = all(l >= 0 and t >= 0 and r <= 400 and b <= 300 for l, t, r, b in canvas.taken)
    pairs = itertools.combinations(canvas.taken, 2)
    return inside and not any(a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3] for a, b in pairs)


def test_texts_never_overlap_nor_are_they_cut_off() -> None:
    canvas, ink = blank()
    rng = np.random.default_rng(0)
    for i, xy in enumerate(rng.uniform([-22, -17], [22, 17], (200, 2))):
        if i < 20:
            sign(canvas, ink, xy, f"ids {i} > {i + 1}", 10.0)
        else:
            label(canvas, ink, xy, str(i), palette.TRACK, reach=2.0)
    assert len(canvas.taken) > 60
    assert disjoint(canvas)


def test_a_text_without_room_is_left_out() -> None:
    canvas, ink = blank()
    placed = [label(canvas, ink, np.zeros(2), "1234", palette.TRACK, reach=1.0) for _ in range(6)]
    assert placed == [True, True, True, True, False, False]
    assert not sign(canvas, ink, np.array([99.0, 0.0]), "out of sight", 10.0)


@pytest.mark.parametrize(("wide", "metres"), [(40.0, 5.0), (100.0, 20.0), (10.0, 2.0), (3.0, 0.5)])
def test_the_scale_bar_is_a_round_number_of_metres(wide: float, metres: float) -> None:
    canvas = Canvas.blank(400, 300, Viewport(0.0, 0.0, wide, 0.75 * wide))
    image = canvas.finished()
    scale_bar(canvas, ImageDraw.Draw(image))
    row = np.asarray(image)[300 - 16]
    black = np.flatnonzero((row == 0).all(axis=-1))
    assert black[-1] - black[0] == pytest.approx(metres * canvas.scale, abs=2)


def test_long_names_end_in_dots() -> None:
    assert fitting("short", 13, 100.0) == "short"
    cut = fitting("a very long name of a scene that has no end", 13, 100.0)
    assert cut.endswith("...")
    assert len(cut) < 25


# ---- what is shown


def test_the_camera_goes_along_with_the_ego_and_never_changes_its_size() -> None:
    ego = np.array([[10.0 * t, 5.0, 0.0, 0.0] for t in range(5)])
    seen_xy = ego[:, :2] + np.array([30.0, 0.0])
    followed = camera(True, ego, seen_xy, np.arange(5))
    first, last = followed.at(ego[0]), followed.at(ego[4])
    assert (last.x - first.x, last.y - first.y) == (40.0, 0.0)
    assert (first.wide, first.high) == (last.wide, last.high)
    assert first.x > ego[0, 0], "most is ahead"
    assert followed.at(ego[0]).wide <= 2 * LARGEST


def test_the_camera_of_a_fixed_place_stays_and_holds_what_was_seen() -> None:
    ego = np.zeros((5, 4))
    seen_xy = np.random.default_rng(0).uniform([100, 200], [130, 210], (500, 2))
    fixed = camera(False, ego, seen_xy, np.repeat(np.arange(5), 100))
    assert fixed.at(ego[0]) == fixed.at(ego[4])
    canvas = Canvas.blank(400, 300, fixed.at(ego[0]))
    assert canvas.inside(seen_xy).all()


@pytest.mark.parametrize("has_ego", [True, False])
def test_the_camera_steps_back_for_a_place_far_away(has_ego: bool) -> None:
    ego, seen_xy = np.zeros((1, 4)), np.array([[5.0, 9.0], [19.0, -9.0]])
    near = camera(has_ego, ego, seen_xy, np.zeros(2, dtype=int))
    assert near.with_place(12.0, 1.0, ego[0]) == near
    view = near.with_place(80.0, -60.0, ego[0]).at(ego[0])
    assert Canvas.blank(400, 300, view).inside(np.array([80.0, -60.0]))


@pytest.mark.parametrize("has_ego", [True, False])
def test_a_scene_without_detections_has_a_camera(has_ego: bool) -> None:
    view = camera(has_ego, np.zeros((3, 4)), np.zeros((0, 2)), np.zeros(0, dtype=int)).at(np.zeros(4))
    assert view.wide > 0
    assert view.high > 0


# ---- colours


PROTAN = [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
DEUTAN = [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
TRITAN = [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]]


@pytest.mark.parametrize("vision", [np.eye(3), PROTAN, DEUTAN, TRITAN], ids=["all", "protan", "deutan", "tritan"])
def test_the_colours_differ_for_every_kind_of_vision(vision: Any) -> None:
    """Simulated after Machado et al. 2009; distances in CIELAB, where 2 is just noticeable."""
    places = [_lab(np.asarray(vision) @ _linear(color)) for color in [*MarkedColors.values(), palette.EGO]]
    assert min(float(np.linalg.norm(a - b)) for a, b in itertools.combinations(places, 2)) > 15


def _linear(color: palette.Color) -> NDArray[np.float64]:
    c = np.array(color) / 255
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def _lab(linear: NDArray[np.float64]) -> NDArray[np.float64]:
    to_xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    xyz = to_xyz @ np.clip(linear, 0, 1) / [0.9505, 1.0, 1.089]
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


# ---- the env

MakeEnv = Callable[..., MTPEnv]


@pytest.fixture
def make_env(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> MakeEnv:
    """An env on a scene in memory, with pictures."""

    def make(scene: Scene | None = None, **keywords: Any) -> MTPEnv:
        source = MemorySource(scene or small_scenes.make_scene())
        monkeypatch.setattr("mtp_bench.env.open_source", lambda card, data: source)
        return MTPEnv(write_card(tmp_path), **{"render_mode": "rgb_array", **keywords})

    return make


def film(env: MTPEnv) -> list[Picture]:
    """The picture after reset and after every step of an agent."""
    agent = EchoAgent()
    agent.reset(env.task)
    observation, _ = env.reset(seed=0)
    images, over = [shot(env)], False
    while not over:
        observation, _, _, over, _ = env.step(agent.act(observation))
        images.append(shot(env))
    return images


def shot(env: MTPEnv) -> Picture:
    image = env.render()
    assert image is not None
    return image


def test_the_env_draws_from_reset_to_the_last_frame(make_env: MakeEnv) -> None:
    images = film(make_env())
    assert len(images) == 9
    assert {image.shape for image in images} == {(720, 960, 3)}
    for a, b in itertools.pairwise(images):
        assert not np.array_equal(a, b)
    assert amount(images[0], palette.TRACK) == 0, "no answer yet"
    for color in (palette.TRUTH, palette.DETECTION):
        assert amount(images[0], color) > 0
    for color in (palette.TRUTH, palette.DETECTION, palette.TRACK, palette.FORECAST):
        assert amount(images[-1], color) > 0


def test_the_truth_is_in_no_picture_of_an_evaluation(make_env: MakeEnv) -> None:
    scene = small_scenes.make_scene()
    honest = film(make_env(scene, evaluation=True))
    for image in honest:
        near = np.abs(image.astype(int) - palette.TRUTH).max(axis=-1) < 12
        assert not near.any(), "neither in the map nor in the legend"
    truth = scene.truth
    for other in (
        replace(scene, truth=replace(truth, box=truth.box + np.array([3.0, 1.0, 0, 0, 0, 0, 0]))),
        replace(scene, truth=replace(truth, eligible=~truth.eligible, object_id=truth.object_id + 1)),
    ):
        for a, b in zip(honest, film(make_env(other, evaluation=True)), strict=True):
            assert np.array_equal(a, b)
    shown, moved = film(make_env(scene)), film(make_env(other))
    assert all(np.array_equal(a, b) for a, b in zip(shown, moved, strict=True))  # ids are not drawn
    assert not np.array_equal(shown[0], honest[0])


def test_a_picture_changes_nothing(make_env: MakeEnv) -> None:
    agents = EchoAgent(), EchoAgent()
    envs = make_env(), make_env()
    seen_by = []
    for env, agent in zip(envs, agents, strict=True):
        agent.reset(env.task)
        observation, _ = env.reset(seed=3)
        rewards = []
        for _ in range(5):
            if env is envs[0]:
                env.render()
            observation, reward, *_ = env.step(agent.act(observation))
            rewards.append(reward)
        seen_by.append((rewards, observation["detection_box"].tolist()))
    assert seen_by[0] == seen_by[1]


@pytest.mark.parametrize("keywords", [{}, {"evaluation": True}, {"observe": "truth"}, {"rigid_motion": True}], ids=str)
def test_the_checker_of_gymnasium(card: str, kitti: str, keywords: dict[str, Any]) -> None:
    env = MTPEnv(card, data=kitti, render_mode="rgb_array", **keywords)
    assert env.metadata["render_fps"] == 10
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env, skip_render_check=True)  # that one opens every mode there is
        env_render_passive_checker(env)


def test_wrappers_that_collect_pictures(make_env: MakeEnv) -> None:
    env: gym.Env[Any, Any] = RenderCollection(make_env())
    env.reset(seed=0)
    for _ in range(3):
        env.step(env.action_space.sample())
    images: Any = env.render()
    assert [image.shape for image in images] == [(720, 960, 3)] * 4
    env.close()


def test_no_mode_no_picture(make_env: MakeEnv) -> None:
    env = make_env(render_mode=None)
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="render\\(\\) without a render mode"):
        assert env.render() is None
    env = make_env()
    with pytest.raises(ResetNeeded):
        env.render()
    env.reset(seed=0)
    env.render()
    env.close()
    env.reset(seed=0)
    assert env.render() is not None


@pytest.mark.data
@pytest.mark.parametrize(
    ("env_id", "scene"),
    [("MTP-KITTI-v0", "0013"), ("MTP-nuScenes-mini-v0", "scene-0103"), ("MTP-WILDTRACK-v0", "wildtrack-1200")],
)
def test_pictures_of_real_logs_show_what_there_is(env_id: str, scene: str, data_root: Path) -> None:
    env = MTPEnv(env_id, data=str(data_root), render_mode="rgb_array", scenes=[scene])
    image = film_until(env, 20)
    for color in (palette.TRUTH, palette.DETECTION, palette.TRACK):
        assert amount(image, color) > 10


def film_until(env: MTPEnv, frames: int) -> Picture:
    from mtp_bench import load_submission

    agent = load_submission("stp").build(env.task)
    agent.reset(env.task)
    observation, _ = env.reset(seed=0)
    for _ in range(frames):
        observation, *_ = env.step(agent.act(observation))
    return shot(env)


def test_a_picture_can_be_written(tmp_path: Path) -> None:
    Image.fromarray(looked(scene_with(*PARTS))).save(tmp_path / "a.png")
    with Image.open(tmp_path / "a.png") as image:
        assert image.size == SIZE
