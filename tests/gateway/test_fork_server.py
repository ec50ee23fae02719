"""Agents as forks of a fork server: each is sandboxed, and starts from the same state."""

import os
import resource
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from mtp_bench.agent import load_submission
from mtp_bench.judge import SceneRun
from mtp_bench.judge.gateway import fork_server
from mtp_bench.judge.gateway.fork_server import ForkServer, ForkServerError, discard
from mtp_bench.judge.gateway.layout import TEMPORARY, Layout, _with_tmp, image_of, layout_for, library
from mtp_bench.judge.gateway.process import AgentProcess
from mtp_bench.judge.gateway.processes import children
from tests.support.hostile import HONEST, QUICK, SCENE, Court, submission

pytestmark = [
    pytest.mark.needs("sandbox"),
    pytest.mark.usefixtures("light_fork_servers"),
]

ASKS = """
def is_open(number):
    try:
        os.fstat(number)
    except OSError:
        return False
    return True

def act(self, observation):
    if self.frame == 0:
        {asks}
        print(said)
        raise RuntimeError(said)
    return self.honest(observation)
"""


def said(court: Court, asks: str) -> str:
    run = court.run(ASKS.format(asks=asks))
    assert run.status == "crashed"
    return run.reason.split("RuntimeError: ")[1]


@pytest.fixture
def court(card: str, kitti: str, tmp_path: Path) -> Court:
    return Court(card, kitti, tmp_path)


@pytest.fixture(autouse=True)
def _no_server_remains() -> Iterator[None]:
    yield
    discard()


def running_server() -> ForkServer:
    return fork_server._servers[threading.get_native_id()]


def open_files() -> int:
    return sum(1 for _ in Path("/proc/self/fd").iterdir())


