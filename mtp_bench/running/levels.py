"""Agents over the strength of one error of the detector: a comparison at each level."""

import hashlib
import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import Annotated, Any, Unpack

import numpy as np

from ..agent import controls, submission_of
from ..cards import Card
from ..core import (
    Column,
    DataError,
    Floats,
    Ints,
    Scene,
    Section,
    SubmissionError,
    Table,
    long_work,
    read_json,
    require_known,
    validate,
    write_text,
)
from ..scoring import (
    DEFINITIONS,
    SUBSET_NAMES,
    Difference,
    Interval,
    IntervalColumn,
    Metres,
    Share,
    Subset,
    data_frame,
    paired_row,
    ratio,
)
from ..sources import covered_truth, detection_matches, open_source
from .drives import compare_driving
from .evaluation import EnvEvaluation, evaluate
from .options import DEFAULTS, RunKeywords, RunOptions
from .settings import Setting, require_list, setting_of

LEVELS = {  # of each knob of `PerturbSection`
    "score": (0.0, 0.1, 0.2, 0.3, 0.5),
    "misses": (0.0, 1.0, 2.0, 4.0),
    "false": (0.0, 1.0, 2.0, 4.0),
    "noise": (0.0, 0.5, 1.0, 2.0, 4.0),
    "delay": (0.0, 0.5, 1.0, 2.0),
}
_P = 0.05
_TRUTH = ("truth", "associated")  # what agents observe that are never ranked
_SUBSETS: tuple[Subset, ...] = ("all", "ids")
_SINGLE, _SAME, _NEIGHBOURS, _ASSOCIATED = CONTROLS = tuple(
    controls()[role]
    for role in ("single", "same_samples", "neighbours", "associated_same_samples")
)
_SENTENCE = (
    "Below a number: 95 % interval. Differences are to stp and to controls; a gain of "
    "hypotheses must exceed those of same samples and of neighbours."
)
_PColumn = Annotated[
    float | None,
    Column("p", format=".3f", optional=True, help="Of the sign-flip test."),
]
_Correlation = Annotated[float | None, Column(format=".2f")]


class LevelRow(Section):
    """An agent at a level of a knob, on a subset of the targets."""

    level: Annotated[float, Column(format="g", help="Of the knob.")]
    agent: Annotated[str, Column(help="Name of the submission.")]
    subset: Subset
    value: Annotated[
        float | None, Column(help="bADE in m; in a closed loop the drive score.")
    ]
    interval: IntervalColumn
    relative: Annotated[
        float | None, Column("by stp", format=".2f", help="Value by that of stp.")
    ] = None
    stp: Annotated[Difference, Column("to stp", help="Value less that of stp.")]
    stp_interval: IntervalColumn
    stp_p: _PColumn
    same: Annotated[
        Difference,
        Column("to same samples", optional=True, help="Less that of the control."),
    ] = None
    same_interval: IntervalColumn = None
    same_p: _PColumn = None
    neighbours: Annotated[
        Difference,
        Column("to neighbours", optional=True, help="Less that of the control."),
    ] = None
    neighbours_interval: IntervalColumn = None
    neighbours_p: _PColumn = None
    association: Annotated[
        Difference, Column(optional=True, help="Less that of perfect association.")
    ] = None
    association_interval: Interval | None = None
    best_p: float | None = None  # of the difference to the best agent of the level
    switches: Annotated[
        float | None,
        Column("IDS", format=".1f", optional=True, help="Per 100 true boxes."),
    ] = None
    effective_objects: float | None = None

    @property
    def gains(self) -> bool:
        """True for a lower error than both controls of hypotheses, with p below .05."""
        differences = (self.same, self.neighbours)
        ps = (self.same_p, self.neighbours_p)
        is_lower = all(value is not None and value < 0 for value in differences)
        return is_lower and all(p is not None and p < _P for p in ps)


class DetectorRow(Section):
    """The detections at a level, before any agent."""

    level: Annotated[float, Column(format="g", help="Of the knob.")]
    missed: Annotated[Share, Column(better="lower", help="Of the boxes in coverage.")]
    false: Annotated[float, Column(help="False detections per frame.")]
    error: Annotated[Metres, Column(help="Mean error of places.")]
    error_memory: Annotated[
        _Correlation, Column(help="Correlation of errors from frame to frame.")
    ]
    miss_memory: Annotated[
        _Correlation, Column(help="Correlation of misses from frame to frame.")
    ]


class Level(Section):
    """Numbers at a level; ``key``: digest of all that they depend on."""

    key: str
    detector: DetectorRow | None
    rows: list[LevelRow]


