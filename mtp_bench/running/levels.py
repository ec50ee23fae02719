"""Agents over the strength of one error of the detector: a comparison at each level."""

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from operator import attrgetter
from pathlib import Path
from typing import Annotated, Any, NamedTuple, Unpack

import numpy as np

from ..agent import controls
from ..cards import Card, PerturbSection, with_perturb
from ..core import (
    Column,
    DataError,
    Floats,
    Ints,
    MtpBenchError,
    Scene,
    Section,
    SubmissionError,
    Table,
    columns_of,
    long_work,
    read_json,
    require_known,
    validate,
    write_text,
)
from ..scoring import (
    DEFINITIONS,
    SIGNIFICANT,
    SUBSET_NAMES,
    IntervalColumn,
    Metres,
    PairedDifference,
    Share,
    Subset,
    data_frame,
    numbers_of,
    paired_difference,
    ratio,
    scene_scores,
    score_interval,
)
from ..sources import covered_truth, detection_matches, open_source
from .drives import drives_of, reference_ways
from .evaluation import EnvEvaluation, evaluate
from .options import DEFAULTS, RunKeywords, RunOptions
from .settings import Setting, distinct, setting_of

LEVELS = {  # of each knob of `PerturbSection`
    "score": (0.0, 0.1, 0.2, 0.3, 0.5),
    "misses": (0.0, 1.0, 2.0, 4.0),
    "false": (0.0, 1.0, 2.0, 4.0),
    "noise": (0.0, 0.5, 1.0, 2.0, 4.0),
    "delay": (0.0, 0.5, 1.0, 2.0),
}
_TRUTH = ("truth", "associated")  # what agents observe that are never ranked
_SUBSETS: tuple[Subset, ...] = ("all", "ids")
_SINGLE, _SAME, _NEIGHBOURS, _ASSOCIATED = CONTROLS = tuple(
    controls()[role]
    for role in ("single", "same_samples", "neighbours", "associated_same_samples")
)
_TRUTH_TRACKS = controls()["ground_truth"]
_SENTENCE = (
    "Below a number: 95 % interval. Differences are to stp and to controls; a gain of "
    "hypotheses must exceed those of same samples and of neighbours."
)
_Correlation = Annotated[float | None, Column(format=".2f")]


class LevelRow(Section):
    """An agent at a level of a knob, on a subset of the targets."""

    level: Annotated[float, Column(format="g", help="Of the knob.")]
    agent: Annotated[str, Column(help="Name of the submission.")]
    subset: Subset
    value: Annotated[float, Column(help="bADE in m; in a closed loop the drive score.")]
    interval: IntervalColumn
    # of the units: the value times the weight, and the weight
    sums: list[float]
    weights: list[float]
    switches: Annotated[
        float | None,
        Column("IDS", format=".1f", optional=True, help="Per 100 true boxes."),
    ] = None
    effective_objects: float | None = None


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


