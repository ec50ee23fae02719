"""The agent's side of the gateway: started as a script, shut in, with two descriptors.

Until the code of the submission is imported, all that runs here is the library's own.
"""

from __future__ import annotations

import importlib.util
import json
import os
import struct
import sys
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

_PREFIX = struct.Struct("<IQ")  # as in wire.py, which needs numpy
_SITE = ("site-packages", "dist-packages")


def main(orders: int, answers: int) -> None:
    """Take orders from one descriptor and answer into the other until there are none."""
    setup = json.loads(_read(orders)[0])
    _limit(setup["limits"])
    prepare(setup)
    _serve(orders, answers, setup)


def prepare(setup: dict[str, Any]) -> None:
    """Find the library, and the kernels that are compiled already."""
    _link_kernels(setup["kernels"], os.environ["NUMBA_CACHE_DIR"])
    _extend_path(setup["path"])


def _serve(orders: int, answers: int, setup: dict[str, Any]) -> None:
    where = "the agent cannot be built"
    try:
        wire = _wire()
        from mtp_bench import Task, load_submission

        agent: Any = None
        while True:
            text, body = _read(orders)
            header = wire.header_of(text)
            match header["kind"]:
                case "build":
                    task = _task(Task, header["task"])
                    agent = load_submission(setup["submission"]).build(task, **setup["parameters"])
                    _say(answers, {"kind": "built"})
                case "reset":
                    where = "reset failed"
                    agent.reset(_task(Task, header["task"]))
                    _say(answers, {"kind": "ready"})
                case _:
                    where = f"frame {header['frame']} failed"
                    action = agent.act(wire.arrays_of(header, body))
                    reply = {"kind": "answer", "frame": header["frame"], "token": header["token"]}
                    _write(answers, _packed(wire, reply, action, header["fields"], header["most"]))
    except EOFError:
        return
    except BaseException as error:
        _say(answers, {"kind": "error", "text": f"{where}: {_text(error)}"[:2000]})


def _wire() -> Any:
    """The module wire.py, alone: its package is the judge's."""
    spec = importlib.util.spec_from_file_location("mtp_bench_wire", Path(__file__).with_name("wire.py"))
    if spec is None or spec.loader is None:
        raise ImportError("wire.py is not there")
    sys.modules[spec.name] = module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _packed(wire: Any, reply: dict[str, Any], action: object, fields: list[str], most: int) -> bytes:
    """The message of an answer; without arrays, and with the reason, where it cannot be sent."""
    arrays, malformed = {}, ""
    if isinstance(action, Mapping):
        arrays = {name: wire.plain(action[name]) for name in fields if name in action}
        size = sum(array.nbytes for array in arrays.values() if array is not None)
        if size > most:
            malformed = f"an answer of {size} bytes, expected at most {most}"
    else:
        malformed = f"act() returned {type(action).__name__}, expected a dict of arrays"[:200]
    message: bytes = wire.encode({**reply, "malformed": malformed}) if malformed else wire.encode(reply, arrays)
    return message


def _text(error: BaseException) -> str:
    known = any(kind.__name__ == "MtpBenchError" for kind in type(error).__mro__)  # the library may not be importable
    return str(error) if known else f"{type(error).__name__}: {error}"


def _task(make: Any, content: dict[str, Any]) -> Any:
    return make(**{**content, "classes": tuple(content["classes"])})


def _limit(limits: dict[str, int]) -> None:
    """Limits of the system for this process and each that it starts; what follows cannot take them back.

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


def _extend_path(path: list[str]) -> None:
    """Find the library where the judge has it, after the standard library and before other packages."""
    first = next((i for i, entry in enumerate(sys.path) if entry.endswith(_SITE)), len(sys.path))
    sys.path[first:first] = [entry for entry in path[:1] if entry not in sys.path]
    sys.path += [entry for entry in path[1:] if entry not in sys.path]


def _link_kernels(source: str | None, target: str) -> None:
    """A cache of compiled kernels that can be written: what is there is linked, what is new is this process's own.

    Numba takes no cache that it cannot write to.
    """
    for folder, _, names in os.walk(source) if source else ():
        own = folder.replace(str(source), target, 1)
        os.makedirs(own, exist_ok=True)  # noqa: PTH103  (paths as text are faster)
        for name in names:
            os.symlink(f"{folder}/{name}", f"{own}/{name}")  # noqa: PTH211


def _read(descriptor: int) -> tuple[bytearray, bytearray]:
    header, body = _PREFIX.unpack(_exactly(descriptor, _PREFIX.size))
    return _exactly(descriptor, header), _exactly(descriptor, body)


def _exactly(descriptor: int, size: int) -> bytearray:
    found = bytearray(size)
    view, at = memoryview(found), 0
    while at < size:
        count = os.readv(descriptor, [view[at:]])
        if count == 0:
            raise EOFError
        at += count
    return found


def _say(descriptor: int, header: dict[str, Any]) -> None:
    text = json.dumps({**header, "arrays": []}).encode()
    _write(descriptor, _PREFIX.pack(len(text), 0) + text)


def _write(descriptor: int, message: bytes) -> None:
    view = memoryview(message)
    while view:
        view = view[os.write(descriptor, view) :]


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
