"""Shapes of a drawing, as lines of SVG, in colours that people with any kind of colour vision tell apart."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

GREEN, BLUE, VERMILLION, ORANGE, PURPLE = (
    "#009e73",
    "#0072b2",
    "#d55e00",
    "#e69f00",
    "#cc79a7",
)
BLACK, GREY, LIGHT = "#222222", "#888888", "#eeeeee"
Point = tuple[float, float]


def drawing(width: float, height: float, lines: Iterable[str]) -> str:
    """A whole file: the lines on white ground."""
    size = f'viewBox="0 0 {width:g} {height:g}" width="{width:g}" height="{height:g}"'
    head = f'<svg xmlns="http://www.w3.org/2000/svg" {size} font-family="sans-serif" font-size="14">'
    return (
        "\n".join(
            [head, '<rect width="100%" height="100%" fill="white"/>', *lines, "</svg>"]
        )
        + "\n"
    )


def text(
    at: Point, words: str, color: str = BLACK, anchor: str = "start", bold: bool = False
) -> str:
    """Words whose baseline starts, has its middle or ends at a point."""
    weight = ' font-weight="bold"' if bold else ""
    return f'<text x="{at[0]:.1f}" y="{at[1]:.1f}" fill="{color}" text-anchor="{anchor}"{weight}>{words}</text>'


def line(
    points: Sequence[Point], color: str, width: float = 2, dashed: bool = False
) -> str:
    """A line through points."""
    path = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    dash = ' stroke-dasharray="4 4"' if dashed else ""
    return f'<polyline points="{path}" fill="none" stroke="{color}" stroke-width="{width:g}"{dash}/>'


def circle(
    at: Point,
    radius: float,
    fill: str = "none",
    stroke: str = "none",
    dashed: bool = False,
) -> str:
    """A circle."""
    dash = ' stroke-dasharray="4 4"' if dashed else ""
    place = f'cx="{at[0]:.1f}" cy="{at[1]:.1f}" r="{radius:g}"'
    return f'<circle {place} fill="{fill}" stroke="{stroke}" stroke-width="1.5"{dash}/>'


def box(at: Point, size: Point, fill: str = "none", stroke: str = "none") -> str:
    """A rectangle around its middle."""
    place = f'x="{at[0] - size[0] / 2:.1f}" y="{at[1] - size[1] / 2:.1f}" width="{size[0]:.1f}" height="{size[1]:.1f}"'
    return f'<rect {place} fill="{fill}" stroke="{stroke}" stroke-width="2"/>'
