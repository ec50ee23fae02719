"""Event weights of small cards are made once for all tests of records; a busy machine leaves no frame unanswered."""

from collections.abc import Iterator

import pytest

from mtp_bench.judge import SceneRun
from mtp_bench.judge.records import rerun, running, submitting, verifying
from mtp_bench.judge.records.parts import Parts
from mtp_bench.judge.records.running import Plan, run_seed
from tests.support.runs import PATIENT, remembered_reference


@pytest.fixture(scope="package", autouse=True)
def weights() -> Iterator[None]:
    """Weights are remembered by card, data and scenes."""
    with pytest.MonkeyPatch.context() as patch:
        for module in (submitting, verifying):
            patch.setattr(module, "reference_for", remembered_reference)
        yield


def _patiently(plan: Plan, seed: int, parts: Parts | None = None) -> list[SceneRun]:
    return run_seed(plan, seed, parts, PATIENT)


@pytest.fixture(scope="package", autouse=True)
def patience() -> Iterator[None]:
    """No test of records is about time: an answer is taken, however late it comes."""
    with pytest.MonkeyPatch.context() as patch:
        for module in (rerun, running):
            patch.setattr(module, "run_seed", _patiently)
        yield
