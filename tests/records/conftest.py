"""Event weights of small cards are made once for all tests of records, not for every submission and check."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import pytest

from mtp_bench.cards import Card
from mtp_bench.records import submitting, verifying
from mtp_bench.running.options import DEFAULTS, RunOptions
from mtp_bench.running.reference import reference_for
from mtp_bench.scoring import Reference

_made: dict[tuple[str, str | None, tuple[str, ...]], Reference] = {}


def _known(card: Card, scenes: Sequence[str], options: RunOptions = DEFAULTS) -> Reference:
    key = (card.digest, options.data, tuple(scenes))
    if key not in _made:
        _made[key] = reference_for(card, scenes, options)
    return _made[key]


@pytest.fixture(scope="package", autouse=True)
def weights() -> Iterator[None]:
    """Weights are remembered by card, data and scenes."""
    with pytest.MonkeyPatch.context() as patch:
        for module in (submitting, verifying):
            patch.setattr(module, "reference_for", _known)
        yield
