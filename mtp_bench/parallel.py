"""The one parallel map: calls spread over processes of this machine or over the workers of a Dask cluster."""

from __future__ import annotations

import gc
import os
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from ._version import __version__
from .errors import MtpBenchError

Started = Callable[[int], object]  # is told how many pieces of work there are
Done = Callable[[str], object]  # is told the name of every piece that is done

BACKENDS = ("loky", "dask")
_CONNECT = 10  # s to wait for the scheduler
_WORKERS = 30  # s to wait for its first worker: those that died may be starting anew
_one_at_a_time = threading.Lock()  # of a worker process: agents need not be safe among threads


def _silent(_: object) -> None:
    """Say nothing."""


def _require_backend(backend: str, scheduler: str | None) -> None:
    if backend not in BACKENDS:
        raise MtpBenchError(f"backend is {backend!r}, expected one of: {', '.join(BACKENDS)}")
    if backend == "dask" and not scheduler:
        raise MtpBenchError("backend 'dask' needs the address of a scheduler, such as tcp://127.0.0.1:8786")
    if backend != "dask" and scheduler is not None:
        raise MtpBenchError(f"scheduler {scheduler!r} is for backend 'dask', got backend {backend!r}")
    if backend == "dask":
        try:
            import distributed  # noqa: F401
        except ImportError:
            raise MtpBenchError("backend 'dask' needs Dask: pip install 'dask[distributed]'") from None


@dataclass(frozen=True)
class Progress:
    """Who is told how the work goes on."""

    started: Started = _silent
    done: Done = _silent


@dataclass(frozen=True)
class Workers:
    """Who does the work: ``count`` processes of this machine, or all workers of a Dask scheduler at an address.

    Raises MtpBenchError unless the backend is known, installed and told the address that it needs.
    """

    count: int = 1
    backend: str = "loky"
    scheduler: str | None = None

    def __post_init__(self) -> None:
        if self.count < 1:
            raise MtpBenchError(f"workers is {self.count}, expected at least 1")
        _require_backend(self.backend, self.scheduler)


QUIET = Progress()  # nobody is told


def cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


ALONE = Workers()  # in this process, one call after the other


def parallel_map(
    function: Callable[..., Any],
    calls: Sequence[tuple[Any, ...]],
    workers: Workers = ALONE,
    done: Callable[[int], object] = _silent,
) -> list[Any]:
    """Results of ``function(*call)`` for every call, in the order of ``calls``; the same whoever does the work.

    ``done`` is told the place of every call that is done, in the order of completion. For more than one worker
    function, arguments and results must pickle. Raises what a call raises; of Dask also as `_cluster_map`.
    """
    results: dict[int, Any] = {}
    for place, result in unordered_map(function, calls, workers):
        results[place] = result
        done(place)
    return [results[place] for place in range(len(calls))]


def unordered_map(
    function: Callable[..., Any], calls: Sequence[tuple[Any, ...]], workers: Workers = ALONE
) -> Iterator[tuple[int, Any]]:
    """`parallel_map`, but place and result of every call as they come.

    Raises MtpBenchError where a process of this machine died, or where what it raised or returned cannot be sent back.
    """
    placed = [(place, function, call) for place, call in enumerate(calls)]
    if workers.scheduler is not None:
        yield from _cluster_map(_placed, placed, workers.scheduler)
    elif workers.count == 1 or len(calls) < 2:
        yield from (_placed(*call) for call in placed)
    else:
        from concurrent.futures.process import BrokenProcessPool

        from joblib import Parallel, delayed
        from joblib.externals.loky.process_executor import TerminatedWorkerError

        count = min(workers.count, len(calls))
        parallel: Any = Parallel(n_jobs=count, backend="loky", return_as="generator_unordered")
        try:
            yield from parallel(delayed(_placed)(*call) for call in placed)
        except TerminatedWorkerError:
            raise MtpBenchError(
                f"one of {count} processes died, most likely because memory ran out: take fewer (--jobs)"
            ) from None
        except BrokenProcessPool:
            raise MtpBenchError(
                f"what one of {count} processes raised or returned cannot be sent back to this one: take one process, "
                "which shows it (--jobs 1)"
            ) from None


def _placed(place: int, function: Callable[..., Any], call: tuple[Any, ...]) -> tuple[int, Any]:
    return place, function(*call)


def _cluster_map(function: Callable[..., Any], calls: Sequence[tuple[Any, ...]], scheduler: str) -> Iterator[Any]:
    """Results of ``function(*call)`` for every call, as they come, from the workers of the scheduler at this address.

    Function, arguments and results must pickle, and paths in them must be the same on every worker. A worker that dies
    loses nothing: its calls are made again by another. A worker process makes one call at a time, whatever the number
    of its threads. Raises what a call raises, and MtpBenchError for a scheduler that does not answer or has no workers,
    workers with another version of the library, and a call that killed several workers.
    """
    from distributed import KilledWorker

    distributed, client = _connect(scheduler)
    try:
        _require_workers(client, scheduler)
        futures = client.map(_alone, [function] * len(calls), calls, pure=False)
        try:
            for _, result in distributed.as_completed(futures, loop=client.loop, with_results=True):
                yield result
        except KilledWorker as error:
            raise MtpBenchError(
                f"several workers of {scheduler} died in the same call ({error.task}): is their memory enough?"
            ) from None
        finally:
            client.cancel(futures)  # after an error nobody waits for the others
    finally:
        client.close()


def _connect(scheduler: str) -> tuple[Any, Any]:
    """The module distributed, which has no types, and a client of the scheduler."""
    import distributed

    untyped: Any = distributed
    try:
        return untyped, untyped.Client(scheduler, timeout=_CONNECT, set_as_default=False)
    except (OSError, TimeoutError, ValueError, TypeError) as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0]
    # The client that was begun is closed here and now. Closed by the collector while another one or a cluster starts,
    # it would wait for a lock that its own thread holds.
    gc.collect()
    raise MtpBenchError(f"no Dask scheduler answers at {scheduler!r} ({reason}): start one with `dask scheduler`")


def _require_workers(client: Any, scheduler: str) -> None:
    try:
        client.wait_for_workers(1, timeout=_WORKERS)
    except TimeoutError:
        raise MtpBenchError(
            f"the Dask scheduler at {scheduler} has no workers: start some with `dask worker {scheduler}`"
        ) from None
    versions = client.run(_library_version, on_error="ignore")  # a worker may end just now
    for worker, version in versions.items():
        if version != __version__:
            raise MtpBenchError(f"worker {worker} has mtp-bench {version}, expected {__version__} as here: install it")


def _library_version() -> str:
    return __version__


def _alone(function: Callable[..., Any], call: tuple[Any, ...]) -> Any:
    with _one_at_a_time:
        return function(*call)
