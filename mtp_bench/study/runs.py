"""Runs of a study: made once, stored as `mtp-bench run` stores them, and read back where nothing has changed."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ..cards import Card
from ..env.environment import MTPEnv
from ..errors import RolloutError
from ..files import file_digest
from ..networks import network_files
from ..parallel import Progress, parallel_map
from ..running.options import RunOptions
from ..running.perturbation import MatchedDetections, matched_detections
from ..running.reference import ranked_scenes
from ..running.rollout_files import load_run, save_run
from ..running.run import jobs_of, run_jobs
from ..running.settings import Setting
from ..running.stored import run_info
from ..scoring import SceneScore, score_scene
from ..scoring.circumstances import Circumstances, circumstances
from ..sources import open_source
from ..types import Rollout, Scene
from ..viz.terminal.paper import unchanged
from .plan import key_of

RUNS = "runs"  # folder of the stored runs
_LIBRARY = Path(__file__).resolve().parent.parent
# Parts of the library that only judge and show; what its baselines are is told by their own digests.
_NO_MAKERS = frozenset(
    ["_bundled", "commands", "gateway", "records", "scoring", "study", "testing", "training", "viz", "__pycache__"]
)
_KEY = 12  # digits


@dataclass(frozen=True, eq=False)
class Measured:
    """A setting on the scenes of a study, a run per seed."""

    setting: Setting
    scores: tuple[tuple[SceneScore, ...], ...]
    around: tuple[tuple[Circumstances, ...], ...]  # empty for runs of more than k samples
    folders: tuple[Path, ...]  # of the stored runs; empty where they are too large to be kept


@dataclass(frozen=True)
class Bench:
    """Where a study runs: the env, its scenes, and the folder for what is kept."""

    env_id: str | Card
    card: Card  # with all changes
    scenes: tuple[str, ...]
    content: str  # digest of all that agents are shown, and of the truth
    matched: tuple[MatchedDetections, ...]  # detections of true objects, per scene
    folder: Path
    options: RunOptions

    @property
    def of_paper(self) -> str:
        """The env whose figures of the paper may stand beside ours; empty where the card was changed."""
        return unchanged(self.card.id, self.card.digest)


def open_bench(env_id: str | Card, folder: Path, options: RunOptions) -> Bench:
    """The bench of an env; reads all its scenes once. Raises MtpBenchError for whatever the user can mend."""
    env = MTPEnv(env_id, **options.env_keywords)
    scenes = options.chosen(ranked_scenes(env.card, env.scene_names))
    read = parallel_map(
        _read,
        [(env.card, options.data, name) for name in scenes],
        options.workers,
        lambda place: options.progress.done(scenes[place]),
    )
    content = hashlib.sha256("\n".join([env.card.digest, *(digest for digest, _ in read)]).encode()).hexdigest()
    return Bench(env_id, env.card, scenes, content, tuple(matched for _, matched in read), folder, options)


def _read(card: Card, data: str | None, name: str) -> tuple[str, MatchedDetections]:
    scene = open_source(card, data).load(name)
    return scene_digest(scene), matched_detections(scene, card)


def scene_digest(scene: Scene) -> str:
    """Hex sha256 of the name, the detections, the ego's poses, the times and the truth of a scene."""
    sha = hashlib.sha256(scene.name.encode())
    for table in (scene, scene.truth, scene.detections):
        for field, value in sorted(vars(table).items()):
            if isinstance(value, np.ndarray):
                sha.update(f"|{field}{value.shape}{value.dtype}".encode())
                sha.update(np.ascontiguousarray(value).tobytes())
    return sha.hexdigest()


