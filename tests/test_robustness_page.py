"""The page on robustness shows what the stored levels say, of the code that is there."""

import re
from pathlib import Path

import pytest

from benchmarks.robustness import PLAN, page, stored
from mtp_bench.cards import PerturbSection, load_card, with_perturb
from mtp_bench.running import LEVELS

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs/environment/robustness.md"
MEASURED = [(env, knob) for env, knobs in PLAN.items() for knob in knobs if stored(env, knob) is not None]


def test_the_tables_are_those_of_the_stored_levels() -> None:
    curves = [curve for curve in (stored(env, knob) for env, knob in MEASURED) if curve is not None]
    shown = re.search(r"<!-- made by .*? -->\n(.*)<!-- end -->", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert shown is not None
    assert shown[1] == page(curves)


@pytest.mark.parametrize("knob", LEVELS)
def test_the_page_states_the_levels(knob: str) -> None:
    levels = ", ".join(f"{level:g}".removeprefix("0") or "0" for level in LEVELS[knob])
    recorded = f"{getattr(PerturbSection(), knob):g}"
    assert f"| `{knob}` | {recorded} | {levels} |" in PAGE.read_text(encoding="utf-8")


@pytest.mark.parametrize(("env", "knob"), MEASURED)
def test_errors_cost(env: str, knob: str) -> None:
    """The strongest level is significantly worse than the recorded one; the targets are equal at all levels."""
    curve = stored(env, knob)
    assert curve is not None
    rows = [row for row in curve.on("all") if row.agent == "stp"]
    difference = curve.difference(rows[-1], level=curve.recorded)
    assert difference is not None
    assert (difference.mean < 0) == curve.is_drive
    assert difference.significant
    assert len({tuple(row.weights) for row in curve.on("all")}) == 1
    for row in rows:
        with_perturb(load_card(env), {knob: row.level})
