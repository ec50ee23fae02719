"""A network in an agent: NumPy alone, once per frame over the distinct windows of all tracks; and its file of weights.

A file holds safetensors with a model card; nothing in it is executed when it is read. It is searched for in the user's
folder, then among those that ship, which are packed.
"""

import json
import lzma
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...agent import Forecasts, Frame
from ...core import (
    PACKED,
    SHIPPED,
    SubmissionError,
    Task,
    file_name,
    open_regular,
    parse_json,
    states_of,
    weights_folder,
    whole_file,
)
from ..windows import shown_as_truth, surroundings_of, windows_of
from .around import detections_of_tracks
from .local import Arrays, to_absolute
from .network import Network, Sizes, network_of, require_lanes

_FILTERS = [
    {
        "id": lzma.FILTER_LZMA2,
        "preset": 9 | lzma.PRESET_EXTREME,
        "lc": 0,
        "lp": 1,
        "pb": 1,
    }
]  # pairs of bytes
FORMAT = "mtp-bench weights 1"
MOST_BYTES = 64 * 2**20  # of a file: more than any network here has
ASSOCIATIONS = ("network", "track")


@dataclass(frozen=True, eq=False)
class StoredWeights:
    """Content of a file of weights."""

    weights: Arrays  # float32
    network: str
    sizes: Sizes
    card: Mapping[
        str, Any
    ]  # how they were trained, see `training.predictors.model_card`


def find_weights(network: str, on: str, task: Task) -> Path:
    """The file for a task: of its env, else of the env whose weights serve here too.

    Raises SubmissionError, with the command that makes the file, if it is missing.
    """
    for env_id in filter(None, (task.env_id, task.weights_of)):
        name = file_name(network, on, env_id)
        for path in (weights_folder() / name, SHIPPED / f"{name}{PACKED}"):
            if path.is_file():
                return path
    (state,) = states_of([f"{network}-{on}"], task.env_id, task.weights_of)
    how = (
        state.command
        if state.minutes is None
        else f"{state.command} (about {state.minutes} min on two cores)"
    )
    raise SubmissionError(
        f"{task.env_id}: no weights {file_name(network, on, task.env_id)} in {weights_folder()}, and none ship; train "
        f"them: {how}"
    )


def write_weights(path: Path, stored: StoredWeights) -> None:
    """Write weights in half precision, as a whole or not at all. Raises OSError.

    A file that ends in ".xz", as those that ship, is compressed, and its numbers are rounded to 7 bits of the fraction,
    as in bfloat16: two thirds of the size.
    """
    from safetensors.numpy import save

    content = {
        "format": FORMAT,
        "network": stored.network,
        "sizes": asdict(stored.sizes),
        "card": stored.card,
    }
    halves = {
        name: np.asarray(value, dtype=np.float16)
        for name, value in sorted(stored.weights.items())
    }
    if path.suffix == PACKED:
        halves = {name: rounded(value) for name, value in halves.items()}
    data = save(halves, {"mtp_bench": json.dumps(content, sort_keys=True)})
    with whole_file(path) as part:
        part.write_bytes(
            lzma.compress(data, filters=_FILTERS) if path.suffix == PACKED else data
        )


def rounded(values: NDArray[np.float16]) -> NDArray[np.float16]:
    """The nearest numbers whose last three bits are 0, ties to even; finite ones stay finite."""
    bits = values.view(np.uint16).astype(np.uint32)
    near = (bits + 3 + (bits >> 3 & 1)) & ~np.uint32(7)
    infinite = (near & 0x7C00) == 0x7C00
    return (
        np.where(infinite, bits & ~np.uint32(7), near)
        .astype(np.uint16)
        .view(np.float16)
    )


def read_weights(path: Path, network: Network) -> StoredWeights:
    """The weights of ``network`` in a file; raises SubmissionError, naming what was got and what was expected."""
    tensors, content = _read_tensors(path)
    found = content.get("network")
    if content.get("format") != FORMAT or found != network.name:
        raise SubmissionError(
            f"{path}: weights of {found!r}, expected {network.name!r} in format {FORMAT!r}"
        )
    card = content.get("card", {})
    if not isinstance(card, dict):
        raise SubmissionError(
            f"{path}: its card is {type(card).__name__}, expected a table"
        )
    try:
        sizes = Sizes(
            **{**content["sizes"], "classes": tuple(content["sizes"]["classes"])}
        )
        shapes = network.shapes(sizes)
    except (KeyError, TypeError, ValueError) as error:
        raise SubmissionError(f"{path}: does not state its sizes ({error})") from None
    got = {name: value.shape for name, value in tensors.items()}
    for name in sorted(shapes.keys() | got.keys()):
        if shapes.get(name) != got.get(name):
            raise SubmissionError(
                f"{path}: {name} is {got.get(name, 'missing')}, expected {shapes.get(name, 'no such array')}"
            )
    for name, value in tensors.items():
        if not np.isfinite(value).all():
            raise SubmissionError(f"{path}: {name} holds numbers that are not finite")
    return StoredWeights(tensors, network.name, sizes, card)


