"""Cards as TOML: by env id, and from a file."""

import os
from pathlib import Path
from typing import Any

from .._bundle import bundled, card_ids
from ..errors import CardError, require_known
from ..strict import read_toml, validate
from .card import Card, check_consistency
from .own import resolve_folder
from .source import FilesSource, read_source


def load_card(name: str | Path) -> Card:
    """Read a card by env id or from a TOML file.

    Raises UnknownNameError for an id that does not exist and CardError for content that is wrong, naming the key.
    """
    if not isinstance(name, (str, os.PathLike)):
        raise CardError(f"the env is {name!r}, expected its id, the path of a card, or a card")
    path = Path(name)
    if path.suffix == ".toml":
        if not path.is_file():
            raise CardError(f"no card file at {path}")
    else:
        require_known("environment", str(name), card_ids(), "`mtp-bench envs` lists them")
        path = bundled("envs") / f"{name}.toml"
    card = parse_card(read_toml(path, CardError), where=path.name)
    if card.id != path.stem:
        raise CardError(f"{path.name}: id is {card.id!r}, expected the file's stem {path.stem!r}")
    if isinstance(card.source, FilesSource):
        return card.model_copy(update={"source": resolve_folder(card.source, path.parent, card.lanes is not None)})
    return card


def parse_card(content: dict[str, Any], where: str = "card") -> Card:
    """Validate the content of a card; errors name it by ``where``."""
    content = {**content, "source": read_source(content.get("source"), where)}
    card = validate(Card, content, where, CardError)
    check_consistency(card, where)
    return card
