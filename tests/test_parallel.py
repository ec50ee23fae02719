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


class NotSentError(Exception):
    """It pickles, but is made of two things, of which only the first is kept."""

    def __init__(self, frame: int, why: str) -> None:
        super().__init__(frame)
        self.why = why


def boom(frame: int) -> None:
    raise NotSentError(frame, "boom")


def test_an_unpicklable_error_is_not_reported_as_lack_of_memory() -> None:
    with pytest.raises(MtpBenchError, match=r"cannot be pickled or unpickled: .*\(--jobs 1\)"):
        parallel_map(boom, [(1,), (2,)], Workers(2))
    with pytest.raises(NotSentError):
        parallel_map(boom, [(1,), (2,)])
