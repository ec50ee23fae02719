"""Files of event weights: JSON with a readable head, and the packed counts of all scenes at the end.

Counts of all scenes are packed together: scenes of one env are alike, so this halves the size.
"""

import base64
import json
import lzma
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from ..core import DataError, Section, read_json, validate, whole_file
from .definitions import WEIGHTS_DEFINITIONS
from .weights import COUNTED, EVENTS, NUMBERS, TEXTS, Reference, SceneWeights, header_of

MOST_BYTES = 64 << 20  # of a file
_MOST_TARGETS = 16 << 20  # of all scenes: a small packed text must not fill the memory
_ADVICE = "freeze it again"
_Count = Annotated[int, Field(ge=0)]


class _SceneEntry(Section):
    targets: _Count
    false_forecasts: _Count
    forecasts: _Count
    stp_events: Annotated[tuple[_Count, _Count, _Count], Field(strict=False)]
    way: Annotated[float, Field(ge=0)] | None = None


class _ReferenceFile(Section):
    env: str
    card: str
    definitions: str
    agent: str
    runs: Annotated[int, Field(ge=1, le=255)]  # counts are bytes
    parameters: dict[str, Any]
    totals: dict[str, Any]
    hash: str
    scenes: dict[str, _SceneEntry]
    counts: str
    stp: str


def write_reference(
    path: str | Path, reference: Reference, secret: bool = False
) -> None:
    """Write a reference as JSON with its hash, one line per scene; the file appears complete or not at all.

    ``secret``: readable by the user alone, also while it is written.
    """
    head = {
        **header_of(reference),
        "totals": reference.totals,
        "hash": reference.digest,
    }
    scenes = dict(sorted(reference.scenes.items()))
    lines = [
        f"  {json.dumps(key)}: {json.dumps(_scene_entry(scene))}"
        for key, scene in scenes.items()
    ]
    tail = ""
    for name in ("counts", "stp"):
        content = b"".join(getattr(scene, name).tobytes() for scene in scenes.values())
        packed = base64.b64encode(
            lzma.compress(content, preset=6 | lzma.PRESET_EXTREME)
        ).decode("ascii")
        tail += f',\n "{name}": "{packed}"'
    text = (
        json.dumps(head, indent=1)[: -len("\n}")]
        + ',\n "scenes": {\n'
        + ",\n".join(lines)
        + "\n }"
        + tail
        + "\n}\n"
    )
    with whole_file(Path(path)) as part:
        part.touch(mode=0o600)
        part.write_text(text, encoding="utf-8")
        if not secret:
            part.chmod(0o644)  # independent of the user's umask


def read_reference(path: str | Path) -> Reference:
    """Read a file of `write_reference`.

    Raises DataError, naming file and key, if the file is missing or broken or does not fit its hash.
    """
    path = Path(path)
    file = validate(
        _ReferenceFile,
        read_json(path, DataError, most=MOST_BYTES),
        str(path),
        DataError,
    )
    reference = Reference(
        **{name: getattr(file, name) for name in (*TEXTS, "runs", "parameters")},
        scenes={},
    )
    reference.scenes.update(_scenes(file, path))
    for name, value in (("hash", reference.digest), ("totals", reference.totals)):
        if getattr(file, name) != value:
            raise DataError(
                f"{path}: {name} is {getattr(file, name)!r}, the content has {value!r}; {_ADVICE}"
            )
    if reference.definitions != WEIGHTS_DEFINITIONS:
        raise DataError(
            f"{path}: definitions is {reference.definitions!r}, expected {WEIGHTS_DEFINITIONS!r}: "
            f"mtp-bench maintain freeze --env {reference.env}"
        )
    return reference


def _scenes(file: _ReferenceFile, path: Path) -> dict[str, SceneWeights]:
    """The scenes of a file by key, in the order in which their counts are packed."""
    entries = sorted(file.scenes.items())
    ends = np.cumsum([entry.targets for _, entry in entries], dtype=np.int64)
    targets = int(ends[-1]) if len(ends) else 0
    if targets > _MOST_TARGETS:
        raise DataError(
            f"{path}: targets of all scenes are {targets}, expected at most {_MOST_TARGETS}"
        )
    counts = np.split(
        _unpacked(file.counts, (targets, len(COUNTED)), f"{path}: counts"), ends[:-1]
    )
    stp = np.split(
        _unpacked(file.stp, (targets, len(EVENTS)), f"{path}: stp").astype(bool),
        ends[:-1],
    )
    return {
        key: SceneWeights(
            counts[i],
            stp[i],
            entry.stp_events,
            entry.false_forecasts,
            entry.forecasts,
            entry.way,
        )
        for i, (key, entry) in enumerate(entries)
    }


def _scene_entry(scene: SceneWeights) -> dict[str, Any]:
    """The numbers of a scene as in a file."""
    entry = {
        **{name: getattr(scene, name) for name in NUMBERS},
        "stp_events": list(scene.stp_events),
    }
    return entry if scene.way is None else {**entry, "way": scene.way}


def _unpacked(text: str, shape: tuple[int, int], where: str) -> NDArray[np.uint8]:
    size = shape[0] * shape[1]
    try:
        reader = lzma.LZMADecompressor(lzma.FORMAT_XZ, memlimit=MOST_BYTES)
        content = reader.decompress(
            base64.b64decode(text, validate=True), size + 1
        )  # never more than is needed
    except (ValueError, lzma.LZMAError, EOFError) as error:
        raise DataError(f"{where} cannot be read: {error}: {_ADVICE}") from None
    if len(content) != size:
        raise DataError(
            f"{where} has another size than {shape[0]} x {shape[1]}: {_ADVICE}"
        )
    return np.frombuffer(content, dtype=np.uint8).reshape(shape)
