"""Text files of recordings: written, broken, and the one error that a broken one gives."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from mtp_bench.cards import Card, load_card, parse_card
from mtp_bench.core.errors import DataError


def write(path: Path, *lines: str) -> None:
    """Write these lines; lone surrogates become the bytes that they stand for."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes("".join(f"{line}\n" for line in lines).encode("utf-8", "surrogateescape"))


def assert_one_error(path: Path, lines: Sequence[str] | None, text: str, load: Callable[[], object]) -> None:
    """With these lines in the file, or without it, loading fails with an error that names the file and says this."""
    if lines is None:
        path.unlink()
    else:
        write(path, *lines)
    with pytest.raises(DataError, match=text) as caught:
        load()
    assert str(path) in str(caught.value)


def card_of(env_id: str, classes: Sequence[str], rate: float, **source: Any) -> Card:
    """A shipped card with other entries of its source, other classes (all gates 1 m) and another frame rate."""
    content = load_card(env_id).model_dump(mode="json")
    content["source"] |= source
    same = dict.fromkeys(classes, 1.0)
    gate = {"measure": "center_distance", "threshold": same}
    content["task"] |= {"rate": rate, "classes": list(classes), "forecast_gate": same, "miss_error": same}
    return parse_card({**content, "task": {**content["task"], "event_gate": gate}})


def with_source(env_id: str, **source: Any) -> Card:
    """A shipped card with other entries of its source, unchecked."""
    card = load_card(env_id)
    return card.model_copy(update={"source": card.source.model_copy(update=source)})


def with_task(card: Card, **task: Any) -> Card:
    """A card with other entries of its task, unchecked."""
    return card.model_copy(update={"task": card.task.model_copy(update=task)})
