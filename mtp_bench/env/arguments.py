"""Arguments of the env: JSON values, each checked with one clear error."""

import os
from collections.abc import Collection, Mapping, Sequence
from typing import Any, TypedDict

import numpy as np

from ..cards import Card
from ..core import MtpBenchError, Scene, UnknownNameError, require_known
from .episode import RENDERERS

# of one action, and of one observation: they are sent between an agent and the env
_MAX_BYTES = 64 << 20
_NUMBER_BYTES = 8
OBSERVE = ("detections", "truth", "associated", "tracks")
_FLAGS = ("evaluation", "rigid_motion", "target_frames", "fresh_noise")
_TEXTS = ("split", "detector", "detection_file", "track_file", "files", "presence")


class EnvKeywords(TypedDict, total=False):
    """Keywords of `MTPEnv`.

    None or a missing one means the card's own value, if the card has one.
    """

    # "detections", "truth" for true boxes with true ids, "associated" for detections
    # with the ids of true objects, or "tracks" for those of ``track_file``
    observe: str
    samples: int | None  # K; more than the card's belong to unranked runs
    tracks: int | None  # N
    objects: int | None  # O
    hypotheses: int | None  # H
    detections: int | None  # D
    # names to choose from, or scenes of one's own (`cards.with_scenes`)
    scenes: Sequence[str] | Sequence[Scene] | None
    evaluation: bool  # the reward is 0 and no returned value derives from the truth
    # an action outside the action space is an ActionError; None: unless ``evaluation``
    strict: bool | None
    # the local frame of every episode is turned and shifted at random, with the lanes
    rigid_motion: bool
    split: str | None  # another split of the card's source
    # another detector, simulated on the true boxes or stored (`cards.with_detector`)
    detector: str | None
    # stored detections of one's own (`cards.with_detections`)
    detection_file: str | None
    # file or folder of stored tracks (`sources.stored_tracks`), for
    # ``observe="tracks"``
    track_file: str | None
    files: str | None  # a folder of scenes of one's own (`cards.with_files`)
    # the presence model of baselines: its file, or "scores" (`cards.with_presence`)
    presence: str | None
    # for training: episodes are the frames from the first to the last that can hold a
    # target
    target_frames: bool
    # for training: the noise of a simulated detector is drawn anew in every episode
    fresh_noise: bool
    render_mode: str | None  # one of RENDERERS


def check_keywords(data: object, keywords: Mapping[str, Any]) -> dict[str, Any]:
    """Return all keywords with their defaults.

    Raises UnknownNameError or MtpBenchError for a wrong keyword, or wrong ``data``.
    """
    if not isinstance(data, (str, os.PathLike, type(None))):
        raise MtpBenchError(f"data is {data!r}, expected the path of the data root")
    names = EnvKeywords.__annotations__
    for name in keywords:
        require_known("keyword of the env", name, names)
    values = dict.fromkeys(names) | dict.fromkeys(_FLAGS, False)
    values |= {"observe": "detections", **keywords}
    if values["strict"] is None:
        values["strict"] = not values["evaluation"]
    for name in (*_FLAGS, "strict"):
        if not isinstance(values[name], bool):
            raise MtpBenchError(f"{name} is {values[name]!r}, expected true or false")
    for name in _TEXTS:
        if not isinstance(values[name], str | None):
            raise MtpBenchError(f"{name} is {values[name]!r}, expected a text")
    require_known("value of observe", values["observe"], OBSERVE)
    observes_tracks = values["observe"] == "tracks"
    if observes_tracks != (values["track_file"] is not None):
        raise MtpBenchError(
            f"observe is {values['observe']!r} and track_file is "
            f"{values['track_file']!r}, expected observe='tracks' and a file or folder "
            "of stored tracks, or neither"
        )
    mode = values["render_mode"]
    if mode is not None and mode not in RENDERERS:
        raise UnknownNameError("render mode", str(mode), tuple(RENDERERS))
    return values


def require_training(card: Card, values: Mapping[str, Any]) -> None:
    """Raise MtpBenchError for an option of training where it has no place."""
    evaluation = values["evaluation"]
    if values["fresh_noise"] and (evaluation or card.detector is None):
        raise MtpBenchError(
            "fresh_noise is for training with a simulated detector, not for evaluation"
        )
    if values["target_frames"] and evaluation:
        raise MtpBenchError(
            "target_frames is for training, not for evaluation: "
            "a score needs every frame"
        )
    for name in ("fresh_noise", "target_frames", "track_file"):
        if values[name]:
            card.require_same_scenes(f"which takes no {name}", "leave it out")


def check_size(name: str, value: int | None, default: int) -> int:
    """Return a size of the spaces: the given one, else the card's.

    Raises MtpBenchError unless it is a positive integer.
    """
    if value is None:
        return default
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 1:
        raise MtpBenchError(
            f"{name} is {value!r}, expected a whole number of at least 1 "
            f"(the card has {default})"
        )
    return int(value)


def require_room(env_id: str, sizes: Mapping[str, int], kind: str, count: int) -> None:
    """Raise MtpBenchError if an action or observation (``kind``) would be too large.

    ``count``: its numbers.
    """
    size = _NUMBER_BYTES * count
    if size > _MAX_BYTES:
        texts = ", ".join(f"{name} {value}" for name, value in sizes.items())
        raise MtpBenchError(
            f"{env_id} with {texts}: one {kind} would have {size / 2**20:.0f} MiB, "
            f"expected at most {_MAX_BYTES >> 20} MiB: choose smaller sizes"
        )


def own_scenes(values: Mapping[str, Any]) -> Sequence[Scene] | None:
    """Return the `Scene` objects among the keywords.

    None if ``scenes`` holds names.
    """
    scenes = values["scenes"]
    if scenes is None:
        return None
    if isinstance(scenes, Scene):
        raise MtpBenchError(
            f"scenes is the scene {scenes.name!r}, expected a list: scenes=[scene]"
        )
    if isinstance(scenes, str) or not isinstance(scenes, Collection):
        raise MtpBenchError(
            f"scenes is {scenes!r}, expected a list of names, or of Scene objects"
        )
    if not any(isinstance(scene, Scene) for scene in scenes):
        return None
    if values["files"] is not None:
        raise MtpBenchError(
            "scenes holds Scene objects and files names a folder, "
            "expected only one of them"
        )
    return list(scenes)


def choose_scenes(
    all_names: Sequence[str], chosen: Sequence[str] | None
) -> tuple[str, ...]:
    """Return the names of the scenes that episodes are drawn from.

    None: all.
    """
    names = tuple(dict.fromkeys(all_names if chosen is None else chosen))
    for name in names:
        require_known("scene", name, all_names)
    if not names:
        raise MtpBenchError(
            "no scene to choose from: expected at least one name in scenes"
        )
    return names


def scene_option(options: Mapping[str, Any], names: Sequence[str]) -> str | None:
    """Return the scene that the options of reset name, if any.

    Raises UnknownNameError for another option, or a name that is not in ``names``.
    """
    for key in options:
        if key != "scene":
            raise UnknownNameError("reset option", str(key), ["scene"])
    if "scene" not in options:
        return None
    require_known("scene", options["scene"], names)
    return str(options["scene"])
