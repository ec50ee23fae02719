"""The version of the package, and the folders of what is bundled with it.

Folders of cards, baselines, keys and seals are those of the checkout or, once
installed, of the wheel.
"""

from functools import cache
from pathlib import Path

__version__ = "0.3.0"


_PACKAGE = Path(__file__).resolve().parent.parent


def bundled(kind: str) -> Path:
    """Return the folder of ``kind``: "envs", "baselines" or "leaderboard".

    A checkout has its own; otherwise it is part of the wheel, which has no records.
    """
    checkout = _PACKAGE.parent / kind
    if (_PACKAGE.parent / "pyproject.toml").is_file() and checkout.is_dir():
        return checkout
    return _PACKAGE / "_bundled" / kind


def card_ids() -> tuple[str, ...]:
    """Return the ids of the cards that ship with the library, sorted."""
    return tuple(path.stem for path in _files(bundled("envs"), "MTP-*.toml"))


def baseline_names() -> tuple[str, ...]:
    """Return the names of the baselines that ship with the library, sorted."""
    manifests = _files(bundled("baselines"), "*/submission.toml")
    return tuple(path.parent.name for path in manifests)


@cache
def _files(folder: Path, pattern: str) -> tuple[Path, ...]:
    return tuple(sorted(folder.glob(pattern)))
