"""Agent's side of the gateway: answers to the judge's orders over two pipes.

Started as a script, for one agent or as the fork server of many: `fork_server_main`,
whose forks call `main`. Only the library's own code runs here before the code of the
submission is imported.
"""

import ctypes
import importlib.util
import json
import os
import platform
import signal
import struct
import sys
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

_PREFIX = struct.Struct("<IQ")  # as in wire.py, which needs numpy
_SITE = ("site-packages", "dist-packages")
_MAX_ERROR = 2000  # characters of a message to the judge
_MAX_MALFORMED = 200  # characters of the reason why an answer is malformed
_PDEATHSIG = 1  # of prctl
_KEYCTL = {"x86_64": 250, "aarch64": 219}  # number of the call
_JOIN_SESSION_KEYRING = 1  # of keyctl


def main(orders: int, answers: int) -> None:
    """Take orders from one descriptor and answer into the other."""
    setup = json.loads(_read(orders)[0])
    if setup["unsandboxed"] is not None:
        end_with(setup["unsandboxed"]["judge"])
        join_new_keyring()
        for members in setup["unsandboxed"]["groups"]:
            Path(members).write_text("0")  # this process
    _limit(setup["limits"])
    prepare(setup)
    _serve(orders, answers, setup)


def prepare(setup: dict[str, Any]) -> None:
    """Make the library and the compiled kernels importable."""
    _link_kernels(setup["kernels"], os.environ["NUMBA_CACHE_DIR"])
    # the judge's copy of the library comes after the standard library, and installed
    # packages come last
    is_site = [entry.endswith(_SITE) for entry in sys.path]
    library, *packages = setup["path"]
    if library not in sys.path:
        sys.path.insert([*is_site, True].index(True), library)
    sys.path += [entry for entry in packages if entry not in sys.path]


def end_with(parent: int | None) -> None:
    """Ask Linux to kill this process when its parent ends.

    Exit if the parent is no longer ``parent``; None: any other serves too.
    """
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PDEATHSIG, int(signal.SIGKILL), 0, 0, 0)
        if parent is not None and os.getppid() != parent:
            sys.exit()


def join_new_keyring() -> None:
    """Enter a new session keyring, since keys outlive a process.

    Only on processors whose call number is known.
    """
    if sys.platform == "linux" and platform.machine() in _KEYCTL:
        number = ctypes.c_long(_KEYCTL[platform.machine()])
        ctypes.CDLL(None).syscall(number, _JOIN_SESSION_KEYRING, None)


def module_beside(name: str) -> Any:
    """Load a module of this folder without its package."""
    path = Path(__file__).with_name(f"{name}.py")
    spec: Any = importlib.util.spec_from_file_location(f"mtp_bench_{name}", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def _serve(orders: int, answers: int, setup: dict[str, Any]) -> None:
    stage = "the agent cannot be built"
    try:
        wire = module_beside("wire")
        # a script has no package: imports are absolute
        from mtp_bench.agent import load_submission
        from mtp_bench.core import Task

        agent: Any = None
        while True:
            text, body = _read(orders)
            header = wire.header_of(text)
            match header["kind"]:
                case "build":
                    task = _task(Task, header["task"])
                    agent = load_submission(setup["submission"]).build(
                        task, **setup["parameters"]
                    )
                    _send(answers, {"kind": "built"})
                case "reset":
                    stage = "reset failed"
                    agent.reset(_task(Task, header["task"]))
                    _send(answers, {"kind": "ready"})
                case _:
                    stage = f"frame {header['frame']} failed"
                    action = agent.act(wire.arrays_of(header, body))
                    _write(answers, _answer_message(wire, header, action))
    except EOFError:
        return
    except BaseException as error:
        message = f"{stage}: {_error_text(error)}"
        _send(answers, {"kind": "error", "text": message[:_MAX_ERROR]})


def _answer_message(wire: Any, order: dict[str, Any], action: object) -> bytes:
    """Return the message of an answer to an order of the judge.

    If the answer cannot be sent, the message has no arrays, but says why.
    """
    reply = {"kind": "answer", "frame": order["frame"], "token": order["token"]}
    arrays = {}
    if isinstance(action, Mapping):
        for name in order["fields"]:
            if name in action:
                arrays[name] = wire.as_numbers(action[name])
        size = sum(array.nbytes for array in arrays.values() if array is not None)
        if size > order["most"]:
            arrays = {}
            text = f"an answer of {size} bytes, expected at most {order['most']}"
            reply["malformed"] = text
    else:
        text = f"act() returned {type(action).__name__}, expected a dict of arrays"
        reply["malformed"] = text[:_MAX_MALFORMED]
    message: bytes = wire.encode(reply, arrays)
    return message


def _error_text(error: BaseException) -> str:
    # by name: the library itself may fail to import
    if any(kind.__name__ == "MtpBenchError" for kind in type(error).__mro__):
        return str(error)
    return f"{type(error).__name__}: {error}"


def _task(task_class: Any, content: dict[str, Any]) -> Any:
    # JSON made a list of the tuple
    return task_class(**{**content, "classes": tuple(content["classes"])})


def _limit(limits: dict[str, int]) -> None:
    """Set limits of the system for this process and its children.

    ``NPROC`` counts the processes and threads of this user: in a user namespace those
    inside it.
    """
    import resource  # not on every system

    for name, value in limits.items():
        kind = getattr(resource, f"RLIMIT_{name}", None)
        if kind is None:
            continue
        hard = resource.getrlimit(kind)[1]
        limit = value
        if hard != resource.RLIM_INFINITY:
            limit = min(value, hard)
        with suppress(OSError, ValueError):
            resource.setrlimit(kind, (limit, limit))


def _link_kernels(source: str | None, target: str) -> None:
    """Link the read-only compiled kernels into a writable folder.

    numba refuses a cache that it cannot write to.
    """
    if source is None:
        return
    for folder, _, names in os.walk(source):
        copy = folder.replace(source, target, 1)
        os.makedirs(copy, exist_ok=True)  # noqa: PTH103  (paths as text are faster)
        for name in names:
            os.symlink(f"{folder}/{name}", f"{copy}/{name}")  # noqa: PTH211


def _read(descriptor: int) -> tuple[bytearray, bytearray]:
    """Return header and body of the next message."""
    header_bytes, body_bytes = _PREFIX.unpack(_read_exactly(descriptor, _PREFIX.size))
    header = _read_exactly(descriptor, header_bytes)
    return header, _read_exactly(descriptor, body_bytes)


def _read_exactly(descriptor: int, size: int) -> bytearray:
    content = bytearray(size)
    view = memoryview(content)
    position = 0
    while position < size:
        count = os.readv(descriptor, [view[position:]])
        if count == 0:
            raise EOFError
        position += count
    return content


def _send(descriptor: int, header: dict[str, Any]) -> None:
    text = json.dumps({**header, "arrays": []}).encode()
    _write(descriptor, _PREFIX.pack(len(text), 0) + text)


def _write(descriptor: int, message: bytes) -> None:
    view = memoryview(message)
    while view:
        view = view[os.write(descriptor, view) :]


if __name__ == "__main__":
    if sys.argv[1] == "fork-server":
        module_beside("fork_server_main").main(
            sys.modules[__name__], json.loads(sys.argv[2]), int(sys.argv[3])
        )
    else:
        main(int(sys.argv[1]), int(sys.argv[2]))
