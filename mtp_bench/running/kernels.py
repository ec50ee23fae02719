"""Compiled kernels of trackers and samplers, filled into the user's cache before workers need them."""

import importlib
from typing import Any

from ..core import SERIAL, Workers, long_work, parallel_map

PLAYERS = (
    "mtp_bench.tracking",
    "mtp_bench.prediction",
)  # rooms whose modules register all kernels


def all_kernels() -> list[Any]:
    """All kernels; imported here, since the judge itself does not import trackers and predictors."""
    for room in PLAYERS:
        facade = importlib.import_module(room)
        for name in facade.__all__:  # each is imported when it is first used
            getattr(facade, name)
    kernels: list[Any] = importlib.import_module(
        "mtp_bench.tracking.kernels.compile"
    ).KERNELS
    return kernels


def compile_kernels(workers: Workers = SERIAL) -> None:
    """Compile the kernels that the user's cache lacks, in processes of this machine.

    To be called before workers start, which print nothing, and before sandboxes, which cannot write to the cache.
    """
    missing = [kernel for kernel in all_kernels() if not kernel.is_cached]
    if not missing or not missing[0].can_be_cached():
        return
    calls = [
        (kernel.function.__module__, kernel.function.__qualname__) for kernel in missing
    ]
    if workers.count == 1 or len(missing) < 2:  # each kernel prints its own line
        parallel_map(_compile, calls)
        return
    seconds = [kernel.seconds for kernel in missing]
    text = "compiling kernels of trackers and samplers, once per installation"
    with long_work(text, max(*seconds, sum(seconds) / workers.count)):
        parallel_map(_compile, calls, Workers(workers.count))


def _compile(module: str, name: str) -> None:
    getattr(importlib.import_module(module), name).compile()
