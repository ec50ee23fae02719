"""The examination of a scene: causes compete, the winner is undone, and again."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ..cards import Card
from ..core import Scene
from .detection_signs import class_signs, detection_signs
from .fits import CauseFits, penalty
from .form_signs import form_signs
from .kinds import Doubt, doubt_of, is_doubt, kinds, limit_of
from .recording import RecordedScene
from .signs import Sign
from .truth_signs import jitter_signs, truth_signs

_MOST_CAUSES = 3
_INCOMPARABLE = ("truth_jitter", "class_renamed")  # then places say nothing
_NEAR = 0.1  # of the misfit that the winner explains: a runner-up is named


@dataclass(frozen=True, eq=False)
class Examination:
    """Result of the examination of a scene."""

    doubts: tuple[Doubt, ...]  # the gravest first
    signs: tuple[Sign, ...]  # all, also those below their limits
    cured: RecordedScene  # with the doubts undone that can be
    near: float  # share of true boxes with a detection near
    powers: Mapping[str, bool]  # which small faults would be told

    def cure(self, scene: Scene) -> Scene:
        """Return the scene with its doubts undone, those that can be.

        The scene must be in one frame of reference, as own scenes are.
        """
        cured = self.cured.scene
        return replace(
            scene,
            truth=cured.truth,
            detections=cured.detections,
            annotated=cured.annotated,
            visible=cured.visible,
        )

    def size_of(self, kind: str) -> float:
        """Return the size that the first fit of a kind found; NaN without one."""
        for sign in self.signs:
            if sign.kind == kind:
                return sign.stated_size
        return np.nan


def examine(scene: Scene, card: Card) -> Examination:
    """Return what the recording of a scene says about itself."""
    recording = RecordedScene.of(scene, card)
    signs = list[Sign]()
    found = list[tuple[Sign, str]]()
    for look in (class_signs, form_signs, jitter_signs):
        seen = list(look(recording))
        signs += seen
        for sign in _unexplained(filter(is_doubt, seen), found):
            found.append((sign, ""))
            if sign.undo is not None:
                recording = sign.undo(recording)
    if not any(sign.kind in _INCOMPARABLE for sign, _ in found):
        recording = _without_causes(recording, signs, found)
    comparison = CauseFits(recording)
    rest = [Sign("apart", comparison.apart), *truth_signs(recording)]
    rest += detection_signs(recording)
    rest += class_signs(recording)
    signs += rest
    for sign in sorted(_unexplained(filter(is_doubt, rest), found), key=_excess):
        found.append((sign, ""))
        if sign.undo is not None:
            recording = sign.undo(recording)
    doubts = [doubt_of(sign, recording, other) for sign, other in found]
    return Examination(
        doubts=tuple(doubts),
        signs=tuple(signs),
        cured=recording,
        near=comparison.near_share,
        powers=comparison.powers(),
    )


def _without_causes(
    recording: RecordedScene, signs: list[Sign], found: list[tuple[Sign, str]]
) -> RecordedScene:
    """Return the recording with up to `_MOST_CAUSES` causes of the misfit undone.

    Adds all fits to ``signs``, and the winners with their runners-up to ``found``.
    """
    for _ in range(_MOST_CAUSES):
        fits = list(CauseFits(recording).signs())
        signs += fits
        winner = _winner(fits)
        if winner is None or winner[0].undo is None:
            break
        found.append(winner)
        recording = winner[0].undo(recording)
    return recording


def _winner(fits: Iterable[Sign]) -> tuple[Sign, str] | None:
    """Return the fit that explains most, and the kind that explains nearly as much."""
    able = sorted(filter(is_doubt, fits), key=penalty)
    if not able:
        return None
    first = able[0]
    allowed = penalty(first) + _NEAR * (first.before - first.after)
    for other in able[1:]:
        if other.kind != first.kind and penalty(other) < allowed:
            return first, other.kind
    return first, ""


def _unexplained(
    signs: Iterable[Sign], found: Iterable[tuple[Sign, str]]
) -> list[Sign]:
    """Return the signs that are not consequences of others, or of those found."""
    new = list(signs)
    explained = {sign.kind for sign, _ in found}
    for kind in (*explained, *(sign.kind for sign in new)):
        explained.update(kinds()[kind].explains)
    return [sign for sign in new if sign.kind not in explained]


def _excess(sign: Sign) -> float:
    """Return minus how often the value has its limit: the gravest comes first."""
    return -sign.value / limit_of(sign.kind)
