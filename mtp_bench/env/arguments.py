"""The arguments of the env: JSON values, each checked with one clear error."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping, Sequence
from typing import Any, TypedDict

import numpy as np

from ..errors import MtpBenchError, UnknownNameError
from ..types import Scene
from .renderers import RENDERERS

MOST_BYTES = 64 << 20  # of one answer, and of one observation: what is sent between an agent and its judge
OBSERVE = ("detections", "truth", "tracks")


class EnvKeywords(TypedDict, total=False):
    """Keywords of `MTPEnv`; None and what is not given stand for the card's own or for no."""

    observe: str  # "detections", "truth" for true boxes with true ids, or "tracks" for those of ``track_file``
    samples: int | None  # K; more than the card's belong to unranked runs
    tracks: int | None  # N
    objects: int | None  # O
    hypotheses: int | None  # H
    detections: int | None  # D
    scenes: Sequence[str] | Sequence[Scene] | None  # names to choose from, or scenes of one's own (`cards.with_scenes`)
    evaluation: bool  # the reward is 0 and nothing that is returned derives from the truth
    strict: bool | None  # an action outside the action space is an ActionError; None: unless ``evaluation``
    rigid_motion: bool  # the local frame of every episode is turned and shifted at random
    split: str | None  # another split of the card's source
    detector: str | None  # another detector, simulated on the true boxes or stored (`cards.with_detector`)
    detection_file: str | None  # stored detections of one's own (`cards.with_detections`)
    track_file: str | None  # file or folder of stored tracks (`sources.tracks`), for ``observe="tracks"``
    files: str | None  # a folder of scenes of one's own (`cards.with_files`)
    fresh_noise: bool  # the noise of a simulated detector is drawn anew in every episode, for training
    render_mode: str | None  # what `render` does, of RENDERERS


def checked(data: object, keywords: Mapping[str, Any]) -> dict[str, Any]:
    """All keywords with their defaults; raises UnknownNameError or MtpBenchError for a wrong one, or wrong ``data``."""
    if not isinstance(data, (str, os.PathLike, type(None))):
        raise MtpBenchError(f"data is {data!r}, expected the path of the data root")
    known = EnvKeywords.__annotations__
    for name in keywords:
        if name not in known:
            raise UnknownNameError("keyword of the env", name, known)
    flags = dict.fromkeys(("evaluation", "rigid_motion", "fresh_noise"), False)
    whole = {**dict.fromkeys(known), "observe": "detections", **flags, **keywords}
    if whole["strict"] is None:
        whole["strict"] = not whole["evaluation"]
    for name in (*flags, "strict"):
        if not isinstance(whole[name], bool):
            raise MtpBenchError(f"{name} is {whole[name]!r}, expected true or false")
    for name in ("split", "detector", "detection_file", "track_file", "files"):
        if whole[name] is not None and not isinstance(whole[name], str):
            raise MtpBenchError(f"{name} is {whole[name]!r}, expected a text")
    if whole["observe"] not in OBSERVE:
        raise UnknownNameError("value of observe", str(whole["observe"]), OBSERVE)
    if (whole["observe"] == "tracks") != (whole["track_file"] is not None):
        raise MtpBenchError(
            f"observe is {whole['observe']!r} and track_file is {whole['track_file']!r}, expected observe='tracks' and "
            "a file or folder of stored tracks, or neither"
        )
    if whole["render_mode"] not in (None, *RENDERERS):
        raise UnknownNameError("render mode", str(whole["render_mode"]), tuple(RENDERERS))
    return whole


def size(name: str, value: int | None, default: int) -> int:
    """A size of the spaces: the given one or the card's; raises MtpBenchError for what is none."""
    if value is None:
        return default
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 1:
        raise MtpBenchError(f"{name} is {value!r}, expected a whole number of at least 1 (the card has {default})")
    return int(value)


def require_room(env_id: str, sizes: Mapping[str, int], kind: str, count: int) -> None:
    """Raise MtpBenchError where an answer or an observation (``kind``) of ``count`` numbers would be too large."""
    if 8 * count > MOST_BYTES:
        given = ", ".join(f"{name} {value}" for name, value in sizes.items())
        raise MtpBenchError(
            f"{env_id} with {given}: one {kind} would have {8 * count / 2**20:.0f} MiB, expected at most "
            f"{MOST_BYTES >> 20} MiB, which is what is sent between an agent and its judge: choose smaller sizes"
        )


def own_scenes(given: Mapping[str, Any]) -> Sequence[Scene] | None:
    """The scenes of one's own among the keywords; None where ``scenes`` holds names."""
    scenes = given["scenes"]
    if isinstance(scenes, Scene):
        raise MtpBenchError(f"scenes is the scene {scenes.name!r}, expected a list: scenes=[scene]")
    if scenes is None or isinstance(scenes, str):
        return None
    if not isinstance(scenes, Collection):
        raise MtpBenchError(f"scenes is {scenes!r}, expected a list of names, or of Scene objects")
    if not any(isinstance(scene, Scene) for scene in scenes):
        return None
    if given["files"] is not None:
        raise MtpBenchError("scenes holds Scene objects and files names a folder, expected one of them")
    return list(scenes)


def choose(known: tuple[str, ...], wanted: Sequence[str] | None) -> tuple[str, ...]:
    """Scenes to draw from: all, or those named."""
    if wanted is None:
        chosen = known
    elif isinstance(wanted, str):
        raise MtpBenchError(f"scenes is {wanted!r}, expected a list of names")
    else:
        for name in wanted:
            if name not in known:
                raise UnknownNameError("scene", str(name), known)
        chosen = tuple(dict.fromkeys(wanted))
    if not chosen:
        raise MtpBenchError("no scene to choose from: expected at least one name in scenes")
    return chosen


def wanted(options: dict[str, Any], known: tuple[str, ...], drawn: str) -> str:
    """The scene that the options of reset name, else the one ``drawn``; raises UnknownNameError."""
    for key in options:
        if key != "scene":
            raise UnknownNameError("reset option", str(key), ["scene"])
    name = options.get("scene", drawn)
    if name not in known:
        raise UnknownNameError("scene", str(name), known)
    return str(name)
