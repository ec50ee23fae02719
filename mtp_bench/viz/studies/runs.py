"""Runs of a study, and everything that it has measured: scores of all settings, and the report over them.

Runs are stored as `mtp-bench run` stores them, and read back while nothing has changed.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path

import numpy as np

from ...cards import Card, scenes_digest
from ...core import (
    Progress,
    Rollout,
    RolloutError,
    Scene,
    file_digest,
    network_files,
    parallel_map,
)
from ...env import MTPEnv
from ...judge import digest_of
from ...running import (
    EnvEvaluation,
    RunOptions,
    Setting,
    load_run,
    ranked_scenes,
    references_of,
    run_info,
    run_jobs,
    save_run,
    scores_of,
)
from ...scoring import (
    RANKED_UNITS,
    AgentScores,
    AgentTable,
    PairedRow,
    Reference,
    References,
    Report,
    Row,
    SceneScore,
    Subset,
    evaluated,
    hypotheses,
    in_all,
    lineage_events,
    match_hypotheses,
    paired_row,
    score_scene,
    separated_truth,
    summarise,
    unchanged,
)
from ...sources import open_source
from .plan import StudiedAgent, StudyPlan, key_of

RUNS = "runs"  # folder of the stored runs
KINDS = ("ids", "lost", "reacquired", "frag")  # the last: lost or reacquired
_LIBRARY = Path(__file__).resolve().parent.parent
# Parts of the library that only judge and show; baselines have digests of their own.
_NO_MAKERS = {
    "_bundled",
    "__pycache__",
    "commands",
    "gateway",
    "records",
    "scoring",
    "study",
    "tables",
    "testing",
    "training",
    "viz",
}


@dataclass(frozen=True)
class EventCounts:
    """Numbers of events of one rollout of one scene, on targets or not, by KINDS."""

    own: dict[str, int]  # along the lineage of the best hypothesis
    shared: dict[str, int]  # that every hypothesis has
    objects: int  # evaluated true objects
    frames: int


@dataclass(frozen=True, eq=False)
class Measured:
    """A setting on the scenes of a study, one run per seed."""

    setting: Setting
    scores: tuple[tuple[SceneScore, ...], ...]
    events: tuple[tuple[EventCounts, ...], ...]  # empty for runs of more than k samples
    folders: tuple[
        Path, ...
    ]  # of the stored runs; empty for runs of more than k samples


@dataclass(frozen=True)
class Bench(EnvEvaluation):
    """The env of a study, its scenes, and the folder of its runs."""

    content: str  # digest of the truth and of everything that agents are shown
    folder: Path

    @property
    def of_paper(self) -> str:
        """Id of the env whose figures of the paper may stand beside ours; empty for a changed card."""
        return unchanged(self.card.id, self.card.digest)


def open_bench(env_id: str | Card, folder: Path, options: RunOptions) -> Bench:
    """The bench of an env; reads all its scenes once. Raises MtpBenchError for wrong options and broken data."""
    env = MTPEnv(env_id, **options.env_keywords)
    scenes = options.chosen(ranked_scenes(env.card, env.scene_names))
    calls = [(env.card, options.data, name) for name in scenes]
    digests = parallel_map(
        _scene_digest,
        calls,
        options.workers,
        lambda i: options.progress.done(scenes[i]),
    )
    return Bench(
        env_id,
        options,
        env.card,
        scenes,
        "",
        digest_of([env.card.digest, *digests]),
        folder,
    )


def _scene_digest(card: Card, data: str | None, name: str) -> str:
    return scenes_digest([open_source(card, data).load(name)])


def measure(
    bench: Bench, setting: Setting, seeds: Sequence[int], done: Callable[[str], object]
) -> Measured:
    """Scores of a setting: of its stored runs if these are up to date, else of new runs.

    ``done`` is called with the name of every scene. Runs of more than k samples are not stored: they are large.
    """
    changes = bench.env_changes(setting)
    options = replace(bench.options, progress=Progress(done=done))
    scores, events, folders = [], [], []
    for seed in seeds:
        jobs = bench.jobs(setting, seed, bench.scenes)
        if setting.samples != bench.card.task.samples:
            scores.append(tuple(run_jobs(jobs, options, score_scene)))
            continue
        folder = bench.folder / RUNS / _folder_name(bench, setting, seed)
        stored = _stored(folder, bench.scenes)
        if stored is None:
            judged = run_jobs(jobs, options, _judge)
            env = MTPEnv(bench.env, **{**bench.options.env_keywords, **changes})
            info = run_info(env, setting, seed, {**changes, **bench.options.changes})
            rollouts = [rollout for rollout, *_ in judged]
            save_run(
                folder, info.model_copy(update={"card": env.card.stored()}), rollouts
            )
        else:
            calls = [(bench.card, rollout, bench.options.data) for rollout in stored]
            judged = parallel_map(
                _judge_stored,
                calls,
                bench.options.workers,
                lambda i: done(bench.scenes[i]),
            )
        scores.append(tuple(score for _, score, _ in judged))
        events.append(tuple(counts for *_, counts in judged))
        folders.append(folder)
    return Measured(setting, tuple(scores), tuple(events), tuple(folders))


def count_events(scene: Scene, rollout: Rollout, card: Card) -> EventCounts:
    """Count the events of a rollout that `score_scene` takes."""
    scene = evaluated(scene)
    truth, lineage = separated_truth(scene, card), hypotheses(rollout, card)
    events = lineage_events(
        truth, rollout, lineage, match_hypotheses(truth, rollout, lineage.member, card)
    )
    own = events.of(lineage.best[truth.frame_of_rows])
    return EventCounts(
        own={kind: int(getattr(own, kind)[:, 0].sum()) for kind in KINDS},
        shared={
            kind: int(in_all(truth, lineage, events, kind).sum()) for kind in KINDS
        },
        objects=len(np.unique(scene.truth.object_id[~truth.neutral])),
        frames=scene.frames,
    )


def _judge(
    scene: Scene, rollout: Rollout, card: Card
) -> tuple[Rollout, SceneScore, EventCounts]:
    return (
        rollout,
        score_scene(scene, rollout, card),
        count_events(scene, rollout, card),
    )


def _judge_stored(
    card: Card, rollout: Rollout, data: str | None
) -> tuple[None, SceneScore, EventCounts]:
    return None, *_judge(open_source(card, data).load(rollout.scene), rollout, card)[1:]


def _stored(folder: Path, scenes: Sequence[str]) -> Sequence[Rollout] | None:
    """Rollouts of a stored run of these scenes; None unless it is complete."""
    try:
        run = load_run(folder) if folder.is_dir() else None
    except RolloutError:
        return None
    return (
        None
        if run is None or [r.scene for r in run.rollouts] != list(scenes)
        else run.rollouts
    )


def _folder_name(bench: Bench, setting: Setting, seed: int) -> str:
    """Name of the folder of a run; its digest is of everything that decides what the agent answers."""
    files = network_files(
        setting.submission.networks, bench.card.id, bench.card.weights_of
    )
    if setting.observe == "tracks":
        given = Path(bench.options.tracks or "")
        files = [
            *files,
            *(
                sorted(path for path in given.rglob("*") if path.is_file())
                if given.is_dir()
                else [given]
            ),
        ]
    parts = [
        bench.content,
        key_of(setting),
        str(seed),
        *map(file_digest, files),
        library_digest(),
    ]
    digest = digest_of(parts)[:12]
    shown = (
        "-truth"
        if setting.observe == "truth"
        else f"-H{setting.hypotheses}"
        if setting.hypotheses
        else ""
    )
    return f"{setting.submission.name}{shown}-k{setting.samples}-seed{seed}-{digest}"


@cache
def library_digest() -> str:
    """Hex sha256 of the code and fitted files of this library that decide what agents see and answer."""
    return digest_of({name: file_digest(_LIBRARY / name) for name in library_files()})


def library_files() -> list[str]:
    """Paths in the library that `library_digest` covers."""
    names = (
        path.relative_to(_LIBRARY) for path in _LIBRARY.rglob("*") if path.is_file()
    )
    return sorted(
        name.as_posix() for name in names if not _NO_MAKERS.intersection(name.parts)
    )


@dataclass(frozen=True, eq=False)
class Findings:
    """Results of a study; every number comes from the scorer."""

    bench: Bench
    plan: StudyPlan
    reference: Reference
    measured: dict[str, Measured]  # by `key_of`

    @property
    def subject(self) -> StudiedAgent:
        """The main agent of the study: the first one that was named."""
        return self.plan.subjects[0]

    @cached_property
    def units(self) -> float:
        """Effective number of units of all targets."""
        return self.row(self.subject.single, "all").effective_units

    @property
    def few(self) -> bool:
        """True with fewer effective units than a rank needs: no difference between agents can be told."""
        return self.units < RANKED_UNITS

    def of(self, setting: Setting) -> Measured:
        """Runs and scores of a setting."""
        return self.measured[key_of(setting)]

    @cached_property
    def tables(self) -> dict[str, AgentTable]:
        """Targets of every setting, by `key_of`."""
        keys = [key_of(setting) for setting in [*self.plan.equal, *self.plan.free]]
        return dict(zip(keys, self.report.tables, strict=True))

    def table(self, setting: Setting) -> AgentTable:
        """Targets of a setting."""
        return self.tables[key_of(setting)]

    @cached_property
    def report(self) -> Report:
        """The report over all settings, with the references of every subject and of controls."""
        found = [
            (each, references_of(each, self.bench.card)) for each in self.plan.controls
        ]
        found = [
            (each, runs)
            for each, runs in found
            if all(key_of(run) in self.measured for run in runs.values())
        ]
        found += [
            (s.equal[count], runs)
            for s in self.plan.subjects
            for count, runs in s.references.items()
        ]
        own = {
            self.of(setting).setting.label: References(
                **{name: self._scores(run) for name, run in runs.items()}
            )
            if runs
            else None
            for setting, runs in found
        }
        settings = [*self.plan.equal, *self.plan.free]
        return summarise(
            [self._scores(s) for s in settings],
            self.bench.card,
            self.reference,
            references=own,
        )

    def row(self, setting: Setting, subset: Subset) -> Row:
        """Row of the report for a setting and a subset."""
        own = self._scores(setting)
        key = own.agent, own.hypotheses, own.samples, own.budget, subset
        return next(
            r
            for r in self.report.rows
            if (r.agent, r.hypotheses, r.samples, r.budget, r.subset) == key
        )

    def difference(self, setting: Setting, other: Setting, subset: Subset) -> PairedRow:
        """A setting minus another one: bADE, and minADE over targets that both cover."""
        return paired_row(self.table(setting), self.table(other), subset)

    def _scores(self, setting: Setting) -> AgentScores:
        measured = self.of(setting)
        return scores_of(
            setting, measured.scores, measured.setting.label
        )  # equal runs have one name in the report
