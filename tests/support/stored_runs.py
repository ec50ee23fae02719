"""Runs written by hand on the tiny KITTI sequences, with events that are known."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mtp_bench.cards import load_card
from mtp_bench.running.rollout_files import RunInfo, save_run
from mtp_bench.sources import open_source
from mtp_bench.types import Floats, Ints, Rollout, Scene

Table = tuple[Ints, Ints, Floats, Ints]
SWITCH, GAP, BACK = 4, 5, 7  # frames of the events of car 7


def write_events_run(folder: Path, card: str, data: str) -> Path:
    """A run of all three scenes.

    In scene 0001, track 7 follows car 7 until frame 3 and track 8 at frame 4 (ids-0); nothing at frames 5 and 6
    (lost-0); track 8 again from frame 7 (reacquired-0). Everything else is tracked by the id of the object. In scene
    0006, track 90 stands 60 m beside at frames 1 to 3 and forecasts there (spurious-0). Scene 0008 is empty.
    """
    source = open_source(load_card(card), data)
    save_run(folder, _info(card), [_rollout(source.load(name)) for name in source.names])
    return folder


def write_ghosts(folder: Path, card: str, data: str) -> Path:
    """A run of scene 0001 that says nothing of its objects and forecasts in every frame under another id."""
    scene = open_source(load_card(card), data).load("0001")
    frame = np.arange(scene.frames)
    box = np.tile(scene.truth.box[:1] + np.array([0.0, 60.0, 0, 0, 0, 0, 0]), (scene.frames, 1))
    table = _table(frame, frame, box, np.zeros_like(frame), scene.frames)
    save_run(folder, _info(card), [_assembled(scene, table, table)])
    return folder


def _info(card: str) -> RunInfo:
    return RunInfo(
        env_id=load_card(card).id, card_digest=load_card(card).digest, observe="detections", samples=4, split="val",
        keywords={}, agent="drawn", parameters={}, submission_digest="", seed=0, definitions="", versions={},
    )  # fmt: skip


def _rollout(scene: Scene) -> Rollout:
    truth, frame = scene.truth, scene.truth.frame_of_rows
    track_id = np.asarray(truth.object_id).copy()
    kept = np.ones(len(frame), dtype=bool)
    if scene.name == "0001":
        track_id[(track_id == 7) & (frame >= SWITCH)] = 8
        kept = ~((track_id == 8) & (frame >= GAP) & (frame < BACK))
    track = _table(frame[kept], track_id[kept], truth.box[kept], truth.class_id[kept], scene.frames)
    nothing = np.zeros(0, dtype=np.int64)
    said = _table(nothing, nothing, truth.box[:0], nothing, scene.frames)
    if scene.name == "0006":
        ghost = np.tile(truth.box[:1] + np.array([0.0, 60.0, 0, 0, 0, 0, 0]), (3, 1))
        beside = np.array([1, 2, 3]), np.full(3, 90), ghost, np.zeros(3, dtype=np.int64)
        said = _table(*beside, scene.frames)
        order = np.argsort(np.concatenate([frame, beside[0]]), kind="stable")
        track = _table(
            np.concatenate([frame, beside[0]])[order],
            np.concatenate([track_id, beside[1]])[order],
            np.concatenate([truth.box, beside[2]])[order],
            np.concatenate([truth.class_id, beside[3]])[order],
            scene.frames,
        )
    return _assembled(scene, track, said)


def _assembled(scene: Scene, track: Table, said: Table) -> Rollout:
    """One hypothesis with these tracks and these objects, which stand still in every sample."""
    return Rollout(
        scene=scene.name,
        track_start=track[0],
        track_id=track[1],
        track_box=track[2],
        track_class=track[3],
        member=np.ones((len(track[1]), 1), dtype=bool),
        hypothesis_log_weight=np.zeros((scene.frames, 1)),
        object_start=said[0],
        object_box=said[2],
        object_class=said[3],
        forecast=np.zeros((len(said[1]), 4, 3, 2), dtype=np.int16),
        forecast_log_weight=np.full((len(said[1]), 4), -np.log(4.0)),
        invalid=np.zeros((scene.frames, 3), dtype=np.int64),
        dropped=np.zeros(scene.frames, dtype=np.int64),
        seconds=np.zeros(scene.frames),
    )


def _table(frame: Ints, ids: Ints, box: Floats, class_id: Ints, frames: int) -> Table:
    """Start of each frame, ids, boxes and classes of rows that are sorted by frame."""
    return np.searchsorted(frame, np.arange(frames + 1)), ids, box, class_id
