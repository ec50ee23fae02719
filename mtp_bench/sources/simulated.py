"""A simulated detector in place of stored detections, on the truth of any source."""

from __future__ import annotations

import hashlib
from dataclasses import replace

import numpy as np

from ..cards import Card
from ..types import Scene
from .frames import in_frames, in_world
from .motion import looking_back
from .people import as_places, extent


def detected(scene: Scene, card: Card, seed: int | None = None) -> Scene:
    """``scene`` with the detections of the card's simulated detector; with its own where it has stored ones.

    The noise depends on the scene's name and the detector's seed, or on ``seed`` alone where it is given. All profiles
    share their random numbers: a box that is undetected with one is likely undetected with another. A detector that
    measures velocities is told nothing of the next frame: where the source's true velocities hold some of it, the truth
    gets backward velocities. What has an unknown one is measured as if it stood still, like a false box: else a
    velocity that is missing would tell that the box is true, and new. Where every frame is in its own frame of
    reference, false boxes that stand do so in the world, if the scene says where that is, else in the sensor's frame;
    velocities are measured in the world and told in the frames.
    """
    from ..detector.simulate import simulate
    from ..detector.visibility import Sensor, visibility_of, visible_fractions

    if card.detector is None or (scene.detector and not scene.simulated):
        return scene
    section, noise = card.detector, card.detector.resolved
    area = section.area
    if area is None and card.source.traits.bounded_by_truth:
        area = extent(scene.truth.box)
    sensor = Sensor(section.reach, float(np.deg2rad(section.field_of_view)), area)
    visible = scene.visible if scene.visible is not None else visible_fractions(scene.truth, scene.ego)
    truth = scene.truth
    if card.velocity and card.source.traits.velocity_ahead:
        truth = looking_back(truth, scene.time)
    there = in_world(replace(scene, truth=truth))
    if card.velocity:
        moves = there.truth if scene.world is None else looking_back(there.truth, scene.time)
        there = replace(there, truth=replace(moves, velocity=np.nan_to_num(moves.velocity)))
    seen = simulate(
        there.truth,
        there.ego,
        card.task.classes,
        noise,
        sensor,
        _seed(section.seed, scene.name) if seed is None else seed,
        dt=1.0 / card.task.rate,
        visibility=visibility_of(there.truth, there.ego, sensor, visible),
    )
    if scene.world is not None:
        seen = in_frames(seen, scene.world, scene.time)
    if card.source.traits.places_only:
        seen = as_places(seen)
    label = f"{noise.name}, simulated detections"
    return replace(scene, truth=truth, detections=seen, detector=label, simulated=True, skipped={}, visible=visible)


def _seed(seed: int, name: str) -> int:
    """The same in every process and on every machine."""
    return int.from_bytes(hashlib.sha256(f"{seed}|detector|{name}".encode()).digest()[:8], "big")
