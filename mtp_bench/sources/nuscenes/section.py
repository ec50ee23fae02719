"""Table ``[source]`` of cards that replay nuScenes logs."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from ...cards.source import STORED_DETECTOR, LocalPath, SourceSection, Traits


class NuScenesSource(SourceSection):
    """nuScenes logs (official v1.0 tables) with stored detections in the official submission form."""

    splits = ("train", "train_val", "val", "mini_train", "mini_val", "all")

    version: Annotated[str, Field(pattern=r"^v1\.0-[A-Za-z0-9_.-]+$")] = "v1.0-trainval"  # folder of the tables
    detector: Annotated[str, Field(pattern=STORED_DETECTOR)] = "megvii"  # detections/<detector>*.json
    detections_sha256: str | None = None  # of a file that replaces the detector's; see cards.with_detections
    detections_file: LocalPath = None  # that file
    velocity: bool = False  # show the velocities of the detections, if the file has them
    truth: Literal["targets", "all"] = "all"
    # "targets": the official prediction split names the targets, and other objects are unknown; "all": every box

    @property
    def traits(self) -> Traits:
        """What the source can do."""
        return Traits(
            stored_detector=self.detector,
            other_detections=True,
            detection_file="a JSON file in the official submission form",
            measured_velocity=self.velocity,
            truth_complete=self.truth == "all",
        )
