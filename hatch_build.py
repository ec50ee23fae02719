"""Puts the leaderboard into the wheel: records, keys, seals and owners, and nothing else that may lie beside them.

Rollouts of recorded scenes are as good as the recordings, secrets are secret; a table of ``force-include`` would take
them along. The records are packed into one file: they are alike, so that each takes a fourth of what it takes alone.
"""

from __future__ import annotations

import tarfile
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

BUNDLE = "mtp_bench/_bundled/leaderboard"
PACKED = "records.tar.xz"  # read by mtp_bench/records/storage.py
PUBLIC = (
    "owners.toml", "keys/allowed_signers", "keys/revoked_keys", "seals/*.commitment.json", "seals/*.retired.json",
)  # fmt: skip


class LeaderboardHook(BuildHookInterface[Any]):
    """Adds the leaderboard to what a wheel holds."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Name every file with its place in the wheel; an editable installation reads those of the checkout."""
        self._made = tempfile.TemporaryDirectory(prefix="mtp_bench-wheel-")
        if version == "editable":
            return
        root = Path(self.root) / "leaderboard"
        for path in sorted(root.rglob("*")):
            place = path.relative_to(root)
            if path.is_file() and any(place.match(pattern) for pattern in PUBLIC):
                build_data["force_include"][str(path)] = f"{BUNDLE}/{place.as_posix()}"
        packed = Path(self._made.name) / PACKED
        pack(root, packed)
        build_data["force_include"][str(packed)] = f"{BUNDLE}/{PACKED}"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove what was made for the wheel."""
        self._made.cleanup()


def pack(root: Path, packed: Path) -> None:
    """Pack ``records/<submission>/*.json`` of a leaderboard; equal records give an equal file."""
    with tarfile.open(packed, "w:xz", preset=9) as archive:
        for path in sorted(root.glob("records/[!.]*/[!.]*.json"), key=lambda path: (path.name, path.parent.name)):
            entry = tarfile.TarInfo(path.relative_to(root).as_posix())
            entry.size = path.stat().st_size
            with path.open("rb") as content:
                archive.addfile(entry, content)
