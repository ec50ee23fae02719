"""Argoverse 2 sensor logs as scenes: truth within reach, stored detections, the road.

Detections are the boxes of detection files that have the log. The road is that of the
log's own map. A middle line is made as the official reader makes it: ten points of each
border, evenly spaced along its length in three dimensions, and the middles of the
pairs. Lanes of bicycles are left out.
"""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np

from ...cards import Card
from ...core import (
    Bools,
    DataError,
    Detections,
    Floats,
    Ints,
    Lane,
    Scene,
    Truth,
    even_points,
    starts_of_sorted,
)
from ..base import (
    DataRoot,
    link_lanes,
    names_by_number,
    no_detections,
    require_classes,
    require_rate,
    section_of,
    sorted_rows,
    stored_label,
)
from ..motion import looking_back, unknown_velocity
from ..stored_tracks import FEWER
from ..tables import SMALLEST_SIDE_M
from ..text import Number, read_json
from .files import (
    ANNOTATIONS,
    CATEGORIES,
    CLASSES,
    DATASET,
    LOGS,
    NEUTRAL,
    RATE_HZ,
    Argoverse2Source,
    Sweeps,
    detection_files,
    log_folder,
    log_folders,
)
from .submission import read_boxes, read_detections


class Argoverse2:
    """Logs of one split, named by their ids, in the frame of their city.

    An origin in whole metres is subtracted. Frames are every ``stride``-th sweep at
    their real times, from 0. The truth of an object begins where it first comes within
    reach; where it is beyond later, or has no lidar point, it is neutral.
    """

    def __init__(self, card: Card, data: DataRoot = None) -> None:
        self.card = card
        self.section = section_of(card, Argoverse2Source)
        require_classes(card, DATASET.name, CLASSES)
        require_rate(card, DATASET.name, RATE_HZ, self.section.stride)
        root = DATASET.find(data, LOGS)
        self.folders = log_folders(root, self.section.split)
        self.names = tuple(self.folders)
        self._files = detection_files(root, card)

    def load(self, name: str) -> Scene:
        """Read one log.

        If it has no stored detections, ``detector`` is empty.
        """
        sweeps = Sweeps.read(self.folders[name], self.section.stride)
        truth, names = scene_truth(sweeps, self.card)
        detections, detector = self._read_detections(sweeps)
        return Scene(
            name=name,
            time=sweeps.time,
            ego=sweeps.ego,
            truth=truth,
            detections=detections,
            detector=detector,
            object_names=names,
        )

    def _read_detections(self, sweeps: Sweeps) -> tuple[Detections, str]:
        """Read the stored detections of a log, if any, and their label.

        A file of ``detections/`` with boxes in less than half of the frames has another
        rate and is passed over.
        """
        frames = len(sweeps.time)
        log = sweeps.folder.name
        is_named = self.section.detections_sha256 is not None
        stored: dict[Path, Detections] = {}
        for path in self._files:
            detections = read_detections(path, sweeps, self.card)
            used_frames = int((detections.counts > 0).sum())
            if 2 * used_frames >= frames:
                stored[path] = detections
            elif is_named:
                raise DataError(
                    f"{path} has detections in {used_frames} of the {frames} frames of "
                    f"log {log}, expected most; {FEWER}"
                )
        if len(stored) > 1:
            advice = "name one of them with --detections"
            files = " and ".join(map(str, stored))
            raise DataError(f"{files} both have detections of log {log}; {advice}")
        if not stored:
            return no_detections(frames), ""
        [(path, detections)] = stored.items()
        if not is_named:  # a named file has a threshold of its own
            is_likely = detections.score >= self.section.min_detection_score
            detections = detections.select(is_likely)
        return detections, stored_label(path.stem)


def first_frames(
    frame: Ints, object_number: Ints, within_reach: Bools, frames: int
) -> Ints:
    """Return the first frame [R] in which the object of each row is within reach.

    ``frame`` and ``object_number`` [R]; ``frames`` where it never is.
    """
    first_frame = np.full(object_number.max(initial=-1) + 1, frames)
    np.minimum.at(first_frame, object_number[within_reach], frame[within_reach])
    return first_frame[object_number]


