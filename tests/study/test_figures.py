"""Colours of figures: told apart by people with any kind of colour vision."""

from itertools import combinations
from xml.etree import ElementTree

import pytest

from mtp_bench.scoring.parts import PARTS
from mtp_bench.viz.studies.drawing import COLORS, SERIES, Panel, Series, Sketch, draw
from mtp_bench.viz.studies.figures import PART_COLORS
from tests.support.colours import APART, TO_XYZ, VISION, distance, linear


def rgb(color: str) -> list[int]:
    return [int(color[i : i + 2], 16) for i in (1, 3, 5)]


@pytest.mark.parametrize("vision", VISION)
def test_series_and_parts_are_told_apart(vision: str) -> None:
    assert len({*PART_COLORS}) == len(PARTS)
    for a, b in combinations(sorted({*SERIES, *PART_COLORS}), 2):
        assert distance(rgb(COLORS[a]), rgb(COLORS[b]), vision) > APART, (a, b)


def test_words_are_read_on_their_ground() -> None:
    for name in ("ink", "soft"):
        low, high = sorted(float(TO_XYZ[1] @ linear(rgb(each))) for each in (COLORS[name], "#ffffff"))
        assert (high + 0.05) / (low + 0.05) > 4.5


LINE = Series("one & other", [1, 2, 3], [3.0, None, 1.0], "blue", "line", [(2.0, 4.0), None, (0.5, 1.5)])
SKETCH = Sketch([Panel([LINE], "hypotheses H", "error, m")])


def test_a_figure_says_what_it_is_and_of_how_many() -> None:
    figure = draw("falls", "It falls", "The error falls & stays < 3 m.", "7 targets", SKETCH)
    root = ElementTree.fromstring(figure.svg)
    words = " ".join(root.itertext())
    for text in ("It falls", "The error falls & stays < 3 m.", "n: 7 targets.", "hypotheses H", "error, m"):
        assert text in words, text
    assert (root.get("role"), root.get("aria-label")) == ("img", "It falls. The error falls & stays < 3 m.")
    assert figure.png.startswith(b"\x89PNG")
    assert b"The error falls" in figure.png


def test_the_same_figure_has_the_same_bytes_and_another_one_other_ids() -> None:
    one, again, other = (draw(name, "It falls", "It falls.", "7", SKETCH) for name in ("a", "a", "b"))
    assert (one.svg, one.png) == (again.svg, again.png)

    def ids(svg: str) -> set[str]:
        found = {str(e.get("id")) for e in ElementTree.fromstring(svg).iter() if e.tag.endswith("clipPath")}
        assert found
        return found

    assert not ids(one.svg) & ids(other.svg)
