"""Bird's-eye pictures of a scene: truth, detections, the agent's answers, and errors.

Tracks are numbered, false tracks and forecasts red, an event is a ring with its name.
"""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ...cards import Card
from ...core import Floats, Scene, rotate, to_metres
from ...env import LiveEpisode
from ...scoring import sample_weights
from ..framing import TRAIL_SECONDS, Window, arrows_of
from ..palette import (
    BLACK,
    DETECTION,
    EGO,
    FALSE,
    FORECAST,
    OTHER_TRACK,
    TRACK,
    TRUTH,
    Color,
)
from ..plan import plan_at
from ..run_replay import Replay
from .canvas import GRAY, LARGE, MIDDLE, SMALL, Canvas, Outline
from .column import Mark, Text, column

SIZE = (960, 720)  # pixels
PANEL = 230  # pixels of the width
# colour, width in pixels, number of the heaviest samples, opacity
FORECAST_STYLE = (FORECAST, 1.3, 5, 0.9)
FALSE_STYLE = (FALSE, 0.8, 1, 0.4)
ROAD = (240, 240, 240)
CENTER_LINE = (205, 205, 205)
BORDER = (150, 150, 150)
SMALLEST_M = 16.0  # half of what is shown around a vehicle
LARGEST_M = 50.0
MARGIN_M = 3.0  # around the objects of a fixed place
EVENT_SECONDS = 1.5  # time that an event stays in the picture
TRACKED = Outline(TRUTH, 2.0, heading=True)
UNTRACKED = Outline(TRUTH, 2.0, heading=True, dashed=True)
DETECTED = Outline(DETECTION, 1.2)
FALSE_DETECTION = Outline(DETECTION, crossed=True)
TRACK_BOX = Outline(TRACK, fill=95)
FALSE_TRACK = Outline(FALSE, fill=25)
OTHER_HYPOTHESIS = Outline(OTHER_TRACK, 0.8, dashed=True)
VEHICLE = Outline(EGO, 1.5, fill=200, heading=True)
PLAN = Mark("plan of the ego", line=EGO, width=3.5)
HARD_BRAKE = Mark("it brakes hard", line=FALSE, width=3.5)
SLOWER = Mark("object that slows it", line=FALSE, sign="circle")


class NamedBox(NamedTuple):
    """A box [7] with its name."""

    box: Floats
    name: str
    color: Color


def windows_of(scene: Scene, card: Card) -> list[Window]:
    """Return the window of each frame, all of one size.

    They hold nearly all detections, or true boxes in a scene without detections. They
    move with the ego if there is one, but never turn.
    """
    table = scene.detections if len(scene.detections.box) else scene.truth
    box_places = table.box[:, :2]
    if card.drive is not None:  # more frames will come
        return _squares(scene.ego[:, :2], LARGEST_M)
    if not card.has_ego:
        if not len(box_places):
            box_places = scene.ego[:, :2]
        # few boxes far off would make all others small
        low = np.quantile(box_places, 0.01, axis=0) - MARGIN_M
        high = np.quantile(box_places, 0.99, axis=0) + MARGIN_M
        return [
            Window(*((low + high) / 2).tolist(), *(high - low).tolist())
        ] * scene.frames
    pose = scene.ego[table.frame_of_rows]
    offset_m = rotate(box_places - pose[:, :2], -pose[:, 3])
    offset_m = np.append(offset_m, [[0.0, 0.0]], axis=0)  # scenes without boxes
    # the side with most detections has most room; where they reach too far for one
    # picture, those near the ego matter most
    ahead = np.clip(np.median(offset_m[:, 0]), -LARGEST_M / 2, LARGEST_M / 2)
    reach = np.abs(offset_m - [ahead, 0.0]).max(axis=1)
    size = 2 * float(np.clip(np.quantile(reach, 0.9), SMALLEST_M, LARGEST_M))
    shift = rotate(np.tile([ahead, 0.0], (scene.frames, 1)), scene.ego[:, 3])
    return _squares(scene.ego[:, :2] + shift, size)


def _squares(middle: Floats, size: float) -> list[Window]:
    return [Window(x, y, size, size) for x, y in middle.tolist()]


