"""How every figure of a study looks: colours that survive colour blindness, print and dark pages; n and a sentence.

A figure is drawn once, in the colours of light paper. In its SVG they become CSS variables, so that the same drawing
is right on a dark page; alone, the SVG brings both sets of them along.
"""

from __future__ import annotations

import io
import re
import textwrap
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WIDTH, HEIGHT = 5.6, 3.3  # inches
DOTS = 150  # per inch, of PNG files
# name -> on light, on dark. After Okabe and Ito; each series has a marker, a line style or a hatch of its own too
COLORS = {
    "ink": ("#1d2126", "#e6e9ec"),
    "soft": ("#5b646e", "#a4adb6"),
    "grid": ("#e2e5e8", "#31383f"),
    "paper": ("#ffffff", "#1a1e22"),
    "green": ("#009e73", "#25b78c"),
    "blue": ("#0072b2", "#3f8fe0"),
    "orange": ("#e69f00", "#e8a317"),
    "vermillion": ("#d55e00", "#f0793a"),
    "purple": ("#cc79a7", "#e39cc6"),
    "sky": ("#56b4e9", "#a3dcfa"),
    "grey": ("#555b61", "#737a81"),
    "yellow": ("#f0e442", "#f5ec7a"),
}
SERIES: tuple[str, ...] = ("green", "blue", "orange", "vermillion", "purple", "sky", "grey")
MARKERS: dict[str, str] = dict(zip(SERIES, "osDv^P*", strict=True))
LINES: dict[str, str] = dict(zip(SERIES, ("-", "-", "--", "-", ":", "-.", "--"), strict=True))
_LETTERS = 14.5  # of the sentence, per inch
HATCHES = ("", "////", "..", "\\\\\\\\", "xxxx", "", "||||")


def color(name: str) -> str:
    """The colour of light paper."""
    return COLORS[name][0]


INK, SOFT, GRID, PAPER = (color(name) for name in ("ink", "soft", "grid", "paper"))
LIGHT, DARK = (";".join(f"--{name}:{pair[i]}" for name, pair in COLORS.items()) for i in (0, 1))  # variables of CSS


@dataclass(frozen=True)
class Figure:
    """A drawn figure."""

    name: str  # of its files
    title: str
    sentence: str  # what it shows
    n: str  # how many targets, objects and scenes it is of
    wide: bool  # it needs the width of the page
    svg: str  # for a page: colours are CSS variables; title and sentence are its name, but are not drawn
    svg_file: str  # alone: with both
    png: bytes


