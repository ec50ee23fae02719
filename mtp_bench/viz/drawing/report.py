"""Picture of an event for a report: the event, its causes, a key, and close-ups."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, PngImagePlugin

from ...core import __version__, whole_file
from ...scoring import LEAST_SHOWN
from ..causes import cause_line, causes_of, happened, headline, sentence
from ..focus import Focus
from ..framing import window_of
from ..palette import BLACK, ROLES, Color
from ..photo import photo_of, photo_row
from .canvas import EDGE, GRAY, PAPER, font, text_size
from .close_up import draw_focus
from .column import column, wrapped

SIZE = (1200, 800)  # pixels, of a report
COLUMN = 300  # pixels of the width
CAPTION = 46
ROW = 256  # pixels of the height for the small pictures, with their captions
LEFT_PX = 14  # of a text
TEXT_TOP_PX = 29  # below the line of stage and title
LINE_PX = 24
LARGE, TEXT, SMALL = 19, 15, 14  # pixels of letters
MAX_CAUSES = 3
REMARK = (
    "From above; {}. Bold: the sample nearest to the truth, else the heaviest; thin: "
    "others."
)


def report(focus: Focus, compared: Sequence[Focus] = ()) -> Image.Image:
    """Draw the frame of an event, and those around it.

    A camera image that shows it stands at the bottom. The same event in other runs,
    ``compared``, has the same scale.
    """
    size_px = (SIZE[0], SIZE[1] - ROW)
    images = [
        picture(focus, focus.at.frame, size_px, compared),
        _strip(focus, compared),
    ]
    photo = photo_of(focus)
    if photo is not None:
        images.append(photo_row(photo, SIZE[0]))
    return stacked(images)


def stacked(images: Sequence[Image.Image]) -> Image.Image:
    """Put images of one width below each other."""
    return Image.fromarray(np.concatenate([np.asarray(image) for image in images]))


def save_report(path: Path, *focuses: Focus) -> None:
    """Write the picture of an event as PNG.

    Its description is the sentence on the event. Several ``focuses`` are one event in
    several runs: their pictures stand below each other, their sentences in lines.
    """
    metadata = PngImagePlugin.PngInfo()
    metadata.add_text("Title", _title(focuses[0], focuses[0].at.frame))
    metadata.add_text("Description", "\n".join(map(sentence, focuses)))
    metadata.add_text("Software", f"mtp_bench {__version__}")
    image = stacked([report(focus, focuses) for focus in focuses])
    has_photos = image.height > len(focuses) * SIZE[1]
    if not has_photos:  # few colours are enough
        image = image.quantize(128, dither=Image.Dither.NONE)
    with whole_file(path) as part:
        image.save(part, format="PNG", pnginfo=metadata, optimize=True)


def picture(
    focus: Focus, t: int, size_px: tuple[int, int], compared: Sequence[Focus] = ()
) -> Image.Image:
    """Draw event, causes, frame ``t`` and key in ``size_px`` pixels.

    The view follows the object. The text is grey in frames other than the event.
    """
    image = Image.new("RGB", size_px, PAPER)
    texts = [happened(focus), *map(cause_line, causes_of(focus)[:MAX_CAUSES])]
    text_px = size_px[0] - 2 * LEFT_PX
    lines = [line for text in texts for line in wrapped(text, LARGE, text_px)]
    top = TEXT_TOP_PX + LINE_PX * len(lines) + 11  # of the close-up
    width_px = size_px[0] - COLUMN
    height_px = size_px[1] - top
    window = window_of(focus, t, compared)
    close_up, marks = draw_focus(focus, t, (width_px, height_px), window)
    image.paste(close_up, (0, top))
    orientation = "the object will be to the right"
    if focus.at.object_id < 0:
        orientation = "north is up"
    remarks = [(REMARK.format(orientation), SMALL - 1, GRAY)]
    heading = [(_error_text(focus, t), SMALL, BLACK)]
    parts = {
        name: part_m
        for name, part_m in _parts(focus, t).items()
        if abs(part_m) >= LEAST_SHOWN
    }
    key = column((COLUMN, height_px), heading, marks, remarks, parts)
    image.paste(key, (width_px, top))
    ink = ImageDraw.Draw(image)
    title = _title(focus, t)
    color: Color = BLACK
    is_false_run = focus.at.object_id < 0 and focus.at.frame < t <= focus.at.until
    if t != focus.at.frame and not is_false_run:
        color = GRAY
        title += f"   The text is of {focus.seconds(focus.at.frame):.1f} s:"
    stage = headline(focus).capitalize()
    ink.text((LEFT_PX, 5), stage, color, font(LARGE), stroke_width=0.4)
    title_left = LEFT_PX + 20 + text_size(stage, LARGE)[0]
    ink.text((title_left, 10), title, GRAY, font(SMALL))
    for i, line in enumerate(lines):
        ink.text((LEFT_PX, TEXT_TOP_PX + LINE_PX * i), line, color, font(LARGE - 1))
    ink.rectangle([0, top, width_px - 1, size_px[1] - 1], outline=EDGE)
    return image


def _parts(focus: Focus, t: int) -> Mapping[str, float]:
    """Return parts of the error at ``t`` by name, m."""
    row = int(focus.rows[t])
    if row < 0:
        return {}
    return focus.replay.moment(row).parts or {}


def _error_text(focus: Focus, t: int) -> str:
    """Return the error of frame ``t``, of which bars follow."""
    if focus.at.object_id < 0:
        return "A false forecast has no error: it uses up the budgets."
    parts = _parts(focus, t)
    if not parts:
        return f"No error is counted at {focus.seconds(t):.1f} s"
    card = focus.replay.card
    max_error = card.per_class(card.task.miss_error)[focus.at.class_id]
    error_m = sum(parts.values())
    return (
        f"Error at {focus.seconds(t):.1f} s: {error_m:.1f} m of at most {max_error:g}"
    )


def _title(focus: Focus, t: int) -> str:
    replay = focus.replay
    texts = [replay.agent, replay.card.id, replay.scene.name]
    texts.append(f"frame {t}, {focus.seconds(t):.1f} s")
    ego_m = replay.ego_distance(t, focus.place(t))
    if ego_m is not None:
        texts.append(f"{ego_m:.0f} m from the ego")
    row = focus.rows[t]
    if replay.scene.visible is not None and row >= 0:
        texts.append(f"{replay.scene.visible[row]:.0%} visible")
    return "   ".join(text for text in texts if text)


def _strip(focus: Focus, compared: Sequence[Focus]) -> Image.Image:
    """Draw close-ups of the event, and of the frames before and after it."""
    width_px = SIZE[0] // 3
    image = Image.new("RGB", (SIZE[0], ROW), PAPER)
    ink = ImageDraw.Draw(image)
    for i, name in enumerate(("t - 1", "t", "t + 1")):
        t = focus.at.frame + i - 1
        left_px = i * width_px
        if 0 <= t < focus.replay.frames:
            window = window_of(focus, t, compared, is_close=True)
            close_up, _ = draw_focus(focus, t, (width_px, ROW - CAPTION), window)
            image.paste(close_up, (left_px, CAPTION))
            text = f"{name}: frame {t}, {focus.seconds(t):.1f} s"
            ink.text((left_px + 10, 4), text, BLACK, font(TEXT))
            text, color = _follower(focus, t)
            ink.text((left_px + 10, 23), text, color, font(TEXT))
        ink.rectangle([left_px, 0, left_px + width_px - 1, ROW - 1], outline=EDGE)
    return image


def _follower(focus: Focus, t: int) -> tuple[str, Color]:
    """Tell which track follows the object at ``t``, in its colour."""
    track_id = focus.at.new_id
    if focus.at.object_id < 0:
        is_output = focus.track_rows(track_id)[t] >= 0
        return f"track {track_id}" if is_output else "not output", ROLES["now"]
    if focus.rows[t] < 0:
        return f"no {focus.named} there", GRAY
    track_id = focus.follower(t)
    if track_id < 0:
        return f"no track follows {focus.named}", ROLES["now"]
    roles = {focus.at.old_id: "before", focus.at.new_id: "now"}
    role = roles.get(track_id, "named")
    return f"track {track_id} follows {focus.named}", ROLES[role]
