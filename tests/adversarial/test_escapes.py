"""Agents that try to get out, to see more than they are shown, to leave something behind, or to hoard unseen.

Each trick raises AssertionError where it gets through. `test_the_tricks_work_where_nothing_holds_them` shows that they
do so without isolation: else these tests could not fail.
"""

import os
import socket
import threading
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from mtp_bench.env.rollouts import digest
from mtp_bench.judge import SceneRun, run_isolated
from mtp_bench.judge.gateway import run
from mtp_bench.judge.gateway.processes import Group
from mtp_bench.judge.gateway.sandbox import sandbox_backend, system_call_filter
from tests.support.hostile import HONEST, QUICK, SCENE, Court, submission
from tests.support.programs import require_program
from tests.support.runs import PATIENT, move_home

pytestmark = pytest.mark.usefixtures("light_fork_servers")


@pytest.fixture
def court(card: str, kitti: str, tmp_path: Path, hostile: Path) -> Court:
    return Court(card, kitti, tmp_path, hostile)


@pytest.fixture
def sandboxed() -> None:
    require_program("sandbox")


@pytest.fixture
def loose(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run, "sandbox_backend", lambda: "none")


def act(code: str) -> str:
    """The method of an agent that runs ``code`` in every frame and then answers honestly."""
    lines = "\n".join(f"    {line}" for line in code.strip("\n").splitlines())
    return f"def act(self, observation):\n{lines}\n    return self.honest(observation)\n"


def expect_no_gain(court: Court, found: SceneRun) -> None:
    assert ((found.status, found.reason), digest(found.rollout)) == (("finished", ""), digest(court.honest()))
    assert found.isolation.sandboxed


