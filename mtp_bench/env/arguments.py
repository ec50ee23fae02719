"""Arguments of the env: JSON values, each checked with one clear error."""

import os
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from ..cards import Card, ChangeKeywords
from ..core import MtpBenchError, Scene, UnknownNameError, require_known
from .episode import RENDERERS

# Of one action, and of one observation: they are sent between an agent and the env.
MAX_BYTES = 64 << 20
OBSERVE = ("detections", "truth", "associated", "tracks")
_FLAGS = ("evaluation", "rigid_motion", "target_frames", "fresh_noise")
# Sizes of the spaces whose keyword has another name: files have theirs.
_SIZE_KEYWORDS = {
    "detections": "max_detections",
    "tracks": "max_tracks",
    "objects": "max_objects",
}


class EnvKeywords(ChangeKeywords, total=False):
    """Keywords of `MTPEnv`, with those of `ChangeKeywords`.

    None or a missing one means the card's own value, if the card has one.
    """

    # "detections", "truth" for true boxes with true ids, "associated" for detections
    # with the ids of true objects, or "tracks" for stored ones
    observe: str
    # file or folder of stored tracks (`sources.stored_tracks`), for observe="tracks"
    tracks: str | os.PathLike[str] | None
    samples: int | None  # K; more than the card's belong to unranked runs
    hypotheses: int | None  # H
    max_tracks: int | None  # N
    max_objects: int | None  # O
    max_detections: int | None  # D
    # names to choose from, or scenes of one's own (`cards.with_scenes`)
    scenes: Sequence[str] | Sequence[Scene] | None
    evaluation: bool  # the reward is 0 and no returned value derives from the truth
    # an action outside the action space is an ActionError; None: unless ``evaluation``
    strict: bool | None
    # the local frame of every episode is turned and shifted at random, with its lanes
    rigid_motion: bool
    # for training: an episode has the frames from the first to the last that can hold
    # a target
    target_frames: bool
    # for training: the noise of a simulated detector is drawn anew in every episode
    fresh_noise: bool
    render_mode: str | None  # one of RENDERERS


def check_keywords(data: object, keywords: Mapping[str, Any]) -> dict[str, Any]:
    """Return all keywords with their defaults, paths as text.

    Raises UnknownNameError or MtpBenchError for a wrong one, or wrong ``data``.
    """
    if not isinstance(data, (str, os.PathLike, type(None))):
        raise MtpBenchError(f"data is {data!r}, expected the path of the data root")
    names = EnvKeywords.__annotations__
    for name in keywords:
        require_known("keyword of the env", name, names)
    values = dict[str, Any](dict.fromkeys(names))
    values |= {"observe": "detections", **dict.fromkeys(_FLAGS, False), **keywords}
    if values["strict"] is None:
        values["strict"] = not values["evaluation"]
    for name in (*_FLAGS, "strict"):
        if not isinstance(values[name], bool):
            raise MtpBenchError(f"{name} is {values[name]!r}, expected true or false")
    for name in ("tracks", *ChangeKeywords.__annotations__):
        if name != "perturb":
            values[name] = _text(name, values[name])
    _check_observe(values["observe"], values["tracks"])
    if values["render_mode"] not in (None, *RENDERERS):
        mode = str(values["render_mode"])
        raise UnknownNameError("render mode", mode, tuple(RENDERERS))
    return values


def _text(name: str, value: object) -> str | None:
    if isinstance(value, os.PathLike):
        value = os.fspath(value)
    if not isinstance(value, str | None):
        raise MtpBenchError(f"{name} is {value!r}, expected a text")
    return value


def _check_observe(observe: str, tracks: str | None) -> None:
    """Raise MtpBenchError unless stored tracks are named where they are observed."""
    require_known("value of observe", observe, OBSERVE)
    if (observe == "tracks") != (tracks is not None):
        raise MtpBenchError(
            f"observe is {observe!r} and tracks is {tracks!r}, expected "
            "observe='tracks' and a file or folder of stored tracks, or neither"
        )


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
    for name in ("fresh_noise", "target_frames", "tracks"):
        if values[name]:
            card.require_same_scenes(f"which takes no {name}", "leave it out")


def chosen_sizes(
    values: Mapping[str, Any], card_sizes: Mapping[str, int]
) -> dict[str, int]:
    """Return the sizes of the spaces.

    A size that no keyword states is that of the card.
    Raises MtpBenchError unless each is a positive whole number.
    """
    sizes: dict[str, int] = {}
    for name, default in card_sizes.items():
        keyword = _SIZE_KEYWORDS.get(name, name)
        value = values[keyword]
        if value is None:
            value = default
        if isinstance(value, bool) or not isinstance(value, int | np.integer):
            value = 0  # refused below
        if value < 1:
            raise MtpBenchError(
                f"{keyword} is {values[keyword]!r}, expected a whole number of at "
                f"least 1 (the card has {default})"
            )
        sizes[name] = int(value)
    return sizes


def require_room(env_id: str, sizes: Mapping[str, int], kind: str, count: int) -> None:
    """Raise MtpBenchError if an action or observation would be too large.

    ``kind``: "action" or "observation". ``count``: how many numbers it holds, of 8
    bytes each.
    """
    if 8 * count > MAX_BYTES:
        stated_sizes = ", ".join(f"{name} {value}" for name, value in sizes.items())
        raise MtpBenchError(
            f"{env_id} with {stated_sizes}: one {kind} would have "
            f"{8 * count / 2**20:.0f} MiB, expected at most {MAX_BYTES >> 20} MiB: "
            "choose smaller sizes"
        )


def own_scenes(values: Mapping[str, Any]) -> Sequence[Scene] | None:
    """Return `Scene` objects among the keywords.

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
    names: Sequence[str], chosen: Sequence[str] | None
) -> tuple[str, ...]:
    """Return the scenes that episodes are drawn from: all ``names``, or chosen ones."""
    if chosen is None:
        chosen = names
    scene_names = tuple(dict.fromkeys(chosen))
    for name in scene_names:
        require_known("scene", name, names)
    if not scene_names:
        raise MtpBenchError(
            "no scene to choose from: expected at least one name in scenes"
        )
    return scene_names


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
