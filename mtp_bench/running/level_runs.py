"""Runs of agents at each level of an error of the detector."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Unpack

from ..agent import controls
from ..cards import Card, with_perturb
from ..core import (
    DataError,
    MtpBenchError,
    SubmissionError,
    long_work,
    read_json,
    require_known,
    validate,
    write_text,
)
from ..scoring import (
    DEFINITIONS,
    ratio,
    scene_scores,
    score_interval,
)
from ..sources import open_source
from .detector_rows import detector_row
from .drives import drives_of, reference_ways
from .evaluation import EnvEvaluation, evaluate
from .levels import CONTROLS, LEVELS, SINGLE, SUBSETS_SHOWN, Level, LevelRow, Robustness
from .options import DEFAULTS, RunKeywords, RunOptions
from .settings import Setting, distinct, setting_of

_TRUTH = ("truth", "associated")  # what agents observe that are never ranked
_TRUTH_TRACKS = controls()["ground_truth"]


def robustness(
    agents: Sequence[object],
    env_id: str | Card,
    knob: str,
    levels: Sequence[float] | None = None,
    options: RunOptions = DEFAULTS,
    folder: str | Path | None = None,
    **keywords: Unpack[RunKeywords],
) -> Robustness:
    """Run and score agents and controls at each level of a knob of ``perturb``.

    Targets and event weights are those of the recorded detections at every level.
    ``levels``: None for those of `LEVELS`. ``folder``: finished levels are kept there,
    and are not run again. ``keywords`` as in `evaluate`; other knobs of ``perturb`` hold
    at every level. Raises MtpBenchError for errors that the user can mend.
    """
    require_known("knob", knob, LEVELS)
    count = len(distinct(agents))
    chosen = LEVELS[knob] if levels is None else tuple(dict.fromkeys(levels))
    if not chosen:
        raise MtpBenchError(f"no level of {knob}, expected at least one")
    others = keywords.get("perturb") or options.perturb or {}
    card = options.card(env_id)
    for level in chosen:  # an error comes before anything runs
        with_perturb(card, {**others, knob: level})
    finished = []
    with long_work(f"levels of {knob}", progress=options.progress):
        for level in sorted(chosen):
            keywords["perturb"] = {**others, knob: level}
            verb = f"running {knob} {level:g}"
            with EnvEvaluation.opened(verb, env_id, options, keywords) as evaluation:
                card = evaluation.card
                settings = _settings(agents, card)
                path = (
                    None if folder is None else Path(folder) / f"{knob}-{level:g}.json"
                )
                finished.append(_level(settings, evaluation, level, path))
    asked = [each for each in settings[:count] if each.observe not in _TRUTH]
    return Robustness(
        env=card.id,
        knob=knob,
        agents=tuple(each.label for each in asked),
        several=tuple(
            each.label
            for each in asked
            if card.drive is None and (each.hypotheses or 1) > 1
        ),
        levels=tuple(finished),
        is_drive=card.drive is not None,
    )


def measured_delay(agent: object, env_id: str | Card, options: RunOptions) -> int:
    """Return the whole frames that an agent's time takes, on this machine.

    It is the mean time of a frame of the first scene.
    """
    report = evaluate(agent, env_id, replace(options, scenes=1))
    seconds = (report.rows[0].ms_per_frame or 0) / 1000
    return int(seconds * options.card(env_id).task.rate)


def _settings(agents: Sequence[object], card: Card) -> list[Setting]:
    """Return the settings of agents and controls with k samples."""
    needed = CONTROLS if card.drive is None else (SINGLE, _TRUTH_TRACKS)
    return [setting_of(each, card) for each in distinct([*agents, *needed])]


def _level(
    settings: Sequence[Setting],
    evaluation: EnvEvaluation,
    level: float,
    path: Path | None,
) -> Level:
    """Return a level, from the file ``path`` if that has the same agents and scenes."""
    card = evaluation.card
    agents = [
        [each.label, each.submission.digest, each.parameters] for each in settings
    ]
    options = evaluation.options
    content = [DEFINITIONS, card.digest, agents, evaluation.scenes, options.tracks]
    text = json.dumps([*content, list(options.seeds)])
    key = hashlib.sha256(text.encode()).hexdigest()
    # an object of a program may have changed since
    has_files = all(each.submission.digest for each in settings)
    if path is not None and has_files and path.is_file():
        stored = validate(Level, read_json(path, DataError), str(path), DataError)
        if stored.key == key:
            return stored
    if card.drive is not None:
        finished = Level(
            key=key, detector=None, rows=_drives(settings, evaluation, level)
        )
    else:
        source = open_source(card, evaluation.options.data)
        scenes = map(source.load, evaluation.scenes)
        finished = Level(
            key=key,
            detector=detector_row(scenes, card, level),
            rows=_scores(settings, evaluation, level),
        )
    if not finished.rows:
        raise MtpBenchError(f"{card.id}: its scenes have no targets, expected some")
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, finished.model_dump_json(indent=1) + "\n")
    return finished


def _scores(
    settings: Sequence[Setting], evaluation: EnvEvaluation, level: float
) -> list[LevelRow]:
    """Run and score agents in an open loop."""
    scores = evaluation.scores(settings, caught=False)
    report, _ = evaluation.report(scores, settings)
    tables = {table.setting.agent: table for table in report.tables}
    switches = {}
    for details in report.details:
        clear = details.tracking.all
        if clear.IDS is not None:
            true_boxes = (clear.TP or 0) + (clear.FN or 0)
            switches[details.agent] = ratio(100 * clear.IDS, true_boxes)
    rows = []
    for row in report.rows:
        if row.subset in SUBSETS_SHOWN and row.error is not None:
            units = tables[row.agent].sums_on(row.subset)
            rows.append(
                LevelRow(
                    level=level,
                    agent=row.agent,
                    subset=row.subset,
                    value=row.error,
                    interval=row.interval,
                    sums=units.error.tolist(),
                    weights=units.weight.tolist(),
                    switches=switches.get(row.agent),
                    effective_objects=row.effective_objects,
                )
            )
    return rows


def _drives(
    settings: Sequence[Setting], evaluation: EnvEvaluation, level: float
) -> list[LevelRow]:
    """Let agents drive in a closed loop; a scene is a unit."""
    drives, failures = drives_of(settings, evaluation)
    for agent, reason in failures.items():
        raise SubmissionError(f"agent {agent!r} {reason}")
    ways_m = reference_ways(evaluation.card, drives[_TRUTH_TRACKS])
    rows = []
    for agent, driven in drives.items():
        scores = scene_scores(driven, ways_m)
        rows.append(
            LevelRow(
                level=level,
                agent=agent,
                subset="all",
                value=float(scores.mean()),
                interval=score_interval(scores),
                sums=scores.tolist(),
                weights=[1.0] * len(scores),
            )
        )
    return rows
