"""Page of the doctor: each doubt with a picture before and after the cure."""

from io import BytesIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ...cards import Card
from ...core import Scene
from ...doubts import Doubt, examine
from ...running import Checkup, RunOptions
from ...sources import in_world, open_source, with_map
from ..drawing.canvas import EDGE, Canvas, Outline
from ..framing import TRAIL_SECONDS, Window
from ..pages import data_uri, page_of
from ..palette import DETECTION, EGO, TRUTH

_TEMPLATES = Path(__file__).parent
_PANEL_PX = 460
_AROUND_M = 40.0  # that a picture shows at least
_TRUE_BOX = Outline(TRUTH, 2.0, heading=True)
_DETECTED_BOX = Outline(DETECTION, 1.2, fill=70, heading=True)


def doubt_page(checkup: Checkup, card: Card, options: RunOptions) -> str:
    """Return the HTML of a checkup, with a picture for each doubt.

    It has no script and loads no other file. The scenes with doubts are read again.
    """
    source = open_source(card, options.data)
    figures = []
    for checked in checkup.scenes:
        if not checked.doubts:
            continue
        scene = with_map(in_world(source.load(checked.scene)), card, options.data)
        cured = examine(scene, card).cure(scene)
        for doubt in checked.doubts:
            png = BytesIO()
            _picture(doubt, scene, cured, card).save(png, format="PNG")
            figures.append((doubt, data_uri(png.getvalue(), "image/png")))
    return page_of(_TEMPLATES, "doubts.html", checkup=checkup, figures=figures)


def _picture(doubt: Doubt, scene: Scene, cured: Scene, card: Card) -> Image.Image:
    """Draw a frame of a doubt, and the same with all cures."""
    truth = scene.truth
    frame = doubt.first
    if frame < 0:
        fullest = np.flatnonzero(truth.counts == truth.counts.max())
        frame = int(fullest[len(fullest) // 2])  # in the first one frames may agree
    here = truth.frame_of_rows == frame
    if doubt.objects:
        here &= np.isin(truth.object_id, doubt.objects)
    x, y = scene.ego[frame, :2].tolist()
    if here.any():
        x, y = np.median(truth.box[here, :2], axis=0).tolist()
    window = Window(x, y, _AROUND_M, _AROUND_M)
    trail = round(TRAIL_SECONDS * card.task.rate)
    panels = [_panel(each, frame, trail, window) for each in (scene, cured)]
    image = Image.fromarray(np.concatenate(panels, axis=1))
    return image.quantize(64, dither=Image.Dither.NONE)


def _panel(scene: Scene, frame: int, trail: int, window: Window) -> NDArray[np.uint8]:
    """Draw truth with its ways, and detections, in a frame [height, width, 3]."""
    canvas = Canvas(_PANEL_PX, _PANEL_PX, window)
    truth = scene.truth
    detections = scene.detections
    around = np.abs(truth.frame_of_rows - frame) <= trail
    for object_id in np.unique(truth.object_id[around]):
        way = truth.box[around & (truth.object_id == object_id), :2]
        canvas.lines([way], TRUTH, 1.0, alpha=140)
    canvas.lines([scene.ego[max(0, frame - trail) : frame + trail + 1, :2]], EGO, 2.0)
    canvas.boxes(detections.box[detections.rows(frame)], _DETECTED_BOX)
    canvas.boxes(truth.box[truth.rows(frame)], _TRUE_BOX)
    canvas.scale_bar()
    picture = np.array(canvas.finished(), dtype=np.uint8)
    picture[:, -1] = EDGE
    return picture
