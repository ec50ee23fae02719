"""The doctor on the scenes of an env, once per state of their files."""

import hashlib
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from ..cards import Card, FilesSource, with_files
from ..core import (
    DataError,
    MtpBenchError,
    Scene,
    Section,
    counted,
    kept,
    long_work,
    new_folder,
)
from ..doubts import DOCTOR_VERSION, Doubt, Examination, examine
from ..sources import open_source, save_scene, scene_digest, with_map
from .evaluation import evaluate
from .options import DEFAULTS, RunKeywords, RunOptions, resolve_options
from .reading import skipped_line, total_skipped

JUDGE = "stp"  # whose error says whether a cure helps
_MOST_DOUBTS = 5  # lines beside other output


class SceneCheckup(Section):
    """Findings of the doctor in a scene."""

    scene: str
    doubts: tuple[Doubt, ...]
    near: float  # share of true boxes with a detection near
    # late by s, off by m, turned by degrees, as fits say; empty: nothing to compare
    shifts: tuple[()] | tuple[float, float, float]
    told: tuple[str, ...]  # small faults that would be told
    missing: tuple[str, ...]  # what could not be checked


@dataclass(frozen=True)
class Checkup:
    """Findings of the doctor in the scenes of an env."""

    env: str
    scenes: tuple[SceneCheckup, ...]

    @property
    def doubts(self) -> list[Doubt]:
        """All doubts, scene by scene."""
        return [doubt for scene in self.scenes for doubt in scene.doubts]

    def lines(self) -> list[str]:
        """Return a line per doubt, and at most three on what is healthy."""
        lines = [f"{doubt.scene}: {doubt.line}" for doubt in self.doubts]
        healthy = [scene for scene in self.scenes if not scene.doubts]
        return lines + _healthy_lines(healthy)

    def to_json(self) -> dict[str, Any]:
        """Return all that was found as plain values."""
        scenes = [scene.model_dump(mode="json") for scene in self.scenes]
        return {"env": self.env, "doubts": len(self.doubts), "scenes": scenes}


def doctor(
    env_id: str | Card,
    options: RunOptions = DEFAULTS,
    **keywords: Unpack[RunKeywords],
) -> Checkup:
    """Examine the scenes of an env: do truth, detections, ego and clock fit together?

    ``env_id``: id, path of a card, or a card; ``keywords`` as in `evaluate`, such as
    ``files`` for own logs. Results are kept until the scenes change. Raises
    MtpBenchError for a closed loop, and for data that cannot be read.
    """
    env_id, options = resolve_options(env_id, options, keywords)
    card = options.card(env_id)
    card.require_same_scenes(
        "whose recordings are made anew by each agent", "there is nothing to examine"
    )
    found = []
    for scene in _scenes(card, options, f"examining the data of {card.id}"):
        found.append(_checked(scene, card, options.data))
    return Checkup(card.id, tuple(found))


def _scenes(card: Card, options: RunOptions, work: str) -> Iterator[Scene]:
    """Yield the chosen scenes, each of which is done when the next one is asked for."""
    with long_work(work, progress=options.progress) as progress:
        source = open_source(card, options.data)
        names = options.chosen(source.names)
        progress.started(len(names))
        for name in names:
            yield source.load(name)
            progress.done(name)


@dataclass(frozen=True)
class Cured:
    """Own scenes before and after the cure."""

    scenes: tuple[str, ...]  # names of those that were changed
    skipped: str  # sentence on rows that are not in the copy; empty: none
    before_m: float | None = None  # bADE of `JUDGE`; None without a target
    after_m: float | None = None


def cure(
    env_id: str | Card,
    folder: str | Path,
    options: RunOptions = DEFAULTS,
    **keywords: Unpack[RunKeywords],
) -> Cured:
    """Write own scenes into a new folder, with the doubts undone that can be.

    ``env_id`` and ``keywords`` as in `doctor`; ``files`` names the scenes, which stay
    as they are. Raises MtpBenchError without own scenes, and if ``folder`` is not new.
    """
    env_id, options = resolve_options(env_id, options, keywords)
    card = options.card(env_id)
    require_own(card)
    names = []
    skipped = []
    with new_folder(Path(folder)) as part:
        for scene in _scenes(card, options, "curing scenes"):
            skipped.append(scene.skipped)
            cured = examine(scene, card).cure(scene)
            if scene_digest(cured) != scene_digest(scene):
                names.append(scene.name)
            save_scene(cured, part, card.task.classes)
    line = skipped_line(total_skipped(skipped)) or ""
    if not names:
        return Cured((), line)
    after = with_files(card, folder)
    return Cured(tuple(names), line, _error_m(card, options), _error_m(after, options))


