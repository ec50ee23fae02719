"""Arguments of the env: JSON values, each checked with one clear error."""

import os
from collections.abc import Collection, Mapping, Sequence
from typing import Any, TypedDict

import numpy as np

from ..core import MtpBenchError, Scene, UnknownNameError, require_known
from .episode import RENDERERS

MOST_BYTES = (
    64 << 20
)  # of one action, and of one observation: they are sent between an agent and the env
OBSERVE = ("detections", "truth", "associated", "tracks")


class EnvKeywords(TypedDict, total=False):
    """Keywords of `MTPEnv`; None or a missing one means the card's own value, if the card has one."""

    # "detections", "truth" for true boxes with true ids, "associated" for detections with the ids of true objects, or
    # "tracks" for those of ``track_file``
    observe: str
    samples: int | None  # K; more than the card's belong to unranked runs
    tracks: int | None  # N
    objects: int | None  # O
    hypotheses: int | None  # H
    detections: int | None  # D
    scenes: (
        Sequence[str] | Sequence[Scene] | None
    )  # names to choose from, or scenes of one's own (`cards.with_scenes`)
    evaluation: bool  # the reward is 0 and no returned value derives from the truth
    strict: (
        bool | None
    )  # an action outside the action space is an ActionError; None: unless ``evaluation``
    rigid_motion: bool  # the local frame of every episode is turned and shifted at random, with the lanes that it shows
    split: str | None  # another split of the card's source
    detector: (
        str | None
    )  # another detector, simulated on the true boxes or stored (`cards.with_detector`)
    detection_file: (
        str | None
    )  # stored detections of one's own (`cards.with_detections`)
    track_file: (
        str | None
    )  # file or folder of stored tracks (`sources.stored_tracks`), for ``observe="tracks"``
    files: str | None  # a folder of scenes of one's own (`cards.with_files`)
    presence: (
        str | None
    )  # the presence model of baselines: its file, or "scores" (`cards.with_presence`)
    target_frames: bool  # episodes are the frames from the first to the last that can hold a target, for training
    fresh_noise: bool  # the noise of a simulated detector is drawn anew in every episode, for training
    render_mode: str | None  # one of RENDERERS


def checked(data: object, keywords: Mapping[str, Any]) -> dict[str, Any]:
    """All keywords with their defaults; raises UnknownNameError or MtpBenchError for a wrong one, or wrong ``data``."""
    if not isinstance(data, (str, os.PathLike, type(None))):
        raise MtpBenchError(f"data is {data!r}, expected the path of the data root")
    names = EnvKeywords.__annotations__
    for name in keywords:
        require_known("keyword of the env", name, names)
    flags = dict.fromkeys(
        ("evaluation", "rigid_motion", "target_frames", "fresh_noise"), False
    )
    values = {**dict.fromkeys(names), "observe": "detections", **flags, **keywords}
    if values["strict"] is None:
        values["strict"] = not values["evaluation"]
    for name in (*flags, "strict"):
        if not isinstance(values[name], bool):
            raise MtpBenchError(f"{name} is {values[name]!r}, expected true or false")
    for name in (
        "split",
        "detector",
        "detection_file",
        "track_file",
        "files",
        "presence",
    ):
        if not isinstance(values[name], str | None):
            raise MtpBenchError(f"{name} is {values[name]!r}, expected a text")
    require_known("value of observe", values["observe"], OBSERVE)
    if (values["observe"] == "tracks") != (values["track_file"] is not None):
        raise MtpBenchError(
            f"observe is {values['observe']!r} and track_file is {values['track_file']!r}, expected observe='tracks' "
            "and a file or folder of stored tracks, or neither"
        )
    if values["render_mode"] not in (None, *RENDERERS):
        raise UnknownNameError(
            "render mode", str(values["render_mode"]), tuple(RENDERERS)
        )
    return values


def size(name: str, value: int | None, default: int) -> int:
    """A size of the spaces: the given one, else the card's; raises MtpBenchError unless it is a positive integer."""
    if value is None:
        return default
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 1:
        raise MtpBenchError(
            f"{name} is {value!r}, expected a whole number of at least 1 (the card has {default})"
        )
    return int(value)


def require_room(env_id: str, sizes: Mapping[str, int], kind: str, count: int) -> None:
    """Raise MtpBenchError if an action or an observation (``kind``) of ``count`` numbers would be too large."""
    if 8 * count > MOST_BYTES:
        given = ", ".join(f"{name} {value}" for name, value in sizes.items())
        raise MtpBenchError(
            f"{env_id} with {given}: one {kind} would have {8 * count / 2**20:.0f} MiB, expected at most "
            f"{MOST_BYTES >> 20} MiB: choose smaller sizes"
        )


def own_scenes(values: Mapping[str, Any]) -> Sequence[Scene] | None:
    """`Scene` objects among the keywords; None if ``scenes`` holds names."""
    scenes = values["scenes"]
    if isinstance(scenes, Scene):
        raise MtpBenchError(
            f"scenes is the scene {scenes.name!r}, expected a list: scenes=[scene]"
        )
    if scenes is None:
        return None
    if isinstance(scenes, str) or not isinstance(scenes, Collection):
        raise MtpBenchError(
            f"scenes is {scenes!r}, expected a list of names, or of Scene objects"
        )
    if not any(isinstance(scene, Scene) for scene in scenes):
        return None
    if values["files"] is not None:
        raise MtpBenchError(
            "scenes holds Scene objects and files names a folder, expected only one of them"
        )
    return list(scenes)


def choose(known: Sequence[str], wanted: Sequence[str] | None) -> tuple[str, ...]:
    """Names of the scenes that episodes are drawn from: all ``known`` ones, or the ``wanted`` ones."""
    chosen = tuple(known if wanted is None else dict.fromkeys(wanted))
    for name in chosen:
        require_known("scene", name, known)
    if not chosen:
        raise MtpBenchError(
            "no scene to choose from: expected at least one name in scenes"
        )
    return chosen


def wanted(options: dict[str, Any], known: Sequence[str], drawn: str) -> str:
    """The scene that the options of reset name, else the one ``drawn``; raises UnknownNameError."""
    for key in options:
        if key != "scene":
            raise UnknownNameError("reset option", str(key), ["scene"])
    name = options.get("scene", drawn)
    require_known("scene", name, known)
    return str(name)
