"""Table ``[source]`` of cards that replay KITTI tracking logs."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from ...cards.source import LocalPath, SourceSection, Traits


class KittiSource(SourceSection):
    """KITTI tracking logs with stored detections."""

    splits = ("train", "val")

    detector: str = "pointrcnn"  # folder under detections/
    detections_sha256: str | None = None  # of a folder that replaces the detector's; see cards.with_detections
    detections_file: LocalPath = None  # that folder
    ego_motion: bool = True  # False: every frame in its own camera frame, as without ego-motion compensation
    stride: Annotated[int, Field(ge=1)] = 1  # keep every n-th frame

    @property
    def traits(self) -> Traits:
        """What the source can do."""
        return Traits(
            stored_detector=self.detector,
            detection_file="a folder of KITTI text, one file per sequence",
            velocity_ahead=True,
            common_frame=self.ego_motion,
            view=90.0,  # of the labels' camera
        )
