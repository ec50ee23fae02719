"""Partly annotated scenes, whose other frames have no truth."""

from dataclasses import replace

import numpy as np

from ..cards import Card
from ..core import DataError, Scene


def as_annotated(scene: Scene, card: Card) -> Scene:
    """Return the scene with the truth of its annotated frames alone.

    The frames are those of the scene, else those that the card names. ``skipped``
    counts the true boxes of other frames. Raises DataError without an annotated frame,
    and if they are too far apart for the windows of the task.
    """
    annotated = scene.annotated
    if annotated is None:
        if card.task.annotated_every is None:
            return scene
        annotated = np.arange(scene.frames) % card.task.annotated_every == 0
    where = f"scene {scene.name!r}: annotated"
    if annotated.shape != (scene.frames,) or not annotated.any():
        raise DataError(
            f"{where} has the shape {annotated.shape} and {np.sum(annotated)} frames, "
            f"expected one or more of the {scene.frames} frames of the scene"
        )
    truth = scene.truth
    visible = scene.visible
    kept = annotated[truth.frame_of_rows]
    skipped = scene.skipped
    if not kept.all():
        reason = "true boxes in frames that are not annotated"
        skipped = skipped | {reason: int((~kept).sum())}
    scene = replace(
        scene,
        annotated=annotated,
        truth=truth.select(kept),
        visible=None if visible is None else visible[kept],
        skipped=skipped,
    )
    step = scene.annotated_step
    if card.task.past <= step or card.task.future < step:
        raise DataError(
            f"{where} frames are {step} apart, but {card.id} has windows of "
            f"{card.task.past} past and {card.task.future} future frames, expected "
            "windows with two annotated frames of the past and one of the future: "
            "take a card of a lower rate, or longer windows"
        )
    return scene
