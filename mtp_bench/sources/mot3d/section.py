"""Table ``[source]`` of cards that replay a sequence of 3DMOT2015."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from ...cards.source import SourceSection, Traits


class Mot3dSource(SourceSection):
    """3DMOT2015: people on the ground plane, seen by a fixed camera, with stored detections."""

    splits = ("train", "val")

    sequence: Literal["PETS09-S2L1", "TUD-Stadtmitte"]
    detector: Literal["acf"] = "acf"  # det/det.txt
    stride: Annotated[int, Field(ge=1)] = 1  # keep every n-th frame
    scene_frames: Annotated[int, Field(ge=2)] = 140  # kept frames per scene, the last scene may have fewer
    train_scenes: Annotated[int, Field(ge=0)] = 2  # the first ones are for training, the others are "val"

    @property
    def traits(self) -> Traits:
        """What the source can do."""
        return Traits(stored_detector=self.detector, places_only=True, bounded_by_truth=True, has_ego=False)
