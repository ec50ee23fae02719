"""Bird's-eye pictures: what is in them, what is not, and that nothing of the truth is in those of an evaluation."""

import itertools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from mtp_bench import MTPEnv
from mtp_bench.cards.card import LaneSection
from mtp_bench.core import Lane, Scene
from mtp_bench.viz import palette
from mtp_bench.viz.drawing.birds_eye import EVENT_SECONDS, LARGEST_M, SIZE, windows_of
from mtp_bench.viz.drawing.canvas import Canvas
from mtp_bench.viz.drawing.video import pictures
from mtp_bench.viz.framing import Window, arrows_of
from mtp_bench.viz.run_replay import Replay, replay
from tests.support import small_scenes
from tests.support.colours import APART, VISION, distance
from tests.support.scoring_scenes import Thing, make_card, make_rollout, make_scene, with_detections
from tests.support.small_scenes import EchoAgent, MemorySource, write_card

CARD = make_card()
COLORS = {
    "truth": palette.TRUTH, "detection": palette.DETECTION, "track": palette.TRACK,
    "other hypothesis": palette.OTHER_TRACK, "forecast": palette.FORECAST, "false": palette.FALSE,
    "event": palette.EVENT,
}  # fmt: skip
Picture = NDArray[np.uint8]


def car(id: int, t: int, y: float, **more: Any) -> Thing:
    return Thing(id, 5.0 + t, y, **more)


def scene_with(*parts: str, frames: int = 6, complete: bool = False) -> Replay:
    """One car or thing per part, each on a line of its own; the ego is in the origin."""
    span = range(frames)
    truth = [[car(1, t, 0.0)] if "truth" in parts else [] for t in span]
    found = [[car(1, t, 6.0)] if "detection" in parts else [] for t in span]
    tracks: list[list[Thing]] = [[] for _ in span]
    said: list[list[Thing]] = [[] for _ in span]
    for t in span:
        if "track" in parts:  # on the true car, where it is the same track all the time
            tracks[t].append(car(9 if "event" in parts and t > 2 else 2, t, 0.8, hypotheses=(0, 1)))
        if "other hypothesis" in parts:
            tracks[t].append(car(3, t, -6.0, hypotheses=(1,)))
        if "false" in parts:
            tracks[t].append(car(4, t, -12.0, hypotheses=(0, 1)))
        if "forecast" in parts:
            ahead = [[[5.0 + t + 3 * s, 0.0] for s in (1, 2, 3)]]
            said[t].append(car(2, t, 0.0, forecast=ahead, log_weight=[0.0]))
    weight = np.log([[0.7, 0.3]] * frames)
    scene = with_detections(make_scene(truth, truth_complete=complete or "false" in parts), found)
    return replay(scene, make_rollout(tracks, said, weight, hypotheses=2), CARD, "mtp")


def picture(run: Replay, t: int) -> Picture:
    return next(pictures(run, [t]))


def amount(image: Picture, color: palette.Color) -> int:
    """Pixels of nearly this colour in the map, beside the panel and above the scale bar."""
    part = image[: SIZE[1] - 60, : round(0.76 * SIZE[0])].astype(int)
    return int((np.abs(part - np.array(color)).max(axis=-1) < 24).sum())


BESIDES = {"forecast": ("truth", "track"), "event": ("truth", "track"), "track": ("truth",)}


@pytest.mark.parametrize("part", COLORS)
def test_each_mark_is_there_with_its_thing_only(part: str) -> None:
    beside = BESIDES.get(part, ())
    without, given = picture(scene_with(*beside), 3), picture(scene_with(*beside, part), 3)
    assert amount(without, COLORS[part]) == 0
    assert amount(given, COLORS[part]) >= 10


def test_an_event_stays_for_a_while() -> None:
    run = scene_with("truth", "track", "event", frames=30)
    (event,) = run.incidents
    held = round(EVENT_SECONDS * CARD.task.rate)
    marked = [amount(picture(run, event.frame + t), palette.EVENT) > 0 for t in (-1, 0, held - 1, held)]
    assert marked == [False, True, True, False]


@pytest.mark.parametrize("junction", [False, True])
def test_lanes_lie_under_everything_and_have_borders_but_in_junctions(junction: bool) -> None:
    run, center = scene_with("truth"), np.array([[-50.0, 0.0], [50.0, 0.0]])
    lane = Lane(center, center + np.array([0.0, 2.0]), center - np.array([0.0, 2.0]), junction=junction)
    scene = replace(run.scene, lanes=(lane,))
    with_road = picture(replace(run, scene=scene), 3)
    assert amount(with_road, (240, 240, 240)) > 1000
    assert (amount(with_road, (150, 150, 150)) < 100) == junction
    assert amount(with_road, palette.TRUTH) == amount(picture(run, 3), palette.TRUTH)
    answers = replace(run.answers, card=run.card.model_copy(update={"lanes": LaneSection()}))
    seen = picture(replace(run, scene=scene, answers=answers), 3)
    assert amount(seen, (150, 150, 150)) > amount(with_road, (150, 150, 150)) + 20  # arrows, where agents see lanes


