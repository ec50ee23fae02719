"""Status of the data of an env after reading all its scenes."""

import hashlib
import os
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from ..cards import Card
from ..core import (
    __version__,
    counted,
    kept,
)
from ..scoring import HOLES, LOST_TARGETS, count_holes
from ..sources import DataStatus, describe, open_source

if TYPE_CHECKING:
    from ..doubts import Doubt

_NOT_READ = (".jpg", ".png", ".bin")  # images and points


def total_skipped(counts: Iterable[Mapping[str, int]]) -> dict[str, int]:
    """Return the sum of the ``skipped`` counts of scenes, by reason."""
    total: Counter[str] = Counter()
    for count in counts:
        total.update(count)
    return dict(sorted(total.items()))


def skipped_line(skipped: Mapping[str, int]) -> str | None:
    """Return one or two sentences on skipped rows and on targets across holes in time.

    None if there are neither.
    """
    sentences = []
    rows = Counter(skipped)
    holes = rows.pop(HOLES, 0)
    lost_targets = rows.pop(LOST_TARGETS, 0)
    if rows:
        reasons = ", ".join(f"{reason} ({number})" for reason, number in rows.items())
        sentences.append(
            f"{counted(rows.total(), 'row')} of the data skipped or completed: "
            f"{reasons}"
        )
    if holes:
        pronoun = "it" if holes == 1 else "them"
        sentences.append(
            f"{counted(holes, 'hole')} in time, steps of more than 1.5 frame periods: "
            f"{counted(lost_targets, 'target')} across {pronoun} left out"
        )
    return "; ".join(sentences) or None


def read_status(
    card: Card, data: str | None = None, no_doctor: bool = False
) -> DataStatus:
    """Return the status of the data of ``card`` after reading all its scenes.

    The status lists broken files, counts, and notes on skipped rows and, unless
    ``no_doctor``, on doubts about the data. If no file is broken, they are cached until
    the size or time of a file changes.
    """
    status = describe(card, data)
    if not status.usable or status.about.generated or status.root is None:
        return status
    from ..doubts import DOCTOR_VERSION  # slow to load

    no_doctor |= card.is_trusted
    version = 0 if no_doctor else DOCTOR_VERSION
    state = f"{card.digest}-{_files_digest(status.root)}-{version}"
    counts, notes = kept(
        f"counts/{state}.json",
        lambda: state if status.usable else "",
        lambda: _read_scenes(status, card, data, no_doctor),
    )
    status.counts.clear()
    status.counts.update(counts)
    status.notes += notes
    return status


def _read_scenes(
    status: DataStatus, card: Card, data: str | None, no_doctor: bool
) -> tuple[Mapping[str, int], list[str]]:
    """Count what the scenes hold in ``status``, and return notes on their rows, too."""
    from .checkup import doubt_lines, scene_doubts  # slow to load

    source = open_source(card, data)
    skipped = []
    doubts: list[Doubt] = []
    for scene_name in source.names:
        with status.noted():
            scene = source.load(scene_name)
            skipped.append(scene.skipped | count_holes(scene, card))
            if not no_doctor:
                doubts += scene_doubts(scene, card, data)
            counts = {
                "scenes": 1,
                "frames": scene.frames,
                "true boxes": len(scene.truth.box),
                "detections": len(scene.detections.box),
            }
            status.counts.update(counts)
    line = skipped_line(total_skipped(skipped))
    return status.counts, [*filter(None, [line]), *doubt_lines(doubts)]


def _files_digest(root: Path) -> str:
    """Return a digest of the version, and of names, sizes and times of files."""
    states = []
    for folder, _, file_names in os.walk(root, followlinks=True):
        for file_name in file_names:
            path = Path(folder, file_name)
            if path.suffix not in _NOT_READ and path.exists():
                stat = path.stat()
                times = (stat.st_mtime_ns, stat.st_ctime_ns)
                states.append((str(path), stat.st_size, *times))
    content = repr((__version__, sorted(states)))
    return hashlib.sha256(content.encode()).hexdigest()[:16]
