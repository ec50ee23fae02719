"""Status of the data of an env after reading all its scenes: broken files, skipped rows."""

import hashlib
import json
import os
from collections import Counter
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path

from ..cards import Card
from ..core import (
    MtpBenchError,
    Section,
    __version__,
    cache_root,
    counted,
    make_folder,
    read_json,
    validate,
    write_text,
)
from ..scoring import HOLES, LOST_TARGETS, left_out
from ..sources import DataStatus, describe, open_source


class _Counts(Section):
    counts: dict[str, int]
    notes: list[str]


def total_skipped(counts: Iterable[Mapping[str, int]]) -> dict[str, int]:
    """Sum of the ``skipped`` counts of scenes, by reason."""
    total: Counter[str] = Counter()
    for count in counts:
        total.update(count)
    return dict(sorted(total.items()))


def skipped_line(skipped: Mapping[str, int]) -> str | None:
    """One or two sentences for the user; None if no row was skipped and no target lies across a hole in time."""
    sentences = []
    if rows := {
        reason: number
        for reason, number in skipped.items()
        if reason not in (HOLES, LOST_TARGETS)
    }:
        reasons = ", ".join(f"{reason} ({number})" for reason, number in rows.items())
        sentences.append(
            f"{counted(sum(rows.values()), 'row')} of the data skipped or completed: {reasons}"
        )
    if holes := skipped.get(HOLES, 0):
        left = f"{counted(skipped[LOST_TARGETS], 'target')} across {'it' if holes == 1 else 'them'} left out"
        sentences.append(
            f"{counted(holes, 'hole')} in time, steps of more than 1.5 frame periods: {left}"
        )
    return "; ".join(sentences) or None


def read_status(card: Card, data: str | Path | None = None) -> DataStatus:
    """Status of the data of ``card`` after reading all its scenes: broken files, counts, and a note on skipped rows.

    Where all are sound, the counts are kept in the cache until a file has another size or time.
    """
    status = describe(card, data)
    if not status.usable or status.about.generated or status.root is None:
        return status
    kept = cache_root() / "counts" / f"{card.digest}-{_state_of(status.root)}.json"
    with suppress(MtpBenchError):  # missing, or not what was written
        known = validate(
            _Counts, read_json(kept, MtpBenchError), str(kept), MtpBenchError
        )
        status.counts.update(known.counts)
        status.notes += known.notes
        return status
    source, skipped = open_source(card, data), []
    for name in source.names:
        with status.noted():
            scene = source.load(name)
            skipped.append(scene.skipped | left_out(scene, card))
            rows = {
                "true boxes": len(scene.truth.box),
                "detections": len(scene.detections.box),
            }
            status.counts.update({"scenes": 1, "frames": scene.frames, **rows})
    notes = [*filter(None, [skipped_line(total_skipped(skipped))])]
    status.notes += notes
    if status.usable:
        with suppress(MtpBenchError, OSError):
            make_folder(kept.parent)
            write_text(kept, json.dumps({"counts": status.counts, "notes": notes}))
    return status


def _state_of(root: Path) -> str:
    """Digest of names, sizes and times of files below a folder, without images and points, and of the version."""
    state = []
    for folder, _, names in os.walk(root, followlinks=True):
        for path in (Path(folder, name) for name in names):
            if path.suffix not in (".jpg", ".png", ".bin") and path.exists():
                found = path.stat()
                state.append(
                    (str(path), found.st_size, found.st_mtime_ns, found.st_ctime_ns)
                )
    return hashlib.sha256(repr((__version__, sorted(state))).encode()).hexdigest()[:16]
