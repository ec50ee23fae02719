"""Files of event weights: JSON with a readable head, and packed counts at the end.

Counts of all scenes are packed together: scenes of one env are alike, so this halves
the size.
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
from .weights import COUNTED, EVENTS, HEADER, Reference, SceneWeights, header_of

MAX_BYTES = 64 << 20  # of a file
_MAX_TARGETS = 16 << 20  # of all scenes: a small packed text must not fill the memory
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
    """Write a reference as JSON with its hash, one line per scene.

    The file appears complete or not at all. ``secret``: readable by the user alone,
    also while it is written.
    """
    header = {
        **header_of(reference),
        "totals": reference.totals,
        "hash": reference.digest,
    }
    scenes = dict(sorted(reference.scenes.items()))
    entries = []
    for key, scene in scenes.items():
        entry = _SceneEntry(
            targets=scene.targets,
            false_forecasts=scene.false_forecasts,
            forecasts=scene.forecasts,
            stp_events=scene.stp_events,
            way=scene.way,
        )
        content = json.dumps(entry.model_dump(mode="json", exclude_none=True))
        entries.append(f"  {json.dumps(key)}: {content}")
    counts = _packed([scene.counts.tobytes() for scene in scenes.values()])
    stp = _packed([scene.stp.tobytes() for scene in scenes.values()])
    head = json.dumps(header, indent=1).removesuffix("\n}")
    lines = ",\n".join(entries)
    text = (
        f'{head},\n "scenes": {{\n{lines}\n }},\n "counts": "{counts}",\n'
        f' "stp": "{stp}"\n}}\n'
    )
    with whole_file(Path(path)) as part:
        part.touch(mode=0o600)
        part.write_text(text, encoding="utf-8")
        if not secret:
            part.chmod(0o644)  # independent of the user's umask


def read_reference(path: str | Path) -> Reference:
    """Read a file of `write_reference`.

    Raises DataError, naming file and key, if the file is missing or broken or does not
    fit its hash.
    """
    path = Path(path)
    content = read_json(path, DataError, most=MAX_BYTES)
    file = validate(_ReferenceFile, content, str(path), DataError)
    reference = Reference(
        **{name: getattr(file, name) for name in HEADER}, scenes=_scenes(file, path)
    )
    for name, value in (("hash", reference.digest), ("totals", reference.totals)):
        if getattr(file, name) != value:
            raise DataError(
                f"{path}: {name} is {getattr(file, name)!r}, the content has "
                f"{value!r}; {_ADVICE}"
            )
    if reference.definitions != WEIGHTS_DEFINITIONS:
        raise DataError(
            f"{path}: definitions is {reference.definitions!r}, expected "
            f"{WEIGHTS_DEFINITIONS!r}: mtp-bench maintain freeze --env {reference.env}"
        )
    return reference


def _scenes(file: _ReferenceFile, path: Path) -> dict[str, SceneWeights]:
    """Return the scenes of a file by key, in the order of their packed counts."""
    entries = dict(sorted(file.scenes.items()))
    targets = sum(entry.targets for entry in entries.values())
    if targets > _MAX_TARGETS:
        raise DataError(
            f"{path}: targets of all scenes are {targets}, "
            f"expected at most {_MAX_TARGETS}"
        )
    counts = _unpacked(file.counts, (targets, len(COUNTED)), f"{path}: counts")
    stp = _unpacked(file.stp, (targets, len(EVENTS)), f"{path}: stp").astype(bool)
    scenes = {}
    start = 0
    for key, entry in entries.items():
        rows = slice(start, start + entry.targets)
        scenes[key] = SceneWeights(
            counts=counts[rows],
            stp=stp[rows],
            stp_events=entry.stp_events,
            false_forecasts=entry.false_forecasts,
            forecasts=entry.forecasts,
            way=entry.way,
        )
        start += entry.targets
    return scenes


def _packed(contents: list[bytes]) -> str:
    content = b"".join(contents)
    packed = lzma.compress(content, preset=6 | lzma.PRESET_EXTREME)
    return base64.b64encode(packed).decode("ascii")


def _unpacked(text: str, shape: tuple[int, int], where: str) -> NDArray[np.uint8]:
    size = shape[0] * shape[1]
    try:
        reader = lzma.LZMADecompressor(lzma.FORMAT_XZ, memlimit=MAX_BYTES)
        packed = base64.b64decode(text, validate=True)
        content = reader.decompress(packed, size + 1)  # never more than is needed
    except (ValueError, lzma.LZMAError, EOFError) as error:
        raise DataError(f"{where} cannot be read: {error}: {_ADVICE}") from None
    if len(content) != size:
        raise DataError(
            f"{where} has another size than {shape[0]} x {shape[1]}: {_ADVICE}"
        )
    return np.frombuffer(content, dtype=np.uint8).reshape(shape)