def require_fit(sizes: Sizes, task: Task, path: Path) -> None:
    """Raise SubmissionError unless weights of these sizes, in the file ``path``, are made for the task."""
    expected = Sizes.of(task)
    for class_name in expected.classes:
        if class_name not in sizes.classes:
            known = ", ".join(sizes.classes)
            raise SubmissionError(
                f"{path}: made for {known}, but {task.env_id} has the class {class_name!r}"
            )
    for name in ("past", "future", "dt"):
        if getattr(sizes, name) != getattr(expected, name):
            raise SubmissionError(
                f"{path}: made for {name} {getattr(sizes, name)}, but {task.env_id} has {getattr(expected, name)}"
            )


def _read_tensors(path: Path) -> tuple[Arrays, dict[str, Any]]:
    """Arrays, float32, and the metadata of a file."""
    from safetensors import SafetensorError
    from safetensors.numpy import load

    try:
        content = _read_bytes(path)
        arrays = {
            name: value.astype(np.float32) for name, value in load(content).items()
        }
        header = json.loads(content[8 : 8 + int.from_bytes(content[:8], "little")])
        metadata = header.get("__metadata__", {}).get("mtp_bench", "{}")
        return arrays, parse_json(metadata, str(path), SubmissionError)
    except (
        OSError,
        lzma.LZMAError,
        SafetensorError,
        ValueError,
        TypeError,
        KeyError,
    ) as error:
        raise SubmissionError(f"{path}: not a file of weights ({error})") from None


def _read_bytes(path: Path) -> bytes:
    """The unpacked content of a file."""
    with open_regular(path) as stream:  # a FIFO would wait for ever
        size = os.fstat(stream.fileno()).st_size
        content = stream.read(MOST_BYTES)
    if path.suffix == PACKED:
        content = lzma.LZMADecompressor(lzma.FORMAT_XZ).decompress(
            content, MOST_BYTES + 1
        )
        size = len(content)
    if size > MOST_BYTES:
        raise SubmissionError(f"{path}: {size} bytes, expected at most {MOST_BYTES}")
    return content


class LearnedPredictor:
    """Forecasts of a trained network.

    ``network``: its name, such as "modes". ``on``: what it was trained on, "truth" or "tracklets". ``weights``: your
    own file; None: the one for the task's env, see `find_weights`. ``association``: of a
    network that finds the object among the detections around it; "network": its input is all of them, "track": only
    those that the track took, as in a pipeline that tracks first.

    A network that was trained on ground-truth tracks gets all tracks in that form, with score 1 and no count of frames
    before the window: it has never seen another score, and its answer to one is arbitrary.

    Raises SubmissionError for an ``association`` that the network lacks, and at ``reset`` if no file fits the task, or
    if the network reads lanes and the task shows none.
    """

    def __init__(
        self,
        network: str = "modes",
        on: str = "truth",
        weights: str | Path | None = None,
        association: str = "network",
    ) -> None:
        if association not in ASSOCIATIONS:
            raise SubmissionError(
                f"association is {association!r}, expected one of: {', '.join(ASSOCIATIONS)}"
            )
        self._network, self._by_track = network_of(network), association == "track"
        if self._by_track and not self._network.around:
            raise SubmissionError(
                f"association is 'track', expected 'network' for network {network!r}: its input is always the track"
            )
        self._on, self._given = on, None if weights is None else Path(weights)

    def reset(self, task: Task) -> None:
        """Begin a new scene."""
        require_lanes(self._network, task.env_id, task.lanes > 0)
        path = self._given or find_weights(self._network.name, self._on, task)
        stored = _read(
            path, path.stat().st_mtime_ns if path.is_file() else 0, self._network.name
        )
        require_fit(stored.sizes, task, path)
        self._stored, self._as_truth = stored, stored.card.get("on") == "truth"
        self._class = np.array(
            [stored.sizes.classes.index(name) for name in task.classes]
        )

    def predict(self, frame: Frame) -> Forecasts:
        """Forecasts of the distinct windows of ``frame``."""
        sizes = self._stored.sizes
        windows, row = windows_of(frame, sizes.past)
        if len(windows) == 0:
            return Forecasts(np.zeros((0, sizes.modes, sizes.future, 2)), row=row)
        seen = surroundings_of(frame.seen)
        windows = replace(windows, class_id=self._class[windows.class_id])
        seen = replace(seen, class_id=self._class[seen.class_id])
        if self._as_truth:
            windows, seen = (
                shown_as_truth(windows),
                replace(seen, score=np.ones_like(seen.score)),
            )
        moment = np.full(len(windows), seen.frames - 1)
        if self._by_track:
            seen, moment = detections_of_tracks(windows, moment, seen)
        output = self._network.forward(
            self._stored.weights,
            self._network.inputs(windows, moment, seen, sizes),
            sizes,
        )
        present = (
            to_absolute(windows, output["present"])
            if self._stored.card.get("present")
            else None
        )
        return Forecasts(
            to_absolute(windows, output["modes"]),
            output["log_weight"],
            present,
            row=row,
        )


@lru_cache(maxsize=4)  # an agent begins many scenes with the same file
def _read(path: Path, changed: int, network: str) -> StoredWeights:
    """The weights of a file that was ``changed`` last at this time, ns."""
    return read_weights(path, network_of(network))