SYSTEM = """
libc = ctypes.CDLL(None, use_errno=True)
def call(*arguments):
    return libc.syscall(*[ctypes.c_long(a) if isinstance(a, int) else a for a in arguments])
"""
SEARCH = """
def everything():
    for folder, folders, files in os.walk("/", onerror=lambda error: None):
        if folder == "/":
            folders[:] = [name for name in folders if name not in ("proc", "sys")]
        for name in [*folders, *files]:
            if name.endswith((".json", ".txt", ".npz", ".toml")):
                yield Path(folder, name)

for path in everything() if self.frame == 0 else ():
    try:
        small = path.is_file() and path.stat().st_size < 9000
        assert not (small and self.given["secret"].encode() in path.read_bytes()), f"read the secret at {path}"
    except OSError:
        continue
"""
LIBRARY = """
import importlib
for name in ("scoring", "sources", "judge.records", "cards", "running", "viz", "traffic", "training", "env"):
    try:
        importlib.import_module(f"mtp_bench.{name}")
    except ImportError:
        continue
    raise AssertionError(f"has the judge's {name}")
"""
SOCKETS = """
for way in self.given["sockets"]:
    try:
        socket.socket(socket.AF_UNIX).connect(way)
    except OSError:
        continue
    raise AssertionError(f"told somebody at {way}")
"""
FIFO = """
try:
    os.write(os.open(self.given["fifo"], os.O_WRONLY | os.O_NONBLOCK), b"out")
except OSError:
    pass
else:
    raise AssertionError("wrote into the FIFO")
"""
LINKED = """
for root in (self.given["link"], self.given["data"]):
    assert not os.path.lexists(root), f"sees the data at {root}"
"""
DEVICES = """
assert sorted(os.listdir("/dev")) == ["null", "urandom", "zero"], os.listdir("/dev")
for make in (lambda: os.mknod("disk", 0o60600, os.makedev(8, 0)), lambda: os.mknod("tty", 0o20600, 1281)):
    try:
        make()
    except OSError:
        continue
    raise AssertionError("made a device")
"""
PROCESSES = """
names = [int(name) for name in os.listdir("/proc") if name.isdigit()]
assert names == [os.getpid()] == [1], f"sees processes {names}"
assert os.readlink("/proc/1/root") == "/"
"""
RIGHTS = """
status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
found = {name: status[name].strip() for name in ("CapEff", "CapPrm", "CapBnd", "NoNewPrivs", "Seccomp")}
none = "0" * 16
assert found == {"CapEff": none, "CapPrm": none, "CapBnd": none, "NoNewPrivs": "1", "Seccomp": "2"}, found
assert (os.getuid(), os.getgid(), socket.gethostname()) == (1000, 1000, "agent")
"""
MOUNTS = (
    SYSTEM
    + """
tries = {
    "remount": lambda: libc.mount(b"none", b"/", None, 32, None),
    "tmpfs": lambda: libc.mount(b"x", b"/tmp", b"tmpfs", 0, None),
    "umount": lambda: libc.umount2(b"/submission", 2), "chroot": lambda: libc.chroot(b"/tmp"),
    "unshare": lambda: libc.unshare(0x10000000), "setns": lambda: libc.setns(0, 0),
    "open_tree": lambda: call(428, -100, b"/", 1), "fsopen": lambda: call(430, b"tmpfs", 0),
    "mount_setattr": lambda: call(442, -100, b"/", 0, (ctypes.c_uint64 * 4)(0, 1, 0, 0), 32),
    "clone": lambda: call(56, 0x10000000 | 17, None, None, None, None),
    "clone3": lambda: call(435, (ctypes.c_uint64 * 8)(0x10000000), 64),
}
done = [name for name, attempt in tries.items() if attempt() != -1]
assert not done, f"has done {done}"
"""
)
CALLS = (
    SYSTEM
    + """
numbers = {  # of x86-64
    "keyctl": (250, 0, -3, 0), "add_key": (248, b"user", b"left", b"x", 1, -3),
    "request_key": (249, b"user", b"left", None, 0), "ptrace": (101, 0, 0, 0, 0), "bpf": (321, 0, None, 0),
    "userfaultfd": (323, 0), "io_uring_setup": (425, 1, (ctypes.c_char * 256)()),
    "perf_event_open": (298, (ctypes.c_char * 256)(), 0, -1, -1, 0), "memfd_create": (319, b"x", 0),
    "memfd_secret": (447, 0), "shmget": (29, 0, 1 << 20, 0o1600), "msgget": (68, 0, 0o1600),
    "semget": (64, 0, 1, 0o1600), "mq_open": (240, b"x", 0o102, 0o600, None),
    "cachestat": (451, 1, (ctypes.c_uint64 * 2)(), (ctypes.c_uint64 * 5)(), 0), "fadvise": (221, 0, 0, 0, 4),
    "inotify": (294, 0), "io_setup": (206, 1, (ctypes.c_uint64 * 1)()), "sync": (162,),
    "socket": (41, 1, 1, 0), "socketpair": (53, 1, 1, 0, (ctypes.c_int * 2)()),
    "process_vm_readv": (310, 1, None, 0, None, 0, 0),
    "setxattrat": (463, -100, b"/tmp", 0, b"user.left", None, 0),
    "removexattrat": (466, -100, b"/tmp", 0, b"user.left"),
    "open_tree_attr": (467, -100, b"/tmp", 0, None, 0), "file_setattr": (469, -100, b"/tmp", None, 0, 0),
    "mbind": (237, None, 0, 0, None, 0, 0), "set_mempolicy_home_node": (450, 0, 0, 0, 0), "readahead": (187, 0, 0, 0),
    "madvise cold": (28, None, 0, 20), "madvise out": (28, None, 0, 21),
}
file = os.open(os.__file__, os.O_RDONLY)
for control in (5, 6, 7, 9, 36, 37, 38, 1024, 1026, 1033, 1034, 1035, 1037, 1038):  # 1035: a hint for all who open it
    numbers[f"fcntl {control}"] = (72, file, control, (ctypes.c_uint64 * 8)())
word = ctypes.c_uint32(0)
for signal in (1, 3, 4, 5, 10, 1 | 256):
    numbers[f"shared futex {signal}"] = (202, ctypes.byref(word), signal, 0, 0, ctypes.byref(word), 0)
common = {"fcntl": (72, file, 3, 0), "private futex": (202, ctypes.byref(word), 1 | 128, 1, 0, 0, 0)}
for name, arguments in common.items():
    assert call(*arguments) != -1, f"may not call {name}, as every program does"
import errno
done = []
for name, arguments in numbers.items():
    ctypes.set_errno(0)
    if call(*arguments) != -1 or ctypes.get_errno() != errno.EPERM:
        done.append(name)
assert not done, f"may call {done}"
"""
)
KERNELS = """
from mtp_bench.tracking.kernels import association
for path in (Path("/kernels"), Path(association.__file__), Path("/submission/agent.py")):
    assert path.exists(), path
    for target in [path, *path.glob("*/*")]:
        try:
            os.open(target, os.O_WRONLY | (os.O_TMPFILE if target.is_dir() else 0))
        except OSError:
            continue
        raise AssertionError(f"can write {target}")
"""
LINKS_OUT = """
for target in ("/proc/self/root/../..", "/proc/1/cwd/../../..", "/agent-scratch/../..", "/dev/../.."):
    assert os.listdir(target) == os.listdir("/"), target
Path("way").unlink(missing_ok=True)
os.symlink("/" + self.given["folder"].lstrip("/"), "way")
assert not os.path.exists("way"), "followed a link out"
"""
DESCRIPTORS = """
kinds = {}
for name in os.listdir("/proc/self/fd"):
    try:
        kinds[int(name)] = os.readlink(f"/proc/self/fd/{name}").split(":")[0]
    except OSError:
        continue
assert sum(kind == "pipe" for kind in kinds.values()) == 5, kinds  # input, the log twice, orders, answers
assert set(kinds.values()) <= {"pipe", f"/proc/{os.getpid()}/fd"}, kinds
"""
MOUNT_POINTS = """
bad = []
for line in Path("/proc/self/mountinfo").read_text().splitlines():
    place, options = line.split()[4:6]
    if place not in ("/agent-scratch", "/dev/null", "/dev/zero", "/dev/urandom") and "ro" not in options.split(","):
        bad.append(place)
assert not bad, f"can be written: {bad}"
"""