class Leader(NamedTuple):
    """The best agent at a level; ``is_ahead``: significantly before the next one."""

    level: float
    agent: str
    is_ahead: bool


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

    def difference(
        self, row: LevelRow, agent: str | None = None, level: float | None = None
    ) -> PairedDifference | None:
        """Return a row less that of another agent or level, by unit.

        None: the same row, or no such one.
        """
        key = (agent or row.agent, row.level if level is None else level)
        for other in self.on(row.subset):
            if other is not row and (other.agent, other.level) == key:
                return paired_difference(row.sums, other.sums, row.weights)
        return None

    @property
    def recorded(self) -> float:
        """Level of the detections as recorded."""
        return float(getattr(PerturbSection(), self.knob))

    def table(self, subset: Subset | None = None) -> Table:
        """Return the rows, or those of a subset, with differences to controls."""
        rows = self.rows if subset is None else self.on(subset)
        name = "" if subset is None else f": {SUBSET_NAMES[subset]}"
        subsets = [Column(key="subset")] if subset is None else []
        columns = [
            *columns_of(LevelRow),
            *subsets,
            *_columns(
                "recorded", lambda row: self.difference(row, None, self.recorded)
            ),
            *_columns("stp", lambda row: self.difference(row, _SINGLE)),
            *_columns("same samples", lambda row: self.difference(row, _SAME)),
            *_columns("neighbours", lambda row: self.difference(row, _NEIGHBOURS)),
            *_columns("associated", lambda row: self.difference(row, _ASSOCIATED)),
        ]
        title = f"{self.env}, {self.knob}{name}"
        return Table(subset or "robustness", title, _SENTENCE, rows, columns)

    @property
    def tables(self) -> list[Table]:
        """Tables of the subsets, and of the detector."""
        tables = [self.table(subset) for subset in _SUBSETS if self.on(subset)]
        detector = [level.detector for level in self.levels if level.detector]
        if detector:
            title = f"{self.env}, {self.knob}: detections"
            tables.append(Table("detector", title, "", detector))
        return tables

    @property
    def mean_relative(self) -> dict[str, float]:
        """Mean over levels of each agent's value by that of stp."""
        stp = {row.level: row.value for row in self.on("all") if row.agent == _SINGLE}
        ratios: dict[str, list[float]] = {}
        for row in self.on("all"):
            if stp[row.level] > 0:  # a drive score may be 0
                ratios.setdefault(row.agent, []).append(row.value / stp[row.level])
        return {agent: float(np.mean(each)) for agent, each in ratios.items()}

    @property
    def leaders(self) -> list[Leader]:
        """The best agent at each level."""
        agents = (*self.agents, _SINGLE)
        leaders = []
        for level in self.levels:
            rows = [
                row for row in level.rows if row.agent in agents and row.subset == "all"
            ]
            rows.sort(key=lambda row: row.value, reverse=self.is_drive)
            best, *others = rows
            lead = self.difference(best, others[0].agent) if others else None
            is_ahead = lead is not None and lead.significant
            leaders.append(Leader(best.level, best.agent, is_ahead))
        return leaders

    @property
    def answer(self) -> str:
        """Sentences: the best agent by level, and gains of hypotheses beyond the controls."""
        parts = []
        for agent, leaders in groupby(self.leaders, key=attrgetter("agent")):
            same_agent = list(leaders)
            part = f"{agent} at {_listed([leader.level for leader in same_agent])}"
            sure = [leader.level for leader in same_agent if leader.is_ahead]
            if sure:
                part += (
                    f" (before the next with p < {SIGNIFICANT:g} at {_listed(sure)})"
                )
            parts.append(part)
        name = "Highest drive score" if self.is_drive else "Lowest bADE"
        order = f"{name} by {self.knob}: {', then '.join(parts)}."
        return " ".join([order, *map(self._gain, self.several)])

    def _gain(self, agent: str) -> str:
        gains = []
        for row in self.on("ids"):
            controls = (self.difference(row, name) for name in (_SAME, _NEIGHBOURS))
            if row.agent == agent and all(
                each is not None and each.mean < 0 and each.significant
                for each in controls
            ):
                gains.append(row.level)
        where = _listed(gains) if gains else "no level"
        return (
            f"On identity switches {agent} gains beyond same samples and neighbours "
            f"(p < {SIGNIFICANT:g}) at {where}."
        )

    def to_frame(self) -> Any:
        """Return the rows as a DataFrame.

        Raises MtpBenchError without pandas.
        """
        return data_frame(self.table().records)

    def to_json(self) -> dict[str, Any]:
        """Return all numbers, the answer and `mean_relative` as plain values."""
        return {
            "env": self.env,
            "definitions": DEFINITIONS,
            "knob": self.knob,
            "answer": self.answer,
            "mean_relative": self.mean_relative,
            "rows": self.table().records,
            "levels": [level.model_dump(mode="json") for level in self.levels],
        }

    def __repr__(self) -> str:
        return self.answer


def _columns(
    name: str, find: Callable[[LevelRow], PairedDifference | None]
) -> Iterator[Column]:
    """Yield the columns of a difference, its interval and its p."""
    key = name.replace(" ", "_")
    numbers = (lambda row, i=i: numbers_of(find(row))[i] for i in range(3))
    mean, interval, p = numbers
    yield Column(
        f"to {name}", "", "", "+.3f", optional=True, key=f"to_{key}", read=mean
    )
    yield Column(optional=True, interval=True, key=f"to_{key}_interval", read=interval)
    yield Column("p", format=".3f", optional=True, key=f"to_{key}_p", read=p)


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
    needed = CONTROLS if card.drive is None else (_SINGLE, _TRUTH_TRACKS)
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
        if row.subset in _SUBSETS and row.error is not None:
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