def forks_made(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    made: list[int] = []
    fork = ForkServer.fork

    def counted(server: ForkServer, descriptors: list[int], space: int) -> int:
        made.append(fork(server, descriptors, space))
        return made[-1]

    monkeypatch.setattr(ForkServer, "fork", counted)
    return made


def test_one_server_serves_a_submission(court: Court) -> None:
    court.run(HONEST)
    first = running_server()
    court.again()
    assert running_server() is first
    court.run("def act(self, observation):\n    return self.honest(observation)  # another submission")
    assert running_server() is not first
    assert not first.running


FACTS = {  # that `tests/adversarial/test_escapes.py` does not look at
    "no parent is seen": ("os.getppid()", "0"),
    "its folder is empty": ("sorted(set(os.listdir()) - {'kernels'})", "[]"),
    "no memory that forks share": (
        "[l for l in open('/proc/self/maps') if l.split()[1][1] == 'w' and l.split()[1][3] == 's']", "[]",
    ),
    "no network": ("[l.split(':')[0].strip() for l in open('/proc/net/dev')][2:]", "['lo']"),
    "no arguments of the server": ("len(sys.argv)", "3"),
}  # fmt: skip


@pytest.mark.parametrize(("asks", "expected"), FACTS.values(), ids=FACTS)
def test_a_fork_sees(court: Court, asks: str, expected: str) -> None:
    assert said(court, f"said = str({asks})") == expected


LEAVES = {
    "a file": ("open('note', 'w').write('x')", "os.path.exists('note')"),
    "a module": ("sys.modules['note'] = sys", "'note' in sys.modules"),
    "an attribute of the library": ("import mtp_bench; mtp_bench.note = 1", "hasattr(__import__('mtp_bench'), 'note')"),
    "the environment": ("os.environ['NOTE'] = '1'", "'NOTE' in os.environ"),
    "a name": ("ctypes.CDLL(None).prctl(15, b'note', 0, 0, 0)", "'note' in open('/proc/self/comm').read()"),
    "a mode of its input": (
        "import fcntl; fcntl.fcntl(0, fcntl.F_SETFL, fcntl.fcntl(0, fcntl.F_GETFL) | os.O_NONBLOCK)",
        "bool(__import__('fcntl').fcntl(0, 3) & os.O_NONBLOCK)",
    ),
}


@pytest.mark.parametrize(("leaves", "finds"), LEAVES.values(), ids=LEAVES)
def test_nothing_survives_a_scene(court: Court, leaves: str, finds: str) -> None:
    """The same submission twice, so the same server: what it finds at its first frame, then leaves."""
    trick = f"""
def act(self, observation):
    found = {finds}
    {leaves}
    raise RuntimeError(f"{{found}} {{{finds}}}")
"""
    runs: list[SceneRun] = [court.run(trick)]
    first = running_server()
    runs.append(court.again())
    assert running_server() is first
    assert [run.reason.split("RuntimeError: ")[1] for run in runs] == ["False True", "False True"]


def test_unseeded_draws_differ_between_agents(court: Court) -> None:
    asks = "said = str(np.random.random()) + ' ' + str(__import__('random').random())"
    one, first = said(court, asks).split(), running_server()
    other = court.again().reason.split("RuntimeError: ")[1].split()
    assert running_server() is first
    assert one[0] != other[0]
    assert one[1] != other[1]


def test_a_server_that_ended_is_replaced(court: Court) -> None:
    court.run(HONEST)
    os.killpg(running_server()._process.pid, signal.SIGKILL)
    running_server()._process.wait()
    assert court.again().status == "finished"


def test_a_low_limit_of_open_files_is_named(court: Court) -> None:
    """In a process of its own, since a limit once lowered is not raised again."""
    folder = str(submission(court.folder / "hostile"))
    code = f"from mtp_bench.judge import run_isolated as run; run({folder!r}, {court.card!r}, "
    code += f"{{'data': {court.data!r}}}, {SCENE!r})"
    program = ["bash", "-c", 'ulimit -n 60; exec "$0" -c "$1"', sys.executable, code]
    output = subprocess.run(program, check=False, capture_output=True, text=True)
    assert "60 open files are allowed, expected 1024: raise the limit with `ulimit -Hn 1024`" in output.stderr


def test_a_server_that_cannot_fork_is_replaced_once(court: Court, monkeypatch: pytest.MonkeyPatch) -> None:
    refused: list[ForkServer] = []

    def refuse(server: ForkServer, descriptors: list[int], space: int) -> int:
        refused.append(server)
        raise ForkServerError("no")

    monkeypatch.setattr(ForkServer, "fork", refuse)
    with pytest.raises(ForkServerError):
        court.run(HONEST)
    assert len(set(refused)) == 2
    assert not any(server.running for server in refused)


def test_a_server_that_hangs_is_replaced(court: Court, monkeypatch: pytest.MonkeyPatch) -> None:
    court.run(HONEST)
    first = running_server()
    os.kill(children(first._process.pid)[0], signal.SIGSTOP)  # the server's own process, which bubblewrap started
    monkeypatch.setattr(fork_server, "_FORK_SECONDS", 5.0)
    assert court.again().status == "finished"
    assert not first.running


def test_an_interruption_discards_the_server(court: Court, monkeypatch: pytest.MonkeyPatch) -> None:
    """Else its next message would be about the interrupted fork."""
    court.run(HONEST)
    first, read_pid = running_server(), ForkServer._read_pid

    def interrupted(server: ForkServer, expected: bytes, seconds: float) -> int:
        time.sleep(0.5)  # until the fork has sent its message
        raise KeyboardInterrupt

    monkeypatch.setattr(ForkServer, "_read_pid", interrupted)
    before = open_files()
    with pytest.raises(KeyboardInterrupt):
        court.again()
    assert not first.running
    assert open_files() == before - 1, "all but the socket of the server"
    monkeypatch.setattr(ForkServer, "_read_pid", read_pid)
    made = forks_made(monkeypatch)
    assert (court.again().status, len(made)) == ("finished", 1)


SLOW_AGENT = """
def act(self, observation):
    time.sleep(0.2)
    return self.honest(observation)
"""


def test_the_end_of_another_thread_ends_no_agent(court: Court) -> None:
    """A sandbox of bubblewrap ends with the thread that started it."""
    court.run(SLOW_AGENT)
    discard()
    ready, over = threading.Event(), threading.Event()
    found: list[SceneRun] = []

    def start_server() -> None:
        court.again()
        ready.set()
        over.wait()

    starter = threading.Thread(target=start_server)
    starter.start()
    ready.wait()
    user = threading.Thread(target=lambda: found.append(court.again()))
    user.start()
    time.sleep(1.0)  # in the middle of the scene, where both had the same server
    over.set()
    starter.join()
    user.join()
    assert [run.status for run in found] == ["finished"]
    for server in fork_server._servers.values():
        server._process.wait(60.0)  # it ends soon after its thread
    court.again()
    assert list(fork_server._servers) == [threading.get_native_id()], "servers of threads that ended are stopped"


def test_threads_with_two_submissions_do_not_end_each_other(court: Court, tmp_path: Path) -> None:
    court.run(SLOW_AGENT)
    (tmp_path / "beside").mkdir()
    beside = replace(court, folder=tmp_path / "beside")
    found: list[SceneRun] = []
    other = threading.Thread(target=lambda: found.append(beside.run(HONEST)))
    other.start()
    found.append(court.again())
    other.join()
    assert [run.status for run in found] == ["finished", "finished"]


def test_another_environment_needs_another_server(court: Court, monkeypatch: pytest.MonkeyPatch) -> None:
    asks = "said = os.environ.get('MKL_NUM_THREADS')"
    monkeypatch.setenv("MKL_NUM_THREADS", "1")
    assert said(court, asks) == "1"
    monkeypatch.setenv("MKL_NUM_THREADS", "2")
    assert court.again().reason.endswith("RuntimeError: 2")


def test_starting_the_server_takes_none_of_the_time_of_an_agent(court: Court, monkeypatch: pytest.MonkeyPatch) -> None:
    start, quick = ForkServer.__init__, QUICK.model_copy(update={"start": 5.0})

    def slowly(server: ForkServer, layout: Layout) -> None:
        time.sleep(quick.start)
        start(server, layout)

    monkeypatch.setattr(ForkServer, "__init__", slowly)
    run = court.run(HONEST, quick)
    assert run.status == "finished"
    assert run.started < quick.start


def test_a_judge_with_many_files_open_keeps_its_socket(court: Court) -> None:
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    if limits[1] < 2048:
        pytest.skip("this user may not open so many files")
    resource.setrlimit(resource.RLIMIT_NOFILE, (2048, limits[1]))
    held = [os.open("/dev/null", os.O_RDONLY) for _ in range(1100)]
    try:
        count = said(court, "said = str(sum(Hostile.is_open(n) for n in range(2048)))")
    finally:
        for descriptor in held:
            os.close(descriptor)
        resource.setrlimit(resource.RLIMIT_NOFILE, limits)
    assert count == "5"


ENDS = {
    "by itself": ("os._exit(3)", "the process ended by itself with exit code 3"),
    "by another program": ("os.execv('/proc/self/exe', ['python', '-c', 'pass'])", "exit code 0"),
    "by a signal": ("ctypes.string_at(0)", "SIGSEGV"),
    "with a daemon": ("os.fork() or (os.setsid(), time.sleep(100))\n        os._exit(4)", "exit code 4"),
}


@pytest.mark.parametrize(("does", "words"), ENDS.values(), ids=ENDS)
def test_how_a_fork_ended(court: Court, does: str, words: str) -> None:
    run = court.run(ASKS.format(asks=does))
    assert words in run.reason
    assert run.status == "crashed"


def test_a_fork_is_in_its_groups_and_does_not_see_their_names(court: Court, monkeypatch: pytest.MonkeyPatch) -> None:
    setup = AgentProcess.setup
    entered: list[bool] = []

    def spied(process: AgentProcess, parameters: dict[str, Any]) -> dict[str, Any]:
        groups = process._group.members
        entered.extend(Path(group).read_text().split() == [str(process._pid)] for group in groups)
        return setup(process, parameters)

    monkeypatch.setattr(AgentProcess, "setup", spied)
    names = said(court, "said = open('/proc/self/cgroup').read().replace(chr(10), ' ')")
    assert f"mtp_bench-{os.getpid()}" not in names
    assert all(entered)
    if court.again().isolation.memory == "watch":
        pytest.skip("no control groups here")
    assert entered


def test_a_library_below_tmp_is_shown_there(tmp_path: Path) -> None:
    """The temporary folder of agents is then at /agent-scratch alone; else /tmp is another name of it."""
    image = image_of(load_submission(submission(tmp_path / "mine")), "MTP-X-v0")
    assert ("agent-scratch", "/tmp") in layout_for(image, None).links or str(library()).startswith("/tmp/")
    shown = [("/elsewhere", "/tmp/library")]
    assert (_with_tmp([], shown), _with_tmp([], [])) == ((), (("agent-scratch", "/tmp"),))
    assert Path(TEMPORARY).name != "scratch", "clusters keep libraries below /scratch, which it would hide"
