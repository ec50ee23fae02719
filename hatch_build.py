"""Put keys, seals and owners of the leaderboard into the wheel, and no other file that may lie beside them.

A table of ``force-include`` would take secrets along. Records stay in the checkout: they are larger than all else, and
each new one adds to them.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

BUNDLE = "mtp_bench/_bundled/leaderboard"
PUBLIC = (
    "owners.toml", "keys/allowed_signers", "keys/revoked_keys", "seals/*.commitment.json", "seals/*.retired.json",
)  # fmt: skip


class LeaderboardHook(BuildHookInterface[Any]):
    """Build hook that adds keys, seals and owners."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Name every file with its place in the wheel; an editable installation reads those of the checkout."""
        if version == "editable":
            return
        root = Path(self.root) / "leaderboard"
        for path in sorted(root.rglob("*")):
            place = path.relative_to(root)
            if path.is_file() and any(
                place.match(pattern) and len(place.parts) == 1 + pattern.count("/")
                for pattern in PUBLIC
            ):
                build_data["force_include"][str(path)] = f"{BUNDLE}/{place.as_posix()}"
