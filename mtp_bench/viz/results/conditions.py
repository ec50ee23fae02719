"""Conditions on figures, and claims: sentences that a page holds only while the records bear them out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ...errors import MtpBenchError
from ...files import clean_text
from ...scoring.definitions import SIGNIFICANT
from .figure import Figure

_MOST_SHOWN = 120  # characters of a claim in an error


@dataclass(frozen=True)
class Condition:
    """Whether something holds, and the figures that say so."""

    holds: bool
    figures: str

    def __bool__(self) -> bool:
        return self.holds


def above(figure: Figure, limit: Figure | float) -> Condition:
    """The figure is larger than a number or another figure."""
    return Condition(figure.value > _value(limit), f"{figure.said}, expected above {_said(limit)}")


def below(figure: Figure, limit: Figure | float) -> Condition:
    """The figure is smaller than a number or another figure."""
    return Condition(figure.value < _value(limit), f"{figure.said}, expected below {_said(limit)}")


def within(figure: Figure, low: float, high: float) -> Condition:
    """The figure lies from ``low`` to ``high``, in its unit; shares from 0 to 1."""
    return Condition(low <= figure.value <= high, f"{figure.said}, expected {low:g} to {high:g}")


def significant(difference: Figure) -> Condition:
    """A difference is below 0 and no matter of chance, by the test that ranks."""
    sure = difference.p is not None and difference.p < SIGNIFICANT
    return Condition(difference.value < 0 and sure, f"{difference.said}, expected below 0 with p < {SIGNIFICANT:g}")


def chance(difference: Figure) -> Condition:
    """A difference could be a matter of chance, by the test that ranks."""
    unsure = difference.p is not None and difference.p >= SIGNIFICANT
    return Condition(unsure, f"{difference.said}, expected p of {SIGNIFICANT:g} or more")


def all_of(*conditions: Condition) -> Condition:
    """Every one of the conditions holds."""
    wrong = [each for each in conditions if not each.holds]
    return Condition(not wrong, "; ".join(each.figures for each in wrong or conditions))


def verdict(difference: Figure) -> str:
    """What a difference says of the relation that the first is better, by the test that ranks."""
    if chance(difference):
        return "cannot be told"
    return "holds" if significant(difference) else "does not hold"


def claim(condition: Condition, text: str = "", caller: Callable[[], str] | None = None) -> str:
    """The sentence, where the condition holds; raises MtpBenchError, with its figures, where it does not.

    ``text``, or what a template's ``{% call claim(...) %}`` block holds.
    """
    sentence = text if caller is None else caller()
    if not isinstance(condition, Condition):
        raise MtpBenchError(f"claim {_short(sentence)!r}: got {condition!r}, expected a condition such as above(...)")
    if not condition.holds:
        raise MtpBenchError(f"claim {_short(sentence)!r} is not what the records say: {condition.figures}")
    return sentence


def _short(sentence: str) -> str:
    return clean_text(" ".join(sentence.split()), _MOST_SHOWN)


def _value(limit: Figure | float) -> float:
    return limit.value if isinstance(limit, Figure) else limit


def _said(limit: Figure | float) -> str:
    return limit.said if isinstance(limit, Figure) else f"{limit:g}"
