"""Agents that look for the truth: in memory, files, descriptors, the network."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import pytest

from mtp_bench.env.rollouts import digest
from mtp_bench.gateway import SceneRun
from tests.support.hostile import Court

pytestmark = pytest.mark.usefixtures("light_fork_servers")

MEMORY = """
def act(self, observation):
    kinds = {"Scene", "Truth", "MTPEnv", "_Episode", "Targets"}
    found = [type(thing).__name__ for thing in gc.get_objects() if type(thing).__name__ in kinds]
    frame = sys._getframe()
    while frame:
        found += [name for name, value in frame.f_locals.items() if type(value).__name__ in kinds]
        frame = frame.f_back
    assert not found, f"read the truth: {found}"
    return self.honest(observation)
"""
JUDGE = """
def act(self, observation):
    judge = f"/proc/{self.given['judge']}"
    for read in (lambda: open(judge + "/mem", "rb"), lambda: open(judge + "/environ", "rb").read(1),
                 lambda: os.readlink(judge + "/cwd"), lambda: os.readlink(judge + "/fd/0"),
                 lambda: open(judge + "/maps").read(1)):
        try:
            read()
        except OSError:
            continue
        raise AssertionError("read the judge's memory")
    libc = ctypes.CDLL(None, use_errno=True)
    assert libc.ptrace(16, self.given["judge"], None, None) != 0, "traces the judge"
    return self.honest(observation)
"""
ENVIRONMENT = """
def act(self, observation):
    words = [*os.environ, *os.environ.values(), *sys.argv, os.getcwd(), *os.listdir()]
    words = [word for word in words if word != "MTP_BENCH_WEIGHTS"]  # of networks: they may be read
    known = [word for word in words if "MTP_BENCH" in word or self.given["data"] in word or word == "PATH"]
    assert not known, f"knows {known}"
    for name in os.listdir("/proc/self/fd"):
        try:
            target = os.readlink(f"/proc/self/fd/{name}")
        except FileNotFoundError:
            continue
        assert target.startswith(("pipe:", "/dev/null", "/proc/")), f"holds {target}"
    return self.honest(observation)
"""
FILES = """
def act(self, observation):
    data = Path(self.given["data"])
    assert not data.exists() or not any(data.rglob("*")), "read the data"
    assert Path.cwd() == Path("/scratch"), Path.cwd()
    given = self.given["submission"], self.given["cache"]
    for folder in (data, *given, "/", "/submission", "/networks", "/dev", "/usr"):
        try:
            Path(folder, "left").write_text("by an agent")
        except OSError:
            continue
        raise AssertionError(f"wrote into {folder}")
    Path("mine").write_text("allowed")
    for call in ("umount", "umount2"):
        assert getattr(ctypes.CDLL(None), call)(os.fsencode(data), 0) != 0, "uncovered the data"
    return self.honest(observation)
"""
NETWORK = """
def act(self, observation):
    for family, address in ((socket.AF_INET, ("127.0.0.1", self.given["port"])), (socket.AF_UNIX, self.given["name"])):
        try:
            socket.socket(family).connect(address)
        except OSError:
            continue
        raise AssertionError("told somebody outside")
    return self.honest(observation)
"""
SIGNALS = """
def act(self, observation):
    try:
        os.kill(self.given["judge"], 0)
    except OSError:
        return self.honest(observation)
    raise AssertionError("reaches the judge")
"""


def expect_nothing_found(court: Court, run: SceneRun) -> None:
    assert (run.status, run.reason) == ("finished", "")
    assert digest(run.rollout) == digest(court.honest())


def test_its_own_memory_holds_no_truth(court: Court) -> None:
    expect_nothing_found(court, court.run(MEMORY))


def test_the_judges_memory_is_closed(court: Court) -> None:
    expect_nothing_found(court, court.run(JUDGE, judge=os.getpid()))


def test_environment_arguments_and_descriptors_tell_nothing(court: Court, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MTP_BENCH_DATA", court.data)
    expect_nothing_found(court, court.run(ENVIRONMENT, data=court.data))


def test_data_is_not_there_and_nothing_else_can_be_written(court: Court, cache: Path) -> None:
    (cache / "kernels-kept").mkdir(exist_ok=True)
    run = court.run(FILES, data=court.data, submission=str(court.shared), cache=str(cache / "kernels-kept"))
    if not run.isolation.sandboxed:
        pytest.skip("this system allows no file system of one's own")
    expect_nothing_found(court, run)


def test_there_is_no_network(court: Court) -> None:
    name = f"\0mtp-bench-{os.getpid()}"
    with socket.create_server(("127.0.0.1", 0)) as server, socket.socket(socket.AF_UNIX) as local:
        local.bind(name)
        local.listen()
        run = court.run(NETWORK, port=server.getsockname()[1], name=name)
    if not run.isolation.sandboxed:
        pytest.skip("this system allows no network of one's own")
    expect_nothing_found(court, run)


def test_the_judge_is_out_of_reach_of_signals(court: Court) -> None:
    run = court.run(SIGNALS, judge=os.getpid())
    if not run.isolation.sandboxed:
        pytest.skip("this system allows no processes of one's own")
    expect_nothing_found(court, run)
