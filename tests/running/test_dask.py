"""Scenes spread over a Dask cluster of processes: the same results, and nothing is lost with a worker."""

import gc
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import distributed
import numpy as np
import pytest
from numpy.typing import NDArray

from mtp_bench.core import Task, parallel
from mtp_bench.core.bundle import __version__
from mtp_bench.core.errors import MtpBenchError
from mtp_bench.core.notice import Progress
from mtp_bench.core.parallel import SERIAL, Workers, parallel_map, unordered_map
from mtp_bench.env.rollouts import digest
from mtp_bench.judge import load_record, run_isolated_scenes
from mtp_bench.judge.records.parts import Parts
from mtp_bench.running.options import RunOptions
from mtp_bench.running.playing import Job, compile_kernels, run_jobs
from tests.support.command_line import CommandLine, read_json
from tests.support.small_scenes import Action, EchoAgent, make_noisy

Done = Callable[[str], object]
NAMES = ["0006", "0001", "0008"]
distributed_untyped: Any = distributed


class SlowAgent(EchoAgent):
    """Leaves time to kill a worker in the middle of a scene."""

    def act(self, observation: dict[str, NDArray[Any]]) -> Action:
        time.sleep(0.05)
        return super().act(observation)


def make_slow(task: Task) -> SlowAgent:
    return SlowAgent(noise=0.1)


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """A scheduler with two worker processes of one thread each."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONSAFEPATH", "1")
        with distributed_untyped.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0", host="127.0.0.1"
        ) as running:
            yield running


def on(cluster: Any, done: Done = lambda _: None) -> RunOptions:
    return RunOptions(workers=Workers(1, cluster.scheduler_address), progress=Progress(done=done))


def jobs(card: str, kitti: str, make: Any, seeds: int = 1) -> list[Job]:
    keywords = {"data": kitti, "evaluation": True}
    return [Job(make, card, keywords, name, seed, "mine") for seed in range(seeds) for name in NAMES]


def test_results_are_those_of_this_process_in_the_order_of_the_jobs(cluster: Any, card: str, kitti: str) -> None:
    given = jobs(card, kitti, make_noisy, seeds=3)
    done: list[str] = []
    alone = run_jobs(given)
    spread = run_jobs(given, on(cluster, done.append))
    assert [digest(rollout) for rollout in alone] == [digest(rollout) for rollout in spread]
    assert len({digest(rollout) for rollout in alone}) > 3
    assert sorted(done) == sorted(job.scene for job in given)


def test_a_killed_worker_loses_nothing(cluster: Any, card: str, kitti: str) -> None:
    given = jobs(card, kitti, make_slow, seeds=4)
    with distributed_untyped.Client(cluster, set_as_default=False) as client:
        processes = list(client.run(os.getpid).values())
    assert len(set(processes)) == 2
    assert os.getpid() not in processes
    killed: list[int] = []

    def kill_once(scene: str) -> None:
        if not killed:
            killed.append(processes[0])
            os.kill(processes[0], signal.SIGKILL)

    spread = run_jobs(given, on(cluster, kill_once))
    assert killed
    assert [digest(rollout) for rollout in run_jobs(given)] == [digest(rollout) for rollout in spread]


def test_agents_behind_the_gateway_answer_alike(cluster: Any, card: str, kitti: str) -> None:
    with distributed_untyped.Client(cluster, set_as_default=False) as client:
        processes = list(client.run(os.getpid).values())

    def runs(workers: Workers, done: Done) -> list[tuple[str, str]]:
        told = Progress(done=done)
        found = run_isolated_scenes("stp", card, {"data": kitti}, scenes=NAMES, workers=workers, progress=told)
        return [(run.seal, digest(run.rollout)) for run in found]

    def kill_once(scene: str) -> None:
        if len(processes) > 1:
            os.kill(processes.pop(), signal.SIGKILL)

    compile_kernels()
    assert runs(Workers(1, cluster.scheduler_address), kill_once) == runs(SERIAL, lambda _: None)
    assert len(processes) == 1


class UnsafeClient:
    """A client of one worker, which runs functions in this process."""

    def wait_for_workers(self, count: int, timeout: float) -> None:
        pass

    def run(self, function: Any, version: str, on_error: str) -> dict[str, str]:
        return {"tcp://127.0.0.1:9": function(version)}


def test_a_worker_that_imports_from_its_folder_is_refused_at_the_start_and_later(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(parallel, "sys", SimpleNamespace(flags=SimpleNamespace(safe_path=False)))
    with pytest.raises(MtpBenchError, match=r"127\.0\.0\.1:9 imports modules .* PYTHONSAFEPATH=1"):
        parallel._require_workers(UnsafeClient(), "tcp://127.0.0.1:8")
    with pytest.raises(MtpBenchError, match=r"a worker on .* imports modules"):
        parallel._indexed_on_worker((0, abs, (-1,)), __version__)
    with pytest.raises(MtpBenchError, match=r"expected 9\.9 as here"):
        parallel._indexed_on_worker((0, abs, (-1,)), "9.9")


def test_a_scheduler_that_does_not_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parallel, "_CONNECT_SECONDS", 0.2)
    with pytest.raises(MtpBenchError, match=r"no Dask scheduler answers at 'tcp://127.0.0.1:9'"):
        parallel_map(np.add, [(1, 2)], Workers(1, "tcp://127.0.0.1:9"))
    with pytest.raises(MtpBenchError, match=r"no Dask scheduler answers at 'nowhere'"):
        parallel_map(np.add, [(1, 2)], Workers(1, "nowhere"))
    clients = [one for one in gc.get_objects() if type(one) is distributed_untyped.Client]
    assert not clients, "one that is half made waits for ever where the collector closes it while a cluster starts"


def test_commands_print_the_same_through_a_cluster(
    cluster: Any, cli: CommandLine, card: str, kitti: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One of its two workers is killed in the middle of each of them."""
    address = cluster.scheduler_address
    known = ("--env", card, "--data", kitti)
    words = {
        "compare": ("compare", "stp", *known, "--seeds", 2),
        "robustness": ("robustness", "stp", *known, "--seeds", 1, "--knob", "score", "--levels", "0,0.3"),
    }
    started = parallel._connected

    def killing(scheduler: str) -> Any:
        threading.Timer(0.5, kill_worker, [cluster]).start()
        return started(scheduler)

    for name, command in words.items():
        files = [tmp_path / f"{name}{number}.json" for number in range(2)]
        cli.ok(*command, "--jobs", 1, "--json", files[0])
        with monkeypatch.context() as patch:
            patch.setattr(parallel, "_connected", killing)
            cli.ok(*command, "--scheduler", address, "--json", files[1])
        alone, spread = (without_times(read_json(file)) for file in files)
        assert alone == spread


