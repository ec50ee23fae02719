"""Event weights of small cards are made once for all tests of records; a busy machine leaves no frame unanswered."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import pytest

from mtp_bench.cards import Card
from mtp_bench.gateway import Limits, SceneRun
from mtp_bench.records import sealing, submitting, verifying
from mtp_bench.records.parts import Parts
from mtp_bench.records.running import Plan, run_seed
from mtp_bench.running.options import DEFAULTS, RunOptions
from mtp_bench.running.reference import reference_for
from mtp_bench.scoring import Reference
from tests.support.runs import PATIENT

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


def _patiently(plan: Plan, seed: int, _: Limits = PATIENT, parts: Parts | None = None) -> list[SceneRun]:
    return run_seed(plan, seed, PATIENT, parts)


@pytest.fixture(scope="package", autouse=True)
def patience() -> Iterator[None]:
    """No test of records is about time: what an agent answers is taken, however late it comes."""
    with pytest.MonkeyPatch.context() as patch:
        for module in (sealing, submitting, verifying):
            patch.setattr(module, "run_seed", _patiently)
        yield