SETTINGS = """
for folder, _, names in os.walk("/proc/sys", onerror=lambda error: None):
    for name in names:
        try:
            os.close(os.open(os.path.join(folder, name), os.O_WRONLY))
        except OSError:
            continue
        raise AssertionError(f"may write {folder}/{name}")
for name in ("kallsyms", "slabinfo", "keys", "kcore", "vmallocinfo"):
    try:
        assert not Path("/proc", name).read_bytes()[:1], f"reads /proc/{name}"
    except OSError:
        continue
"""
MARKS = """
for path in ("/dev/null", "/dev/zero", "/dev/urandom"):
    before = os.stat(path)
    for mark in (lambda: os.utime(path, (4711, 4711)), lambda: os.utime(path), lambda: os.chmod(path, 0o600),
                 lambda: os.chown(path, 1000, 1000), lambda: os.setxattr(path, "user.x", b"1")):
        try:
            mark()
        except OSError:
            pass
    after = os.stat(path)
    assert (after.st_mtime, after.st_mode, after.st_atime) == (before.st_mtime, before.st_mode, before.st_atime), path
"""
LOCKS = (
    SYSTEM
    + """
import fcntl
with open("/submission/agent.py") as file:
    for lock in (lambda: fcntl.flock(file, fcntl.LOCK_SH), lambda: fcntl.lockf(file, fcntl.LOCK_SH),
                 lambda: fcntl.fcntl(file, fcntl.F_SETLEASE, fcntl.F_RDLCK), lambda: fcntl.fcntl(file, 37, bytes(32))):
        try:
            lock()
        except OSError:
            continue
        raise AssertionError("locked a file that others see")
    lock = (ctypes.c_char * 32)()  # a read lock of the whole file
    for command in (5, 6, 7, 36, 37, 38, 1024, 1026):
        for control in (command, command | 1 << 32, command | -1 << 32):  # the kernel reads 32 bits of it
            kept = call(72, file.fileno(), control, 0 if command > 1000 else lock)
            assert kept == -1, f"file control {control:#x} was not refused"
"""
)
OUTLIVES = (
    SYSTEM
    + """
assert libc.prctl(1, 0, 0, 0, 0) == -1, "may outlive the judge"
assert call(157, 1 | 1 << 32, 0, 0, 0, 0) == -1, "may outlive the judge, by bits that the kernel does not read"
"""
)

