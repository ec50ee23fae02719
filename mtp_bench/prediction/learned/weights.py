"""Files of weights: safetensors with what they were trained for, read without running anything of them.

A file is looked for where the user said, then in the user's own folder, then among those that ship, which are packed.
"""

from __future__ import annotations

import json
import lzma
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import SubmissionError
from ...files import open_regular, whole_file
from ...networks import file_name, weights_folder
from ...strict import parse_json
from ...types import Task
from .local import Arrays
from .network import Network, Sizes

SHIPPED = Path(__file__).with_name("weights")
PACKED = ".xz"  # end of the names of those that ship
FORMAT = "mtp-bench weights 1"
MOST_BYTES = 64 * 2**20  # of a file: more than any network here has


@dataclass(frozen=True, eq=False)
class Stored:
    """Weights and what is said of them."""

    weights: Arrays  # float32
    network: str
    sizes: Sizes
    card: Mapping[str, Any]  # how they were trained, see `training.predictors.model_card`


def find_weights(network: str, on: str, task: Task) -> Path:
    """The file for a task: its env's own, else that of the env it borrows from.

    Raises SubmissionError that says how to make it, where there is none.
    """
    for env_id in filter(None, (task.env_id, task.weights_of)):
        name = file_name(network, on, env_id)
        for path in (weights_folder() / name, SHIPPED / f"{name}{PACKED}"):
            if path.is_file():
                return path
    raise SubmissionError(
        f"{task.env_id}: no weights {file_name(network, on, task.env_id)} in {weights_folder()}, and none ship; train "
        f"them: mtp-bench train predictor {network} --env {task.weights_of or task.env_id} --on {on}"
    )


def write_weights(path: Path, stored: Stored) -> None:
    """Write weights in half precision, as a whole or not at all. Raises OSError."""
    with whole_file(path) as part:
        part.write_bytes(content_of(stored))


def content_of(stored: Stored) -> bytes:
    """What stands in a file of weights."""
    from safetensors.numpy import save

    said = {"format": FORMAT, "network": stored.network, "sizes": asdict(stored.sizes), "card": stored.card}
    halves = {name: np.asarray(value, dtype=np.float16) for name, value in sorted(stored.weights.items())}
    return save(halves, {"mtp_bench": json.dumps(said, sort_keys=True)})


def read_weights(path: Path, network: Network) -> Stored:
    """The weights of ``network`` in a file, checked.

    Nothing in the file is run. Raises SubmissionError that says what was found and what was expected.
    """
    tensors, said = _content(path)
    found = said.get("network")
    if said.get("format") != FORMAT or found != network.name:
        raise SubmissionError(f"{path}: weights of {found!r}, expected {network.name!r} in the form {FORMAT!r}")
    card = said.get("card", {})
    if not isinstance(card, dict):
        raise SubmissionError(f"{path}: its card is {type(card).__name__}, expected a table")
    try:
        sizes = Sizes(**{**said["sizes"], "classes": tuple(said["sizes"]["classes"])})
        shapes = network.shapes(sizes)
    except (KeyError, TypeError, ValueError) as error:
        raise SubmissionError(f"{path}: does not say what it is made for ({error})") from None
    got = {name: value.shape for name, value in tensors.items()}
    for name in sorted(shapes.keys() | got.keys()):
        if shapes.get(name) != got.get(name):
            raise SubmissionError(
                f"{path}: {name} is {got.get(name, 'missing')}, expected {shapes.get(name, 'no such array')}"
            )
    for name, value in tensors.items():
        if not np.isfinite(value).all():
            raise SubmissionError(f"{path}: {name} holds numbers that are not finite")
    return Stored(tensors, network.name, sizes, card)


def require_fit(sizes: Sizes, task: Task, path: Path) -> None:
    """Raise SubmissionError unless weights of these sizes, in a file, are made for the task."""
    wanted = Sizes.of(task)
    for class_name in wanted.classes:
        if class_name not in sizes.classes:
            known = ", ".join(sizes.classes)
            raise SubmissionError(f"{path}: made for {known}, but {task.env_id} has the class {class_name!r}")
    for name in ("past", "future", "dt"):
        if getattr(sizes, name) != getattr(wanted, name):
            raise SubmissionError(
                f"{path}: made for {name} {getattr(sizes, name)}, but {task.env_id} has {getattr(wanted, name)}"
            )


def _content(path: Path) -> tuple[Arrays, dict[str, Any]]:
    """Arrays, float32, and what the file says of itself."""
    from safetensors import SafetensorError
    from safetensors.numpy import load

    try:
        content = _bytes(path)
        arrays = {name: value.astype(np.float32) for name, value in load(content).items()}
        said = parse_json(_metadata(content).get("mtp_bench", "{}"), str(path), SubmissionError)
    except (OSError, lzma.LZMAError, SafetensorError, ValueError, TypeError, KeyError) as error:
        raise SubmissionError(f"{path}: no file of weights ({error})") from None
    return arrays, said


def _bytes(path: Path) -> bytes:
    """The content of a file, unpacked."""
    with open_regular(path) as stream:  # a FIFO would wait for ever
        size = os.fstat(stream.fileno()).st_size
        content = stream.read(MOST_BYTES)
    if path.suffix == PACKED:
        content = lzma.LZMADecompressor(lzma.FORMAT_XZ).decompress(content, MOST_BYTES + 1)
        size = len(content)
    if size > MOST_BYTES:
        raise SubmissionError(f"{path}: {size} bytes, expected at most {MOST_BYTES}")
    return content


def _metadata(content: bytes) -> dict[str, str]:
    """What a safetensors file, already read without an error, says beside its arrays."""
    header = json.loads(content[8 : 8 + int.from_bytes(content[:8], "little")])
    return dict(header.get("__metadata__", {}))
