"""Causes of the errors of a stored run: parts of bADE per target (docs/definitions, "Parts of the error")."""

import hashlib
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from ..agent import load_submission
from ..core import (
    MtpBenchError,
    SubmissionError,
    UnknownNameError,
    __version__,
    cache_root,
    long_work,
)
from ..scoring import (
    DEFINITIONS,
    PARTS,
    AgentScores,
    SceneParts,
    agent_table,
    blame,
    error_parts,
    reference_errors,
    score_scene,
    thresholds_of,
)
from ..sources import Arrays, read_arrays, write_arrays
from .evaluation import scores_of
from .options import DEFAULTS, RunOptions
from .playing import jobs_of, run_jobs
from .reference import card_budget
from .rollout_files import RUN_FILE
from .settings import Setting, references_of, setting_of
from .stored import OpenedRun, run_scores

_SPLIT = (
    "associated",
    "tracks",
)  # references that split the error of a forecast, fields of `References`


def run_parts(
    opened: OpenedRun, options: RunOptions = DEFAULTS, again: bool = False
) -> dict[str, SceneParts]:
    """Parts of the errors of a stored run by scene: they add up to the bADE of each target of the run.

    Made once, which runs two references on all scenes of the run, and kept in the cache. Without references, the error
    of a forecast is its rest, and `SceneParts.unsplit` says why. ``options``: workers. ``again``: not from the cache.
    Raises DataError if the scenes cannot be read.
    """
    runs, why = _references(opened)
    content = f"{__version__}|{DEFINITIONS}|{why}|{(opened.folder / RUN_FILE).read_text(encoding='utf-8')}"
    path = (
        cache_root()
        / "causes"
        / f"{hashlib.sha256(content.encode()).hexdigest()[:32]}.npz"
    )
    names = [rollout.scene for rollout in opened.run.rollouts]
    stored = None if again else read_arrays(path)
    if stored is None:
        stored, failed = _made(opened, names, runs, options)
        why = why or failed
        if not failed:  # tried again the next time
            with suppress(
                OSError, MtpBenchError
            ):  # without a cache it is made each time
                path.parent.mkdir(parents=True, exist_ok=True)
                write_arrays(path, stored)
    part, ends = stored["part"], np.cumsum(stored["count"])[:-1]
    usual = float(blame(part).mean()) if len(part) else 0.0
    rows = zip(
        names, np.split(part, ends), np.split(stored["distance"], ends), strict=True
    )
    return {
        name: SceneParts(own, usual, distance, why, stored["thresholds"])
        for name, own, distance in rows
    }


def _references(opened: OpenedRun) -> tuple[dict[str, Setting], str]:
    """The references that split the errors of a run, or none and the reason."""
    info, card = opened.run.info, opened.card
    if info.observe != "detections":
        return {}, f"its agent observes {info.observe}"
    try:
        submission = load_submission(info.folder or info.agent)
    except (SubmissionError, UnknownNameError):
        return {}, f"no submission {info.folder or info.agent!r} there any more"
    if submission.digest != info.submission_digest:
        return {}, "its submission has changed since the run"
    own = setting_of(submission, card)
    setting = replace(
        own,
        parameters=info.parameters,
        hypotheses=info.hypotheses,
        samples=info.samples,
    )
    found = references_of(setting, card)
    return (
        (found, "")
        if {*_SPLIT} <= found.keys()
        else ({}, "its manifest states no gap_references")
    )


def _made(
    opened: OpenedRun,
    names: Sequence[str],
    runs: dict[str, Setting],
    options: RunOptions,
) -> tuple[Arrays, str]:
    """Parts [n, len(PARTS)] and distances [n] of all targets, m, their numbers by scene; why a reference failed."""
    split, failed = None, ""
    with long_work(
        "finding causes: scoring the run, and the two references that split its errors"
    ):
        scores = run_scores(opened, options)
        try:
            associated, tracks = (
                _scores(runs[name], opened, names, options) if runs else None
                for name in _SPLIT
            )
            split = reference_errors(associated, tracks, opened.run.info.samples)
        except SubmissionError as error:  # such as weights that are not there
            failed = f"a reference failed: {error}"
        table = agent_table(scores, None, card_budget(opened.card.id))
        found = error_parts(table, "all", split)
    count = [len(score) for score in scores.seeds[0]]
    part = np.stack([found.get(name, np.zeros(sum(count))) for name in PARTS], axis=1)
    distance = np.concatenate([score.distance for score in scores.seeds[0]])
    arrays = {
        "part": part,
        "count": np.array(count),
        "distance": distance,
        "thresholds": thresholds_of(table),
    }
    return arrays, failed


def _scores(
    setting: Setting, opened: OpenedRun, names: Sequence[str], options: RunOptions
) -> AgentScores:
    keywords = {"data": opened.data, **setting.env_keywords(opened.card)}
    jobs = jobs_of(
        setting.submission,
        opened.card,
        keywords,
        names,
        opened.run.info.seed,
        setting.parameters,
    )
    return scores_of(setting, [tuple(run_jobs(jobs, options, score_scene))])
