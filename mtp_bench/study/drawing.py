"""Look of every figure: colours for colour blindness and print, letters, and the files of a drawn figure."""

import io
import re
from collections.abc import Callable
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

WIDTH, HEIGHT = 5.6, 3.3  # inches
DOTS = 150  # per inch, of PNG files
# After Okabe and Ito; each series has a marker, a line style or a hatch of its own too
COLORS = {
    "ink": "#1d2126",
    "soft": "#5b646e",
    "green": "#009e73",
    "blue": "#0072b2",
    "orange": "#e69f00",
    "vermillion": "#d55e00",
    "purple": "#cc79a7",
    "sky": "#56b4e9",
    "grey": "#555b61",
    "yellow": "#f0e442",
    "brown": "#6b3410",
    "violet": "#6000d8",
    "lime": "#a8d890",
}
SERIES: tuple[str, ...] = ("green", "blue", "orange", "vermillion", "purple", "sky", "grey")
_STYLE = Path(__file__).with_name("figure.mplstyle")


@dataclass(frozen=True)
class Drawing:
    """A drawn figure."""

    title: str
    sentence: str  # what it shows
    n: str  # number of targets, objects and scenes
    wide: bool  # needs the width of the page
    svg: str  # title and sentence are its label
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
    from matplotlib import style

    salt: Any = {"svg.hashsalt": name}  # ids are stable, and differ between figures of a page
    with style.context(["default", _STYLE, salt]):  # whatever file of settings is in the current folder
        from matplotlib.figure import Figure

        across = -(-panels // rows)
        width, height = size or (WIDTH if across == 1 else WIDTH * 1.45, HEIGHT * rows)
        canvas = Figure(figsize=(width, height), layout="constrained")
        paint(*canvas.subplots(rows, across, squeeze=False).ravel()[:panels])
        text, png = io.StringIO(), io.BytesIO()
        about = {"Title": title, "Description": f"{sentence} n: {n}."}
        canvas.savefig(text, format="svg", bbox_inches="tight", metadata={**about, "Date": None, "Creator": None})
        options: Any = {"dpi": DOTS, "pil_kwargs": {"optimize": True}}
        canvas.savefig(png, format="png", bbox_inches="tight", metadata={**about, "Software": None}, **options)
    svg = text.getvalue()
    svg = re.sub(r"<style[^>]*>.*?</style>", "", svg[svg.index("<svg") :], flags=re.DOTALL)  # pages have a style
    svg = svg.replace("'DejaVu Sans'", "system-ui, 'DejaVu Sans', sans-serif")
    label = f'<svg role="img" aria-label="{escape(f"{title}. {sentence}")}" data-figure="{name}" '
    return Drawing(title, sentence, n, width > WIDTH * 1.2, svg.replace("<svg ", label, 1), png.getvalue())