def draw(
    name: str,
    title: str,
    sentence: str,
    n: str,
    paint: Callable[..., object],
    panels: int = 1,
    size: tuple[float, float] | None = None,
    rows: int = 1,
    grid: Literal["x", "y", ""] = "y",
) -> Figure:
    """A figure of some ``panels`` beside each other, in ``rows``; ``paint`` gets the axes of each panel to fill.

    ``size``: inches, width and height. ``grid``: fine lines to read values by, across this axis.
    """
    with _settings(name):
        from matplotlib.figure import Figure as Canvas

        across = -(-panels // rows)
        width, height = size or (WIDTH if across == 1 else WIDTH * 1.45, HEIGHT * rows)
        canvas = Canvas(figsize=(width, height), layout="constrained")
        axes: list[Any] = list(canvas.subplots(rows, across, squeeze=False).ravel()[:panels])
        for each in axes if grid else ():
            each.grid(axis=grid, color=GRID, linewidth=0.8)
        paint(*axes)
        for each in axes:
            each.spines[["top", "right"]].set_visible(False)
            each.set_axisbelow(True)
        canvas.draw_without_rendering()  # panels of equal scales find their places only then
        svg = _svg(canvas, name, f"{title}. {sentence}")
        foot = textwrap.fill(f"{sentence} n: {n}.", int(width * _LETTERS))
        png = _png(canvas, title, foot, sentence)
    return Figure(name, title, sentence, n, width > WIDTH * 1.2, svg, _alone(svg, title, foot), png)


def _png(canvas: Any, title: str, foot: str, sentence: str) -> bytes:
    """The drawing as a picture, the title above and the sentence below."""
    from matplotlib import font_manager
    from PIL import Image, ImageDraw, ImageFont, PngImagePlugin

    plain = io.BytesIO()
    canvas.savefig(plain, format="png", dpi=DOTS)
    drawing = Image.open(plain).convert("RGB")
    point = DOTS / 72
    faces = [
        font_manager.findfont(font_manager.FontProperties(family="DejaVu Sans", weight=w)) for w in ("bold", "normal")
    ]
    bold, small = (ImageFont.truetype(face, round(size * point)) for face, size in zip(faces, (12, 8.5), strict=True))
    above, below = round(24 * point), round((11 * (1 + foot.count("\n")) + 10) * point)
    whole = Image.new("RGB", (drawing.width, drawing.height + above + below), PAPER)
    whole.paste(drawing, (0, above))
    brush, left = ImageDraw.Draw(whole), round(6 * point)
    brush.text((left, round(5 * point)), title, INK, bold)
    brush.multiline_text((left, above + drawing.height), foot, SOFT, small, spacing=round(1.5 * point))
    told = PngImagePlugin.PngInfo()
    told.add_text("Title", title)
    told.add_text("Description", sentence)
    content = io.BytesIO()
    whole.quantize(256, dither=Image.Dither.NONE).save(content, "PNG", optimize=True, pnginfo=told)
    return content.getvalue()


@contextmanager
def _settings(name: str) -> Iterator[None]:
    import matplotlib as mpl

    settings: Any = {
        "font.family": "sans-serif",
        "text.parse_math": False,  # "$" in a name is a name
        "font.sans-serif": ["DejaVu Sans"],
        "font.size": 10,
        "axes.labelsize": 10,
        "axes.titlesize": 10.5,
        "axes.edgecolor": SOFT,
        "axes.labelcolor": INK,
        "axes.titlecolor": INK,
        "axes.facecolor": "none",
        "figure.facecolor": PAPER,
        "text.color": INK,
        "xtick.color": SOFT,
        "ytick.color": SOFT,
        "xtick.labelcolor": INK,
        "ytick.labelcolor": INK,
        "xtick.labelsize": 9,
        "ytick.labelsize": 9,
        "legend.fontsize": 9,
        "legend.frameon": False,
        "legend.labelcolor": INK,
        "grid.color": GRID,
        "hatch.linewidth": 0.6,
        "svg.fonttype": "none",  # text stays text
        "svg.hashsalt": name,  # ids are the same every time, and others in every figure of a page
        "axes.unicode_minus": True,
    }
    with mpl.rc_context(settings):
        yield


_FONTS = "font-family: system-ui, -apple-system, 'Segoe UI', Roboto, 'DejaVu Sans', sans-serif"


def _svg(canvas: Any, name: str, label: str) -> str:
    """The drawing as an element of a page: sizes by its box, colours by variables; ``label``: for those who listen."""
    text = io.StringIO()
    nothing = dict.fromkeys(("Date", "Creator", "Format", "Type"))
    canvas.savefig(text, format="svg", facecolor="none", metadata=nothing)
    svg = text.getvalue()
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>\s*", "", svg, flags=re.DOTALL)
    svg = re.sub(r"<style[^>]*>.*?</style>", "", svg, flags=re.DOTALL)  # the same in every figure; a page has its own
    svg = re.sub(r'(<svg[^>]*?) width="[^"]*"', r"\1", svg, count=1)
    svg = re.sub(r'(<svg[^>]*?) height="[^"]*"', r"\1", svg, count=1)
    svg = svg.replace("font-family: 'DejaVu Sans'", _FONTS).replace(
        "'DejaVu Sans'", "system-ui, 'DejaVu Sans', sans-serif"
    )
    for key, (light, _) in COLORS.items():
        svg = re.sub(re.escape(light), f"var(--{key})", svg, flags=re.IGNORECASE)
    return svg.replace("<svg ", f'<svg role="img" aria-label="{escape(label)}" data-figure="{name}" ', 1)


def _alone(svg: str, title: str, foot: str) -> str:
    """The element as a file that needs no page: with both sets of colours, the title above and the sentence below."""
    style = (
        f"<style>svg{{{LIGHT};background:var(--paper)}}@media(prefers-color-scheme:dark){{svg{{{DARK}}}}}"
        f"*{{stroke-linejoin:round;stroke-linecap:butt}}text{{{_FONTS}}}</style>"
    )
    lines = [line.replace("&", "&amp;").replace("<", "&lt;") for line in (title, *foot.split("\n"))]
    box = re.search(r'viewBox="0 0 ([\d.]+) ([\d.]+)"', svg)
    assert box is not None
    width, height = float(box[1]), float(box[2])
    said = "".join(
        f'<text x="6" y="{height + 11 * (i + 1):g}" font-size="8.5" fill="var(--soft)">{line}</text>'
        for i, line in enumerate(lines[1:])
    )
    top = f'<text x="6" y="-9" font-size="12" font-weight="bold" fill="var(--ink)">{lines[0]}</text>'
    whole = f"0 -24 {width:g} {height + 30 + 11 * len(lines):g}"
    svg = svg.replace(box[0], f'viewBox="{whole}"', 1)
    first = svg.index(">") + 1
    head = f"<title>{lines[0]}</title><desc>{' '.join(lines[1:])}</desc>{style}"
    return f'<?xml version="1.0" encoding="utf-8"?>\n{svg[:first]}{head}{top}{said}{svg[first:]}'


def caps(axes: Axes, at: Any, value: Any, low: Any, high: Any, across: bool = False, name: str = "ink") -> None:
    """Intervals, where they are known."""
    known = [each for each in zip(at, value, low, high, strict=True) if None not in each]
    if known:
        place, _, least, most = zip(*known, strict=True)
        lines = axes.hlines if across else axes.vlines
        lines(place, least, most, color=color(name), linewidth=1.2)


def line(axes: Axes, x: Any, y: Any, name: str, label: str, low: Any = None, high: Any = None, **more: Any) -> None:
    """A series with its own colour, marker and kind of line; a band where its interval is known."""
    import numpy as np

    style = {"marker": MARKERS.get(name, "o"), "linestyle": LINES.get(name, "-"), "markersize": 4.5, "linewidth": 1.7}
    axes.plot(x, np.array(y, dtype=float), color=color(name), label=label, **{**style, **more})
    if low is not None and high is not None:
        least, most = (np.array(each, dtype=float) for each in (low, high))
        axes.fill_between(x, least, most, color=color(name), alpha=0.14, linewidth=0)


def diamonds(axes: Axes, x: Any, y: Any, label: str | None, **more: Any) -> None:
    """Figures of the paper."""
    axes.plot(x, y, "D", markerfacecolor="none", color=color("ink"), label=label, **more)


def beside(axes: Axes, **more: Any) -> None:
    """The legend of the axes, above all panels."""
    handles, labels = axes.get_legend_handles_labels()
    axes.figure.legend(
        handles, labels, loc="outside upper left", ncols=more.pop("ncols", 3), borderaxespad=0.2, columnspacing=1.2,
        handlelength=1.8, **more,
    )  # fmt: skip
