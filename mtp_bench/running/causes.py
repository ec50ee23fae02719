"""Causes of the errors of a stored run: parts of bADE per target.

See docs/definitions, "Parts of the error".
"""

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
    PART_NAMES,
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

# References that split the error of a forecast, fields of `References`.
_SPLIT_ROLES = ("associated", "tracks")


def run_parts(
    opened: OpenedRun, options: RunOptions = DEFAULTS, again: bool = False
) -> dict[str, SceneParts]:
    """Return the parts of the errors of a stored run by scene.

    They add up to the bADE of each target of the run. Made once, which runs two
    references on all scenes of the run, and kept in the cache. Without references, the
    whole error of a forecast is the part "rest", and `SceneParts.unsplit` says why.
    ``options``: workers. ``again``: make them even if the cache has them. Raises
    DataError if the scenes cannot be read.
    """
    references, unsplit = _references(opened)
    run_text = (opened.folder / RUN_FILE).read_text(encoding="utf-8")
    samples = opened.run.info.samples  # may be fewer than the run has
    content = f"{__version__}|{DEFINITIONS}|{unsplit}|{samples}|{run_text}"
    digest = hashlib.sha256(content.encode()).hexdigest()[:32]
    path = cache_root() / "causes" / f"{digest}.npz"
    scene_names = [rollout.scene for rollout in opened.run.rollouts]
    arrays = None if again else read_arrays(path)
    if arrays is None:
        arrays, failure = _make_parts(opened, scene_names, references, options)
        unsplit = unsplit or failure
        if not failure:  # else it is tried again the next time
            with suppress(OSError, MtpBenchError):  # a cache is not needed
                path.parent.mkdir(parents=True, exist_ok=True)
                write_arrays(path, arrays)
    part = arrays["part"]
    mean_blame = float(blame(part).mean()) if len(part) else 0.0
    ends = np.cumsum(arrays["count"])[:-1]
    parts = np.split(part, ends)
    distances = np.split(arrays["distance"], ends)
    scene_parts: dict[str, SceneParts] = {}
    for i, scene_name in enumerate(scene_names):
        scene_parts[scene_name] = SceneParts(
            parts[i], mean_blame, distances[i], unsplit, arrays["thresholds"]
        )
    return scene_parts


def _references(opened: OpenedRun) -> tuple[dict[str, Setting], str]:
    """Return the references that split the errors of a run, or none and the reason."""
    info = opened.run.info
    if info.observe == "file":
        return {}, "they were read from a file, and no submission can be run again"
    if info.observe != "detections":
        return {}, f"its agent observes {info.observe}"
    folder = info.folder or info.agent
    try:
        submission = load_submission(folder)
    except (SubmissionError, UnknownNameError):
        return {}, f"no submission {folder!r} there any more"
    if submission.digest != info.submission_digest:
        return {}, "its submission has changed since the run"
    setting = replace(
        setting_of(submission, opened.card),
        parameters=info.parameters,
        hypotheses=info.hypotheses,
        samples=info.samples,
    )
    references = references_of(setting, opened.card)
    if not references.keys() >= set(_SPLIT_ROLES):
        return {}, "its manifest states no gap_references"
    return references, ""


def _make_parts(
    opened: OpenedRun,
    scene_names: Sequence[str],
    references: dict[str, Setting],
    options: RunOptions,
) -> tuple[Arrays, str]:
    """Return the parts of all targets, and why a reference failed.

    The arrays: ``part`` [n, len(PART_NAMES)] and ``distance`` [n] to the ego, m;
    ``count``, the number of targets of each scene; ``thresholds`` of `thresholds_of`.
    """
    split = None
    failure = ""
    with long_work("finding causes: scoring the run and two references"):
        scores = run_scores(opened, options)
        try:
            if references:
                associated, tracks = [
                    _reference_scores(references[role], opened, scene_names, options)
                    for role in _SPLIT_ROLES
                ]
                split = reference_errors(associated, tracks, opened.run.info.samples)
        except SubmissionError as error:  # such as weights that are not there
            failure = f"a reference failed: {error}"
        table = agent_table(
            scores, reference=None, constants=card_budget(opened.card.id)
        )
        parts = error_parts(replace(table, split=split), "all")
    scene_scores = scores.seeds[0]  # a stored run has one seed
    count = np.array([len(score) for score in scene_scores])
    missing = np.zeros(count.sum())
    arrays = {
        "part": np.stack(
            [parts.get(part_name, missing) for part_name in PART_NAMES], axis=1
        ),
        "count": count,
        "distance": np.concatenate([score.distance for score in scene_scores]),
        "thresholds": thresholds_of(table),
    }
    return arrays, failure


def _reference_scores(
    setting: Setting,
    opened: OpenedRun,
    scene_names: Sequence[str],
    options: RunOptions,
) -> AgentScores:
    """Score a new run of a reference on a stored run's scenes."""
    jobs = jobs_of(
        setting.submission,
        opened.card,
        {"data": opened.data, **setting.env_keywords(opened.card)},
        scene_names,
        opened.run.info.seed,
        setting.parameters,
    )
    return scores_of(setting, [tuple(run_jobs(jobs, options, score_scene))])
