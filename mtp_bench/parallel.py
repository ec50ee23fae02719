"""A parallel map over processes of this machine or over the workers of a Dask cluster."""

from __future__ import annotations

import gc
import os
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from ._version import __version__
from .errors import MtpBenchError

Started = Callable[[int], object]  # called with the number of work items
Done = Callable[[str], object]  # called with the name of every finished item

BACKENDS = ("loky", "dask")
_CONNECT_SECONDS = 10  # wait for the scheduler
_WORKER_SECONDS = 30  # wait for its first worker: workers that died may be restarting
_one_at_a_time = threading.Lock()  # one call per worker process: agents need not be thread-safe


def _ignore(_: object) -> None:
    """Do nothing."""


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
    """Progress callbacks."""

    started: Started = _ignore
    done: Done = _ignore


@dataclass(frozen=True)
class Workers:
    """The workers of a parallel map: ``count`` processes of this machine, or all workers of a Dask scheduler.

    Raises MtpBenchError unless the backend is known and installed and has the address that it needs.
    """

    count: int = 1
    backend: str = "loky"
    scheduler: str | None = None

    def __post_init__(self) -> None:
        if self.count < 1:
            raise MtpBenchError(f"workers is {self.count}, expected at least 1")
        _require_backend(self.backend, self.scheduler)


NO_PROGRESS = Progress()


def cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


SERIAL = Workers()  # in this process, one call after the other


def parallel_map(
    function: Callable[..., Any],
    calls: Sequence[tuple[Any, ...]],
    workers: Workers = SERIAL,
    done: Callable[[int], object] = _ignore,
) -> list[Any]:
    """Results of ``function(*call)`` for every call, in the order of ``calls``, the same for all backends.

    ``done`` is called with the index of every finished call, in the order of completion. For more than one worker
    function, arguments and results must pickle. Raises what a call raises; with Dask also as `_cluster_map`.
    """
    results: dict[int, Any] = {}
    for index, result in unordered_map(function, calls, workers):
        results[index] = result
        done(index)
    return [results[index] for index in range(len(calls))]


def unordered_map(
    function: Callable[..., Any], calls: Sequence[tuple[Any, ...]], workers: Workers = SERIAL
) -> Iterator[tuple[int, Any]]:
    """Index and result of every call of `parallel_map`, in the order of completion.

    Raises MtpBenchError if a process of this machine died, or if its result or exception cannot be pickled.
    """
    indexed = [(index, function, call) for index, call in enumerate(calls)]
    if workers.scheduler is not None:
        yield from _cluster_map(_indexed, indexed, workers.scheduler)
    elif workers.count == 1 or len(calls) < 2:
        yield from (_indexed(*call) for call in indexed)
    else:
        from concurrent.futures.process import BrokenProcessPool

        from joblib import Parallel, delayed
        from joblib.externals.loky.process_executor import TerminatedWorkerError

        count = min(workers.count, len(calls))
        parallel: Any = Parallel(n_jobs=count, backend="loky", return_as="generator_unordered")
        try:
            yield from parallel(delayed(_indexed)(*call) for call in indexed)
        except TerminatedWorkerError:
            raise MtpBenchError(
                f"one of {count} processes died, most likely because memory ran out: take fewer (--jobs)"
            ) from None
        except BrokenProcessPool:
            raise MtpBenchError(
                f"one of {count} processes returned a result or an exception that cannot be pickled or unpickled: "
                "use one process to see it (--jobs 1)"
            ) from None


def _indexed(index: int, function: Callable[..., Any], call: tuple[Any, ...]) -> tuple[int, Any]:
    return index, function(*call)


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
        return untyped, untyped.Client(scheduler, timeout=_CONNECT_SECONDS, set_as_default=False)
    except (OSError, TimeoutError, ValueError, TypeError) as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0]
    # The client that was begun is closed here and now. Closed by the collector while another one or a cluster starts,
    # it would wait for a lock that its own thread holds.
    gc.collect()
    raise MtpBenchError(f"no Dask scheduler answers at {scheduler!r} ({reason}): start one with `dask scheduler`")


def _require_workers(client: Any, scheduler: str) -> None:
    try:
        client.wait_for_workers(1, timeout=_WORKER_SECONDS)
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
