"""The agent's side of the gateway: answers the judge's orders over two pipes.

Started as a script, for one agent or as the fork server of many: `fork_server_main`, whose forks call `main`. Only the
library's own code runs here before the code of the submission is imported.
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
_PDEATHSIG = 1  # of prctl
_KEYCTL, _JOIN_SESSION_KEYRING = {"x86_64": 250, "aarch64": 219}, 1


def main(orders: int, answers: int) -> None:
    """Take orders from one descriptor and answer into the other until the judge closes it."""
    setup = json.loads(_read(orders)[0])
    if setup["unsandboxed"] is not None:
        end_with(setup["unsandboxed"]["judge"])
        join_new_keyring()
        for members in setup["unsandboxed"]["groups"]:
            Path(members).write_text("0")
    _limit(setup["limits"])
    prepare(setup)
    _serve(orders, answers, setup)


def prepare(setup: dict[str, Any]) -> None:
    """Make the library and the compiled kernels importable."""
    _link_kernels(setup["kernels"], os.environ["NUMBA_CACHE_DIR"])
    # the judge's copy of the library after the standard library, and installed packages at the end
    first = next(
        (i for i, entry in enumerate(sys.path) if entry.endswith(_SITE)), len(sys.path)
    )
    sys.path[first:first] = [
        entry for entry in setup["path"][:1] if entry not in sys.path
    ]
    sys.path += [entry for entry in setup["path"][1:] if entry not in sys.path]


def end_with(parent: int | None) -> None:
    """Ask Linux to kill this process when its parent ends; exit if it is no longer ``parent``."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PDEATHSIG, int(signal.SIGKILL), 0, 0, 0)
        if parent is not None and os.getppid() != parent:
            sys.exit()


def join_new_keyring() -> None:
    """Enter a new session keyring, since keys outlive a process; only on processors whose call number is known."""
    if sys.platform == "linux" and platform.machine() in _KEYCTL:
        number = ctypes.c_long(_KEYCTL[platform.machine()])
        ctypes.CDLL(None).syscall(number, _JOIN_SESSION_KEYRING, None)


def module_beside(name: str) -> Any:
    """A module of this folder without its package, which belongs to the judge."""
    path = Path(__file__).with_name(f"{name}.py")
    spec: Any = importlib.util.spec_from_file_location(f"mtp_bench_{name}", path)
    sys.modules[spec.name] = module = importlib.util.module_from_spec(spec)
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
                    reply = {
                        "kind": "answer",
                        "frame": header["frame"],
                        "token": header["token"],
                    }
                    _write(
                        answers,
                        _answer_message(
                            wire, reply, action, header["fields"], header["most"]
                        ),
                    )
    except EOFError:
        return
    except BaseException as error:
        _send(
            answers, {"kind": "error", "text": f"{stage}: {_error_text(error)}"[:2000]}
        )


def _answer_message(
    wire: Any, reply: dict[str, Any], action: object, fields: list[str], most: int
) -> bytes:
    """The message of an answer; without arrays, and with the reason, if it cannot be sent."""
    arrays, malformed = {}, ""
    if isinstance(action, Mapping):
        arrays = {name: wire.plain(action[name]) for name in fields if name in action}
        size = sum(array.nbytes for array in arrays.values() if array is not None)
        if size > most:
            malformed = f"an answer of {size} bytes, expected at most {most}"
    else:
        malformed = (
            f"act() returned {type(action).__name__}, expected a dict of arrays"[:200]
        )
    message: bytes = (
        wire.encode({**reply, "malformed": malformed})
        if malformed
        else wire.encode(reply, arrays)
    )
    return message


def _error_text(error: BaseException) -> str:
    # by name: the library itself may fail to import
    known = any(kind.__name__ == "MtpBenchError" for kind in type(error).__mro__)
    return str(error) if known else f"{type(error).__name__}: {error}"


def _task(make: Any, content: dict[str, Any]) -> Any:
    return make(**{**content, "classes": tuple(content["classes"])})


def _limit(limits: dict[str, int]) -> None:
    """Set limits of the system for this process and those that it starts, which cannot raise them again.

    ``NPROC`` counts the processes and threads of this user: in a user namespace those inside it.
    """
    import resource  # not on every system

    for name, value in limits.items():
        kind = getattr(resource, f"RLIMIT_{name}", None)
        if kind is None:
            continue
        hard = resource.getrlimit(kind)[1]
        least = value if hard == resource.RLIM_INFINITY else min(value, hard)
        with suppress(OSError, ValueError):
            resource.setrlimit(kind, (least, least))


def _link_kernels(source: str | None, target: str) -> None:
    """Link the read-only compiled kernels into a writable folder: numba refuses a cache that it cannot write to."""
    for folder, _, names in os.walk(source) if source else ():
        own = folder.replace(str(source), target, 1)
        os.makedirs(own, exist_ok=True)  # noqa: PTH103  (paths as text are faster)
        for name in names:
            os.symlink(f"{folder}/{name}", f"{own}/{name}")  # noqa: PTH211


def _read(descriptor: int) -> tuple[bytearray, bytearray]:
    header, body = _PREFIX.unpack(_read_exactly(descriptor, _PREFIX.size))
    return _read_exactly(descriptor, header), _read_exactly(descriptor, body)


def _read_exactly(descriptor: int, size: int) -> bytearray:
    content = bytearray(size)
    view, position = memoryview(content), 0
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
