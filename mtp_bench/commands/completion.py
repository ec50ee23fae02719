"""Shell completion of the values of options and arguments."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from .._bundle import baseline_names, card_ids


def env_ids(incomplete: str) -> list[str]:
    """Ids of the shipped environments, and cards of one's own."""
    return _offered([*card_ids(), *_beside(incomplete, "*.toml")], incomplete)


def submissions(incomplete: str) -> list[str]:
    """Names of the baselines, and folders of submissions."""
    own = [path.removesuffix("/submission.toml") for path in _beside(incomplete, "*/submission.toml")]
    return _offered([*baseline_names(), *own], incomplete)


def detectors(incomplete: str) -> list[str]:
    """Names of the shipped profiles and of the variants that stand alone, and files of profiles."""
    from ..detector import profile_names

    return _offered(["iid", "hard", *profile_names(), *_beside(incomplete, "*.toml")], incomplete)


def words(*known: str) -> Callable[[str], list[str]]:
    """One of a few words."""
    return lambda incomplete: _offered(known, incomplete)


def _beside(incomplete: str, pattern: str) -> list[str]:
    """Files of ``pattern`` in the folder that is being named."""
    folder = incomplete[: incomplete.rfind("/") + 1]
    return [f"{folder}{path.relative_to(folder)}" for path in sorted(Path(folder).glob(pattern))]


def _offered(names: Iterable[str], incomplete: str) -> list[str]:
    return [name for name in names if name.startswith(incomplete)]
