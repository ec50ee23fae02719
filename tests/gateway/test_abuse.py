"""Agents that crash, hang, allocate, fork, flood and fill."""

import importlib.util
import os
import py_compile
import re
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from mtp_bench.core.notice import Progress
from mtp_bench.core.parallel import Workers
from mtp_bench.env.rollouts import digest
from mtp_bench.judge import SceneRun, run_isolated, run_isolated_scenes
from mtp_bench.judge.gateway import fork_server
from mtp_bench.judge.gateway.processes import children
from tests.support.hostile import HONEST, HURRIED, QUICK, SCENE, Court, submission

pytestmark = pytest.mark.usefixtures("light_fork_servers")


@pytest.fixture(scope="module", autouse=True)
def agents(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Folder of the unsandboxed processes of these tests; it is in the environment of all, by which they are found."""
    folder = tmp_path_factory.mktemp("agents")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tempfile, "tempdir", str(folder))
        patch.setenv("LD_LIBRARY_PATH", str(folder))
        yield folder


def at_frame_two(what: str) -> str:
    return f"""
def act(self, observation):
    if self.frame == 2:
        {what}
    return self.honest(observation)
"""


CRASHES = {
    "exit": ("os._exit(3)", "exit code 3"),
    "segmentation fault": ("ctypes.string_at(0)", "SIGSEGV"),
    "exception": ("1 / 0", "frame 2 failed: ZeroDivisionError"),
    "SystemExit": ("sys.exit('enough')", "SystemExit: enough"),
    "allocates": ("hoard = [np.zeros(1 << 28, np.uint8) for _ in range(100)]", "MemoryError"),
    "closes its connection": ("[os.close(int(n)) for n in sys.argv[1:3]]", "frame 2|closed|process"),
}


@pytest.mark.parametrize(("what", "text"), CRASHES.values(), ids=CRASHES)
def test_a_crash_ends_the_scene_and_keeps_what_was_answered(court: Court, what: str, text: str) -> None:
    run = court.run(at_frame_two(what), QUICK.model_copy(update={"memory": 2 << 30}))
    assert run.status == "crashed"
    assert any(part in run.reason for part in text.split("|")), run.reason
    assert np.diff(run.rollout.object_start).tolist() == [3, 3, 0, 0, 0, 0, 0]
    assert court.error(run.rollout) > court.error(court.honest())


def test_the_last_words_are_in_the_reason(court: Court) -> None:
    run = court.run(at_frame_two("print('no more weights', flush=True); os._exit(1)"))
    assert "no more weights" in run.reason


SILENT = {
    "act": (at_frame_two("time.sleep(1000)"), HURRIED.model_copy(update={"scene": 6.0})),
    "import": ("time.sleep(1000)", QUICK.model_copy(update={"start": 1.0})),
    "build": ("__init__ = lambda self: time.sleep(1000)", QUICK.model_copy(update={"start": 1.0})),
}


@pytest.mark.parametrize(("trick", "limits"), SILENT.values(), ids=SILENT)
def test_an_agent_that_hangs_is_ended(court: Court, trick: str, limits: object) -> None:
    run = court.run(trick, limits)  # type: ignore[arg-type]  # pyright: ignore[reportArgumentType]
    assert (run.status, np.diff(run.rollout.object_start)[2:].sum()) == ("hung", 0)


REACHES = {"its group": "os.kill(0, 9)", "everybody": "os.kill(-1 if os.getpid() == 1 else 0, 9)"}


@pytest.mark.parametrize("what", REACHES.values(), ids=REACHES)
def test_an_agent_that_kills_reaches_at_most_itself(court: Court, agents: Path, what: str) -> None:
    undying = "ctypes.CDLL(None).prctl(1, 0, 0, 0, 0)"
    run = court.run(at_frame_two(f"{undying}; {what}"))
    assert run.status in ("finished", "crashed")
    assert court.error(run.rollout) >= court.error(court.honest())
    assert left_over(agents) == []


FORKS = {
    "fork": "os.fork() or time.sleep(4711)",
    "double fork": "os.fork() or (os.setsid(), os.fork() or time.sleep(4711), os._exit(0))",
    "many": "any(os.fork() == 0 and not time.sleep(4711) for _ in range(30))",
}


@pytest.mark.parametrize("what", FORKS.values(), ids=FORKS)
def test_processes_that_an_agent_starts_end_with_it(court: Court, agents: Path, what: str) -> None:
    run = court.run(at_frame_two(what))
    assert run.status == "rejected", run.reason
    assert re.search("other processes|processes held", run.reason), run.reason  # many forks map much, too
    assert left_over(agents) == []


HOARDS = {  # on a busy machine the memory of the processes that start is seen before their number
    "processes": ("[os.fork() or time.sleep(4711) for _ in range(100)]", "other processes|(most|than) 2048 MiB"),
    "memory": (
        "[os.fork() or (np.ones(50_000_000), time.sleep(4711)) for _ in range(6)]",
        r"its \d processes held .* MiB, expected at most 2048 MiB|its processes held more than 2048 MiB",
    ),
}


@pytest.mark.parametrize(("what", "text"), HOARDS.values(), ids=HOARDS)
def test_processes_that_take_the_machine_end_at_once(court: Court, agents: Path, what: str, text: str) -> None:
    run = court.run(
        at_frame_two(f"{what}; time.sleep(4711)"), QUICK.model_copy(update={"frame": 50.0, "memory": 2 << 30})
    )
    assert run.status == "rejected", run.reason
    assert re.search(text, run.reason), run.reason
    assert left_over(agents) == []


DAEMON = "os.fork() or (os.setsid(), os.fork() or START, os._exit(0))"
ENDS = {"the agent goes on": ("os.wait()", "rejected"), "the agent ends": ("os._exit(4)", "crashed")}


@pytest.mark.parametrize(("ends", "status"), ENDS.values(), ids=ENDS)
def test_a_daemon_of_an_unsandboxed_agent_ends_with_its_scene(court: Court, ends: str, status: str) -> None:
    """It has a session and an environment of its own, and its parent has ended."""
    mark = f"left-by-{os.getpid()}"
    sleeps = f"[sys.executable, '-c', 'import time; time.sleep(4711)', {mark!r}]"
    start = f"(os.closerange(0, 99), os.execve(sys.executable, {sleeps}, {{}}))"  # else it holds the connection open
    folder = submission(court.folder / "hostile", at_frame_two(f"{DAEMON.replace('START', start)}; {ends}"))
    waiting = [sys.executable, "-c", "input()"]
    with subprocess.Popen(waiting, stdin=subprocess.PIPE, stderr=subprocess.DEVNULL, start_new_session=True) as own:
        run = run_isolated(folder, court.card, {"data": court.data}, SCENE, limits=QUICK, backend="none")
        alive = own.poll() is None
    assert run.status == status, run.reason
    commands = [entry.read_bytes() for entry in Path("/proc").glob("[0-9]*/cmdline") if entry.exists()]
    assert not [command for command in commands if mark.encode() in command]
    assert alive, "a process of the judge's own program"


def left_over(agents: Path) -> list[str]:
    """Processes of agents that are still running: the folder is in their environment."""
    found = []
    for entry in Path("/proc").iterdir():
        try:
            if entry.name.isdigit() and bytes(agents) in (entry / "environ").read_bytes():
                found.append(entry.name)
        except OSError:
            continue
    started = [server._process.pid for server in fork_server._servers.values()]  # bubblewrap, with the server in it
    own = {os.getpid(), *started, *(pid for outer in started for pid in children(outer))}
    return [name for name in found if int(name) not in own]


def test_processes_of_agents_can_be_found(court: Court, agents: Path) -> None:
    """Else there would never be any left over."""
    seen: list[str] = []
    watcher = threading.Timer(0.3, lambda: seen.extend(left_over(agents)))
    watcher.start()
    court.run(at_frame_two("time.sleep(1)"))
    watcher.join()
    assert seen


def test_floods_are_read_away(court: Court) -> None:
    run = court.run("def act(self, observation):\n    print('x' * 4_000_000)\n    return self.honest(observation)")
    assert (run.status, digest(run.rollout)) == ("finished", digest(court.honest()))


FILLS = """
def act(self, observation):
    written = 0
    try:
        for i in range(100):
            with open(f"junk{i}", "wb") as file:
                for _ in range(16):
                    file.write(bytes(1 << 20))
                    file.flush()
                    written += 1 << 20
    except OSError:
        pass
    assert written <= self.given["disk"], f"wrote {written} bytes"
    return self.honest(observation)
"""


def test_the_disk_does_not_fill(court: Court, agents: Path) -> None:
    run = court.run(FILLS, disk=QUICK.disk)
    assert run.status == "finished", run.reason
    assert not list(agents.glob("mtp_bench-agent-*"))


def test_nothing_is_unpickled(court: Court) -> None:
    folder, marker = submission(court.folder / "hostile"), court.folder / "opened"
    pickled = f"cbuiltins\nexec\n(Vopen({str(marker)!r}, 'w')\ntR.".encode()
    for name in ("weights.pkl", "agent.pkl", "weights.safetensors", "weights.npz"):
        (folder / name).write_bytes(pickled)
    assert court.run(HONEST).status == "finished"
    assert not marker.exists()


@pytest.mark.needs("sandbox")
def test_compiled_code_that_the_digest_does_not_cover_is_not_run(court: Court) -> None:
    folder, other = submission(court.folder / "hostile"), court.folder / "other.py"
    other.write_text("raise RuntimeError('not in the digest')")
    compiled = importlib.util.cache_from_source(str(folder / "agent.py"))
    py_compile.compile(str(other), compiled, invalidation_mode=py_compile.PycInvalidationMode.UNCHECKED_HASH)
    run = run_isolated(folder, court.card, {"data": court.data}, SCENE, limits=QUICK)
    assert run.status == "finished", run.reason


def test_one_scene_that_crashes_does_not_end_the_run(court: Court) -> None:
    trick = """
def act(self, observation):
    if not observation["detection_valid"].any():
        os._exit(1)
    return self.honest(observation)
"""
    folder, done = submission(court.folder / "hostile", trick), list[str]()
    runs: list[SceneRun] = run_isolated_scenes(
        folder, court.card, {"data": court.data}, limits=QUICK, scenes=["0006", "0008", "0001"], workers=Workers(2),
        progress=Progress(done=done.append),
    )  # fmt: skip
    assert ([run.rollout.scene for run in runs], sorted(done)) == (["0006", "0008", "0001"], ["0001", "0006", "0008"])
    assert ([run.rollout.frames for run in runs], {run.status for run in runs}) == ([7, 4, 9], {"crashed"})
    assert np.diff(runs[0].rollout.object_start).tolist() == [3, 3, 3, 0, 0, 0, 0]
