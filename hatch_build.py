"""Puts the leaderboard into the wheel: records, keys, seals and owners, and nothing else that may lie beside them.

Rollouts of recorded scenes are as good as the recordings, secrets are secret; a table of ``force-include`` would take
them along.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

BUNDLE = "mtp_bench/_bundled/leaderboard"
PUBLIC = (
    "owners.toml", "keys/allowed_signers", "keys/revoked_keys", "seals/*.commitment.json", "seals/*.retired.json",
)  # fmt: skip
PRIVATE = (".rollouts", ".part")  # suffixes of folders beside records; git ignores them too


class LeaderboardHook(BuildHookInterface[Any]):
    """Adds the leaderboard to what a wheel holds."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Name every file with its place in the wheel."""
        root = Path(self.root) / "leaderboard"
        for path in sorted(root.rglob("*")):
            place = path.relative_to(root)
            if path.is_file() and _ships(place):
                build_data["force_include"][str(path)] = f"{BUNDLE}/{place.as_posix()}"


def _ships(place: Path) -> bool:
    if place.parts[0] == "records":
        return not any(part.endswith(PRIVATE) for part in place.parts)
    return any(place.match(pattern) for pattern in PUBLIC)
