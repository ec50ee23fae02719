"""Simulated detections in place of stored ones, for the truth of any source."""

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
    """``scene`` with the detections of the card's simulated detector; unchanged if it has stored ones.

    The noise depends on the scene's name and the detector's seed, or on ``seed`` alone if it is given. All profiles
    share random numbers: a box that one of them misses is likely missed by another.

    Measured velocities do not contain the next frame: if true velocities do, the truth gets backward velocities. An
    unknown velocity is measured as 0, as that of a false positive, since a missing one would show that a box is true
    and new. If every frame has its own frame of reference, free false positives stand still in the world, or in the
    sensor's frame if the scene has no world poses; velocities are those in the world, turned into the frames.
    """
    from ..detector.simulate import simulate
    from ..detector.visibility import Sensor, visibility_of, visible_fractions

    if card.detector is None or (scene.detector and not scene.simulated):
        return scene
    section, profile = card.detector, card.detector.resolved
    area = section.area
    if area is None and card.source.traits.bounded_by_truth:
        area = extent(scene.truth.box)
    sensor = Sensor(section.reach, float(np.deg2rad(section.field_of_view)), area)
    visible = scene.visible if scene.visible is not None else visible_fractions(scene.truth, scene.ego)
    truth = scene.truth
    if card.velocity and card.source.traits.velocity_ahead:
        truth = looking_back(truth, scene.time)
    world = in_world(replace(scene, truth=truth))
    if card.velocity:
        moving = world.truth if scene.world is None else looking_back(world.truth, scene.time)
        world = replace(world, truth=replace(moving, velocity=np.nan_to_num(moving.velocity)))
    detections = simulate(
        world.truth,
        world.ego,
        card.task.classes,
        profile,
        sensor,
        _noise_seed(section.seed, scene.name) if seed is None else seed,
        dt=1.0 / card.task.rate,
        visibility=visibility_of(world.truth, world.ego, sensor, visible),
    )
    if scene.world is not None:
        detections = in_frames(detections, scene.world, scene.time)
    if card.source.traits.places_only:
        detections = as_places(detections)
    label = f"{profile.name}, simulated detections"
    return replace(
        scene, truth=truth, detections=detections, detector=label, simulated=True, skipped={}, visible=visible
    )


def _noise_seed(seed: int, name: str) -> int:
    """Seed of the noise of a scene, equal in every process and on every machine."""
    return int.from_bytes(hashlib.sha256(f"{seed}|detector|{name}".encode()).digest()[:8], "big")
