"""Runs on disk: `run` stores one, `score` scores it, `open_run` opens it with its card and scenes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Unpack

from ..agent import submission_of
from ..cards import CHANGES, Card, changed_card, load_card, parse_card
from ..core import (
    SERIAL,
    Rollout,
    RolloutError,
    Scene,
    UnknownNameError,
    card_ids,
    parallel_map,
    require_folder,
    require_known,
)
from ..env import MTPEnv, shown_boxes
from ..scoring import (
    DEFINITIONS,
    AgentScores,
    Budget,
    Report,
    SceneScore,
    left_out,
    score_scene,
    stated_hypotheses,
    summarise,
)
from ..sources import SceneSource, open_source, with_map, with_tracks
from .drives import recorded_card
from .options import DEFAULTS, RunKeywords, RunOptions, asked
from .playing import jobs_of, library_versions, run_jobs
from .reading import total_skipped
from .reference import reference_for
from .rollout_files import Run, RunInfo, load_run, require_run_folder, save_run
from .settings import Setting, setting_of, training_note

Note = Callable[[str], object]


@dataclass(frozen=True)
class StoredRun:
    """Numbers of a run that was stored."""

    scenes: int
    skipped: dict[str, int]  # rows of the data that could not be used, by reason
    rejected: int  # invalid rows of the agent's actions


@dataclass(frozen=True)
class StoredScore:
    """Report of a stored run."""

    report: Report
    skipped: dict[str, int]  # rows of the data that could not be used, by reason


@dataclass(frozen=True, eq=False)
class OpenedRun:
    """A stored run, its card and the source of its scenes."""

    folder: Path
    run: Run
    card: Card  # with the run's own split and detector
    source: SceneSource
    data: str | None  # data root

    def rollouts(self, scene: str | None = None) -> Sequence[Rollout]:
        """All rollouts, or that of one scene; raises UnknownNameError if the run does not have it."""
        by_scene = {rollout.scene: rollout for rollout in self.run.rollouts}
        if scene is not None and scene not in by_scene:
            raise UnknownNameError(f"scene of {self.folder}", scene, by_scene)
        return self.run.rollouts if scene is None else [by_scene[scene]]

    def first(self, scene: str | None = None) -> Rollout:
        """The rollout of ``scene``, or the first one."""
        return self.rollouts(scene)[0]

    def scene(self, name: str) -> Scene:
        """The scene of this name with the boxes that the agent was shown as its detections: see `shown_boxes`.

        Raises UnknownNameError if the source does not have it, and DataError if stored tracks are missing.
        """
        scene, info = self.recorded(name), self.run.info
        if info.observe == "tracks":
            file = _text(self.folder, info, "track_file")
            if file is None:
                raise RolloutError(
                    f"{self.folder}: does not name the stored tracks that its agent was given"
                )
            scene = with_tracks(self.source, self.card, self.data, file).load(name)
        return replace(scene, detections=shown_boxes(scene, info.observe)[0])

    def drawn(self, name: str, note: Note = lambda text: None) -> Scene:
        """The `scene` of this name with its road, for pictures; ``note`` is called if its map is broken."""
        return with_map(self.scene(name), self.card, self.data, note)

    def recorded(self, name: str) -> Scene:
        """The scene of this name as its source has it, for scoring; raises UnknownNameError if it is missing."""
        require_known(f"scene of {self.folder}", name, self.source.names)
        return self.source.load(name)


def run(
    agent: object,
    env_id: str | Card,
    folder: str | Path,
    options: RunOptions = DEFAULTS,
    replace: bool = False,
    **keywords: Unpack[RunKeywords],
) -> StoredRun:
    """Run an agent on the scenes of an env and store its rollouts in ``folder``.

    ``agent``, ``env_id`` and ``keywords`` as in `evaluate`; of the seeds, only the first counts. ``replace``: replace
    an earlier run, once this one is complete. Raises MtpBenchError for errors that the user can mend; before anything
    runs if ``folder`` cannot be written or holds a run that is not to be replaced.
    """
    folder = Path(folder)
    require_free(folder, replace)
    env_id, options = asked(env_id, options, keywords)
    submission, seed = submission_of(agent), options.seeds[0]
    options.require_usable([submission])
    shown = options.shown_to(submission)
    env = MTPEnv(env_id, evaluation=True, **shown, **options.env_keywords)
    setting = setting_of(submission, env.card)
    settings = {**setting.env_keywords(env.card), **shown, **options.changes}
    names = options.chosen(env.scene_names)
    jobs = jobs_of(submission, env_id, {"data": options.data, **settings}, names, seed)
    info = run_info(env, setting, seed, settings).model_copy(
        update={"card": env.card.stored()}
    )
    results: list[tuple[Rollout, dict[str, int]]] = run_jobs(
        jobs, options, _with_skipped
    )
    save_run(folder, info, [rollout for rollout, _ in results])
    rejected = sum(int(rollout.invalid.sum()) for rollout, _ in results)
    return StoredRun(
        len(results), total_skipped(skipped for _, skipped in results), rejected
    )


def require_free(folder: Path, replace: bool) -> None:
    """Raise MtpBenchError unless a run can be stored in ``folder``: writable, and empty unless it is replaced."""
    require_run_folder(folder.absolute())
    if not replace and folder.exists() and any(folder.iterdir()):
        advice = "choose another folder, or replace it (--force, replace=True)"
        raise RolloutError(f"{folder} holds an earlier run: {advice}")
    require_folder(folder)


def run_info(
    env: MTPEnv, setting: Setting, seed: int, keywords: dict[str, Any]
) -> RunInfo:
    """Description of a run on ``env``, without its card; ``keywords`` are further settings of the env."""
    submission = setting.submission
    return RunInfo(
        env_id=env.card.id,
        card_digest=env.card.digest,
        observe=env.task.observe,
        samples=env.task.samples,
        split=env.card.source.split,
        keywords={
            name: value
            for name, value in keywords.items()
            if name not in ("samples", "observe")
        },
        agent=submission.name,
        folder=str(submission.path) if submission.digest else "",
        parameters=setting.parameters,
        hypotheses=setting.hypotheses,
        submission_digest=submission.digest,
        note=training_note(submission, env.card) or "",
        seed=seed,
        definitions=DEFINITIONS,
        versions=library_versions(),
    )


def score(
    folder: str | Path,
    options: RunOptions = DEFAULTS,
    env_id: str | Card | None = None,
    data: str | Path | None = None,
) -> StoredScore:
    """Report of a run that `run` stored in ``folder``.

    ``data``: data root. ``options``: data and progress; everything else is stored with the run. ``env_id``: id, path or
    card, if it is not the card stored with the run. Raises RolloutError if the run was made for another version of the
    card, or contradicts its rollouts.
    """
    options = options if data is None else replace(options, data=str(data))
    opened = open_run(Path(folder), options.data, env_id)
    info, card = opened.run.info, opened.card
    options.progress.started(len(opened.run.rollouts))
    agent = run_scores(opened, options)
    reference = reference_for(
        card, [rollout.scene for rollout in opened.run.rollouts], options
    )
    report = summarise([agent], card, reference)
    if info.note:
        report.condition["trained"] = f"{info.note}: {info.agent}"
    return StoredScore(report, total_skipped(each.skipped for each in agent.seeds[0]))


def run_scores(opened: OpenedRun, options: RunOptions = DEFAULTS) -> AgentScores:
    """Scores of a stored run; ``options``: workers and progress."""
    info, rollouts = opened.run.info, opened.run.rollouts
    source = opened.source if options.workers == SERIAL else None
    calls = [(opened.card, opened.data, rollout, source) for rollout in rollouts]
    scores = parallel_map(
        _scored,
        calls,
        options.workers,
        lambda i: options.progress.done(rollouts[i].scene),
    )
    hypotheses = info.hypotheses or stated_hypotheses([scores])
    budget: Budget = "equal" if info.samples == opened.card.task.samples else "free"
    return AgentScores(
        info.agent, hypotheses, info.samples, budget, (tuple(scores),), info.observe
    )


def open_run(
    folder: Path, data: str | None = None, env: str | Card | None = None
) -> OpenedRun:
    """The run stored in ``folder``, with the card that it keeps, or the one that ``env`` (id, path or card) names.

    Raises RolloutError if the run was made for another version of the card, or contradicts its rollouts, and DataError
    if its data is missing.
    """
    stored = load_run(folder)
    card = _card(folder, stored.info, env)
    _check(folder, stored)
    if card.drive is not None:
        card = recorded_card(card, stored.rollouts)
    return OpenedRun(folder, stored, card, open_source(card, data), data)


def _scored(
    card: Card, data: str | None, rollout: Rollout, source: SceneSource | None
) -> SceneScore:
    return score_scene(
        (source or open_source(card, data)).load(rollout.scene), rollout, card
    )


def _with_skipped(
    scene: Scene, rollout: Rollout, card: Card
) -> tuple[Rollout, dict[str, int]]:
    return rollout, scene.skipped | left_out(scene, card)


def _card(folder: Path, info: RunInfo, env: str | Card | None) -> Card:
    """The card that the run was made for, by its digest."""
    if env is None and info.card is not None:
        card = parse_card(info.card, f"{folder}, card")
    else:
        if env is None and info.env_id not in card_ids():
            advice = "which does not ship here; name its card with --env"
            raise RolloutError(f"{folder}: made for {info.env_id!r}, {advice}")
        card = env if isinstance(env, Card) else load_card(env or info.env_id)
        if card.digest != info.card_digest:
            card = changed_card(
                card, **{key: _text(folder, info, key) for key in CHANGES}
            )
    if card.digest != info.card_digest:
        made = f"made for {info.env_id} with card digest {info.card_digest}"
        raise RolloutError(
            f"{folder}: {made}, {card.id} now has {card.digest}; run the agent again"
        )
    return card


def _text(folder: Path, info: RunInfo, key: str) -> str | None:
    value = info.keywords.get(key)
    if value is not None and not isinstance(value, str):
        raise RolloutError(f"{folder}: {key} is {value!r}, expected a name")
    return value


def _check(folder: Path, stored: Run) -> None:
    """Raise RolloutError if the description of the run contradicts its rollouts."""
    scenes = [rollout.scene for rollout in stored.rollouts]
    if not scenes or len(set(scenes)) < len(scenes):
        raise RolloutError(
            f"{folder}: holds the scenes {scenes}, expected at least one, and each once"
        )
    for rollout in stored.rollouts:
        stated, samples = stored.info.samples, rollout.forecast.shape[1]
        if samples != stated:
            got = f"states {stated} samples per object, scene {rollout.scene!r} has {samples}"
            raise RolloutError(f"{folder}: {got}; run the agent again")
