"""Table ``[source]`` of cards that replay WILDTRACK."""

from __future__ import annotations

from typing import Literal

from ...cards.source import SourceSection, Traits


class WildtrackSource(SourceSection):
    """WILDTRACK: people on a square, seen by seven fixed cameras; real detections of the last 40 frames.

    The other frames have simulated detections, of the card's ``[detector]``.
    """

    splits = ("train", "val", "test")

    detector: Literal["mvdet"] | None = "mvdet"  # None: simulated detections everywhere

    @property
    def traits(self) -> Traits:
        """What the source can do."""
        return Traits(
            stored_detector=self.detector or "",
            without_detections="most of WILDTRACK",
            mixed_detections=True,
            places_only=True,
            has_ego=False,
        )
