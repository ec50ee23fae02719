"""Colours of figures: told apart by people with any kind of colour vision, on light and on dark pages."""

from __future__ import annotations

from itertools import combinations
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.axes import Axes
from numpy.typing import NDArray

from mtp_bench.study.drawing import COLORS, SERIES, draw
from mtp_bench.study.figures import CAUSE_COLORS
from mtp_bench.study.panels import Panel, Series, draw_panel

Array = NDArray[np.float64]

# Machado, Oliveira and Fernandes 2009, severity 1, for linear RGB
VISION = {
    "normal": np.eye(3),
    "protanopia": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
    "deuteranopia": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    ),
    "tritanopia": np.array(
        [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]]
    ),
}
TO_XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)
WHITE = np.array([0.95047, 1.0, 1.08883])
APART = 15.0  # of the Lab space; 2.3 is just noticeable


def linear(color: str) -> Array:
    value = np.array([int(color[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def lab(rgb: Array) -> Array:
    x = TO_XYZ @ np.clip(rgb, 0, 1) / WHITE
    f = np.where(x > 216 / 24389, np.cbrt(x), (24389 / 27 * x + 16) / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize("vision", VISION)
@pytest.mark.parametrize("page", [0, 1], ids=["light", "dark"])
def test_series_and_causes_are_told_apart(vision: str, page: int) -> None:
    for a, b in combinations(sorted({*SERIES, *CAUSE_COLORS}), 2):
        one, other = (lab(VISION[vision] @ linear(COLORS[name][page])) for name in (a, b))
        assert np.linalg.norm(one - other) > APART, (a, b)


def contrast(a: str, b: str) -> float:
    low, high = sorted(float(TO_XYZ[1] @ linear(color)) for color in (a, b))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("page", [0, 1], ids=["light", "dark"])
def test_words_are_read_on_their_ground(page: int) -> None:
    for name in ("ink", "soft"):
        assert contrast(COLORS[name][page], COLORS["paper"][page]) > 4.5


def painted(axis: Axes) -> None:
    intervals = [(2.0, 4.0), None, (0.5, 1.5)]
    series = Series("one & other", [1, 2, 3], [3.0, None, 1.0], "blue", "line", intervals)
    draw_panel(axis, Panel([series], "hypotheses H", "error, m"))


def test_a_name_with_dollars_is_not_a_formula() -> None:
    draw("x", "", "", "", lambda axis: axis.set_xticks([0], ["$\\foo$"]))


def test_a_figure_says_what_it_is_and_of_how_many() -> None:
    figure = draw("falls", "It falls", "The error falls & stays < 3 m.", "7 targets", painted)
    root = ElementTree.fromstring(figure.svg_file)
    words = " ".join(root.itertext())
    for text in ("It falls", "The error falls & stays < 3 m.", "n: 7 targets.", "hypotheses H", "error, m"):
        assert text in words, text
    assert "The error falls" not in " ".join(ElementTree.fromstring(figure.svg).itertext())  # the page says it
    for svg in (figure.svg, figure.svg_file):
        named = ElementTree.fromstring(svg)
        assert (named.get("role"), named.get("aria-label")) == ("img", "It falls. The error falls & stays < 3 m.")
    assert figure.png.startswith(b"\x89PNG")
    assert b"The error falls" in figure.png


def test_colors_are_variables_of_the_page() -> None:
    svg = draw("falls", "It falls", "It falls.", "7 targets", painted).svg
    assert "var(--blue)" in svg
    assert not [light for light, _ in COLORS.values() if light in svg.lower()]


def test_the_same_figure_has_the_same_bytes_and_another_one_other_ids() -> None:
    one, again, other = (draw(name, "It falls", "It falls.", "7", painted) for name in ("a", "a", "b"))
    assert (one.svg, one.png) == (again.svg, again.png)

    def ids(svg: str) -> set[str]:
        found = {str(e.get("id")) for e in ElementTree.fromstring(svg).iter() if e.tag.endswith("clipPath")}
        assert found
        return found

    assert not ids(one.svg) & ids(other.svg)
