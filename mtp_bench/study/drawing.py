"""Look of every figure, with colours for colour blindness, print and dark pages.

A figure is drawn once, in the colours of light paper. In its SVG they become CSS variables, so that the same drawing
is right on a dark page; a file of its own defines both sets of them.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from dataclasses import dataclass
from html import escape
from typing import Any

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
LIGHT, DARK = (";".join(f"--{name}:{pair[i]}" for name, pair in COLORS.items()) for i in (0, 1))  # variables of CSS
_FONTS = "font-family: system-ui, -apple-system, 'Segoe UI', Roboto, 'DejaVu Sans', sans-serif"


def hex_color(name: str) -> str:
    """Hex colour on light paper."""
    return COLORS[name][0]


INK, SOFT, GRID, GROUND = (hex_color(name) for name in ("ink", "soft", "grid", "paper"))
_SETTINGS: dict[str, Any] = {
    "font.family": "sans-serif",
    "text.parse_math": False,  # "$" in a name is a name
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 10,
    "axes.titlesize": 10.5,
    "axes.edgecolor": SOFT,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "axes.facecolor": "none",
    "figure.facecolor": GROUND,
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
}


@dataclass(frozen=True)
class Drawing:
    """A drawn figure."""

    name: str  # of its files
    title: str
    sentence: str  # what it shows
    n: str  # number of targets, objects and scenes
    wide: bool  # needs the width of the page
    svg: str  # for a page: colours are CSS variables; title and sentence are its label
    svg_file: str  # on its own
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
) -> Drawing:
    """A figure of ``panels`` in ``rows``; ``paint`` gets the axes of each panel. ``size``: width and height, inches."""
    import matplotlib as mpl

    settings: Any = {**_SETTINGS, "svg.hashsalt": name}  # ids are stable, and differ between figures of a page
    with mpl.rc_context(settings):
        from matplotlib.figure import Figure

        across = -(-panels // rows)
        width, height = size or (WIDTH if across == 1 else WIDTH * 1.45, HEIGHT * rows)
        canvas = Figure(figsize=(width, height), layout="constrained")
        axes: list[Any] = list(canvas.subplots(rows, across, squeeze=False).ravel()[:panels])
        paint(*axes)
        for each in axes:
            each.spines[["top", "right"]].set_visible(False)
            each.set_axisbelow(True)
        label = f'<svg role="img" aria-label="{escape(f"{title}. {sentence}")}" data-figure="{name}" '
        svg = _svg(canvas).replace("<svg ", label, 1)
        png = io.BytesIO()
        description = f"{sentence} n: {n}."
        about = {"Title": title, "Description": description, "Software": None}
        canvas.savefig(png, format="png", dpi=DOTS, bbox_inches="tight", metadata=about, pil_kwargs={"optimize": True})
    svg_file = _standalone(svg, title, description)
    return Drawing(name, title, sentence, n, width > WIDTH * 1.2, svg, svg_file, png.getvalue())


def _svg(canvas: Any) -> str:
    """The drawing as an element of a page: sized by its box, coloured by variables."""
    text = io.StringIO()
    anonymous = dict.fromkeys(("Date", "Creator", "Format", "Type"))
    canvas.savefig(text, format="svg", facecolor="none", bbox_inches="tight", metadata=anonymous)
    svg = text.getvalue()
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>\s*|<style[^>]*>.*?</style>", "", svg, flags=re.DOTALL)  # pages have a style
    svg = re.sub(r'(<svg[^>]*?) width="[^"]*"', r"\1", svg, count=1)
    svg = re.sub(r'(<svg[^>]*?) height="[^"]*"', r"\1", svg, count=1)
    svg = svg.replace("font-family: 'DejaVu Sans'", _FONTS)
    svg = svg.replace("'DejaVu Sans'", "system-ui, 'DejaVu Sans', sans-serif")
    for key, (light, _) in COLORS.items():
        svg = re.sub(re.escape(light), f"var(--{key})", svg, flags=re.IGNORECASE)
    return svg


def _standalone(svg: str, title: str, sentence: str) -> str:
    """The element as a file that needs no page, with both sets of colours; its description holds the sentence."""
    style = (
        f"<style>svg{{{LIGHT};background:var(--paper)}}@media(prefers-color-scheme:dark){{svg{{{DARK}}}}}"
        f"*{{stroke-linejoin:round;stroke-linecap:butt}}text{{{_FONTS}}}</style>"
    )
    heading, description = (escape(text, quote=False) for text in (title, sentence))
    first = svg.index(">") + 1
    head = f"<title>{heading}</title><desc>{description}</desc>{style}"
    return f'<?xml version="1.0" encoding="utf-8"?>\n{svg[:first]}{head}{svg[first:]}'
