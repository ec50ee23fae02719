"""Pages and figure of robustness show what the stored levels say, of the code that is there."""

from pathlib import Path

import pytest

from docs.generate.robustness import PAGES, PICTURES, curves, filled, inputs_digest
from mtp_bench.cards import PerturbSection, load_card, with_perturb
from mtp_bench.running import LEVELS, Robustness

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs/environment/robustness.md"
CURVES = curves()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_tables_are_those_of_the_stored_levels(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert "<!-- robustness: " in text
    assert filled(text) == text, "run python -m docs.generate.robustness"


@pytest.mark.parametrize("picture", PICTURES.values(), ids=lambda path: path.stem)
def test_the_figure_is_that_of_the_stored_levels(picture: Path) -> None:
    text = picture.read_text(encoding="utf-8")
    assert inputs_digest() in text, "run python -m docs.generate.robustness"


@pytest.mark.parametrize("knob", LEVELS)
def test_the_page_states_the_levels(knob: str) -> None:
    levels = ", ".join(f"{level:g}".removeprefix("0") or "0" for level in LEVELS[knob])
    recorded = f"{getattr(PerturbSection(), knob):g}"
    assert f"| `{knob}` | {recorded} | {levels} |" in PAGE.read_text(encoding="utf-8")


@pytest.mark.parametrize("curve", CURVES, ids=lambda curve: f"{curve.env} {curve.knob}")
def test_errors_cost(curve: Robustness) -> None:
    """The strongest level is significantly worse than the recorded one; the targets are equal at all levels."""
    rows = [row for row in curve.on("all") if row.agent == "stp"]
    assert [row.level for row in rows] == list(LEVELS[curve.knob])
    difference = curve.difference(rows[-1], level=curve.recorded)
    assert difference is not None
    assert (difference.mean < 0) == curve.is_drive
    assert difference.significant
    assert len({tuple(row.weights) for row in curve.on("all")}) == 1
    for row in rows:
        with_perturb(load_card(curve.env), {curve.knob: row.level})
