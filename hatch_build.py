"""Puts the leaderboard's records, keys and seals into the wheel, and nothing of the rollouts that may lie beside them.

Rollouts of recorded scenes are as good as the recordings; a table of ``force-include`` would take them along.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

BUNDLE = "mtp_bench/_bundled"
FOLDERS = ("records", "keys", "seals")
PUBLIC = ("allowed_signers", "revoked_keys", "*.commitment.json", "*.retired.json")  # of keys and seals, nothing else
OWNERS = "owners.toml"
ROLLOUTS = ".rollouts"  # suffix of their folders; git ignores them too


class RecordsHook(BuildHookInterface[Any]):
    """Adds what the leaderboard is made of to what a wheel holds."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Name every file with its place in the wheel."""
        root = Path(self.root)
        build_data["force_include"][str(root / "leaderboard" / OWNERS)] = f"{BUNDLE}/leaderboard/{OWNERS}"
        for folder in FOLDERS:
            for path in sorted((root / "leaderboard" / folder).rglob("*")):
                place = path.relative_to(root)
                if path.is_file() and _ships(folder, place):
                    build_data["force_include"][str(path)] = f"{BUNDLE}/{place.as_posix()}"


def _ships(folder: str, place: Path) -> bool:
    if folder == "records":
        return not any(part.endswith(ROLLOUTS) for part in place.parts)
    return any(place.match(pattern) for pattern in PUBLIC)
