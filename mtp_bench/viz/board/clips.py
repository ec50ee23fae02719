"""A short clip of the costliest event of an entry, made when the site is built; for simulated scenes only.

Recorded scenes belong to their datasets: no picture of them is ever made for the leaderboard.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from ...errors import MtpBenchError, RecordError
from ...files import whole_file
from ...records.record import Record
from ...records.storage import rollouts_folder
from ...running.stored import open_run
from ..replay import Incident, Replay, replay
from .order import simulated

SUFFIX = ".webp"
MOST_BYTES = 150_000
SIZE = (760, 500)  # pixels
_MOST_FRAMES = 16
_QUALITIES = (60, 45, 30, 20, 10)  # of WebP, until it is small enough


def can_have_clip(path: Path, record: Record) -> bool:
    """Return True if scenes of the env may be shown and the rollouts of the record at ``path`` are stored."""
    return simulated(record.env.id) and rollouts_folder(path, record.seeds[0]).is_dir()


def write_clip(clip: Path, path: Path, record: Record) -> bool:
    """Write the clip of the record at ``path`` from its rollouts of the first seed; False without an event.

    Raises RecordError where the scenes are not simulated or the rollouts are of another submission, and the errors of
    `open_run`.
    """
    if not simulated(record.env.id):
        raise RecordError(f"{path}: scenes of {record.env.id} are recorded, and no picture of them may be published")
    opened = open_run(rollouts_folder(path, record.seeds[0]))
    if opened.run.info.submission_digest != record.submission.digest:
        raise RecordError(f"{opened.folder}: made with another submission than the record {path.name}")
    name = record.submission.name
    replays = (replay(opened.scene(rollout.scene), rollout, opened.card, name) for rollout in opened.rollouts())
    worst = worst_event(replays)
    if worst is not None:
        draw_clip(clip, *worst)
    return worst is not None


def worst_event(replays: Iterable[Replay]) -> tuple[Replay, Incident] | None:
    """The costliest identity event; of equal ones the one with the largest rise of the error, then the first."""
    events = (
        (played, incident, incident.error)
        for played in replays
        for incident in played.incidents
        if incident.kind != "spurious" and incident.error is not None
    )
    worst = max(events, key=lambda event: (event[2], event[2] - (event[1].error_before or 0.0)), default=None)
    return None if worst is None else worst[:2]


def draw_clip(path: Path, played: Replay, incident: Incident) -> None:
    """Write an event as an animated WebP of at most MOST_BYTES. Raises MtpBenchError where that fails."""
    from ..drawing.report import picture
    from ..drawing.video import frames_around
    from ..focus import Focus

    focus, frames = Focus.of(played, incident), frames_around(played, incident.name)
    step = -(-len(frames) // _MOST_FRAMES)
    images = [picture(focus, t, SIZE) for t in frames[::step]]
    duration = round(1000 * step / played.card.task.rate)
    try:
        with whole_file(path) as part:
            for quality in _QUALITIES:
                images[0].save(
                    part, format="WEBP", save_all=True, append_images=images[1:], duration=duration, loop=0,
                    quality=quality,
                )  # fmt: skip
                if part.stat().st_size <= MOST_BYTES:
                    return
            raise MtpBenchError(f"{path}: a clip of {len(images)} pictures has more than {MOST_BYTES} bytes")
    except OSError as error:
        raise MtpBenchError(f"cannot write {path}: {error.strerror or error}") from None
