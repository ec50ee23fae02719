"""Bird's-eye pictures of a scene: truth, detections, the agent's answers, and errors.

Tracks are numbered, false tracks and forecasts red, an event is a ring with its name.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from ...cards import Card
from ...core import Floats, Scene, rotate, to_metres
from ...env import LiveEpisode
from ...scoring import sample_weights
from ..framing import TRAIL_SECONDS, Window, arrows_of
from ..palette import (
    BLACK,
    DETECTION,
    EGO,
    EVENT,
    FALSE,
    FORECAST,
    OTHER_TRACK,
    TRACK,
    TRUTH,
    Color,
)
from ..plan import plan_at
from ..run_replay import Replay, ego_boxes
from .canvas import (
    EDGE,
    GRAY,
    LARGE,
    MIDDLE,
    SMALL,
    Canvas,
    Outline,
    callout,
    scale_bar,
)
from .column import Mark, Text, column

SIZE = (960, 720)  # pixels
PANEL = 230  # pixels of the width
SAMPLES = 5  # of each forecast, the heaviest
ROAD, CENTER_LINE, BORDER = (240, 240, 240), (205, 205, 205), (150, 150, 150)
SMALLEST, LARGEST = 16.0, 50.0  # m, half of what is shown around a vehicle
MARGIN = 3.0  # m around the objects of a fixed place
EVENT_SECONDS = 1.5  # time that an event stays in the picture
TRACKED = Outline(TRUTH, 2.0, heading=True)
UNTRACKED = Outline(TRUTH, 2.0, heading=True, dashed=True)
DETECTED = Outline(DETECTION, 1.2)
FALSE_DETECTION = Outline(DETECTION, crossed=True)
TRACK_BOX = Outline(TRACK, fill=95)
FALSE_TRACK = Outline(FALSE, fill=25)
OTHER = Outline(OTHER_TRACK, 0.8, dashed=True)
VEHICLE = Outline(EGO, 1.5, fill=200, heading=True)
PLAN = (
    Mark("plan of the ego", line=EGO, width=3.5),
    Mark("it brakes hard", line=FALSE, width=3.5),
    Mark("object that slows it", line=FALSE, sign="circle"),
)


def windows_of(scene: Scene, card: Card) -> list[Window]:
    """Window of each frame, by the detections of the scene; by its true boxes if it has no detections.

    It follows the ego or stays; it never turns, and its size never changes.
    """
    seen = scene.detections if len(scene.detections.box) else scene.truth
    xy = seen.box[:, :2]
    if not card.has_ego:
        places = xy if len(xy) else scene.ego[:, :2]
        low, high = (
            np.quantile(places, 0.01, axis=0) - MARGIN,
            np.quantile(places, 0.99, axis=0) + MARGIN,
        )
        (x, y), (wide, tall) = (low + high) / 2, np.maximum(high - low, 2 * MARGIN)
        return [Window(float(x), float(y), float(wide), float(tall))] * scene.frames
    if card.drive is not None:  # more frames will come
        return [Window(x, y, LARGEST, LARGEST) for x, y in scene.ego[:, :2].tolist()]
    pose = scene.ego[seen.frame_of_rows]
    ahead, aside = rotate(xy - pose[:, :2], -pose[:, 3]).T
    rear, front = np.quantile(ahead, [0.05, 0.95]) if len(xy) else (0.0, 0.0)
    rear, front = min(rear, -5.0), max(front, 5.0)
    half = max(
        (front - rear) / 2,
        np.quantile(np.abs(aside), 0.9) if len(xy) else 0.0,
        SMALLEST,
    )
    # if the detections reach too far for one picture, those near the ego matter most
    center = (
        (front + rear) / 2
        if half <= LARGEST
        else np.clip((front + rear) / 2, -LARGEST / 2, LARGEST / 2)
    )
    size = float(2 * min(half, LARGEST))
    middle = scene.ego[:, :2] + rotate(
        np.tile([center, 0.0], (scene.frames, 1)), scene.ego[:, 3]
    )
    return [Window(x, y, size, size) for x, y in middle.tolist()]


def draw_frame(run: Replay, t: int, window: Window) -> NDArray[np.uint8]:
    """Frame ``t`` of a run as a picture [height, width, 3] of SIZE."""
    scene, truth = run.scene, run.scene.truth
    # the newest event of each object lately, and its place [2] now
    place = dict(
        zip(
            truth.object_id[truth.rows(t)].tolist(),
            truth.box[truth.rows(t), :2],
            strict=True,
        )
    )
    recent = run.recent(t, EVENT_SECONDS * run.card.task.rate)
    events = [
        (event, place.get(event.object_id, np.array(event.position[:2])))
        for event in recent
    ]
    canvas = Canvas.blank(SIZE[0] - PANEL, SIZE[1], window)
    ring = min(max(10.0, 2.5 * canvas.scale), 20.0)  # pixels
    draw_lanes(canvas, run)
    names = _draw_answers(canvas, run, t)
    _draw_boxes(canvas, run, t)
    draw_plan(canvas, run, t)
    for _, xy in events:
        canvas.ring(canvas.pixels(xy), ring)
    image = canvas.finished()
    ink = ImageDraw.Draw(image)
    scale_bar(canvas, ink)
    for (
        incident,
        xy,
    ) in events:  # names are written as far as there is room, events first
        callout(canvas, ink, xy, incident.label, BLACK, 0.7 * ring, SMALL, EVENT)
    if run.card.has_ego:
        names = [(ego_boxes(scene.ego[t][None])[0], "ego", EGO), *names]
    for box, text, color in names:
        callout(
            canvas,
            ink,
            box[:2],
            text,
            color,
            0.5 * float(box[4]) * canvas.scale,
            SMALL,
            None,
        )
    panel = column((PANEL, SIZE[1]), list(_heading(run, t)), legend(run), [], {})
    whole = Image.new("RGB", SIZE)
    whole.paste(image, (0, 0))
    whole.paste(panel, (image.width, 0))
    ImageDraw.Draw(whole).line([image.width, 0, image.width, SIZE[1]], fill=EDGE)
    return np.array(whole, dtype=np.uint8)  # a copy, which can be drawn on


def draw_lanes(canvas: Canvas, run: Replay) -> None:
    """The road, under everything else; with the directions of its lanes where agents see these."""
    near = [
        lane
        for lane in run.scene.lanes
        if canvas.meets(np.concatenate([lane.left, lane.right]))
    ]
    for lane in near:
        outline = np.concatenate([lane.left, lane.right[::-1]])
        canvas.draw.polygon(
            [(2 * x, 2 * y) for x, y in canvas.pixels(outline).tolist()], fill=ROAD
        )
    for lane in near:
        canvas.lines([] if lane.junction else [lane.left, lane.right], BORDER)
        canvas.lines([lane.center], CENTER_LINE, 0.5)
    canvas.lines([] if run.card.lanes is None else arrows_of(near), BORDER)


def draw_plan(canvas: Canvas, run: Replay, t: int) -> list[tuple[Floats, Mark]]:
    """Draw the plan of the ego of a closed loop, its way, and what slows it; places [n, 2] m of each mark."""
    plan = plan_at(run, t)
    if plan is None:
        return []
    canvas.lines([run.scene.ego[:, :2]], EGO, 1.0, 110)
    for step, hard in zip(
        zip(plan.path[:-1], plan.path[1:], strict=True), plan.hard, strict=True
    ):
        canvas.lines([np.array(step)], FALSE if hard else EGO, 3.5)
    canvas.dot(canvas.pixels(plan.path[-1]), 4.0, EGO)
    for box in plan.slower:
        canvas.circle(
            canvas.pixels(box[:2]), 16.0 + 0.6 * float(box[4]) * canvas.scale, FALSE
        )
    return list(
        zip(
            (plan.slower[:, :2], plan.path[1:][plan.hard], plan.path),
            PLAN[::-1],
            strict=True,
        )
    )


def _draw_answers(
    canvas: Canvas, run: Replay, t: int
) -> list[tuple[Floats, str, Color]]:
    """Draw forecasts, trails and tracks; returns the boxes of the tracks with their names, false tracks last."""
    rollout, answers, answered = run.rollout, run.answers, t - run.first
    _draw_forecasts(canvas, run, answered)
    tracks, best = rollout.tracks.rows(answered), int(answers.hypotheses.best[answered])
    member, shown = answers.hypotheses.member[tracks].any(axis=1), answers.shown[tracks]
    boxes = rollout.track_box[tracks].astype(np.float64)
    canvas.boxes(boxes[member & ~shown], OTHER)
    rows = tracks.start + np.flatnonzero(shown)
    boxes, false = boxes[shown], run.track_false[rows]
    past = answers.past(
        rows, best, min(answered, max(1, round(TRAIL_SECONDS * run.card.task.rate)))
    )
    for row, wrong in zip(past, false, strict=True):
        trail = rollout.track_box[np.unique(row), :2]
        canvas.lines([trail], FALSE if wrong else TRACK, 1.0 if wrong else 1.6, 150)
    canvas.boxes(boxes[false], FALSE_TRACK)
    canvas.boxes(boxes[~false], TRACK_BOX)
    order = np.argsort(false, kind="stable")
    return [
        (boxes[i], str(rollout.track_id[rows[i]]), FALSE if false[i] else TRACK)
        for i in order
    ]


def _draw_forecasts(canvas: Canvas, run: Replay, answered: int) -> None:
    """The heaviest samples of each object, lighter ones fainter, each with a dot at its end."""
    rollout = run.rollout
    objects = rollout.objects.rows(answered)
    start = rollout.object_box[objects, :2].astype(np.float64)
    weights = sample_weights(rollout.forecast_log_weight[objects])
    for i in np.flatnonzero(canvas.inside(start, canvas.width / 4)):
        weight, paths = (
            weights[i],
            start[i] + to_metres(rollout.forecast[objects.start + i]),
        )
        false = run.forecast_false[objects.start + i]
        color, width, most, dim = (
            (FALSE, 0.8, 1, 0.4) if false else (FORECAST, 1.3, SAMPLES, 0.9)
        )
        for k in np.argsort(-weight, kind="stable")[:most][::-1]:
            if weight[k] > 0:
                path = canvas.pixels(np.concatenate([start[i, None], paths[k]]))
                alpha = round(dim * (100 + 140 * float(weight[k] / weight.max())))
                canvas.stroke(path, color, width, alpha)
                canvas.dot(path[-1], 1.6 * width, color, alpha)


def _draw_boxes(canvas: Canvas, run: Replay, t: int) -> None:
    truth, detections = run.scene.truth, run.scene.detections
    rows = detections.rows(t)
    false = run.detection_false[rows]
    canvas.boxes(detections.box[rows][~false], DETECTED)
    canvas.boxes(detections.box[rows][false], FALSE_DETECTION)
    rows = truth.rows(t)
    evaluated, tracked = ~truth.neutral[rows], run.truth_track[rows] >= 0
    canvas.boxes(truth.box[rows][evaluated & tracked], TRACKED)
    canvas.boxes(truth.box[rows][evaluated & ~tracked], UNTRACKED)
    if run.card.has_ego:
        canvas.boxes(ego_boxes(run.scene.ego[t][None]), VEHICLE)


def _heading(run: Replay, t: int) -> Iterator[Text]:
    """Lines at the top of the column."""
    scene, answered = run.scene, t - run.first
    if run.agent:
        yield run.agent, LARGE, BLACK
    yield run.card.id, MIDDLE, GRAY
    yield f"scene {scene.name}", MIDDLE, GRAY
    yield (
        f"frame {t} of {scene.frames - 1}   {scene.time[t] - scene.time[0]:.1f} s",
        MIDDLE,
        BLACK,
    )
    if (plan := plan_at(run, t)) is not None:
        yield (
            f"ego: {round(plan.acceleration, 1) + 0.0:+.1f} m/s2, risk {plan.risk:.0%}",
            MIDDLE,
            BLACK,
        )
    weight = run.rollout.hypothesis_log_weight[answered]
    if np.isfinite(weight).sum() > 1:
        share = 100 * float(np.exp(weight[run.answers.hypotheses.best[answered]]))
        yield (
            f"best of {np.isfinite(weight).sum()} hypotheses ({share:.0f} %)",
            MIDDLE,
            BLACK,
        )
    if run.judged:
        tracked, untracked, false = (int(series[t]) for series in run.counts.values())
        text = f"tracked {tracked}, untracked {untracked}"
        yield text + (f", false {false}" if scene.truth_complete else ""), MIDDLE, BLACK


def legend(run: Replay) -> list[Mark]:
    """Marks of this kind of picture with their meaning; the same for all frames of a video."""
    truth, complete = (
        len(run.scene.truth.box) > 0,
        run.judged and run.scene.truth_complete,
    )
    driven = run.card.drive is not None or run.rollout.drive is not None
    entries = [
        (truth, Mark("true box", TRACKED)),
        (truth and run.judged, Mark("true box, untracked", UNTRACKED)),
        (True, Mark("detection", DETECTED)),
        (complete, Mark("false positive", FALSE_DETECTION)),
        (True, Mark("track, where it was", TRACK_BOX, TRACK)),
        (complete, Mark("false track", FALSE_TRACK, FALSE)),
        (True, Mark("other hypotheses", OTHER)),
        (True, Mark("forecast", line=FORECAST)),
        (complete, Mark("false forecast", line=FALSE)),
        (run.judged, Mark("event")),
        (run.card.has_ego, Mark("ego", VEHICLE)),
        *((driven, mark) for mark in PLAN),
    ]
    return [mark for shown, mark in entries if shown]


class EpisodePictures:
    """Renderer of an env: pictures of the frame that was answered last; before the first answer, of frame 0."""

    def __init__(self) -> None:
        self._episode: LiveEpisode | None = None
        self._windows: list[Window] = []

    def render(self, episode: LiveEpisode) -> NDArray[np.uint8]:
        """A picture [height, width, 3], always of the same size; true boxes are not compared with the answer."""
        if self._episode is not episode:
            self._episode, self._windows = (
                episode,
                windows_of(episode.scene, episode.card),
            )
        run = Replay.of_episode(episode, round(TRAIL_SECONDS * episode.card.task.rate))
        return draw_frame(run, episode.frame, self._windows[episode.frame])

    def close(self) -> None:
        """Do nothing: pictures keep no resource open."""