TRICKS: dict[str, tuple[str, dict[str, Any]]] = {
    "imports the judge": (LIBRARY, {}),
    "looks at devices": (DEVICES, {}),
    "looks at processes": (PROCESSES, {}),
    "looks at its rights": (RIGHTS, {}),
    "mounts": (MOUNTS, {}),
    "calls what is forbidden": (CALLS, {}),
    "writes where trusted code is": (KERNELS, {}),
    "holds descriptors": (DESCRIPTORS, {}),
    "finds a place to write": (MOUNT_POINTS, {}),
    "changes the kernel's settings": (SETTINGS, {}),
    "marks what others see": (MARKS, {}),
    "locks what others see": (LOCKS, {}),
    "outlives the judge": (OUTLIVES, {}),
}


MEMORY = """
kinds = {"Scene", "Truth", "MTPEnv", "_Episode", "Targets"}
found = [type(thing).__name__ for thing in gc.get_objects() if type(thing).__name__ in kinds]
frame = sys._getframe()
while frame:
    found += [name for name, value in frame.f_locals.items() if type(value).__name__ in kinds]
    frame = frame.f_back
assert not found, f"read the truth: {found}"
"""
JUDGE = """
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
"""
ENVIRONMENT = """
words = [*os.environ, *os.environ.values(), *sys.argv, os.getcwd(), *os.listdir()]
# weights of networks may be read, and every agent is told to be quiet
words = [word for word in words if word not in ("MTP_BENCH_WEIGHTS", "MTP_BENCH_QUIET")]
known = [word for word in words if "MTP_BENCH" in word or self.given["data"] in word or word == "PATH"]
assert not known, f"knows {known}"
for name in os.listdir("/proc/self/fd"):
    try:
        target = os.readlink(f"/proc/self/fd/{name}")
    except FileNotFoundError:
        continue
    assert target.startswith(("pipe:", "/dev/null", "/proc/")), f"holds {target}"
"""
FILES = """
data = Path(self.given["data"])
assert not data.exists() or not any(data.rglob("*")), "read the data"
assert Path.cwd() == Path("/agent-scratch"), Path.cwd()
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
"""
SIGNALS = """
try:
    os.kill(self.given["judge"], 0)
except OSError:
    pass
else:
    raise AssertionError("reaches the judge")
"""
INTERNET = """
try:
    socket.create_connection(("127.0.0.1", self.given["port"]))
except OSError:
    pass
else:
    raise AssertionError("reached the network")
"""
READS = {
    "its own memory": MEMORY, "the judge's memory": JUDGE, "its environment": ENVIRONMENT, "files": FILES,
    "signals": SIGNALS,
}  # fmt: skip


