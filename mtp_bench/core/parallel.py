"""A parallel map over processes of this machine or over workers of a Dask cluster."""

import gc
import os
import signal
import socket
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import cache
from typing import Any

from .bundle import __version__
from .errors import MtpBenchError

Calls = Sequence[tuple[Any, ...]]  # the arguments of each
_CONNECT_SECONDS = 10  # wait for the scheduler
_WORKER_SECONDS = 30  # wait for a worker: those that died may be restarting
_POLL_SECONDS = 0.05
# Where it is set, Python does not import from the current folder.
_SAFE_PATH = "PYTHONSAFEPATH"
ENDING_SIGNALS = tuple(  # Windows does not have all
    getattr(signal, name)
    for name in ("SIGINT", "SIGTERM", "SIGHUP")
    if hasattr(signal, name)
)
_WATCH_SECONDS = 0.5
# Calls in one process follow each other: agents need not be thread-safe.
_one_at_a_time = threading.Lock()


def _ignore(_: object) -> None:
    """Do nothing."""


class WorkerDiedError(MtpBenchError):
    """A process of this machine ended before its calls did."""


@dataclass(frozen=True)
class Workers:
    """Workers of a parallel map.

    They are ``count`` processes of this machine, or all workers of a Dask
    ``scheduler``. Raises MtpBenchError for a count below 1, and for a scheduler
    without Dask.
    """

    count: int = 1
    scheduler: str | None = None  # address, such as tcp://10.0.0.1:8786

    def __post_init__(self) -> None:
        if self.count < 1:
            raise MtpBenchError(f"workers is {self.count}, expected at least 1")
        if self.scheduler is not None:
            try:
                import distributed  # noqa: F401
            except ImportError:
                advice = "in a clone, `pip install -c constraints.txt '.[dask]'`"
                raise MtpBenchError(f"a scheduler needs Dask: {advice}") from None


SERIAL = Workers()  # in this process, one call after the other


def cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def parallel_map(
    function: Callable[..., Any],
    calls: Calls,
    workers: Workers = SERIAL,
    done: Callable[[int], object] = _ignore,
) -> list[Any]:
    """Return the results of ``function(*call)``, in the order of ``calls``.

    All kinds of workers give the same results. ``done`` is called with the index of
    every finished call, in the order of completion. For more than one worker function,
    arguments and results must pickle. Raises what a call raises, and as
    `unordered_map`.
    """
    results: dict[int, Any] = {}
    for index, result in unordered_map(function, calls, workers):
        results[index] = result
        done(index)
    return [results[index] for index in range(len(calls))]


def unordered_map(
    function: Callable[..., Any],
    calls: Calls,
    workers: Workers,
    own_process: bool = False,
) -> Iterator[tuple[int, Any]]:
    """Yield index and result of every call, in the order of completion.

    See `parallel_map`. ``own_process``: with several workers, a single call gets a
    process of its own too. Raises WorkerDiedError if a process of this machine died,
    MtpBenchError if a result or exception cannot be pickled, for a scheduler that does
    not answer, has no workers or one of another version, and for a call that ended
    several workers.
    """
    indexed = [(index, function, call) for index, call in enumerate(calls)]
    fewest_calls = 1 if own_process else 2  # that are worth other processes
    if workers.scheduler is not None:
        yield from _on_cluster(indexed, workers.scheduler)
    elif workers.count == 1 or len(calls) < fewest_calls:
        yield from (_indexed(*call) for call in indexed)
    else:
        from concurrent.futures.process import BrokenProcessPool
        from multiprocessing import resource_tracker

        from joblib import Parallel, delayed
        from joblib.externals.loky.process_executor import TerminatedWorkerError

        # joblib renews workers that hold much memory, and says so; nothing is lost by it
        warnings.filterwarnings("ignore", message="A worker stopped while some jobs")
        # with n_jobs=1 joblib would use this process
        count = min(workers.count, max(2, len(calls)))
        parallel: Any = Parallel(
            n_jobs=count, backend="loky", return_as="generator_unordered"
        )
        try:
            # held until the last result: joblib may replace a worker at any time
            with _safe_path():
                resource_tracker.ensure_running()  # unblocks signals as it starts
                with _blocked_signals():
                    parent = os.getpid()
                    results = parallel(
                        delayed(_indexed_in_worker)(parent, *call) for call in indexed
                    )
                yield from results
        except TerminatedWorkerError:
            raise WorkerDiedError(
                f"one of {count} processes died, most likely because memory ran out: "
                "take fewer (--jobs)"
            ) from None
        except BrokenProcessPool:
            raise MtpBenchError(
                f"one of {count} processes returned a result or an exception that "
                "cannot be pickled or unpickled: use one process to see it (--jobs 1)"
            ) from None


def _indexed(
    index: int, function: Callable[..., Any], call: tuple[Any, ...]
) -> tuple[int, Any]:
    return index, function(*call)


def _indexed_in_worker(parent: int, *call: Any) -> tuple[int, Any]:
    _end_with(parent)
    return _indexed(*call)


