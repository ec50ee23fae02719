"""The read-only image of a submission: what its digest covers, and nothing else, is what runs.

The image is a copy, so that nobody can change what runs after it was hashed; it leaves out what the digest leaves out.
"""

from __future__ import annotations

import atexit
import hashlib
import os
import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path

from ..files import file_digest, open_regular
from ..networks import network_files
from ..submission.contents import files_of
from ..submission.loader import Submission


@dataclass(frozen=True)
class Image:
    """A submission as it runs."""

    source: Path  # the folder of the submission
    submission: Path  # a copy of it
    networks: Path  # weights of the networks that its manifest names, trained on this machine for this env
    digest: str  # hex sha256 over names and contents of both


_NAME = "mtp_bench-image"
_known: dict[tuple[object, ...], Image] = {}


def image_of(submission: Submission, env_id: str) -> Image:
    """The image of a submission for an env; made once per process, and anew when a file has changed.

    Raises SubmissionError for a folder that cannot be a submission.
    """
    files = {f"submission/{p.relative_to(submission.path)}": p for p in files_of(submission.path)}
    files |= {f"networks/{path.name}": path for path in network_files(submission.networks, env_id)}
    key = (submission.path, *((n, p, (s := p.stat()).st_size, s.st_mtime_ns, s.st_ino) for n, p in files.items()))
    if key not in _known:
        _known[key] = _copy(submission.path, files)
    return _known[key]


def submission_digest(submission: Submission, env_id: str) -> str:
    """The digest of what runs: that of the folder where the manifest names no networks."""
    return image_of(submission, env_id).digest


def _copy(source: Path, files: dict[str, Path]) -> Image:
    if not _known:
        _sweep()
        atexit.register(_remove)
    root = Path(tempfile.mkdtemp(prefix=f"{_NAME}-{os.getpid()}-"))
    for part in ("submission", "networks"):
        (root / part).mkdir()
    total = hashlib.sha256()
    for name, path in files.items():
        target = root / name
        target.parent.mkdir(parents=True, exist_ok=True)
        with open_regular(path) as source_file, target.open("wb") as copy:
            shutil.copyfileobj(source_file, copy)
        # A network's name begins with a slash, which the name of no file of the folder does.
        stated = name.removeprefix("submission/") if name.startswith("submission/") else f"/{name}"
        total.update(f"{stated}\0{file_digest(target)}\n".encode())
    return Image(source, root / "submission", root / "networks", total.hexdigest())


def _sweep() -> None:
    """Remove images of judges that were killed."""
    for folder in Path(tempfile.gettempdir()).glob(f"{_NAME}-*-*"):
        judge = folder.name.removeprefix(f"{_NAME}-").split("-")[0]
        if judge.isdigit() and Path("/proc/self").exists() and not Path(f"/proc/{judge}").exists():
            shutil.rmtree(folder, ignore_errors=True)


def _remove() -> None:
    for image in _known.values():
        shutil.rmtree(image.submission.parent, ignore_errors=True)
