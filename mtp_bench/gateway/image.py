"""The image of a submission: a copy of the files that its digest covers, from which it runs.

A copy cannot be changed after it was hashed, and leaves out the files that the digest leaves out.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from ..errors import SubmissionError
from ..files import file_digest, open_regular
from ..networks import network_files
from ..submission.contents import digest_of, files_of
from ..submission.loader import Submission


@dataclass(frozen=True)
class Image:
    """A submission as it runs."""

    source: Path  # the folder of the submission
    submission: Path  # a copy of it
    networks: Path  # weights of the networks that its manifest names, trained on this machine for this env
    weights: Mapping[str, str]  # name and hex sha256 of each file of `networks`
    digest: str  # hex sha256 over names and contents of both


_known: dict[tuple[object, ...], Image] = {}
_folders: list[tempfile.TemporaryDirectory[str]] = []  # removed when this process ends


def image_of(submission: Submission, env_id: str, weights_of: str | None = None) -> Image:
    """The image of a submission for an env; made once per process, and again if a file has changed.

    ``weights_of``: another env whose network weights serve here too. Raises SubmissionError for a folder that is not a
    submission.
    """
    files, networks = files_of(submission.path), network_files(submission.networks, env_id, weights_of)
    try:
        states = [(path, (s := path.lstat()).st_size, s.st_mtime_ns, s.st_ino) for path in (*files, *networks)]
        key = (submission.path, *states)
        if key not in _known:
            _known[key] = _copy(submission.path, files, networks)
    except OSError as error:
        path = error.filename or submission.path
        raise SubmissionError(f"{path}: cannot be read: {error.strerror or error}") from None
    return _known[key]


def _copy(source: Path, files: Sequence[Path], networks: Sequence[Path]) -> Image:
    _folders.append(tempfile.TemporaryDirectory(prefix="mtp_bench-image-"))
    root = Path(_folders[-1].name)
    folder, beside = root / "submission", root / "networks"
    places = {path: folder / path.relative_to(source) for path in files} | {p: beside / p.name for p in networks}
    for path in (folder, beside, *(place.parent for place in places.values())):
        path.mkdir(parents=True, exist_ok=True)
    for path, place in places.items():
        with open_regular(path, links=False) as original, place.open("wb") as copy:
            shutil.copyfileobj(original, copy)
    weights = {place.name: file_digest(place) for place in sorted(beside.iterdir())}
    return Image(source, folder, beside, weights, digest_of(folder, files_of(folder), weights))
