"""`check_card`: checks of the env that a card makes, by Gymnasium and of its targets."""

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
    """Check a card: the path of a .toml, or an id.

    The findings have an "ok" for each check that passes. The card is read, its env is
    made and given to Gymnasium's own checker on its first scene, and that scene must
    hold detections that fit and targets. Without its data under ``data`` a warning says
    that only the card was checked; unreadable data is an error. Errors of the card or
    its data are findings, not exceptions.
    """
    where = str(path)
    try:
        card = load_card(where)
    except MtpBenchError as error:
        return [Finding("error", "card", str(error), "a card", where)]
    findings = [Finding("ok", "card", f"{card.id}: {card.summary}")]
    try:
        scene_names = MTPEnv(where, data).scene_names
        env = MTPEnv(where, data, scenes=scene_names[:1])
        env.reset(seed=0)
    except DataError as error:
        status = describe(card, data)
        if status.root is None or status.missing:
            got = "the env was not checked: its data is missing"
            finding = Finding("warning", "data", got, "", where, str(error))
        else:
            expected = "data that can be read"
            finding = Finding("error", "data", str(error), expected, where)
        return [*findings, finding]
    except MtpBenchError as error:
        return [*findings, Finding("error", "env", str(error), "an env", where)]
    return [*findings, *_check_env(env), *_check_content(env)]


def _check_env(env: MTPEnv) -> list[Finding]:
    """Run Gymnasium's own checker."""
    from gymnasium.utils.env_checker import check_env

    check_name = "gymnasium"
    where = f"{env.card.id}, scene {env.scene_names[0]}"
    untyped: Any = env
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            check_env(untyped, skip_render_check=True)
        except Exception as error:  # the checker asserts, and raises what the env does
            text = f"{type(error).__name__}: {error}"
            return [Finding("error", check_name, text, "a sound env", where)]
    if not caught:
        return [Finding("ok", check_name, "Gymnasium's checker passes")]
    texts = [str(item.message) for item in caught]
    return [Finding("warning", check_name, text, "no warning", where) for text in texts]


def _check_content(env: MTPEnv) -> list[Finding]:
    """Check that the first scene has detections that fit, and targets."""
    env.reset(seed=0, options={"scene": env.scene_names[0]})
    scene = env.scene
    card = env.card
    findings: list[Finding] = []

    def warn(check_name: str, got: str, expected: str, advice: str = "") -> None:
        where = f"{card.id}, scene {scene.name}"
        findings.append(Finding("warning", check_name, got, expected, where, advice))

    max_detections = int(scene.detections.counts.max(initial=0))
    if max_detections > card.size.detections:
        warn(
            "sizes",
            f"{max_detections} detections in a frame",
            f"at most {card.size.detections}",
            "raise detections in [size]: the lowest scores are dropped",
        )
    if not max_detections:
        warn("detections", "0 in this scene", "at least 1")
    targets = len(find_targets(scene, card).frame)
    if not targets:
        warn(
            "targets",
            "0 in this scene",
            "objects to forecast",
            "compare past and future in [task] with the length of the scenes",
        )
    text = (
        f"{scene.frames} frames, {targets} targets, at most {max_detections} detections"
    )
    return findings or [Finding("ok", "content", text)]
