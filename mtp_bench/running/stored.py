"""Runs on disk: `run` stores one, `score` scores it, `open_run` opens it."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from ..agent import submission_of
from ..cards import Card, parse_card
from ..core import (
    SERIAL,
    Detections,
    Floats,
    Ints,
    Rollout,
    RolloutError,
    Scene,
    UnknownNameError,
    long_work,
    parallel_map,
    require_folder,
    require_known,
)
from ..env import MTPEnv, log_softmax, shown_boxes
from ..scoring import (
    DEFINITIONS,
    AgentScores,
    Budget,
    Report,
    SceneScore,
    count_holes,
    score_scene,
    stated_hypotheses,
    summarise,
)
from ..sources import SceneSource, open_source, with_map, with_tracks
from .drives import recorded_card
from .options import DEFAULTS, RunKeywords, RunOptions, resolve_options
from .playing import jobs_of, library_versions, run_jobs
from .reading import total_skipped
from .reference import reference_for
from .rollout_files import Run, RunInfo, load_run, require_run_folder, save_run
from .settings import Setting, setting_of, training_note

Note = Callable[[str], object]
# parameter of a run that was read from a file: its objects are the detections
OWN_DETECTIONS = "own_detections"


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
        """Return all rollouts, or that of one scene.

        Raises UnknownNameError if the run does not have it.
        """
        if scene is None:
            return self.run.rollouts
        by_scene = {rollout.scene: rollout for rollout in self.run.rollouts}
        if scene not in by_scene:
            raise UnknownNameError(f"scene of {self.folder}", scene, by_scene)
        return [by_scene[scene]]

    def first(self, scene: str | None = None) -> Rollout:
        """Return the rollout of ``scene``, or the first one."""
        return self.rollouts(scene)[0]

    def scene(self, name: str) -> Scene:
        """Return a scene with the boxes that the agent was shown as its detections.

        See `shown_boxes`. Raises UnknownNameError if the source does not have it, and
        DataError if stored tracks are missing.
        """
        scene = self.recorded(name)
        info = self.run.info
        if info.observe == "tracks":
            file = info.keywords.get("tracks")
            if not isinstance(file, str):
                raise RolloutError(
                    f"{self.folder}: tracks is {file!r}, expected the path of the "
                    "stored tracks that its agent was given"
                )
            scene = with_tracks(self.source, self.card, self.data, file).load(name)
        return replace(scene, detections=shown_boxes(scene, info.observe)[0])

    def drawn(self, name: str, note: Note = lambda text: None) -> Scene:
        """Return the `scene` of this name with its road, for pictures.

        ``note`` is called with the problem if its map is broken.
        """
        return with_map(self.scene(name), self.card, self.data, note)

    def recorded(self, name: str) -> Scene:
        """Return the scene of this name as its source has it, for scoring.

        Raises UnknownNameError if it is missing.
        """
        require_known(f"scene of {self.folder}", name, self.source.names)
        scene = self.source.load(name)
        if self.run.info.parameters.get(OWN_DETECTIONS) is not True:
            return scene
        return with_stated_detections(scene, self.first(name))


def run(
    agent: object,
    env_id: str | Card,
    folder: str | Path,
    options: RunOptions = DEFAULTS,
    replace: bool = False,
    **keywords: Unpack[RunKeywords],
) -> StoredRun:
    """Run an agent on the scenes of an env and store its rollouts in ``folder``.

    ``agent``, ``env_id`` and ``keywords`` as in `evaluate`; of the seeds, only the
    first counts. ``replace``: replace an earlier run, once this one is complete. Raises
    MtpBenchError for errors that the user can mend; before anything runs if ``folder``
    cannot be written or holds a run that is not to be replaced.
    """
    folder = Path(folder)
    require_free(folder, replace)
    env_id, options = resolve_options(env_id, options, keywords)
    submission = submission_of(agent)
    seed = options.seeds[0]
    options.require_usable([submission])
    shown_keywords = options.shown_to(submission)
    env = MTPEnv(env_id, evaluation=True, **shown_keywords, **options.env_keywords)
    setting = setting_of(submission, env.card)
    env_settings = {
        **setting.env_keywords(env.card),
        **shown_keywords,
        **options.changes,
    }
    jobs = jobs_of(
        submission,
        env_id,
        {"data": options.data, **env_settings},
        options.chosen(env.scene_names),
        seed,
    )
    info = run_info(env, setting, seed, env_settings)
    info = info.model_copy(update={"card": env.card.stored()})
    scene_results: list[tuple[Rollout, dict[str, int]]]
    scene_results = run_jobs(jobs, options, _with_skipped)
    save_run(folder, info, [rollout for rollout, _ in scene_results])
    rejected = sum(int(rollout.invalid.sum()) for rollout, _ in scene_results)
    skipped = total_skipped(skipped for _, skipped in scene_results)
    return StoredRun(len(scene_results), skipped, rejected)


def require_free(folder: Path, replace: bool) -> None:
    """Raise MtpBenchError unless a run can be stored in ``folder``.

    It must be writable, and empty unless an earlier run is replaced.
    """
    require_run_folder(folder.absolute())
    if not replace and folder.exists() and any(folder.iterdir()):
        raise RolloutError(
            f"{folder} holds an earlier run: "
            "choose another folder, or replace it (--force, replace=True)"
        )
    require_folder(folder)


def run_info(
    env: MTPEnv, setting: Setting, seed: int, keywords: dict[str, Any]
) -> RunInfo:
    """Return the description of a run on ``env``, without its card.

    ``keywords``: further settings of the env.
    """
    submission = setting.submission
    # samples and observe have fields of their own
    env_keywords = dict(keywords)
    for field_name in ("samples", "observe"):
        env_keywords.pop(field_name, None)
    return RunInfo(
        env_id=env.card.id,
        card_digest=env.card.digest,
        observe=env.task.observe,
        samples=env.task.samples,
        split=env.card.source.split,
        keywords=env_keywords,
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
    folders: str | Path | Iterable[str | Path],
    options: RunOptions = DEFAULTS,
    card: Card | None = None,
    data: str | Path | None = None,
    samples: int | None = None,
) -> StoredScore:
    """Score runs that `run` or an import stored, each in a folder of ``folders``.

    Several runs stand in one table, each tested against each other. An agent that
    occurs twice has the end of the path of its folder as name. ``data``: data root. ``options``:
    data and workers; everything else is stored with the runs. ``card``: in place of the
    one stored with a run, whose scenes were in memory. ``samples``: only so many of the heaviest
    samples of each object count, since fewer samples have larger errors. Raises
    RolloutError if a run was made for another version of the card, contradicts its
    rollouts, or is of another task or other scenes than the first, or if ``samples`` is
    below 1 or more than a run has.
    """
    paths = [folders] if isinstance(folders, str | Path) else list(folders)
    if data is not None:
        options = replace(options, data=str(data))
    if not paths:
        raise RolloutError("no run, expected the folder of at least one")
    named = ", ".join(map(str, paths))
    with long_work(f"scoring {named}", progress=options.progress) as progress:
        options = replace(options, progress=progress)
        return score_opened(open_runs(paths, options.data, card, samples), options)


def score_opened(runs: Sequence[OpenedRun], options: RunOptions) -> StoredScore:
    """Score opened runs of one task in one table, see `score`."""
    options.progress.started(sum(len(opened.run.rollouts) for opened in runs))
    agents = [run_scores(opened, options) for opened in runs]
    first = runs[0]
    scenes = [rollout.scene for rollout in first.run.rollouts]
    reference = reference_for(first.card, scenes, options)
    report = summarise(agents, first.card, reference, with_each_other=True)
    infos = [opened.run.info for opened in runs]
    notes = [f"{info.note}: {info.agent}" for info in infos if info.note]
    if notes:
        report.condition["trained"] = "; ".join(notes)
    skipped = [scene.skipped for agent in agents for scene in agent.seeds[0]]
    return StoredScore(report, total_skipped(skipped))


def run_scores(opened: OpenedRun, options: RunOptions = DEFAULTS) -> AgentScores:
    """Return the scores of a stored run.

    ``options``: workers and progress.
    """
    info = opened.run.info
    rollouts = opened.run.rollouts
    # each worker opens the source itself
    source = opened.source if options.workers == SERIAL else None
    is_own = info.parameters.get(OWN_DETECTIONS) is True
    calls = [
        (opened.card, opened.data, rollout, source, is_own) for rollout in rollouts
    ]

    def end_scene(index: int) -> None:
        options.progress.done(rollouts[index].scene)

    scores = parallel_map(_score, calls, options.workers, end_scene)
    hypotheses = info.hypotheses or stated_hypotheses([scores])
    budget: Budget = "equal" if info.samples == opened.card.task.samples else "free"
    return AgentScores(
        info.agent, hypotheses, info.samples, budget, (tuple(scores),), info.observe
    )


def open_runs(
    folders: Sequence[str | Path],
    data: str | None = None,
    card: Card | None = None,
    samples: int | None = None,
    taken: Sequence[str] = (),
    like: Card | None = None,
) -> list[OpenedRun]:
    """Open runs of one task for one table, see `score`.

    ``taken``: names of other agents in the table, which is of the task of ``like``.
    """
    runs = [open_run(Path(folder), data, card) for folder in folders]
    for opened in runs:
        like = like or opened.card
        if opened.card.task != like.task:
            raise RolloutError(
                f"{opened.folder}: made for {opened.card.id} with another task than "
                f"the others, of {like.id}; score it alone"
            )
    agents = [*taken, *(opened.run.info.agent for opened in runs)]
    named_runs = []
    for opened in runs:
        name = opened.run.info.agent
        if agents.count(name) > 1:
            name = _folder_name(opened.folder, runs, agents)
        named_runs.append(_relabelled(opened, name, samples))
    return named_runs


def _folder_name(folder: Path, runs: Sequence[OpenedRun], agents: Sequence[str]) -> str:
    """Return the end of the path of a folder, as long as others end like it.

    Raises RolloutError if it occurs twice.
    """
    paths = [opened.folder.absolute().as_posix() for opened in runs]
    parts = folder.absolute().parts
    for length in range(1, len(parts)):
        end = "/".join(parts[-length:])
        if sum(path.endswith(f"/{end}") for path in paths) == 1 and end not in agents:
            # a name ends at its first space, where parameters would begin
            return end.replace(" ", "_")
    raise RolloutError(f"{folder}: named twice, expected each run once")


def _relabelled(opened: OpenedRun, agent: str, samples: int | None) -> OpenedRun:
    """Return the run under another name of its agent, with fewer samples if wanted."""
    stored = opened.run
    samples = stored.info.samples if samples is None else samples
    if not 1 <= samples <= stored.info.samples:
        raise RolloutError(
            f"{opened.folder}: {samples} samples, expected 1 to the "
            f"{stored.info.samples} that it has"
        )
    rollouts = stored.rollouts
    if samples < stored.info.samples:
        rollouts = tuple(heaviest_samples(rollout, samples) for rollout in rollouts)
    info = stored.info.model_copy(update={"agent": agent, "samples": samples})
    return replace(opened, run=Run(info, rollouts))


def heaviest_samples(rollout: Rollout, samples: int) -> Rollout:
    """Return the rollout with the heaviest ``samples`` of each object, in their order.

    Of equal weights the first stay.
    """
    log_weight = rollout.forecast_log_weight
    kept = heaviest(log_weight, samples)
    kept_weight = np.take_along_axis(log_weight, kept, axis=1)
    normalised = log_softmax(kept_weight, np.isfinite(kept_weight))
    forecast = np.take_along_axis(rollout.forecast, kept[..., None, None], axis=1)
    return replace(
        rollout,
        forecast=forecast,
        forecast_log_weight=normalised.astype(log_weight.dtype),
    )


def heaviest(log_weight: Floats, samples: int) -> Ints:
    """Return the numbers [R, ``samples``] of the heaviest of samples [R, K]."""
    order = np.argsort(-log_weight, axis=1, kind="stable")
    return np.sort(order[:, :samples], axis=1)


def open_run(
    folder: Path, data: str | None = None, card: Card | None = None
) -> OpenedRun:
    """Open the run stored in ``folder``, with the card that it keeps.

    ``card``: in place of that card. Raises RolloutError if the run was
    made for another version of the card, or contradicts its rollouts, and DataError if
    its data is missing.
    """
    stored = load_run(folder)
    card = _card(folder, stored.info, card)
    _check_rollouts(folder, stored)
    if card.drive is not None:
        card = recorded_card(card, stored.rollouts)
    return OpenedRun(folder, stored, card, open_source(card, data), data)


def _score(
    card: Card,
    data: str | None,
    rollout: Rollout,
    source: SceneSource | None,
    is_own: bool,
) -> SceneScore:
    scene = (source or open_source(card, data)).load(rollout.scene)
    if is_own:
        scene = with_stated_detections(scene, rollout)
    return score_scene(scene, rollout, card)


def with_stated_detections(scene: Scene, rollout: Rollout) -> Scene:
    """Return the scene with the objects of a rollout as its detections."""
    detections = Detections(
        start=rollout.object_start,
        box=rollout.object_box.astype(np.float64),
        velocity=np.full((len(rollout.object_box), 2), np.nan),
        class_id=rollout.object_class,
        score=rollout.object_confidence.astype(np.float64),
    )
    return replace(scene, detections=detections, detector="objects of the file")


def _with_skipped(
    scene: Scene, rollout: Rollout, card: Card
) -> tuple[Rollout, dict[str, int]]:
    return rollout, scene.skipped | count_holes(scene, card)


def _card(folder: Path, info: RunInfo, card: Card | None) -> Card:
    """Return the card that the run was made for, by its digest."""
    card = card or parse_card(info.card or {}, f"{folder}, card")
    if card.digest != info.card_digest:
        raise RolloutError(
            f"{folder}: made for {info.env_id} with card digest {info.card_digest}, "
            f"{card.id} now has {card.digest}; run the agent again"
        )
    return card


def _check_rollouts(folder: Path, stored: Run) -> None:
    """Raise RolloutError if the description of the run contradicts its rollouts."""
    scenes = [rollout.scene for rollout in stored.rollouts]
    if not scenes or len(set(scenes)) < len(scenes):
        raise RolloutError(
            f"{folder}: holds the scenes {scenes}, expected at least one, and each once"
        )
    samples = stored.info.samples
    for rollout in stored.rollouts:
        if rollout.forecast.shape[1] != samples:
            raise RolloutError(
                f"{folder}: states {samples} samples per object, scene "
                f"{rollout.scene!r} has {rollout.forecast.shape[1]}; "
                "run the agent again"
            )