def draw_frame(
    replay: Replay, t: int, window: Window, remarks: Iterable[Text] = ()
) -> NDArray[np.uint8]:
    """Draw frame ``t`` of a run [height, width, 3] in `SIZE`.

    ``remarks`` stand below the heading of the column.
    """
    truth = replay.scene.truth
    canvas = Canvas(SIZE[0] - PANEL, SIZE[1], window)
    rollout_frame = t - replay.first
    draw_lanes(canvas, replay)
    _draw_forecasts(canvas, replay, rollout_frame)
    named_boxes = _draw_tracks(canvas, replay, rollout_frame)
    _draw_boxes(canvas, replay, t)
    draw_plan(canvas, replay, t)
    # the newest event of each object lately, at the place of the object now
    object_ids = truth.object_id[truth.rows(t)].tolist()
    box_places = dict(zip(object_ids, truth.box[truth.rows(t), :2], strict=True))
    ring_px = min(max(10.0, 2.5 * canvas.scale), 20.0)  # 2.5 m, if that is visible
    events = replay.recent(t, EVENT_SECONDS * replay.card.task.rate)
    event_places = [
        box_places.get(e.object_id, np.array(e.position[:2])) for e in events
    ]
    for place in event_places:
        canvas.ring(canvas.pixels(place), ring_px)
    # names are written as far as there is room, events first
    canvas.scale_bar()
    for event, place in zip(events, event_places, strict=True):
        canvas.callout(place, event.label, BLACK, 0.7 * ring_px, SMALL)
    if replay.card.has_ego:
        named_boxes.insert(0, NamedBox(replay.ego_boxes[t], "ego", EGO))
    for box, name, color in named_boxes:
        canvas.label(box[:2], name, color, 0.5 * float(box[4]) * canvas.scale)
    heading = [*_heading(replay, t), *remarks]
    panel = column((PANEL, SIZE[1]), heading, legend(replay))
    picture = Image.new("RGB", SIZE)
    picture.paste(canvas.finished(), (0, 0))
    picture.paste(panel, (canvas.width, 0))
    return np.array(picture, dtype=np.uint8)  # a copy, which can be drawn on


def draw_lanes(canvas: Canvas, replay: Replay) -> None:
    """Draw the road, with directions of lanes where agents see lanes."""
    outlines = {}
    for lane in replay.scene.lanes:
        outline = np.concatenate([lane.left, lane.right[::-1]])
        if canvas.meets(outline):
            outlines[lane] = outline
    for outline in outlines.values():
        canvas.polygon(outline, ROAD)
    for lane in outlines:
        if not lane.junction:
            canvas.lines([lane.left, lane.right], BORDER)
        canvas.lines([lane.center], CENTER_LINE, 0.5)
    if replay.card.lanes is not None:
        canvas.lines(arrows_of(outlines), BORDER)


def draw_plan(canvas: Canvas, replay: Replay, t: int) -> list[tuple[Mark, Floats]]:
    """Draw the plan and way of the ego, and what slows it.

    Returns the marks with their places [n, 2], m.
    """
    plan = plan_at(replay, t)
    if plan is None:
        return []
    canvas.lines([replay.scene.ego[:, :2]], EGO, 1.0, 110)
    steps = np.stack([plan.path[:-1], plan.path[1:]], axis=1)
    canvas.lines(steps[~plan.hard], EGO, PLAN.width)
    canvas.lines(steps[plan.hard], FALSE, PLAN.width)
    canvas.dot(canvas.pixels(plan.path[-1]), 4.0, EGO)
    for box in plan.slower:
        radius_px = 16.0 + 0.6 * float(box[4]) * canvas.scale
        canvas.circle(canvas.pixels(box[:2]), radius_px, FALSE)
    return [
        (PLAN, plan.path),
        (HARD_BRAKE, plan.path[1:][plan.hard]),
        (SLOWER, plan.slower[:, :2]),
    ]


def _draw_tracks(canvas: Canvas, replay: Replay, rollout_frame: int) -> list[NamedBox]:
    """Draw trails and tracks of one frame.

    Returns their boxes with ids as names, false ones last.
    """
    rollout = replay.rollout
    answers = replay.answers
    rows = np.arange(*rollout.tracks.start[[rollout_frame, rollout_frame + 1]])
    is_shown = answers.shown[rows]
    is_other = answers.hypotheses.member[rows].any(axis=1) & ~is_shown
    boxes = rollout.track_box.astype(np.float64)
    canvas.boxes(boxes[rows[is_other]], OTHER_HYPOTHESIS)
    rows = rows[is_shown]
    frames_back = max(1, round(TRAIL_SECONDS * replay.card.task.rate))
    best = int(answers.hypotheses.best[rollout_frame])
    past = answers.past(rows, best, min(rollout_frame, frames_back))
    trails = boxes[past, :2]
    is_false = replay.track_false[rows]
    canvas.lines(trails[is_false], FALSE, 1.0, 150)
    canvas.lines(trails[~is_false], TRACK, 1.6, 150)
    canvas.boxes(boxes[rows[is_false]], FALSE_TRACK)
    canvas.boxes(boxes[rows[~is_false]], TRACK_BOX)
    named_boxes = []
    for chosen, color in ((rows[~is_false], TRACK), (rows[is_false], FALSE)):
        for row in chosen:
            named_boxes.append(NamedBox(boxes[row], str(rollout.track_id[row]), color))
    return named_boxes


