"""Puts the leaderboard's records into the wheel, and nothing of the rollouts that may lie beside them.

Rollouts of recorded scenes are as good as the recordings; a table of ``force-include`` would take them along.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

BUNDLE = "mtp_bench/_bundled"
ROLLOUTS = ".rollouts"  # suffix of their folders; git ignores them too


class RecordsHook(BuildHookInterface[Any]):
    """Adds leaderboard/records to what a wheel holds."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Name every file with its place in the wheel."""
        root = Path(self.root)
        for path in sorted((root / "leaderboard" / "records").rglob("*")):
            place = path.relative_to(root)
            if path.is_file() and not any(part.endswith(ROLLOUTS) for part in place.parts):
                build_data["force_include"][str(path)] = f"{BUNDLE}/{place.as_posix()}"