def test_every_baseline_is_submitted_though_a_worker_dies(
    cluster: Any, cli: CommandLine, card: str, kitti: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ("submit", "--all", "stp", "--env", card, "--data", kitti, "--seeds", 2)
    assert cli(*words, "--jobs", 1, "-o", tmp_path / "alone").status == 0
    killed: list[int] = []

    def writing(parts: Parts, *given: Any) -> None:
        if not killed:
            killed.append(kill_worker(cluster))
        written(parts, *given)

    written = Parts.write
    monkeypatch.setattr(Parts, "write", writing)
    assert cli(*words, "--scheduler", cluster.scheduler_address, "-o", tmp_path / "spread").status == 0
    assert killed
    records = [load_record(next((tmp_path / name).rglob("*.json"))) for name in ("alone", "spread")]
    same, other = (record.model_dump(exclude={"measured", "digest"}) for record in records)
    assert same == other


def test_a_cluster_that_loses_all_workers_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    with distributed_untyped.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=":0"
    ) as small:
        monkeypatch.setattr(parallel, "_worker_problem", lambda version: "")
        results = unordered_map(wait_and_return, [(0.1,), (1.0,)], Workers(1, small.scheduler_address))
        assert next(results) == (0, 0.1)
        monkeypatch.setattr(parallel, "_WORKER_SECONDS", 0.5)
        small.scale(0)
        with pytest.raises(MtpBenchError, match=r"all workers of inproc://.* ended, .* start some again"):
            next(results)


def wait_and_return(seconds: float) -> float:
    time.sleep(seconds)
    return seconds


def kill_worker(cluster: Any) -> int:
    worker = next(iter(cluster.workers.values()))
    os.kill(worker.pid, signal.SIGKILL)
    return int(worker.pid)


def without_times(content: Any) -> Any:
    if isinstance(content, dict):
        return {key: without_times(value) for key, value in content.items() if key not in {"ms_per_frame", "key"}}
    return [without_times(each) for each in content] if isinstance(content, list) else content