@pytest.mark.parametrize("name", READS)
def test_finds_no_truth(sandboxed: None, court: Court, name: str, cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MTP_BENCH_DATA", court.data)
    (cache / "kernels-kept").mkdir(exist_ok=True)
    given: dict[str, Any] = {"judge": os.getpid(), "data": court.data, "submission": str(court.shared)}
    expect_no_gain(court, court.run(act(READS[name]), cache=str(cache / "kernels-kept"), **given))


@pytest.mark.skipif(os.geteuid() == 0, reason="root reads all memory")
def test_the_judges_memory_is_closed_without_a_sandbox(loose: None, court: Court) -> None:
    found = court.run(act(JUDGE), judge=os.getpid())
    assert (found.status, found.reason) == ("finished", "")


@pytest.mark.parametrize("name", TRICKS)
def test_it_gets_nowhere(sandboxed: None, court: Court, name: str) -> None:
    code, given = TRICKS[name]
    expect_no_gain(court, court.run(act(code), **given))


def test_it_follows_no_path_out(sandboxed: None, court: Court) -> None:
    expect_no_gain(court, court.run(act(LINKS_OUT), folder=str(court.folder)))


@pytest.fixture
def secret(court: Court, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """A word that lies in the home folder, in the data, in the records, in the cache and beside the submission."""
    word = "salt-" + os.urandom(16).hex()
    home, records = court.folder / "home", court.folder / "leaderboard" / "records"
    places = [home, records, records / "gt_tracks.rollouts", court.folder, Path(court.data)]
    places += [home / ".cache" / "mtp_bench", *([court.shared.parent] if court.shared else [])]
    move_home(home, monkeypatch)
    files = []
    for place in places:
        place.mkdir(parents=True, exist_ok=True)
        files.append(place / "seal.json")
        files[-1].write_text(word)
    yield word
    for file in files:
        file.unlink()


def test_a_seal_is_nowhere_to_be_found(sandboxed: None, court: Court, secret: str) -> None:
    expect_no_gain(court, court.run(act(SEARCH), PATIENT, secret=secret))


def test_no_socket_and_no_fifo_leads_out(sandboxed: None, court: Court) -> None:
    place, abstract, fifo = str(court.folder / "s"), f"\0mtp-{os.getpid()}", str(court.folder / "fifo")
    os.mkfifo(fifo)
    reader = os.open(fifo, os.O_RDONLY | os.O_NONBLOCK)
    with socket.socket(socket.AF_UNIX) as path, socket.socket(socket.AF_UNIX) as name:
        for listener, address in ((path, place), (name, abstract)):
            listener.bind(address)
            listener.listen()
        expect_no_gain(court, court.run(act(SOCKETS), sockets=[place, abstract]))
        expect_no_gain(court, court.run(act(FIFO), fifo=fifo))
    with socket.create_server(("127.0.0.1", 0)) as server:
        expect_no_gain(court, court.run(act(INTERNET), port=server.getsockname()[1]))
    os.close(reader)


def test_data_behind_a_link_is_not_there(sandboxed: None, court: Court) -> None:
    link = court.folder / "link"
    link.symlink_to(court.data)
    there = replace(court, data=str(link))
    expect_no_gain(court, there.run(act(LINKED), link=str(link), data=str(Path(court.data).resolve())))


def test_what_the_digest_leaves_out_is_not_there(sandboxed: None, court: Court) -> None:
    folder = submission(court.folder / "hostile", act("""
here = Path(__file__).parent
assert sorted(os.listdir(here)) == ["agent.py", "submission.toml"], os.listdir(here)
"""))  # fmt: skip
    for name in ("__pycache__", ".git"):
        (folder / name).mkdir()
        (folder / name / "agent.py").write_text("raise RuntimeError")
    found = run_isolated(folder, court.card, {"data": court.data}, SCENE, parameters={}, limits=QUICK)
    expect_no_gain(court, found)


LEAVES = (
    SYSTEM
    + """
if self.frame == 0:
    for write in (lambda: call(248, b"user", b"left", b"x", 1, -3), lambda: call(248, b"user", b"left", b"x", 1, -4),
                  lambda: call(29, 4711, 4096, 0o1666), lambda: Path("left").write_text("x"),
                  lambda: Path("/dev/shm/left").write_text("x"), lambda: Path("/submission/left").write_text("x"),
                  lambda: Path("/kernels/left").write_text("x"), lambda: os.fork() or time.sleep(4711)):
        try:
            self.given["leave"] and write()
        except OSError:
            continue
"""
)
FINDS = (
    SYSTEM
    + """
assert call(249, b"user", b"left", None, 0) == -1, "found a key"
assert call(29, 4711, 4096, 0) == -1, "found shared memory"
for place in ("left", "/dev/shm/left", "/submission/left", "/kernels/left"):
    assert not os.path.exists(place), f"found {place}"
"""
)


def test_nothing_is_left_for_the_next_run(sandboxed: None, court: Court) -> None:
    court.run(act(LEAVES), leave=True)
    expect_no_gain(court, court.run(act(FINDS)))


HOARDS = {
    "threads": """
import threading
for _ in range(1500):
    threading.Thread(target=time.sleep, args=(4711,), daemon=True).start()
""",
    "shared memory": """
import mmap
self.hoard = [mmap.mmap(-1, 1 << 26) for _ in range(20)]
for part in self.hoard:
    part.write(bytes(1 << 26))
""",
    "names": """
for i in range(200_000):
    Path(f"{i}").touch()
""",
}


@pytest.mark.parametrize("grouped", [True, False], ids=["cgroup", "watch"])
@pytest.mark.parametrize("what", HOARDS)
def test_hoards_count(sandboxed: None, court: Court, what: str, grouped: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    if not grouped:
        monkeypatch.setattr("mtp_bench.judge.gateway.processes.make_group", lambda *_: Group(()))
    limits = QUICK if what == "threads" else type(QUICK)(**{**vars(QUICK), "memory": 1 << 30})
    code = (
        "if self.frame == 1:\n"
        + "\n".join(f"    {line}" for line in HOARDS[what].strip().splitlines())
        + "\n    time.sleep(2)"
    )
    found = court.run(act(code), limits)
    assert found.status in ("crashed", "rejected"), found
    assert court.error(found.rollout) > court.error(court.honest())


def test_its_name_says_nothing_of_its_memory(sandboxed: None, court: Court) -> None:
    code = "import ctypes\nctypes.CDLL(None).prctl(15, b'VmHWM: 1', 0, 0, 0)"
    found = court.run(act(code))
    assert found.status == "finished", found
    assert found.peak_memory > 10 << 20


HEADERS = {
    "huge and empty": [["track_box", "<f4", [2**39, 0, 2**39]]],
    "huge": [["track_box", "<f4", [2**39, 2**39]]],
    "another field": [["weights", "<f8", [0]]],
    "twice": [["track_id", "<i8", [0]], ["track_id", "<i8", [0]]],
    "deep": [[[[[["x"]]]]]],
    "many": [["track_id", "<i8", [0]]] * 70,
    "not a name": [[{"a": 1}, "<i8", [0]]],
}


@pytest.mark.parametrize("entries", HEADERS.values(), ids=HEADERS)
def test_a_header_costs_its_scene_and_never_the_run(court: Court, entries: object) -> None:
    """It is read outside of the cell, whoever made that."""
    code = f"""
import json
header = dict(sys._getframe(1).f_locals["header"])
reply = {{name: header[name] for name in ("frame", "token")}}
text = json.dumps({{"kind": "answer", **reply, "arrays": {entries!r}}}).encode()
os.write(int(sys.argv[2]), sys.modules["mtp_bench_wire"].PREFIX.pack(len(text), 0) + text)
time.sleep(0.2)
"""
    found = court.run(act(code))
    assert found.status == "rejected" or found.malformed
    assert court.error(found.rollout) > court.error(court.honest())


def test_half_a_letter_in_its_last_words_is_no_trouble(sandboxed: None, court: Court) -> None:
    found = court.run(act("raise ValueError('\\\\ud800 \\\\x1b[31m red')"))
    assert found.status == "crashed"
    assert "red" in found.reason
    found.reason.encode()
    assert found.reason.isprintable()


CONTROLS: dict[str, tuple[str, str]] = {
    "secret": (SEARCH.replace('os.walk("/"', 'os.walk(self.given["folder"]'), "read the secret"),
    "socket": (SOCKETS, "told somebody"),
    "judge": (LIBRARY, "has the judge's scoring"),
    "devices": (DEVICES, "null"),
    "processes": (PROCESSES, "sees processes"),
    "calls": (CALLS, "may call"),
    "links": (LINKED, "sees the data"),
}


@pytest.mark.parametrize("name", CONTROLS)
def test_the_tricks_work_where_nothing_holds_them(loose: None, court: Court, secret: str, name: str) -> None:
    code, said = CONTROLS[name]
    place = str(court.folder / "s")
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(place)
        listener.listen()
        threading.Thread(target=_accept, args=(listener,), daemon=True).start()
        given: dict[str, Any] = {
            "secret": secret, "sockets": [place], "folder": str(court.folder), "link": court.data, "data": court.data,
        }  # fmt: skip
        found = court.run(act(code), **given)
    assert found.status == "crashed"
    assert said in found.reason
    assert not found.isolation.sandboxed


def _accept(listener: socket.socket) -> None:
    with suppress(OSError):
        listener.accept()[0].close()


def test_where_nothing_can_be_filtered_nothing_holds(court: Court, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mtp_bench.judge.gateway.sandbox.system_call_filter", lambda: None)
    assert sandbox_backend.__wrapped__() == "none"
    assert system_call_filter()
    monkeypatch.setattr(run, "sandbox_backend", lambda: "none")
    found = court.run(HONEST)
    assert digest(found.rollout) == digest(court.honest())
    assert not found.isolation.sandboxed