def measure(bench: Bench, setting: Setting, seeds: Sequence[int], done: Any) -> Measured:
    """Scores of a setting, from its stored runs where these hold what would be run now; else it is run.

    ``done`` is told the name of every scene. A run of more than k samples is not stored: its samples would fill disks.
    """
    whole = setting.samples == bench.card.task.samples
    keywords = {**bench.options.env_keywords, **shown_of(bench, setting)}
    progress = replace(bench.options, progress=Progress(done=done))
    scores, around, folders = [], [], []
    for seed in seeds:
        make = jobs_of(
            setting.submission, bench.env_id, keywords, bench.scenes, seed, setting.parameters, setting.label
        )
        if not whole:
            scores.append(tuple(run_jobs(make, progress, score_scene)))
            continue
        folder = bench.folder / RUNS / _name(bench, setting, seed)
        kept = _stored(folder, bench.scenes)
        if kept is None:
            made = run_jobs(make, progress, _keep)
            _store(bench, setting, seed, folder, [rollout for rollout, *_ in made])
        else:
            calls = [(bench.card, rollout, bench.options.data) for rollout in kept]
            made = parallel_map(_again, calls, bench.options.workers, lambda place: done(bench.scenes[place]))
        scores.append(tuple(score for _, score, _ in made))
        around.append(tuple(near for *_, near in made))
        folders.append(folder)
    return Measured(setting, tuple(scores), tuple(around), tuple(folders))


def _keep(scene: Scene, rollout: Rollout, card: Card) -> tuple[Rollout, SceneScore, Circumstances]:
    return rollout, score_scene(scene, rollout, card), circumstances(scene, rollout, card)


def _again(card: Card, rollout: Rollout, data: str | None) -> tuple[None, SceneScore, Circumstances]:
    """A stored rollout, scored."""
    scene = open_source(card, data).load(rollout.scene)
    return None, score_scene(scene, rollout, card), circumstances(scene, rollout, card)


def _store(bench: Bench, setting: Setting, seed: int, folder: Path, rollouts: Sequence[Rollout]) -> None:
    shown = shown_of(bench, setting)
    env = MTPEnv(bench.env_id, **bench.options.env_keywords, **shown)
    info = run_info(env, setting, seed, {**shown, **bench.options.changes})
    save_run(folder, info.model_copy(update={"card": env.card.stored()}), rollouts)


def shown_of(bench: Bench, setting: Setting) -> dict[str, Any]:
    """Keywords of the env of a setting beyond those of all; raises MtpBenchError where stored tracks are not named."""
    stored = bench.options.shown_to(setting.submission) if setting.observe == "tracks" else {}
    return {**setting.env_keywords(bench.card), **stored}


def _stored(folder: Path, scenes: Sequence[str]) -> Sequence[Rollout] | None:
    """The rollouts of a stored run of these scenes; None where there is none that is whole."""
    try:
        run = load_run(folder) if folder.is_dir() else None
    except RolloutError:
        return None
    return None if run is None or [r.scene for r in run.rollouts] != list(scenes) else run.rollouts


def _name(bench: Bench, setting: Setting, seed: int) -> str:
    """Name of the folder of a run: for people, and a digest of everything that decides what is said."""
    networks = network_files(setting.submission.networks, bench.card.id, bench.card.weights_of)
    weights = [file_digest(path) for path in networks]
    tracks = _given_files(bench.options) if setting.observe == "tracks" else []
    given = [file_digest(path) for path in tracks]
    content = "\n".join([bench.content, key_of(setting), str(seed), *weights, *given, library_digest()])
    digest = hashlib.sha256(content.encode()).hexdigest()[:_KEY]
    shown = "-truth" if setting.ideal else f"-H{setting.hypotheses}" if setting.hypotheses else ""
    return f"{setting.submission.name}{shown}-k{setting.samples}-seed{seed}-{digest}"


def _given_files(options: RunOptions) -> list[Path]:
    """Files of stored tracks that some agents are shown."""
    given = Path(options.track_file or "")
    return sorted(path for path in given.rglob("*") if path.is_file()) if given.is_dir() else [given]


@cache
def library_digest() -> str:
    """Hex sha256 over the code and the fitted files of this library that have a part in what agents see and say."""
    sha = hashlib.sha256()
    for name in library_files():
        sha.update(f"{name}|{file_digest(_LIBRARY / name)}\n".encode())
    return sha.hexdigest()


def library_files() -> list[str]:
    """What `library_digest` covers, as paths in the library."""
    names = (path.relative_to(_LIBRARY) for path in _LIBRARY.rglob("*") if path.is_file())
    return sorted(name.as_posix() for name in names if not _NO_MAKERS.intersection(name.parts))
