"""Folders of the bundled cards, baselines and records: those of the checkout or, once installed, of the wheel."""

from functools import cache
from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent


def bundled(kind: str) -> Path:
    """Folder of ``kind`` ("envs", "baselines" or "leaderboard"): the checkout's own, else the wheel's copy."""
    checkout = _PACKAGE.parent / kind
    if (_PACKAGE.parent / "pyproject.toml").is_file() and checkout.is_dir():
        return checkout
    return _PACKAGE / "_bundled" / kind


@cache
def card_ids() -> tuple[str, ...]:
    """Ids of the cards that ship with the library, sorted."""
    return tuple(sorted(path.stem for path in bundled("envs").glob("MTP-*.toml")))


@cache
def baseline_names() -> tuple[str, ...]:
    """Names of the baselines that ship with the library, sorted."""
    return tuple(sorted(path.parent.name for path in bundled("baselines").glob("*/submission.toml")))
