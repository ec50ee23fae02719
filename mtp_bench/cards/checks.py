"""What must hold between the sections of a card; ``where`` names the card in errors."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..errors import CardError, MtpBenchError, nearest

if TYPE_CHECKING:
    from .card import Card


def check_card(card: Card, where: str) -> None:
    """Raise CardError unless the sections of a card fit each other."""
    _check_classes(card, where)
    check_detector(card, where)
    _check_length(card, where)


def _check_classes(card: Card, where: str) -> None:
    classes = set(card.task.classes)
    if len(classes) != len(card.task.classes):
        raise CardError(f"{where}: task.classes is {list(card.task.classes)}, expected each class once")
    tables = {
        "task.event_gate.threshold": card.task.event_gate.threshold,
        "task.forecast_gate": card.task.forecast_gate,
        "task.miss_error": card.task.miss_error,
    }
    for key, table in tables.items():
        for name in table:
            if name not in classes:
                raise CardError(f"{where}: {key} has an unknown class {name!r}{nearest(name, classes)}")
        for name in card.task.classes:
            if name not in table:
                raise CardError(f"{where}: {key} has no value for class {name!r}")
            if table[name] <= 0:
                raise CardError(f"{where}: {key}.{name} is {table[name]}, expected a number above 0")


def check_detector(card: Card, where: str) -> None:
    """A simulated source needs a simulated detector, which must know every class."""
    if not card.source.traits.truth_complete and card.detector is not None:
        raise CardError(
            f"{where}: a simulated detector would see nothing but the prediction targets, the only known objects; "
            'take stored detections, or a card with truth = "all"'
        )
    if card.detector is None:
        if card.source.traits.without_detections:
            what = card.source.traits.without_detections
            raise CardError(f"{where}: {what} has no detections: a [detector] section is missing")
        return
    try:
        noise = card.detector.resolved
        for name in card.task.classes:
            noise.noise(name)
    except MtpBenchError as error:
        raise CardError(f"{where}: {error}") from None


def _check_length(card: Card, where: str) -> None:
    """Scenes whose length the card decides must be long enough for a target."""
    seconds = card.source.traits.scene_seconds
    if seconds is None:
        return
    frames, needed = seconds * card.task.rate, card.task.past + card.task.future
    if frames < needed:
        raise CardError(
            f"{where}: scenes of {seconds:g} s at {card.task.rate:g} Hz have {frames:g} frames, expected "
            f"at least {needed}: task.past and task.future"
        )
