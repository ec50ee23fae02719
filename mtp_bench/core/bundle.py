"""Folders of the bundled cards, baselines, keys and seals: those of the checkout or, once installed, of the wheel."""

from functools import cache
from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent.parent


def bundled(kind: str) -> Path:
    """Folder of ``kind`` ("envs", "baselines" or "leaderboard"): of the checkout, else the wheel's, without records."""
    checkout = _PACKAGE.parent / kind
    if (_PACKAGE.parent / "pyproject.toml").is_file() and checkout.is_dir():
        return checkout
    return _PACKAGE / "_bundled" / kind


def card_ids() -> tuple[str, ...]:
    """Ids of the cards that ship with the library, sorted."""
    return tuple(path.stem for path in _found(bundled("envs"), "MTP-*.toml"))


def baseline_names() -> tuple[str, ...]:
    """Names of the baselines that ship with the library, sorted."""
    return tuple(
        path.parent.name for path in _found(bundled("baselines"), "*/submission.toml")
    )


@cache
def _found(folder: Path, pattern: str) -> tuple[Path, ...]:
    return tuple(sorted(folder.glob(pattern)))
