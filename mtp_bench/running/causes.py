"""Causes of the errors of a stored run: parts of bADE per target (docs/definitions, "Parts of the error")."""

import hashlib
import zlib
from collections.abc import Sequence
from dataclasses import replace
from zipfile import BadZipFile

import numpy as np

from .._version import __version__
from ..errors import SubmissionError, UnknownNameError
from ..files import cache_root, whole_file
from ..parallel import reported
from ..scoring import AgentScores, score_scene
from ..scoring.parts import PARTS, SceneParts, blame, error_parts, reference_errors
from ..scoring.table import agent_table
from ..submission.loader import load_submission
from ..types import Floats, Ints
from .evaluate import scores_of
from .options import DEFAULTS, RunOptions
from .reference import frozen_reference, make_reference
from .rollout_files import RUN_FILE
from .run import jobs_of, run_jobs
from .settings import Setting, references_of, setting_of
from .stored import OpenedRun, run_scores

_SPLIT = ("associated", "tracks")  # references that split the error of a forecast, fields of `References`


def run_parts(opened: OpenedRun, options: RunOptions = DEFAULTS) -> dict[str, SceneParts]:
    """Parts of the errors of a stored run by scene: they add up to the bADE of each target of the run.

    Made once, which runs two references on all scenes of the run, and kept in the cache. Without references, the error
    of a forecast is its rest, and `SceneParts.unsplit` says why. ``options``: workers. Raises DataError if the scenes
    cannot be read.
    """
    runs, why = _references(opened)
    content = f"{__version__}|{why}|{(opened.folder / RUN_FILE).read_text(encoding='utf-8')}"
    path = cache_root() / "causes" / f"{hashlib.sha256(content.encode()).hexdigest()[:32]}.npz"
    names = [rollout.scene for rollout in opened.run.rollouts]
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:  # numpy leaves a broken one open
            part, count = stored["part"], stored["count"]
    except (OSError, ValueError, KeyError, EOFError, BadZipFile, zlib.error):  # none there, or a broken one
        part, count, failed = _made(opened, names, runs, options)
        why = why or failed
        if not failed:  # tried again the next time
            path.parent.mkdir(parents=True, exist_ok=True)
            with whole_file(path) as written:
                np.savez_compressed(written, part=part, count=count)
    usual, ends = float(blame(part).mean()) if len(part) else 0.0, np.cumsum(count)[:-1]
    return {name: SceneParts(own, usual, why) for name, own in zip(names, np.split(part, ends), strict=True)}


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
    setting = replace(own, parameters=info.parameters, hypotheses=info.hypotheses, samples=info.samples)
    found = references_of(setting, card)
    return (found, "") if {*_SPLIT} <= found.keys() else ({}, "its manifest states no gap_references")


def _made(
    opened: OpenedRun, names: Sequence[str], runs: dict[str, Setting], options: RunOptions
) -> tuple[Floats, Ints, str]:
    """Parts [n, len(PARTS)] of all targets, m, numbers of targets by scene, and why a reference failed."""
    split, failed = None, ""
    with reported("finding causes: scoring the run, and the two references that split its errors"):
        scores = run_scores(opened, options)
        reference = frozen_reference(opened.card)
        if reference is None or not reference.holds(names):
            reference = make_reference(opened.card, names, options, seeds=[0])  # budgets need no event weights
        try:
            associated, tracks = (_scores(runs[name], opened, names, options) if runs else None for name in _SPLIT)
            split = reference_errors(associated, tracks, opened.run.info.samples)
        except SubmissionError as error:  # such as weights that are not there
            failed = f"a reference failed: {error}"
        found = error_parts(agent_table(scores, reference), "all", split)
    count = [len(score) for score in scores.seeds[0]]
    part = np.stack([found.get(name, np.zeros(sum(count))) for name in PARTS], axis=1)
    return part, np.array(count), failed


def _scores(setting: Setting, opened: OpenedRun, names: Sequence[str], options: RunOptions) -> AgentScores:
    keywords = {"data": opened.data, **setting.env_keywords(opened.card)}
    jobs = jobs_of(setting.submission, opened.card, keywords, names, opened.run.info.seed, setting.parameters)
    return scores_of(setting, [tuple(run_jobs(jobs, options, score_scene))])