def scene_truth(sweeps: Sweeps, card: Card) -> tuple[Truth, dict[int, str]]:
    """Return the truth of a log, and the names of its objects.

    Raises DataError for annotations that are wrong.
    """
    path = sweeps.folder / ANNOTATIONS
    boxes = read_boxes(path, sweeps, card, "num_interior_pts", "track_uuid")
    table = boxes.table
    frame = boxes.frame
    object_name = table["track_uuid"]
    table.refuse_second_box(frame, object_name)
    is_flat = (boxes.box[:, 4:] < SMALLEST_SIDE_M).any(axis=1)
    table.refuse(is_flat, "a side of the box is not above 0 m")
    object_number = np.unique(object_name, return_inverse=True)[1]
    category_labels = CATEGORIES.items()
    neutral_categories = [
        word for word, label in category_labels if label.startswith(NEUTRAL)
    ]
    neutral = (
        ~boxes.within_reach
        | (table["num_interior_pts"] == 0)
        | np.isin(table["category"], neutral_categories)
    )
    frames = len(sweeps.time)
    first_frame = first_frames(frame, object_number, boxes.within_reach, frames)
    true_rows = sorted_rows(frame, frame >= first_frame)
    truth = Truth(
        start=starts_of_sorted(frame[true_rows], frames),
        box=boxes.box[true_rows],
        velocity=unknown_velocity(len(true_rows)),
        class_id=boxes.class_id[true_rows],
        object_id=object_number[true_rows],
        eligible=np.ones(len(true_rows), dtype=bool),
        neutral=neutral[true_rows],
    )
    truth = looking_back(truth, sweeps.time, sweeps.stride / RATE_HZ)
    return truth, names_by_number(object_number[true_rows], object_name[true_rows])


CENTER_POINTS = 10  # of a middle line


class _Point(msgspec.Struct, gc=False):
    x: Number
    y: Number
    z: Number


_Border = Annotated[list[_Point], msgspec.Meta(min_length=1)]


class _Lane(msgspec.Struct):
    id: int
    is_intersection: bool
    lane_type: str
    left_lane_boundary: _Border
    right_lane_boundary: _Border
    successors: list[int]


class _Map(msgspec.Struct):
    lane_segments: dict[str, _Lane]


def scene_lanes(card: Card, data: DataRoot, scene: Scene) -> tuple[Lane, ...]:
    """Return the lanes of a log in the frame of its scene.

    Empty without a map. Raises DataError for a wrong map.
    """
    folder = log_folder(card, data, scene.name)
    paths = sorted(folder.glob("map/log_map_archive_*.json"))
    if not paths:
        return ()
    segments = read_json(paths[0], _Map).lane_segments.values()
    records = [record for record in segments if record.lane_type != "BIKE"]
    successors = {record.id: record.successors for record in records}
    if len(successors) < len(records):
        raise DataError(
            f"{paths[0]}: two lanes have the same id, expected one of its own for each"
        )
    origin = Sweeps.read(folder, 1).origin
    lanes: dict[int, Lane] = {}
    for record in records:
        left_border = _points(record.left_lane_boundary) - origin
        right_border = _points(record.right_lane_boundary) - origin
        lane = lane_between(left_border, right_border)
        lanes[record.id] = replace(lane, junction=record.is_intersection)
    return link_lanes(lanes, successors)


def _points(border: list[_Point]) -> Floats:
    return np.array([(point.x, point.y, point.z) for point in border])


def lane_between(left_border: Floats, right_border: Floats) -> Lane:
    """Return the lane between a left and a right border [n, 3]."""
    # a lane may turn about one point, which stands against all of the other border
    if min(len(left_border), len(right_border)) > 1:
        left_border = even_points(left_border, CENTER_POINTS)
        right_border = even_points(right_border, CENTER_POINTS)
    edges = np.broadcast_arrays(left_border[:, :2], right_border[:, :2])
    return Lane((edges[0] + edges[1]) / 2, edges[0], edges[1])
