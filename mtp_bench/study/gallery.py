"""The worst events of each kind as pictures, each with the command that opens the moment in the viewer."""

from __future__ import annotations

import base64 as encoding
from collections.abc import Sequence
from dataclasses import dataclass

from .findings import Findings

KINDS = ("ids", "lost", "reacquired")


@dataclass(frozen=True)
class Picture:
    """One event."""

    name: str  # of its file
    title: str
    sentence: str
    command: str  # that opens it
    png: bytes

    @property
    def base64(self) -> str:
        """The picture as text, for a page."""
        return encoding.b64encode(self.png).decode("ascii")


def gallery(found: Findings) -> Sequence[Picture]:
    """Pictures of the worst events."""
    return ()
