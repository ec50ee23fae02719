"""A number of the records: text where a template shows it, a value where a claim compares it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from ...scoring.rows import Interval

Kind = Literal["length", "share", "times", "time", "count", "order"]
TEXT: dict[Kind, tuple[str, int]] = {  # unit, digits after the point
    "length": (" m", 2), "share": (" %", 0), "times": (" times", 1), "time": (" ms", 1), "count": ("", 0),
    "order": ("", 2),
}  # fmt: skip


@dataclass(frozen=True)
class Figure:
    """A number, and what it is of."""

    of: str  # in words, for errors
    value: float
    kind: Kind = "length"
    interval: Interval | None = None  # 95 %
    p: float | None = None  # of a test that it is not 0
    digits: int | None = None  # after the point; None: as usual for its kind

    def __str__(self) -> str:
        return f"{self.bare}{TEXT[self.kind][0]}"

    @property
    def bare(self) -> str:
        """Without its unit."""
        return self._number(self.value)

    @property
    def sure(self) -> str:
        """With its interval and p in brackets, as far as they are known: "0.73 m (0.47 to 1.08, p = 0.002)"."""
        known = [] if self.interval is None else [f"{self.between}{' %' if self.kind == 'share' else ''}"]
        known += [] if self.p is None else [p_text(self.p)]
        return f"{self} ({', '.join(known)})" if known else str(self)

    @property
    def between(self) -> str:
        """The ends of its interval; "no interval" without one."""
        return "no interval" if self.interval is None else " to ".join(map(self._number, self.interval))

    @property
    def ranged(self) -> str:
        """As in tables: without its unit, the interval in square brackets."""
        return self.bare if self.interval is None else f"{self.bare} [{', '.join(map(self._number, self.interval))}]"

    @property
    def said(self) -> str:
        """What it is, and how much."""
        return f"{self.of}: {self.sure}"

    def to(self, digits: int) -> Figure:
        """The same, shown with as many ``digits`` after the point."""
        return replace(self, digits=digits)

    def _number(self, value: float) -> str:
        digits = TEXT[self.kind][1] if self.digits is None else self.digits
        return signed(100 * value if self.kind == "share" else value, digits)


def signed(value: float, digits: int) -> str:
    """With a minus of typography, and none before a zero."""
    return f"{value:z.{digits}f}".replace("-", "−")


def p_text(p: float) -> str:
    """As the pages write it."""
    if p < 0.001:
        return "p < 0.001"
    return f"p = {p:.3f}" if p < 0.01 else f"p = {p:.2f}"
