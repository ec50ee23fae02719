"""Signs in the form of rows: units, angles, sides, copies and padding."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from ..core import Bools, Detections, Floats, Ints, Truth
from ..sources import usual_sizes
from .maps import UNITS
from .recording import RecordedScene
from .signs import Sign, Undo, mean_of_others

LONG = ("car", "van", "truck", "bus", "trailer", "regular_vehicle")
_MIN_ROWS = 5  # below which a share says nothing
_MIN_HEADINGS = 20
_SAME_M = 0.1  # between two detections that are one
_AT_ZERO_M = 1e-6
_Rows = Truth | Detections


def form_signs(recording: RecordedScene) -> Iterator[Sign]:
    """Yield the signs in the form of the rows of truth and detections."""
    for part in ("truth", "detections"):
        rows: _Rows = getattr(recording, part)
        if len(rows.box) >= _MIN_ROWS:
            yield _sizes(recording, part, rows)
            yield from _sides(recording, part, rows)
            yield _angles(part, rows)
    yield from _padding(recording)
    if len(recording.detections.box):
        yield _doubled(recording)
        yield from _repeated(recording)


def heading_signs(part: str, along: Floats, object_id: Ints) -> Iterator[Sign]:
    """Yield the shares of rows of vehicles that face backwards and across.

    ``along`` [n]: cosine between their heading and the right one; ``object_id`` [n].
    """
    if len(along) >= _MIN_HEADINGS:
        yield Sign(f"{part}_backwards", mean_of_others(along < -0.7, object_id))
        yield Sign(f"{part}_across", mean_of_others(np.abs(along) < 0.7, object_id))


def unit_of(factor: float) -> tuple[str, float]:
    """Return the unit whose lengths are about ``factor`` times those in metres.

    With the exact factor, below 1 where lengths were taken for that unit.
    """
    factors = list(UNITS.items())
    factors += [(name, 1.0 / times) for name, times in UNITS.items()]
    unit = min(factors, key=lambda unit: abs(np.log(unit[1] / factor)))
    if abs(np.log2(unit[1] / factor)) > 1:
        return "another unit", factor
    return unit


def _sizes(recording: RecordedScene, part: str, rows: _Rows) -> Sign:
    """Return how many octaves sizes are from usual ones."""
    usual = usual_sizes(recording.card.task.classes)
    share = np.maximum(rows.box[:, 4:7], 1e-6) / usual[rows.class_id]
    share = share[np.isfinite(share)]
    octaves = float(np.median(np.log2(share))) if len(share) else 0.0
    factor = 2.0**octaves
    name, unit = unit_of(factor)

    def undo(box: Floats) -> None:
        on_ground = box[:, 2] == box[:, 6] / 2  # as own tables without z have it
        box[:, 4:7] /= unit
        box[on_ground, 2] = box[on_ground, 6] / 2

    return Sign(
        f"{part}_sizes",
        abs(octaves),
        factor,
        undo=_edit(part, undo) if name in UNITS else None,
    )


def _sides(recording: RecordedScene, part: str, rows: _Rows) -> Iterator[Sign]:
    """Yield the share of vehicles that are wider than long."""
    long = recording.is_of(rows.class_id, LONG)
    wide = long & (rows.box[:, 4] < rows.box[:, 5])
    if long.sum() < _MIN_ROWS:
        return

    def undo(box: Floats) -> None:
        box[wide, 4:6] = box[wide, 5:3:-1]

    share = float(wide.sum() / long.sum())
    yield Sign(f"{part}_sides", share, undo=_edit(part, undo))


def _angles(part: str, rows: _Rows) -> Sign:
    """Return how large headings are; a tenth may be larger."""

    def undo(box: Floats) -> None:
        box[:, 3] = np.radians(box[:, 3])

    large = float(np.quantile(np.abs(rows.box[:, 3]), 0.9))
    return Sign(f"{part}_degrees", large, undo=_edit(part, undo))


def _padding(recording: RecordedScene) -> Iterator[Sign]:
    """Yield the object with the most rows at x = y = 0."""
    truth = recording.truth
    at_zero = np.abs(truth.box[:, :2]).max(axis=1) < _AT_ZERO_M
    at_zero &= np.isin(truth.object_id, truth.object_id[~at_zero])
    if not at_zero.any():
        return
    ids, counts = np.unique(truth.object_id[at_zero], return_counts=True)
    object_id = int(ids[counts.argmax()])
    frame = truth.frame_of_rows[at_zero & (truth.object_id == object_id)]
    yield Sign(
        "padded_zeros",
        float(counts.max()),
        first=int(frame[0]),
        last=int(frame[-1]),
        object_id=object_id,
        undo=partial(_kept, "truth", ~at_zero),
    )


def _doubled(recording: RecordedScene) -> Sign:
    """Return the share of detections that lie on another one."""
    rows = recording.detections
    pairs = recording.detected.pairs(_SAME_M)
    copy = np.zeros(len(rows.box), dtype=bool)
    copy[pairs[:, 1]] = True
    both = copy.copy()
    both[pairs[:, 0]] = True
    undo = partial(_kept, "detections", ~copy)
    first = int(rows.frame_of_rows[both].min(initial=recording.frames))
    return Sign("doubled", float(both.mean()), copy.sum(), first=first, undo=undo)


def _repeated(recording: RecordedScene) -> Iterator[Sign]:
    """Yield how many frames show all the boxes of the frame before."""
    frames = [
        t
        for t in range(1, recording.frames)
        if _repeats(recording.detections, t) and not _repeats(recording.truth, t)
    ]
    if frames:
        yield Sign("hangs", float(len(frames)), first=frames[0], last=frames[-1])


def _repeats(rows: _Rows, t: int) -> bool:
    """Return True for several boxes that are those of the frame before."""
    box = rows.box[rows.rows(t)]
    return len(box) > 1 and np.array_equal(box, rows.box[rows.rows(t - 1)])


def _edit(part: str, change: Callable[[Floats], None]) -> Undo:
    """Return what changes the boxes of a part in place of a copy."""

    def undo(recording: RecordedScene) -> RecordedScene:
        rows: _Rows = getattr(recording, part)
        box = rows.box.copy()
        change(box)
        return recording.with_rows(replace(rows, box=box))

    return undo


def _kept(part: str, mask: Bools, recording: RecordedScene) -> RecordedScene:
    rows: _Rows = getattr(recording, part)
    scene = recording.scene
    if part == "truth" and scene.visible is not None:
        scene = replace(scene, visible=scene.visible[mask])
    return replace(recording, scene=scene).with_rows(rows.select(mask))
