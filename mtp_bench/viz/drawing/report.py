"""Picture of an event for a report: a sentence, the event, a key, and close-ups of the frames around it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, PngImagePlugin

from ..._version import __version__
from ...files import whole_file
from ..focus import ROLES, Focus, Key, Window
from ..palette import BLACK, Color
from ..photo import photo_row, photos_around
from .canvas import EDGE, GRAY, PAPER, Canvas, Outline, font, text_size
from .close_up import DETECTION_NEAR, DIM_TRUTH, OBJECT, OTHER_OBJECT, draw_focus

SIZE = (1200, 800)  # pixels, of a report
COLUMN, CAPTION = 300, 26
ROW = 256  # pixels of the height for the small pictures, with their captions
LARGE, TEXT, SMALL = 19, 15, 14  # pixels of letters
LINE = 25  # pixels between two lines of the key
REMARK = (
    "Seen from above; the way of the object, or its front, points to the right. Bold: the sample of the forecast that "
    "{bold}; thin: the others."
)
_TIED = "\u00a0"  # a blank that breaks no line; the font has none


def report(focus: Focus) -> Image.Image:
    """The picture of an event, of SIZE: frame t, and below it close-ups of t - 1, t and t + 1.

    If a camera image shows the event, a row of images is added below.
    """
    photos = photos_around(focus)
    parts = [picture(focus, focus.at.frame, (SIZE[0], SIZE[1] - ROW)), strip(focus)]
    return stacked([*parts, *([photo_row(focus, photos, SIZE[0])] if photos else [])])


def stacked(images: Sequence[Image.Image]) -> Image.Image:
    """Images of one width below each other."""
    whole = Image.new("RGB", (SIZE[0], sum(image.height for image in images)), PAPER)
    top = 0
    for image in images:
        whole.paste(image, (0, top))
        top += image.height
    return whole


def save_report(path: Path, *focuses: Focus) -> None:
    """Write the picture of an event as PNG, with its sentence as description; the file is complete or does not appear.

    Several ``focuses`` are one event in several runs: their pictures stand below each other, their sentences in lines.
    """
    about = PngImagePlugin.PngInfo()
    about.add_text("Title", _title(focuses[0], focuses[0].at.frame))
    about.add_text("Description", "\n".join(focus.sentence for focus in focuses))
    about.add_text("Software", f"mtp_bench {__version__}")
    drawn = stacked([report(focus) for focus in focuses])
    if drawn.height == len(focuses) * SIZE[1]:  # camera images need all their colours
        drawn = drawn.quantize(128, dither=Image.Dither.NONE)
    with whole_file(path) as part:
        drawn.save(part, format="PNG", pnginfo=about, optimize=True)


def picture(focus: Focus, t: int, size: tuple[int, int]) -> Image.Image:
    """The sentence, frame ``t`` of the event and the key in ``size`` pixels; the view follows the object."""
    whole, window = Image.new("RGB", size, PAPER), focus.window()
    x, y = focus.case.place(t) - focus.case.place(focus.at.frame)
    moved = Window(window.x + float(x), window.y + float(y), window.wide, window.high, window.turn)
    lines = wrapped_words(focus.sentence, LARGE, size[0] - 28)
    top = 40 + 26 * len(lines)
    whole.paste(draw_focus(focus, t, (size[0] - COLUMN, size[1] - top), moved), (0, top))
    whole.paste(_key(focus, (COLUMN, size[1] - top)), (size[0] - COLUMN, top))
    ink = ImageDraw.Draw(whole)
    ink.text((14, 8), _title(focus, t), fill=GRAY, font=font(SMALL))
    for i, line in enumerate(lines):
        ink.text((14, 29 + 26 * i), line, fill=BLACK, font=font(LARGE))
    ink.rectangle([0, top, size[0] - COLUMN - 1, size[1] - 1], outline=EDGE)
    return whole


def _title(focus: Focus, t: int) -> str:
    card, scene = focus.replay.card, focus.replay.scene
    parts = (focus.replay.agent, card.id, scene.name, f"frame {t}, {focus.case.seconds(t):.1f} s")
    return "   ".join(part for part in parts if part)


def strip(focus: Focus) -> Image.Image:
    """The small pictures of the frames t - 1, t and t + 1, each with the track that follows the object."""
    wide, at = SIZE[0] // 3, focus.at.frame
    whole = Image.new("RGB", (SIZE[0], ROW), PAPER)
    ink = ImageDraw.Draw(whole)
    for i, (t, name) in enumerate(((at - 1, "t - 1"), (at, "t"), (at + 1, "t + 1"))):
        left = i * wide
        if 0 <= t < focus.replay.frames:
            near = draw_focus(focus, t, (wide, ROW - CAPTION), focus.close_window(t), near=True)
            whole.paste(near, (left, CAPTION))
            when, (text, color) = f"{name}, {focus.case.seconds(t):.1f} s:", _follower(focus, t)
            ink.text((left + 10, 4), when, fill=BLACK, font=font(TEXT))
            ink.text((left + 18 + text_size(when, TEXT)[0], 4), text, fill=color, font=font(TEXT))
        ink.rectangle([left, 0, left + wide - 1, ROW - 1], outline=EDGE)
    return whole


def _follower(focus: Focus, t: int) -> tuple[str, Color]:
    """The track that follows the object in a frame, in words and in the colour of its role."""
    if focus.at.object_id < 0:
        return "", BLACK
    track, shown = focus.case.follower(t), focus.frame(t)
    if not len(shown.object_box):
        return f"no {focus.named} there", GRAY
    if track < 0:
        return f"no track follows {focus.named}", ROLES["now"]
    role = {mine.track_id: mine.role for mine in shown.tracks}.get(track)
    return f"track {track} follows {focus.named}", BLACK if role is None else ROLES[role]


def _key(focus: Focus, size: tuple[int, int]) -> Image.Image:
    """The key, as a column."""
    canvas = Canvas.blank(*size, Window(0.0, 0.0, *size), PAPER)
    for i, key in enumerate(focus.key):
        _mark(canvas, key, 22.0 + LINE * i)
    image = canvas.finished()
    ink = ImageDraw.Draw(image)
    y = 12.0
    for key in focus.key:
        ink.text((56, y), key.text, fill=BLACK, font=font(SMALL))
        y += LINE
    for line in wrapped_words(REMARK.format(bold=focus.bold), SMALL, size[0] - 26):
        y += 19
        ink.text((14, y), line, fill=GRAY, font=font(SMALL))
    return image


def _mark(canvas: Canvas, key: Key, y: float) -> None:
    """The mark of a line of the key."""
    color, newest = ROLES[key.role], key.role == "now"
    path = np.array([[14.0, y], [42.0, y]])
    if key.mark == "ring":
        canvas.ring(np.array([28.0, y]), 8.0)
    elif key.mark == "path":
        canvas.stroke(path, color, 4.0)
        canvas.dot(path[1], 5.0, color)
    elif key.mark == "forecast":
        canvas.stroke(path, color, 3.0 if newest else 2.0, dashed=not newest)
        canvas.dot(path[1], 4.0, color)
    else:
        truth = OTHER_OBJECT if key.mark == "other" else OBJECT
        outline = {"truth": truth, "detection": DETECTION_NEAR, "dim": DIM_TRUTH}.get(key.role)
        box = np.array([[26.0 - canvas.width / 2, canvas.height / 2 - y, 0.0, 0.0, 20.0, 11.0, 1.0]])
        canvas.boxes(box, outline or Outline(color, 1.5, fill=90))


def wrapped_words(text: str, size: int, wide: float) -> list[str]:
    """``text`` in lines of at most ``wide`` pixels, broken between words, but not between a number and its unit."""
    lines, rest = [], re.sub(r"(\d) (m|s)\b", rf"\1{_TIED}\2", text).split(" ")
    while rest:
        count = len(rest)
        while count > 1 and text_size(" ".join(rest[:count]), size)[0] > wide:
            count -= 1
        lines.append(" ".join(rest[:count]).replace(_TIED, " "))
        rest = rest[count:]
    return lines
