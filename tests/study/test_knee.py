"""Where a falling curve stops to pay."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from mtp_bench.study.error_rows import knee

CASES: dict[str, tuple[Sequence[float], Sequence[float], int | None]] = {
    "falls at once, then hardly": ((1, 2, 3, 4), (10, 2, 1.5, 1), 1),
    "falls late": ((1, 2, 3, 4), (10, 9.9, 9.8, 1), None),
    "a straight line has none": ((1, 2, 3), (3, 2, 1), None),
    "it does not fall": ((1, 2, 3), (1, 0.5, 1), None),
    "two points": ((1, 2), (2, 1), None),
    "cost decides: the third point is nearly free": ((1, 1.1, 1.2, 10), (10, 8, 2, 1), 2),
    "no cost at all": ((1, 1, 1), (3, 1, 0.5), None),
}


@pytest.mark.parametrize("name", CASES)
def test_knees(name: str) -> None:
    cost, error, place = CASES[name]
    assert knee(cost, error) == place
