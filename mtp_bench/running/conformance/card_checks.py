"""`check_card`: checks that a card makes an env that Gymnasium accepts, with targets to score."""

import warnings
from pathlib import Path
from typing import Any

from ...cards import load_card
from ...core import DataError, MtpBenchError
from ...env import MTPEnv
from ...scoring import find_targets
from ...sources import describe
from .playing import Finding


def check_card(path: str | Path, data: str | None = None) -> list[Finding]:
    """Findings of all checks of a card (path of a .toml, or an id), with an "ok" for each check that passes.

    The card is read, its env is made and given to Gymnasium's own checker on its first scene, and that scene must hold
    detections that fit and targets. Without its data under ``data`` a warning says that only the card was checked;
    unreadable data is an error. Errors of the card or its data are findings, not exceptions.
    """
    try:
        card = load_card(str(path))
    except MtpBenchError as error:
        return [Finding("error", "card", str(error), "a card", str(path))]
    findings = [Finding("ok", "card", f"{card.id}: {card.summary}")]
    try:
        env = MTPEnv(str(path), data)
        env = MTPEnv(str(path), data, scenes=env.scene_names[:1])
        env.reset(seed=0)
    except DataError as error:
        status = describe(card, data)
        if status.root is not None and not status.missing:
            return [
                *findings,
                Finding(
                    "error", "data", str(error), "data that can be read", str(path)
                ),
            ]
        got = "the env was not checked: its data is missing"
        return [*findings, Finding("warning", "data", got, "", str(path), str(error))]
    except MtpBenchError as error:
        return [*findings, Finding("error", "env", str(error), "an env", str(path))]
    return [*findings, *_gymnasium(env), *_content(env)]


def _gymnasium(env: MTPEnv) -> list[Finding]:
    from gymnasium.utils.env_checker import check_env

    where = f"{env.card.id}, scene {env.scene_names[0]}"
    untyped: Any = env
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            check_env(untyped, skip_render_check=True)
        except (
            Exception
        ) as error:  # the checker asserts, and raises what the env raises
            return [
                Finding(
                    "error",
                    "gymnasium",
                    f"{type(error).__name__}: {error}",
                    "a sound env",
                    where,
                )
            ]
    found = [
        Finding("warning", "gymnasium", str(item.message), "no warning", where)
        for item in caught
    ]
    return found or [Finding("ok", "gymnasium", "Gymnasium's checker passes")]


def _content(env: MTPEnv) -> list[Finding]:
    """Check that the first scene has detections and targets."""
    env.reset(seed=0, options={"scene": env.scene_names[0]})
    scene, card = env.scene, env.card
    where = f"{card.id}, scene {scene.name}"
    found: list[Finding] = []
    most = int(scene.detections.counts.max(initial=0))
    if most > card.size.detections:
        got, advice = (
            f"{most} detections in a frame",
            "raise detections in [size]: the lowest scores are dropped",
        )
        found.append(
            Finding(
                "warning",
                "sizes",
                got,
                f"at most {card.size.detections}",
                where,
                advice,
            )
        )
    if not most:
        found.append(
            Finding("warning", "detections", "0 in this scene", "at least 1", where)
        )
    targets = len(find_targets(scene, card).frame)
    if not targets:
        advice = "compare past and future in [task] with the length of the scenes"
        found.append(
            Finding(
                "warning",
                "targets",
                "0 in this scene",
                "objects to forecast",
                where,
                advice,
            )
        )
    return found or [
        Finding(
            "ok",
            "content",
            f"{scene.frames} frames, {targets} targets, at most {most} detections",
        )
    ]