@cache
def _end_with(parent: int) -> None:
    """End this process soon after its parent, however that ends."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_WATCH_SECONDS)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _safe_path() -> Iterator[None]:
    """Keep new processes from importing modules of the current folder."""
    previous = os.environ.get(_SAFE_PATH)
    os.environ[_SAFE_PATH] = "1"
    try:
        yield
    finally:
        os.environ.pop(_SAFE_PATH, None)
        if previous is not None:
            os.environ[_SAFE_PATH] = previous


@contextmanager
def _blocked_signals() -> Iterator[None]:
    """Let new processes leave signals to end to this one, which ends them.

    A signal that comes meanwhile is delivered to this process afterwards.
    """
    if not hasattr(signal, "pthread_sigmask"):  # on Windows
        yield
        return
    previous = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING_SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, previous)


def _on_cluster(calls: Sequence[tuple[Any, ...]], scheduler: str) -> Iterator[Any]:
    """Yield index and result of every call, in the order of completion.

    Paths in the arguments must be the same on every worker of the scheduler at this
    address. The calls of a worker that dies are made again by another.
    """
    import distributed

    with _connected(scheduler) as client:
        futures = client.map(_indexed_on_worker, calls, version=__version__, pure=False)
        try:
            for _, result in _completed(client, futures):
                yield result
        except distributed.KilledWorker as error:
            raise MtpBenchError(
                f"several workers of {scheduler} died in the same call "
                f"({error.task}): is their memory enough?"
            ) from None
        finally:
            client.cancel(futures)  # after an error the others are not waited for


def _completed(client: Any, futures: Sequence[Any]) -> Iterator[Any]:
    """Yield each future with its result, as long as the scheduler has workers."""
    import distributed

    untyped: Any = distributed
    completed = untyped.as_completed(futures, loop=client.loop, with_results=True)
    seen = time.monotonic()  # when there was a worker last
    while not completed.is_empty():
        if completed.has_ready():
            yield next(completed)
        elif _has_workers(client):
            seen = time.monotonic()
            time.sleep(_POLL_SECONDS)
        elif time.monotonic() < seen + _WORKER_SECONDS:
            time.sleep(_POLL_SECONDS)
        else:
            raise MtpBenchError(
                f"all workers of {client.scheduler.address} ended, and none joined in "
                f"{_WORKER_SECONDS} s: start some again"
            )


def _has_workers(client: Any) -> bool:
    try:
        return bool(client.nthreads())
    except OSError:
        raise MtpBenchError(
            f"the Dask scheduler at {client.scheduler.address} ended: start it again"
        ) from None


def require_cluster(scheduler: str) -> None:
    """Raise MtpBenchError unless a Dask scheduler with sound workers answers.

    Its workers must have this version of the library.
    """
    with _connected(scheduler):
        pass


@contextmanager
def _connected(scheduler: str) -> Iterator[Any]:
    """Yield a client of the scheduler, whose workers are the expected ones."""
    with closing(_connect(scheduler)) as client:
        _require_workers(client, scheduler)
        yield client


def _connect(scheduler: str) -> Any:
    import distributed

    untyped: Any = distributed
    try:
        return untyped.Client(scheduler, timeout=_CONNECT_SECONDS, set_as_default=False)
    except (OSError, TimeoutError, ValueError, TypeError) as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0]
    # The half-made client is closed here and now. Closed by the collector while
    # another one or a cluster starts, it would wait for a lock of its own thread.
    gc.collect()
    raise MtpBenchError(
        f"no Dask scheduler answers at {scheduler!r} ({reason}): "
        "does `dask scheduler` run there?"
    )


def _require_workers(client: Any, scheduler: str) -> None:
    try:
        client.wait_for_workers(1, timeout=_WORKER_SECONDS)
    except TimeoutError:
        raise MtpBenchError(
            f"the Dask scheduler at {scheduler} has no workers: start some with "
            f"`{_SAFE_PATH}=1 dask worker {scheduler} --nthreads 1`"
        ) from None
    # "ignore": a worker may end just now
    problems = client.run(_worker_problem, __version__, on_error="ignore")
    for worker, problem in problems.items():
        if problem:
            raise MtpBenchError(f"worker {worker} {problem}")


def _worker_problem(version: str) -> str:
    """Return why this process cannot be a worker for ``version``.

    It is empty if it can.
    """
    if __version__ != version:
        return f"has mtp-bench {__version__}, expected {version} as here: install it"
    if not sys.flags.safe_path:
        return (
            "imports modules of the folder in which it was started: "
            f"start it again with {_SAFE_PATH}=1 in its environment"
        )
    return ""


def _indexed_on_worker(call: tuple[Any, ...], version: str) -> Any:
    """Return index and result of a call.

    Raises MtpBenchError on a worker that joined later and has a problem.
    """
    if problem := _worker_problem(version):
        raise MtpBenchError(f"a worker on {socket.gethostname()} {problem}")
    with _one_at_a_time:
        return _indexed(*call)
