"""Picture of an event for a report: a sentence, the event, a key, and close-ups of the frames around it."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, PngImagePlugin

from ...core import __version__, whole_file
from ...scoring import BELOW, LEAST_SHOWN, named_parts, parts_text
from ..evidence import left_out, verdict
from ..focus import Focus
from ..framing import ROLES, close_window, frame_of, window_of
from ..palette import BLACK, Color
from ..photo import photo_of, photo_row
from ..sentences import sentence
from .canvas import EDGE, GRAY, PAPER, font, text_size
from .close_up import EXPECTED, draw_focus
from .column import Mark, column, wrapped

SIZE = (1200, 800)  # pixels, of a report
COLUMN, CAPTION = 300, 46
ROW = 256  # pixels of the height for the small pictures, with their captions
LARGE, TEXT, SMALL = 19, 15, 14  # pixels of letters
MOST = 3  # parts of the whole moment
REMARK = "From above; {}. Bold: the sample nearest to the truth, else the heaviest; thin: others."


def report(focus: Focus, beside: Sequence[Focus] = ()) -> Image.Image:
    """The picture of an event, of SIZE: frame t above the small pictures, which may add a camera image.

    The same event in other runs, ``beside``, has the same scale.
    """
    marks: list[Mark] = []
    small = small_pictures(focus, beside, marks)
    return stacked(
        [picture(focus, focus.at.frame, (SIZE[0], SIZE[1] - ROW), beside, marks), small]
    )


def small_pictures(
    focus: Focus, beside: Sequence[Focus], marks: list[Mark]
) -> Image.Image:
    """Close-ups of t - 1, t and t + 1, and below them the camera image that shows the event, if there is one.

    Their marks are added to ``marks``.
    """
    photo = photo_of(focus)
    return stacked(
        [
            strip(focus, beside, marks),
            *([] if photo is None else [photo_row(photo, SIZE[0])]),
        ]
    )


def stacked(images: Sequence[Image.Image]) -> Image.Image:
    """Images of one width below each other."""
    return Image.fromarray(np.concatenate([np.asarray(image) for image in images]))


def save_report(path: Path, *focuses: Focus) -> None:
    """Write the picture of an event as PNG, with its sentence as description; the file is complete or does not appear.

    Several ``focuses`` are one event in several runs: their pictures stand below each other, their sentences in lines.
    """
    about = PngImagePlugin.PngInfo()
    about.add_text("Title", _title(focuses[0], focuses[0].at.frame))
    about.add_text("Description", "\n".join(map(sentence, focuses)))
    about.add_text("Software", f"mtp_bench {__version__}")
    drawn = stacked([report(focus, focuses) for focus in focuses])
    if drawn.height == len(focuses) * SIZE[1]:  # camera images need all their colours
        drawn = drawn.quantize(128, dither=Image.Dither.NONE)
    with whole_file(path) as part:
        drawn.save(part, format="PNG", pnginfo=about, optimize=True)


def picture(
    focus: Focus,
    t: int,
    size: tuple[int, int],
    beside: Sequence[Focus] = (),
    further: Sequence[Mark] = (),
) -> Image.Image:
    """The sentence, frame ``t`` of the event and the key in ``size`` pixels; the view follows the object.

    ``further``: marks of small pictures, of which the key has the cross.
    """
    whole = Image.new("RGB", size, PAPER)
    lines = wrapped(sentence(focus), LARGE, size[0] - 28)
    top = 40 + 26 * len(lines)
    wide, high = size[0] - COLUMN, size[1] - top
    drawn, marks = draw_focus(focus, t, (wide, high), window_of(focus, t, beside))
    whole.paste(drawn, (0, top))
    marks += [EXPECTED] if EXPECTED in further and EXPECTED not in marks else []
    parts = {
        name: value
        for name, value in _parts(focus, t, t).items()
        if abs(value) >= LEAST_SHOWN
    }
    heading = [(text, SMALL, BLACK) for text in _errors(focus, t)]
    above = REMARK.format(
        "north is up" if focus.at.object_id < 0 else "the object will be to the right"
    )
    below = (
        f"Below threshold: a forecast {left_out(focus, t)}." if BELOW in parts else ""
    )
    remarks = [(text, SMALL - 1, GRAY) for text in (above, below) if text]
    whole.paste(column((COLUMN, high), heading, marks, remarks, parts), (wide, top))
    ink = ImageDraw.Draw(whole)
    of_event = (
        focus.at.frame
        <= t
        <= (focus.at.until if focus.at.object_id < 0 else focus.at.frame)
    )
    other = (
        "" if of_event else f"   The text is of {focus.seconds(focus.at.frame):.1f} s:"
    )
    fault = verdict(focus).capitalize()
    ink.text(
        (14, 5),
        fault,
        fill=GRAY if other else BLACK,
        font=font(LARGE),
        stroke_width=0 if other else 0.4,
    )
    ink.text(
        (34 + text_size(fault, LARGE)[0], 10),
        _title(focus, t) + other,
        fill=GRAY,
        font=font(SMALL),
    )
    for i, line in enumerate(lines):
        ink.text(
            (14, 29 + 26 * i), line, fill=GRAY if other else BLACK, font=font(LARGE)
        )
    ink.rectangle([0, top, wide - 1, size[1] - 1], outline=EDGE)
    return whole


def _parts(focus: Focus, first: int, last: int) -> dict[str, float]:
    """Parts of the object's error by name, m: means over the frames from ``first`` to ``last`` that are counted."""
    part = focus.replay.part[focus.rows[first : last + 1]][
        focus.rows[first : last + 1] >= 0
    ]
    part = part[np.isfinite(part[:, 0])]
    return named_parts(part.mean(axis=0)) if len(part) else {}


