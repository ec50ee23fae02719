"""Files of event weights: JSON that a person can read the head of, with the counts of all scenes packed at its end.

Counts of all scenes are packed together, because scenes of one env are alike: half the room of packing each alone.
"""

from __future__ import annotations

import base64
import json
import lzma
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import DataError
from ..files import whole_file
from ..strict import read_json
from .definitions import DEFINITIONS
from .weights import COUNTED, EVENTS, NUMBERS, TEXTS, Reference, SceneWeights, header_of

MOST_BYTES = 64 << 20  # of a file
_MOST_RUNS = 255  # counts are bytes
_MOST_TARGETS = 16 << 20  # of all scenes: what is packed small must not fill the memory
_AGAIN = "freeze it again"


def write_reference(path: str | Path, reference: Reference, secret: bool = False) -> None:
    """Write a reference as JSON with its hash, one line per scene; the file appears complete or not at all.

    ``secret``: nobody else can read it, not even while it is written.
    """
    head = {**header_of(reference), "totals": reference.totals, "hash": reference.digest}
    scenes = [scene for _, scene in sorted(reference.scenes.items())]
    lines = [f"  {json.dumps(key)}: {json.dumps(_said(scene))}" for key, scene in sorted(reference.scenes.items())]
    packed = {name: _packed([getattr(scene, name) for scene in scenes]) for name in ("counts", "stp")}
    tail = "".join(f',\n "{name}": "{text}"' for name, text in packed.items())
    text = json.dumps(head, indent=1)[: -len("\n}")] + ',\n "scenes": {\n' + ",\n".join(lines) + "\n }" + tail + "\n}\n"
    with whole_file(Path(path)) as part:
        part.touch(mode=0o600)
        part.write_text(text, encoding="utf-8")
        if not secret:
            part.chmod(0o644)  # whatever the user's own files are


def read_reference(path: str | Path) -> Reference:
    """Read what `write_reference` wrote.

    Raises DataError, naming file and key, where the file is missing or broken or does not fit its hash.
    """
    path = Path(path)
    content = read_json(path, DataError, most=MOST_BYTES)
    where = _Where(path)
    for key, kind in (*((name, str) for name in TEXTS), ("runs", int), ("parameters", dict), ("scenes", dict)):
        where.has(content, key, kind)
    if not 0 < content["runs"] <= _MOST_RUNS:
        raise DataError(f"{path}: runs is {content['runs']}, expected 1 to {_MOST_RUNS}")
    known = {name: content[name] for name in (*TEXTS, "runs", "parameters")}
    reference = Reference(**known, scenes=_scenes(content, where))
    for name, value in (("hash", reference.digest), ("totals", reference.totals)):
        if content.get(name) != value:
            raise DataError(f"{path}: {name} is {content.get(name)!r}, the content has {value!r}; {_AGAIN}")
    if reference.definitions != DEFINITIONS:
        raise DataError(
            f"{path}: definitions is {reference.definitions!r}, expected {DEFINITIONS!r}: "
            f"mtp-bench maintain freeze --env {reference.env}"
        )
    return reference


@dataclass(frozen=True)
class _Where:
    """A place in a file, for the text of an error."""

    path: Path
    key: str = ""

    def inside(self, *keys: str) -> _Where:
        return _Where(self.path, ".".join([*([self.key] if self.key else []), *keys]))

    def has(self, content: Any, key: str, kind: type) -> Any:
        """``content[key]``; raises DataError where it is not there or not of this kind."""
        value = content.get(key) if isinstance(content, dict) else None
        if not isinstance(value, kind) or isinstance(value, bool):
            got = "missing" if value is None else f"{type(value).__name__} {str(value)[:40]!r}"
            raise DataError(f"{self.path}: {self.inside(key).key} is {got}, expected {kind.__name__}: {_AGAIN}")
        return value

    def count(self, content: Any, key: str) -> int:
        """A whole number that is not negative."""
        value = self.has(content, key, int)
        if value < 0:
            raise DataError(f"{self.path}: {self.inside(key).key} is {value}, expected 0 or more: {_AGAIN}")
        return int(value)


def _said(scene: SceneWeights) -> dict[str, Any]:
    """What a file says of a scene in plain numbers."""
    return {**{name: getattr(scene, name) for name in NUMBERS}, "stp_events": list(scene.stp_events)}


def _scenes(content: dict[str, Any], where: _Where) -> dict[str, SceneWeights]:
    """The scenes of a file, by their keys in order: in this order their counts are packed."""
    said = {key: _numbers(value, where.inside("scenes", key)) for key, value in sorted(content["scenes"].items())}
    targets = [targets for targets, *_ in said.values()]
    counts = np.split(_unpacked(content, "counts", (sum(targets), len(COUNTED)), where), np.cumsum(targets)[:-1])
    stp = np.split(_unpacked(content, "stp", (sum(targets), len(EVENTS)), where).astype(bool), np.cumsum(targets)[:-1])
    return {
        key: SceneWeights(counts[at], stp[at], events, false, forecasts)
        for at, (key, (_, false, forecasts, events)) in enumerate(said.items())
    }


def _numbers(content: Any, where: _Where) -> tuple[int, int, int, tuple[int, int, int]]:
    """Targets, false forecasts, forecasts and events of a scene."""
    targets, false, forecasts = (where.count(content, name) for name in NUMBERS)
    events = where.has(content, "stp_events", list)
    if len(events) != len(EVENTS) or not all(type(number) is int and number >= 0 for number in events):
        raise DataError(f"{where.path}: {where.key}.stp_events is {events}, expected 3 whole numbers: {_AGAIN}")
    return targets, false, forecasts, (events[0], events[1], events[2])


def _packed(arrays: Sequence[NDArray[Any]]) -> str:
    content = b"".join(array.tobytes() for array in arrays)
    return base64.b64encode(lzma.compress(content, preset=6 | lzma.PRESET_EXTREME)).decode("ascii")


def _unpacked(content: dict[str, Any], key: str, shape: tuple[int, int], where: _Where) -> NDArray[np.uint8]:
    size = shape[0] * shape[1]
    if shape[0] > _MOST_TARGETS:
        raise DataError(f"{where.path}: targets of all scenes are {shape[0]}, expected at most {_MOST_TARGETS}")
    try:
        packed = base64.b64decode(where.has(content, key, str), validate=True)
        reader = lzma.LZMADecompressor(lzma.FORMAT_XZ, memlimit=MOST_BYTES)
        found = reader.decompress(packed, size + 1)  # never more than is needed
    except (ValueError, lzma.LZMAError, EOFError) as error:
        raise DataError(f"{where.path}: {key} cannot be read: {error}: {_AGAIN}") from None
    if len(found) != size:
        raise DataError(f"{where.path}: {key} has another size than {shape[0]} x {shape[1]}: {_AGAIN}")
    return np.frombuffer(found, dtype=np.uint8).reshape(shape)
