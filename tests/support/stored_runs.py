"""Runs written by hand on the tiny KITTI sequences, with events that are known."""

from dataclasses import replace
from pathlib import Path

from mtp_bench.cards import load_card
from mtp_bench.core import Rollout, Scene
from mtp_bench.running.rollout_files import RunInfo, save_run
from mtp_bench.sources import open_source
from tests.support.scoring_scenes import Thing, at, make_rollout

SWITCH, GAP, BACK = 4, 5, 7  # frames of the events of car 7


def write_events_run(folder: Path, card: str, data: str) -> Path:
    """A run of all three scenes.

    In scene 0001, track 7 follows car 7 until frame 3 and track 8 at frame 4 (ids-0); nothing at frames 5 and 6
    (lost-0); track 8 again from frame 7 (reacquired-0). Everything else is tracked by the id of the object. In scene
    0006, track 90 forecasts 20 m beside at frames 1 to 3 (spurious-0). Scene 0008 is empty.
    """
    source = open_source(load_card(card), data)
    save_run(folder, _info(card), [_rollout(source.load(name)) for name in source.names])
    return folder


def _info(card: str) -> RunInfo:
    return RunInfo(
        env_id=load_card(card).id, card_digest=load_card(card).digest, observe="detections", samples=4, split="val",
        keywords={}, agent="drawn", parameters={}, submission_digest="", seed=0, definitions="", versions={},
        card=load_card(card).stored(),
    )  # fmt: skip


def _rollout(scene: Scene) -> Rollout:
    truth = scene.truth
    tracks: list[list[Thing]] = []
    said: list[list[Thing]] = []
    for t in range(scene.frames):
        now = zip(truth.object_id[truth.rows(t)], truth.box[truth.rows(t)], truth.class_id[truth.rows(t)], strict=True)
        here = {int(i): at(int(i), box, class_id=int(kind)) for i, box, kind in now}
        if scene.name == "0001" and t >= SWITCH and 7 in here:
            here[7] = replace(here[7], id=8)
            if GAP <= t < BACK:
                del here[7]
        # 20 m beside the first object, inside the image; it stands still in every sample
        said.append([at(90, truth.box[0, :2] - [0.0, 20.0])] if scene.name == "0006" and t in (1, 2, 3) else [])
        tracks.append([*here.values(), *said[t]])
    return make_rollout(tracks, said, name=scene.name, samples=4)