def _errors(focus: Focus, t: int) -> Iterator[str]:
    """The error of the whole moment, if it lasts, and that of frame ``t``, of which bars follow."""
    at, when, parts = focus.at, f"at {focus.seconds(t):.1f} s", _parts(focus, t, t)
    if 0 <= at.first < at.until:
        span = f"{focus.seconds(at.first):.1f} to {focus.seconds(at.until):.1f} s"
        yield f"Whole moment, {span}: {parts_text(_parts(focus, at.first, at.until), MOST)}"
    bars = max(map(abs, parts.values()), default=0.0) >= LEAST_SHOWN
    if at.object_id < 0:
        yield "A false forecast has no error: it uses up the budgets."
    elif not parts:
        yield f"No error is counted {when}"
    else:
        most = focus.replay.card.per_class(focus.replay.card.task.miss_error)[
            at.class_id
        ]
        cause = ", by cause:" if bars else ""
        yield f"Mean error {when}: {sum(parts.values()):.1f} m of at most {most:g}{cause}"


def _title(focus: Focus, t: int) -> str:
    run = focus.replay
    parts = (
        run.agent,
        run.card.id,
        run.scene.name,
        f"frame {t}, {focus.seconds(t):.1f} s",
    )
    return "   ".join(part for part in parts if part)


def strip(focus: Focus, beside: Sequence[Focus], marks: list[Mark]) -> Image.Image:
    """The small pictures of the frames t - 1, t and t + 1, each with the track that follows the object."""
    wide, at = SIZE[0] // 3, focus.at.frame
    whole = Image.new("RGB", (SIZE[0], ROW), PAPER)
    ink = ImageDraw.Draw(whole)
    for i, (t, name) in enumerate(((at - 1, "t - 1"), (at, "t"), (at + 1, "t + 1"))):
        left = i * wide
        if 0 <= t < focus.replay.frames:
            near, own = draw_focus(
                focus,
                t,
                (wide, ROW - CAPTION),
                close_window(focus, t, beside),
                near=True,
            )
            marks += own
            whole.paste(near, (left, CAPTION))
            when, (text, color) = (
                f"{name}: frame {t}, {focus.seconds(t):.1f} s",
                _follower(focus, t),
            )
            ink.text((left + 10, 4), when, fill=BLACK, font=font(TEXT))
            ink.text(
                (left + 26 + text_size(when, TEXT)[0], 4),
                _lineage(focus, t),
                fill=GRAY,
                font=font(TEXT),
            )
            ink.text((left + 10, 23), text, fill=color, font=font(TEXT))
        ink.rectangle([left, 0, left + wide - 1, ROW - 1], outline=EDGE)
    return whole


def _lineage(focus: Focus, t: int) -> str:
    """Change of the hypothesis that is looked at, in words; empty if it is the best one all along."""
    hypotheses, at = focus.replay.answers.hypotheses, focus.at.frame
    if t < at and focus.hypothesis[t] != hypotheses.best[t]:
        return "not the best hypothesis then"
    changed = (
        t > at and hypotheses.parent[t, focus.hypothesis[t]] != focus.hypothesis[t - 1]
    )
    return "other hypothesis than at t" if changed else ""


def _follower(focus: Focus, t: int) -> tuple[str, Color]:
    """The track that follows the object in a frame, in words and in the colour of its role."""
    if focus.at.object_id < 0:
        output = focus.at.new_id >= 0 and focus.track_rows(focus.at.new_id)[t] >= 0
        return (f"track {focus.at.new_id}" if output else "not output", ROLES["now"])
    track = focus.follower(t)
    if focus.rows[t] < 0:
        return f"no {focus.named} there", GRAY
    if track < 0:
        return f"no track follows {focus.named}", ROLES["now"]
    role = {each.track_id: each.role for each in frame_of(focus, t).tracks}.get(track)
    return f"track {track} follows {focus.named}", BLACK if role is None else ROLES[
        role
    ]
