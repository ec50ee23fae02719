"""Scenes of an environment, truth included: for training and for drawing."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from ..cards import Card, load_card
from ..errors import UnknownNameError
from ..sources import open_source
from ..types import Scene


def load_scenes(
    card: str | Card, data: str | Path | None = None, names: Iterable[str] | None = None
) -> Iterator[Scene]:
    """The scenes of an env, read one after the other as they are asked for.

    ``card``: an env id, the path of a card, or a card (`Card.with_split` chooses another split). ``data``: the data
    root, else that of MTP_BENCH_DATA. ``names``: those scenes alone. Raises UnknownNameError or DataError.
    """
    source = open_source(card if isinstance(card, Card) else load_card(card), data)
    chosen = tuple(source.names if names is None else names)
    for name in chosen:
        if name not in source.names:
            raise UnknownNameError("scene", name, source.names)
    return (source.load(name) for name in chosen)
