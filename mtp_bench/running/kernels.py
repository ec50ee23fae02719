"""Compiled kernels of trackers and samplers, filled into the user's cache before workers need them."""

import importlib
from typing import Any

from .. import notice
from ..parallel import SERIAL, Workers, parallel_map

PLAYERS = ("mtp_bench.tracking", "mtp_bench.prediction")  # packages whose import registers all kernels
_SECONDS = 2.0  # per kernel, in several processes: 34 s for all


def all_kernels() -> list[Any]:
    """All kernels; imported here, since the judge itself does not import trackers and predictors."""
    for package in PLAYERS:
        importlib.import_module(package)
    kernels: list[Any] = importlib.import_module("mtp_bench.tracking.kernels.compile").KERNELS
    return kernels


def compile_kernels(workers: Workers = SERIAL) -> None:
    """Fill the user's cache of compiled kernels over the processes of this machine.

    Workers are silent and an agent's sandbox keeps nothing, so it is done before them.
    """
    missing = [(place,) for place, kernel in enumerate(all_kernels()) if not kernel.is_cached]
    if workers.count == 1 or len(missing) < 2:  # each kernel speaks for itself
        parallel_map(_compile, missing)
        return
    text = "compiling kernels of trackers and samplers, once per machine"
    with notice.work(text, _SECONDS * len(missing)):
        parallel_map(_compile, missing, Workers(workers.count))


def _compile(place: int) -> None:
    all_kernels()[place].compile()