def require_own(card: Card) -> None:
    """Raise MtpBenchError for a card without own scenes, which alone can be cured."""
    if not isinstance(card.source, FilesSource):
        raise MtpBenchError(
            f"{card.id} has no scenes of your own: a cure writes tables, so name their "
            "folder (--files)"
        )


def _error_m(card: Card, options: RunOptions) -> float | None:
    """Return the bADE of `JUDGE` on the scenes of a card."""
    with suppress(DataError):  # such as windows that are too short for the copy
        report = evaluate(JUDGE, card, options.unchanged)
        return report.rows[0].error if report.rows else None
    return None


def scene_doubts(scene: Scene, card: Card, data: str | None) -> tuple[Doubt, ...]:
    """Return the doubts about a scene; none where the doctor does not examine it."""
    return () if card.is_trusted else _checked(scene, card, data).doubts


def doubt_lines(doubts: Sequence[Doubt]) -> list[str]:
    """Return a line per doubt, up to five, and what to do next."""
    lines = [f"doubt: {doubt.scene}: {doubt.line}" for doubt in doubts[:_MOST_DOUBTS]]
    if lines:
        shown = f"{len(lines)} of {counted(len(doubts), 'doubt')}"
        lines.append(
            f"shown: {shown}; `mtp-bench doctor` with the same --env or --files draws "
            "them (--page), and corrects own scenes (--cure)"
        )
    return lines


def _checked(scene: Scene, card: Card, data: str | None) -> SceneCheckup:
    """Return what is kept of a scene, else examine it."""
    scene = with_map(scene, card, data)
    lanes = repr([lane.center.tolist() for lane in scene.lanes])
    state = f"{scene_digest(scene)}|{lanes}|{card.digest}|{DOCTOR_VERSION}"
    digest = hashlib.sha256(state.encode()).hexdigest()[:32]
    text = kept(
        f"doctor/{digest}.json",
        lambda: digest,
        lambda: _summary(examine(scene, card), scene, card).model_dump_json(),
    )
    return SceneCheckup.model_validate_json(text)


def _unchecked(found: Examination, scene: Scene) -> list[str]:
    """Return what could not be checked in a scene, and why."""
    missing = [
        f"{fault}, too small to be seen here"
        for fault, is_told in found.powers.items()
        if not is_told
    ]
    if not len(scene.truth.box):
        missing = ["truth: the scene has none"]
    elif not len(scene.detections.box):
        missing = ["detections: the scene has none"]
    elif np.ptp(scene.detections.score) == 0 or not scene.truth_complete:
        missing.append("the order of scores, and regions without labels")
    if not scene.lanes:
        missing.append("the map: the scene has none")
    if not found.cured.has_ego:
        missing.append("the ego, which does not move")
    return missing


def _summary(found: Examination, scene: Scene, card: Card) -> SceneCheckup:
    """Return what is kept of an examination."""
    sizes = np.abs([found.size_of(kind) for kind in ("late", "offset", "turn")])
    sizes[0] /= card.task.rate
    return SceneCheckup(
        scene=scene.name,
        doubts=found.doubts,
        near=found.near,
        shifts=tuple(sizes[np.isfinite(sizes)].tolist()),
        told=tuple(fault for fault, is_told in found.powers.items() if is_told),
        missing=tuple(_unchecked(found, scene)),
    )


def _fit_text(scenes: Sequence[SceneCheckup]) -> str:
    """Return how well truth and detections of scenes without a doubt fit."""
    compared = [scene for scene in scenes if scene.shifts]
    if not compared:
        return "no doubt, but truth and detections could not be compared"
    near = min(scene.near for scene in compared)
    late_s, offset_m, turn_degrees = np.max([scene.shifts for scene in compared], 0)
    return (
        f"data fit together. In the worst scene {near:.0%} of the true boxes have a "
        f"detection within one gate; largest misfits: {1000 * late_s:.0f} ms, "
        f"{offset_m:.2f} m, {turn_degrees:.2f}°"
    )


def _healthy_lines(scenes: Sequence[SceneCheckup]) -> list[str]:
    """Return what was checked in scenes without a doubt, and with what power."""
    if not scenes:
        return []
    who = scenes[0].scene if len(scenes) == 1 else counted(len(scenes), "scene")
    lines = [f"{who}: {_fit_text(scenes)}"]
    told = [fault for fault in scenes[0].told if all(fault in s.told for s in scenes)]
    if told:
        lines.append(
            f"{who}: faults as small as these would be told: {', '.join(told)}"
        )
    missing = list(dict.fromkeys(gap for scene in scenes for gap in scene.missing))
    if missing:
        lines.append(f"{who}: not checked: {'; '.join(missing)}")
    return lines
