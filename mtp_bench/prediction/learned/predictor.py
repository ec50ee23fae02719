"""A network in an agent, and its file of weights.

The network runs with NumPy alone, once per frame over the distinct windows of all
tracks. A file of weights holds safetensors with a model card; nothing in it is executed
when it is read. It is searched for in the user's folder, then among those that ship,
which are packed.
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
    PACKED_SUFFIX,
    SHIPPED_WEIGHTS,
    SubmissionError,
    Task,
    file_name,
    open_regular,
    parse_json,
    states_of,
    weights_folder,
    whole_file,
)
from ..windows import Arrays, shown_as_truth, surroundings_of, to_absolute, windows_of
from .around import detections_of_tracks
from .network import Network, Sizes, network_of, require_lanes

# numbers are pairs of bytes
_XZ_FILTER = {
    "id": lzma.FILTER_LZMA2,
    "preset": 9 | lzma.PRESET_EXTREME,
    "lc": 0,
    "lp": 1,
    "pb": 1,
}
_EXPONENT = 0x7C00  # bits of a number in half precision, all 1 in infinity
FORMAT = "mtp-bench weights 1"
MOST_BYTES = 64 * 2**20  # of a file: more than any network here has
ASSOCIATIONS = ("network", "track")


@dataclass(frozen=True, eq=False)
class StoredWeights:
    """Content of a file of weights."""

    weights: Arrays  # float32
    network: str
    sizes: Sizes
    # how they were trained, see `training.predictors`
    card: Mapping[str, Any]


def find_weights(network: str, on: str, task: Task) -> Path:
    """Return the file of the weights for a task.

    It is that of its env, else of the env whose weights it shares. Raises
    SubmissionError, with the command that makes the file, if it is missing.
    """
    for env_id in filter(None, (task.env_id, task.weights_of)):
        name = file_name(network, on, env_id)
        for path in (
            weights_folder() / name,
            SHIPPED_WEIGHTS / f"{name}{PACKED_SUFFIX}",
        ):
            if path.is_file():
                return path
    (state,) = states_of([f"{network}-{on}"], task.env_id, task.weights_of)
    command = state.command
    if state.minutes is not None:
        command += f" (about {state.minutes} min on two cores)"
    missing = file_name(network, on, task.env_id)
    raise SubmissionError(
        f"{task.env_id}: no weights {missing} in {weights_folder()}, and none ship; "
        f"train them: {command}"
    )


def write_weights(path: Path, stored: StoredWeights) -> None:
    """Write weights in half precision, as a whole or not at all.

    Raises OSError. A file that ends in ".xz", as those that ship, is compressed, and
    its numbers are rounded to 7 bits of the fraction, as in bfloat16: two thirds of the
    size.
    """
    from safetensors.numpy import save

    content = {
        "format": FORMAT,
        "network": stored.network,
        "sizes": asdict(stored.sizes),
        "card": stored.card,
    }
    is_packed = path.suffix == PACKED_SUFFIX
    halves = {}
    for name, value in sorted(stored.weights.items()):
        half = np.asarray(value, dtype=np.float16)
        halves[name] = rounded(half) if is_packed else half
    data = save(halves, {"mtp_bench": json.dumps(content, sort_keys=True)})
    if is_packed:
        data = lzma.compress(data, filters=[_XZ_FILTER])
    with whole_file(path) as part:
        part.write_bytes(data)


def rounded(values: NDArray[np.float16]) -> NDArray[np.float16]:
    """Return the nearest numbers whose last three bits are 0.

    Ties go to even. Finite ones stay finite.
    """
    bits = values.view(np.uint16).astype(np.uint32)
    # half of the last bit that is kept, less 1; adding that bit sends ties to even
    nearest = (bits + 3 + (bits >> 3 & 1)) & ~np.uint32(7)
    is_infinite = (nearest & _EXPONENT) == _EXPONENT
    # cut off where rounding up would give infinity
    rounded_bits = np.where(is_infinite, bits & ~np.uint32(7), nearest)
    return rounded_bits.astype(np.uint16).view(np.float16)


def read_weights(path: Path, network: Network) -> StoredWeights:
    """Read the weights of ``network`` from a file.

    Raises SubmissionError, naming what was got and what was expected.
    """
    tensors, content = _read_tensors(path)
    name = content.get("network")
    if content.get("format") != FORMAT or name != network.name:
        raise SubmissionError(
            f"{path}: weights of {name!r}, "
            f"expected {network.name!r} in format {FORMAT!r}"
        )
    card = content.get("card", {})
    if not isinstance(card, dict):
        raise SubmissionError(
            f"{path}: its card is {type(card).__name__}, expected a table"
        )
    try:
        classes = tuple(content["sizes"]["classes"])
        sizes = Sizes(**{**content["sizes"], "classes": classes})
        shapes = network.shapes(sizes)
    except (KeyError, TypeError, ValueError) as error:
        raise SubmissionError(f"{path}: does not state its sizes ({error})") from None
    for name in sorted(shapes.keys() | tensors.keys()):
        shape = tensors[name].shape if name in tensors else "missing"
        expected = shapes.get(name, "no such array")
        if shape != expected:
            raise SubmissionError(f"{path}: {name} is {shape}, expected {expected}")
    for name, value in tensors.items():
        if not np.isfinite(value).all():
            raise SubmissionError(f"{path}: {name} holds numbers that are not finite")
    return StoredWeights(tensors, network.name, sizes, card)


def require_fit(sizes: Sizes, task: Task, path: Path) -> None:
    """Raise SubmissionError unless weights of these sizes fit the task.

    ``path``: their file.
    """
    expected = Sizes.of(task)
    for class_name in expected.classes:
        if class_name not in sizes.classes:
            raise SubmissionError(
                f"{path}: made for {', '.join(sizes.classes)}, "
                f"but {task.env_id} has the class {class_name!r}"
            )
    for name in ("past", "future", "dt"):
        size = getattr(sizes, name)
        task_size = getattr(expected, name)
        if size != task_size:
            raise SubmissionError(
                f"{path}: made for {name} {size}, but {task.env_id} has {task_size}"
            )


def _read_tensors(path: Path) -> tuple[Arrays, dict[str, Any]]:
    """Read the arrays, float32, and the metadata of a file."""
    from safetensors import SafetensorError
    from safetensors.numpy import load

    unreadable = (
        OSError,
        lzma.LZMAError,
        SafetensorError,
        ValueError,
        TypeError,
        KeyError,
    )
    try:
        content = _read_bytes(path)
        arrays = {
            name: value.astype(np.float32) for name, value in load(content).items()
        }
        header_size = int.from_bytes(content[:8], "little")
        header = json.loads(content[8 : 8 + header_size])
        metadata = header.get("__metadata__", {}).get("mtp_bench", "{}")
        return arrays, parse_json(metadata, str(path), SubmissionError)
    except unreadable as error:
        raise SubmissionError(f"{path}: not a file of weights ({error})") from None


def _read_bytes(path: Path) -> bytes:
    """Read the unpacked content of a file."""
    with open_regular(path) as stream:  # a FIFO would wait for ever
        size = os.fstat(stream.fileno()).st_size
        content = stream.read(MOST_BYTES)
    if path.suffix == PACKED_SUFFIX:
        decompressor = lzma.LZMADecompressor(lzma.FORMAT_XZ)
        content = decompressor.decompress(content, MOST_BYTES + 1)
        size = len(content)
    if size > MOST_BYTES:
        raise SubmissionError(f"{path}: {size} bytes, expected at most {MOST_BYTES}")
    return content


class LearnedPredictor:
    """Forecasts of a trained network.

    Args:
        network: its name, such as "modes".
        on: what it was trained on, "truth" or "tracklets".
        weights: your own file; None: the one for the task's env, see `find_weights`.
        association: of a network that finds the object among the detections around it.
            With "network" its input is all of them, with "track" only those that the
            track took, as in a pipeline that tracks first.

    A network that was trained on ground-truth tracks gets all tracks in that form, with
    score 1 and no count of frames before the window. It has never seen another score,
    and its answer to one is arbitrary.

    Raises SubmissionError for an ``association`` that the network lacks, and at
    ``reset`` if no file fits the task, or if the network reads lanes and the task shows
    none.
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
                f"association is {association!r}, "
                f"expected one of: {', '.join(ASSOCIATIONS)}"
            )
        self._network = network_of(network)
        self._by_track = association == "track"
        if self._by_track and not self._network.around:
            raise SubmissionError(
                "association is 'track', expected 'network' for network "
                f"{network!r}: its input is always the track"
            )
        self._trained_on = on
        self._weights_path = None if weights is None else Path(weights)

    def reset(self, task: Task) -> None:
        """Begin a new scene."""
        network = self._network
        require_lanes(network, task.env_id, task.lanes > 0)
        path = self._weights_path
        if path is None:
            path = find_weights(network.name, self._trained_on, task)
        changed_ns = path.stat().st_mtime_ns if path.is_file() else 0
        stored = _read(path, changed_ns, network.name)
        require_fit(stored.sizes, task, path)
        self._stored = stored
        self._as_truth = stored.card.get("on") == "truth"
        class_ids = [stored.sizes.classes.index(name) for name in task.classes]
        # [C] class of the weights for each class of the task
        self._class_of_weights = np.array(class_ids)

    def predict(self, frame: Frame) -> Forecasts:
        """Forecast the distinct windows of ``frame``."""
        stored = self._stored
        sizes = stored.sizes
        windows, row = windows_of(frame, sizes.past)
        if len(windows) == 0:
            return Forecasts(np.zeros((0, sizes.modes, sizes.future, 2)), row=row)
        surroundings = surroundings_of(frame.seen)
        windows = replace(windows, class_id=self._class_of_weights[windows.class_id])
        surroundings = replace(
            surroundings, class_id=self._class_of_weights[surroundings.class_id]
        )
        if self._as_truth:
            windows = shown_as_truth(windows)
            surroundings = replace(surroundings, score=np.ones_like(surroundings.score))
        moment = np.full(len(windows), surroundings.frames - 1)
        if self._by_track:
            surroundings, moment = detections_of_tracks(windows, moment, surroundings)
        inputs = self._network.inputs(windows, moment, surroundings, sizes)
        output = self._network.forward(stored.weights, inputs, sizes)
        modes = to_absolute(windows, output["modes"])
        present = None
        if stored.card.get("present"):
            present = to_absolute(windows, output["present"])
        return Forecasts(modes, output["log_weight"], present, row=row)


@lru_cache(maxsize=4)  # an agent begins many scenes with the same file
def _read(path: Path, changed_ns: int, network: str) -> StoredWeights:
    """Read weights once per modification.

    ``changed_ns``: its time, a key of the cache.
    """
    return read_weights(path, network_of(network))