def _draw_forecasts(canvas: Canvas, replay: Replay, rollout_frame: int) -> None:
    """Draw the heaviest samples of each object, lighter ones fainter.

    Each has a dot at its end. Of a false forecast there is one, fainter still.
    """
    rollout = replay.rollout
    objects = rollout.objects.rows(rollout_frame)
    starts = rollout.object_box[objects, :2].astype(np.float64)
    weights = sample_weights(rollout.forecast_log_weight[objects])
    # forecasts may lead into the picture from outside
    for i in np.flatnonzero(canvas.inside(starts, margin_px=canvas.width / 4)):
        is_false = replay.forecast_false[objects.start + i]
        style = FALSE_STYLE if is_false else FORECAST_STYLE
        color, width, max_samples, opacity = style
        paths = starts[i] + to_metres(rollout.forecast[objects.start + i])
        heaviest = np.argsort(-weights[i], kind="stable")[:max_samples]
        for sample in heaviest[weights[i][heaviest] > 0][::-1]:
            path = canvas.pixels(np.concatenate([starts[i, None], paths[sample]]))
            share = float(weights[i][sample] / weights[i].max())
            alpha = round(opacity * (100 + 140 * share))  # light ones can still be seen
            canvas.stroke(path, color, width, alpha)
            canvas.dot(path[-1], 1.6 * width, color, alpha)


def _draw_boxes(canvas: Canvas, replay: Replay, t: int) -> None:
    truth = replay.scene.truth
    detections = replay.scene.detections
    detected = detections.box[detections.rows(t)]
    is_false = replay.detection_false[detections.rows(t)]
    canvas.boxes(detected[~is_false], DETECTED)
    canvas.boxes(detected[is_false], FALSE_DETECTION)
    boxes = truth.box[truth.rows(t)]
    is_evaluated = ~truth.neutral[truth.rows(t)]
    is_tracked = replay.truth_track[truth.rows(t)] >= 0
    canvas.boxes(boxes[is_evaluated & is_tracked], TRACKED)
    canvas.boxes(boxes[is_evaluated & ~is_tracked], UNTRACKED)
    if replay.card.has_ego:
        canvas.boxes(replay.ego_boxes[t][None], VEHICLE)


def _heading(replay: Replay, t: int) -> Iterator[Text]:
    """Yield the lines at the top of the column."""
    scene = replay.scene
    if replay.agent:
        yield replay.agent, LARGE, BLACK
    yield replay.card.id, MIDDLE, GRAY
    yield f"scene {scene.name}", MIDDLE, GRAY
    time = f"{scene.seconds(t):.1f} s"
    yield f"frame {t} of {scene.frames - 1}   {time}", MIDDLE, BLACK
    plan = plan_at(replay, t)
    if plan is not None:
        acceleration = round(plan.acceleration, 1) + 0.0  # never -0.0
        text = f"ego: {acceleration:+.1f} m/s2, risk {plan.risk:.0%}"
        yield text, MIDDLE, BLACK
    log_weight = replay.rollout.hypothesis_log_weight[t - replay.first]
    count = int(np.isfinite(log_weight).sum())
    if count > 1:
        best = replay.answers.hypotheses.best[t - replay.first]
        share = float(np.exp(log_weight[best]))
        yield f"best of {count} hypotheses ({100 * share:.0f} %)", MIDDLE, BLACK


def legend(replay: Replay) -> list[Mark]:
    """Return the marks, the same for all frames of a video."""
    has_truth = len(replay.scene.truth.box) > 0
    knows_false = replay.judged and replay.scene.truth_complete
    is_driven = replay.card.drive is not None or replay.rollout.drive is not None
    entries = [
        (has_truth, Mark("true box", TRACKED)),
        (has_truth and replay.judged, Mark("true box, untracked", UNTRACKED)),
        (True, Mark("detection", DETECTED)),
        (knows_false, Mark("false positive", FALSE_DETECTION)),
        (True, Mark("track, where it was", TRACK_BOX, TRACK)),
        (knows_false, Mark("false track", FALSE_TRACK, FALSE)),
        (True, Mark("other hypotheses", OTHER_HYPOTHESIS)),
        (True, Mark("forecast", line=FORECAST)),
        (knows_false, Mark("false forecast", line=FALSE)),
        (replay.judged, Mark("event", sign="ring")),
        (replay.card.has_ego, Mark("ego", VEHICLE)),
        (is_driven, PLAN),
        (is_driven, HARD_BRAKE),
        (is_driven, SLOWER),
    ]
    return [mark for is_shown, mark in entries if is_shown]


class EpisodePictures:
    """Renderer of an env: pictures of the frame that was answered last.

    Before the first answer they are of frame 0.
    """

    def render(self, episode: LiveEpisode) -> NDArray[np.uint8]:
        """Draw a picture [height, width, 3], always of the same size.

        True boxes are not compared with the answer.
        """
        windows = windows_of(episode.scene, episode.card)
        frames_back = round(TRAIL_SECONDS * episode.card.task.rate)
        replay = Replay.of_episode(episode, frames_back)
        return draw_frame(replay, episode.frame, windows[episode.frame])

    def close(self) -> None:
        """Do nothing: pictures keep no resource open."""