def test_arrows_point_along_lanes() -> None:
    bend = np.array([[0.0, 0.0], [0.0, 20.0], [-25.0, 20.0]])
    first, second, third = arrows_of([Lane(bend, bend, bend)])
    np.testing.assert_allclose(first, [[-0.6, 6.2], [0.0, 7.5], [0.6, 6.2]], atol=1e-9)
    np.testing.assert_allclose((second[1], third[1]), [[-2.5, 20.0], [-17.5, 20.0]])
    np.testing.assert_allclose(third[[0, 2], 0], -16.2)


# ---- texts
def test_texts_never_overlap_nor_are_they_cut_off() -> None:
    canvas = Canvas(400, 300, Window(0.0, 0.0, 40.0, 30.0))
    rng = np.random.default_rng(0)
    for i, xy in enumerate(rng.uniform([-22, -17], [22, 17], (200, 2))):
        if i < 20:
            canvas.callout(xy, f"ids {i} > {i + 1}", palette.BLACK, 10.0)
        else:
            canvas.label(xy, str(i), palette.TRACK, 2.0)
    assert len(canvas.text_places) > 60
    assert all(l >= 0 and t >= 0 and r <= 400 and b <= 300 for l, t, r, b in canvas.text_places)
    pairs = itertools.combinations(canvas.text_places, 2)
    assert not any(a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3] for a, b in pairs)


# ---- the camera
def seen_scene(detected: list[tuple[float, float]], speed: float = 0.0) -> Scene:
    """Five frames with detections at these places relative to the ego, which drives along x from (10, 5)."""
    ego = np.array([[10.0 + speed * t, 5.0, 0.0, 0.0] for t in range(5)])
    things = [[Thing(i, pose[0] + x, pose[1] + y) for i, (x, y) in enumerate(detected)] for pose in ego]
    return replace(with_detections(make_scene([[]] * 5), things), ego=ego)


def test_the_camera_goes_along_with_the_ego_and_never_changes_its_size() -> None:
    scene = seen_scene([(30.0, 0.0)], speed=10.0)
    windows = windows_of(scene, CARD)
    first, last = windows[0], windows[4]
    assert ((last.x - first.x, last.y - first.y), (first.wide, first.high)) == ((40.0, 0.0), (last.wide, last.high))
    assert first.x > scene.ego[0, 0], "most is ahead"
    assert first.wide <= 2 * LARGEST_M


# ---- colours
@pytest.mark.parametrize("vision", VISION)
def test_the_colours_differ_for_every_kind_of_vision(vision: str) -> None:
    for one, other in itertools.combinations([*COLORS.values(), palette.EGO], 2):
        assert distance(one, other, vision) > APART


# ---- the env
MakeEnv = Callable[..., MTPEnv]


@pytest.fixture
def make_env(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> MakeEnv:
    def make(scene: Scene | None = None, **keywords: Any) -> MTPEnv:
        source = MemorySource(scene or small_scenes.make_scene())
        monkeypatch.setattr("mtp_bench.env.environment.open_source", lambda card, data: source)
        chosen: dict[str, Any] = {"render_mode": "rgb_array", **keywords}
        return MTPEnv(write_card(tmp_path), **chosen)

    return make


def shot(env: MTPEnv) -> Picture:
    image = env.render()
    assert image is not None
    return image


def film(env: MTPEnv, drawn: bool = True) -> tuple[list[Picture], list[Any]]:
    """The picture after reset and after every step of an agent; and what it was told."""
    agent = EchoAgent()
    agent.reset(env.task)
    observation, _ = env.reset(seed=0)
    images, told, over = [shot(env)] if drawn else [], [], False
    while not over:
        observation, reward, over, *_ = env.step(agent.act(observation))
        told.append((reward, observation["detection_box"].tolist()))
        images += [shot(env)] if drawn else []
    return images, told


def test_the_env_draws_from_reset_to_the_last_frame_and_changes_nothing(make_env: MakeEnv) -> None:
    images, told = film(make_env())
    assert [image.shape for image in images] == [(720, 960, 3)] * 9
    assert not any(np.array_equal(a, b) for a, b in itertools.pairwise(images))
    assert amount(images[0], palette.TRACK) == 0, "no answer yet"
    assert min(amount(images[0], color) for color in (palette.TRUTH, palette.DETECTION)) > 0
    assert min(amount(images[-1], COLORS[part]) for part in ("truth", "detection", "track", "forecast")) > 0
    assert film(make_env(), drawn=False) == ([], told)


def test_the_truth_is_in_no_picture_of_an_evaluation(make_env: MakeEnv) -> None:
    scene = small_scenes.make_scene()
    honest, _ = film(make_env(scene, evaluation=True))
    for image in honest:
        near = np.abs(image.astype(int) - palette.TRUTH).max(axis=-1) < 12
        assert not near.any(), "neither in the map nor in the legend"
    truth = scene.truth
    moved = replace(truth, box=truth.box + np.array([3.0, 1.0, 0, 0, 0, 0, 0]))
    other = replace(scene, truth=replace(moved, eligible=~truth.eligible, object_id=truth.object_id + 1))
    for a, b in zip(honest, film(make_env(other, evaluation=True))[0], strict=True):
        assert np.array_equal(a, b)
    assert not np.array_equal(film(make_env(scene))[0][0], honest[0])


def test_no_mode_no_picture(make_env: MakeEnv) -> None:
    env = make_env(render_mode=None)
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="without a render mode"):
        assert env.render() is None
    with pytest.raises(ResetNeeded):
        make_env().render()
