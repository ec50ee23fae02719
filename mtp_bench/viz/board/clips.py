"""A short clip of the costliest event of an entry, beside its record: of simulated scenes alone.

Recorded scenes belong to their datasets: no picture of them is ever made for the leaderboard.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from ...errors import MtpBenchError, RecordError
from ...files import whole_file
from ...records.record import Record
from ...records.storage import rollouts_folder
from ...running.opened import open_run
from ..replay import Incident, Replay, replay
from .order import simulated

SUFFIX = ".clip.webp"  # of the file beside a record
MOST_BYTES = 150_000
SIZE = (760, 500)  # pixels
_MOST_FRAMES = 16
_QUALITIES = (60, 45, 30, 20, 10)  # of WebP, until it is small enough


def clip_path(path: Path, record: Record) -> Path:
    """Where the clip of the record at ``path`` is; its name tells of which record it is."""
    return path.with_name(f"{path.stem}.{record.digest[:12]}{SUFFIX}")


def can_have_clip(path: Path, record: Record) -> bool:
    """Whether scenes of the env may be shown, and what the agent said on them is stored."""
    return simulated(record.env.id) and rollouts_folder(path, record.seeds[0]).is_dir()


def write_clip(path: Path, record: Record) -> Path | None:
    """Write the clip of the record at ``path`` from its rollouts of the first seed; None without an event.

    Raises RecordError where the scenes are not simulated or the rollouts are of another submission, and what
    `open_run` raises.
    """
    if not simulated(record.env.id):
        raise RecordError(f"{path}: scenes of {record.env.id} are recorded, and no picture of them may be published")
    opened = open_run(rollouts_folder(path, record.seeds[0]))
    if opened.run.info.submission_digest != record.submission.digest:
        raise RecordError(f"{opened.folder}: made with another submission than the record {path.name}")
    name = record.submission.name
    worst = worst_event(
        replay(opened.scene(rollout.scene), rollout, opened.card, name) for rollout in opened.rollouts()
    )
    if worst is None:
        return None
    clip = clip_path(path, record)
    draw_clip(clip, *worst)
    for other in path.parent.glob(f"{path.stem}.*{SUFFIX}"):  # of earlier records
        if other != clip:
            other.unlink()
    return clip


def worst_event(replays: Iterable[Replay]) -> tuple[Replay, Incident] | None:
    """The identity event that costs most; of equal ones that whose error rose most, then the first."""
    worst: tuple[Replay, Incident] | None = None
    most = (-1.0, 0.0)
    for played in replays:
        for incident in played.incidents:
            if incident.kind == "spurious" or incident.error is None:
                continue
            cost = incident.error, incident.error - (incident.error_before or 0.0)
            if cost > most:
                worst, most = (played, incident), cost
    return worst


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
