"""The parallel map."""

from __future__ import annotations

import os

import pytest

from mtp_bench.errors import MtpBenchError
from mtp_bench.parallel import Workers, parallel_map


def test_a_process_that_dies_is_one_clear_error() -> None:
    with pytest.raises(MtpBenchError, match=r"one of 2 processes died, .*: take fewer \(--jobs\)"):
        parallel_map(os._exit, [(1,), (1,)], Workers(2))
    assert parallel_map(abs, [(-1,), (2,)], Workers(2)) == [1, 2], "the next ones work"