@dataclass(frozen=True, repr=False)
class Robustness:
    """Agents at the levels of a knob.

    ``agents``: those that were asked for and are not shown the truth; ``several``: of
    these, those with several hypotheses.
    """

    env: str
    knob: str
    agents: tuple[str, ...]
    several: tuple[str, ...]
    levels: tuple[Level, ...]
    is_drive: bool

    @property
    def rows(self) -> list[LevelRow]:
        """Rows of all levels, agents and subsets."""
        return [row for level in self.levels for row in level.rows]

    def on(self, subset: str) -> list[LevelRow]:
        """Return the rows on a subset."""
        return [row for row in self.rows if row.subset == subset]

    @property
    def tables(self) -> list[Table]:
        """Tables of the subsets, and of the detector."""
        title = f"{self.env}, {self.knob}"
        tables = [
            Table(subset, f"{title}: {SUBSET_NAMES[subset]}", _SENTENCE, rows)
            for subset in _SUBSETS
            if (rows := self.on(subset))
        ]
        detector = [level.detector for level in self.levels if level.detector]
        if detector:
            tables.append(Table("detector", f"{title}: detections", "", detector))
        return tables

    @property
    def data_table(self) -> Table:
        """All rows as one table, for files."""
        return Table("robustness", f"{self.env}, {self.knob}", _SENTENCE, self.rows)

    @property
    def mean_relative(self) -> dict[str, float]:
        """Mean over levels of each agent's value by that of stp."""
        rows = self.on("all")
        ratios = {
            agent: [row.relative or 0 for row in rows if row.agent == agent]
            for agent in dict.fromkeys(row.agent for row in rows)
        }
        return {agent: float(np.mean(each)) for agent, each in ratios.items()}

    @property
    def answer(self) -> str:
        """Sentences: the best agent by level, and gains of hypotheses beyond the controls."""
        return " ".join([self._order(), *self._gains()])

    def _order(self) -> str:
        parts = []
        firsts = map(self._first, self.levels)
        for agent, run in groupby(firsts, key=itemgetter(0)):
            levels = list(run)
            part = f"{agent} at {_listed([level for _, level, _ in levels])}"
            sure = [level for _, level, is_sure in levels if is_sure]
            if sure:
                part += f" (before the next with p < {_P:g} at {_listed(sure)})"
            parts.append(part)
        name = "Highest drive score" if self.is_drive else "Lowest bADE"
        return f"{name} by {self.knob}: {', then '.join(parts)}."

    def _first(self, level: Level) -> tuple[str, float, bool]:
        """Return the best agent, the level, and whether the next is surely behind."""
        agents = (*self.agents, _SINGLE)
        rows = [
            row for row in level.rows if row.agent in agents and row.subset == "all"
        ]
        sign = -1 if self.is_drive else 1
        best, *others = sorted(rows, key=lambda row: sign * (row.value or 0))
        next_p = others[0].best_p if others else None
        return best.agent, best.level, next_p is not None and next_p < _P

    def _gains(self) -> Iterator[str]:
        for agent in self.several:
            rows = [row for row in self.on("ids") if row.agent == agent]
            gains = [row.level for row in rows if row.gains]
            where = _listed(gains) if gains else "no level"
            yield (
                f"On identity switches {agent} gains beyond same samples and neighbours "
                f"(p < {_P:g}) at {where}."
            )

    def to_frame(self) -> Any:
        """Return the rows as a DataFrame.

        Raises MtpBenchError without pandas.
        """
        return data_frame(self.rows, LevelRow)

    def to_json(self) -> dict[str, Any]:
        """Return all numbers, the answer and `mean_relative` as plain values."""
        return {
            "env": self.env,
            "definitions": DEFINITIONS,
            "knob": self.knob,
            "answer": self.answer,
            "mean_relative": self.mean_relative,
            "levels": [level.model_dump(mode="json") for level in self.levels],
        }

    def __repr__(self) -> str:
        return self.answer


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
    require_list(agents)
    others = keywords.get("perturb") or options.perturb or {}
    finished = []
    with long_work(f"levels of {knob}", progress=options.progress):
        for level in LEVELS[knob] if levels is None else levels:
            keywords["perturb"] = {**others, knob: level}
            verb = f"running {knob} {level:g}"
            with EnvEvaluation.opened(verb, env_id, options, keywords) as evaluation:
                card = evaluation.card
                settings = _settings(agents, card)
                path = (
                    None if folder is None else Path(folder) / f"{knob}-{level:g}.json"
                )
                finished.append(_level(settings, evaluation, level, path))
    asked = [each for each in settings[: len(agents)] if each.observe not in _TRUTH]
    return Robustness(
        env=card.id,
        knob=knob,
        agents=tuple(each.label for each in asked),
        several=tuple(each.label for each in asked if (each.hypotheses or 1) > 1),
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
    needed = CONTROLS if card.drive is None else (_SINGLE,)
    every_agent = [*agents, *(name for name in needed if name not in agents)]
    return [setting_of(submission_of(agent), card) for agent in every_agent]


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
    content = [DEFINITIONS, card.digest, agents, evaluation.scenes]
    text = json.dumps([*content, list(evaluation.options.seeds)])
    key = hashlib.sha256(text.encode()).hexdigest()
    if path is not None and path.is_file():
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
    error = {(row.agent, row.subset): row.error or 0 for row in report.rows}
    ranked = [each.label for each in settings if each.observe not in _TRUTH]
    switches = {}
    for details in report.details:
        clear = details.tracking.all
        if clear.IDS is not None:
            true_boxes = (clear.TP or 0) + (clear.FN or 0)
            switches[details.agent] = ratio(100 * clear.IDS, true_boxes)
    rows = []
    for row in report.rows:
        subset = row.subset
        if subset not in _SUBSETS:
            continue
        best = min(ranked, key=lambda agent: error[agent, subset])
        same, neighbours, associated, first = (
            paired_row(tables[row.agent], tables[name], subset)
            for name in (_SAME, _NEIGHBOURS, _ASSOCIATED, best)
        )
        rows.append(
            LevelRow(
                level=level,
                agent=row.agent,
                subset=subset,
                value=row.error,
                interval=row.interval,
                relative=ratio(error[row.agent, subset], error[_SINGLE, subset]),
                stp=row.difference_to_stp,
                stp_interval=row.difference_interval,
                stp_p=row.p,
                same=same.error,
                same_interval=same.interval,
                same_p=same.p,
                neighbours=neighbours.error,
                neighbours_interval=neighbours.interval,
                neighbours_p=neighbours.p,
                association=associated.error,
                association_interval=associated.interval,
                best_p=first.p,
                switches=switches.get(row.agent),
                effective_objects=row.effective_objects,
            )
        )
    return rows


def _drives(
    settings: Sequence[Setting], evaluation: EnvEvaluation, level: float
) -> list[LevelRow]:
    """Let agents drive in a closed loop."""
    driven = compare_driving([each.submission for each in settings], evaluation)
    for agent, reason in driven.failures.items():
        raise SubmissionError(f"agent {agent!r} {reason}")
    score = {row.agent: row.drive_score for row in driven.rows}
    return [
        LevelRow(
            level=level,
            agent=row.agent,
            subset="all",
            value=row.drive_score,
            interval=row.interval,
            relative=ratio(row.drive_score, score[_SINGLE]),
            stp=row.difference,
            stp_interval=row.difference_interval,
            stp_p=row.p,
        )
        for row in driven.rows
    ]


def detector_row(scenes: Iterable[Scene], card: Card, level: float) -> DetectorRow:
    """Return the errors of the detections of scenes, and how long they last."""
    false = 0
    frames = 0
    parts = []
    for scene in scenes:
        true_row = detection_matches(scene, card)
        parts.append(_errors(scene, card, true_row))
        false += int((true_row < 0).sum())
        frames += scene.frames
    error, missed, following = map(np.concatenate, zip(*parts, strict=True))
    before = np.flatnonzero(following[:-1])
    found = ~np.isnan(error[:, 0])
    pairs = before[found[before] & found[before + 1]]
    return DetectorRow(
        level=level,
        missed=float(missed.mean()) if len(missed) else None,
        false=false / max(frames, 1),
        error=float(np.hypot(*error[found].T).mean()) if found.any() else None,
        error_memory=_correlation(error[pairs].ravel(), error[pairs + 1].ravel()),
        miss_memory=_correlation(missed[before], missed[before + 1]),
    )


def _errors(scene: Scene, card: Card, true_row: Ints) -> tuple[Floats, Floats, Floats]:
    """Return the errors x y [n, 2] m of true boxes in coverage, NaN where missed.

    They are sorted by object and frame. Also 1 where a box is missed [n], and where the
    next box is of the same object in the next frame [n].
    """
    truth = scene.truth
    error = np.full((len(truth.box), 2), np.nan)
    is_found = true_row >= 0
    places = scene.detections.box[is_found, :2]
    error[true_row[is_found]] = places - truth.box[true_row[is_found], :2]
    rows = np.flatnonzero(covered_truth(scene, card, true_row))
    frame = truth.frame_of_rows[rows]
    order = np.lexsort([frame, truth.object_id[rows]])
    rows = rows[order]
    is_same = np.diff(truth.object_id[rows], append=-1) == 0
    is_next = np.diff(frame[order], append=-1) == 1
    missed = np.isnan(error[rows, 0]).astype(float)
    return error[rows], missed, (is_same & is_next).astype(float)


def _correlation(first: Floats, second: Floats) -> float | None:
    if len(first) < 2 or np.ptp(first) == 0 or np.ptp(second) == 0:
        return None
    return float(np.corrcoef(first, second)[0, 1])


def _listed(levels: Sequence[float]) -> str:
    *first, last = (f"{level:g}" for level in levels)
    return f"{', '.join(first)} and {last}" if first else last
