"""The worst moments of each cause, as pictures, with the command that opens each in the viewer."""

import os
from base64 import b64encode
from dataclasses import dataclass, replace
from pathlib import Path

from ...cards import Card
from ...core import NO_PROGRESS, Rollout, counted, long_work, parallel_map
from ...running import open_run
from ...scoring import SceneParts
from ...sources import open_source
from ..causes import sentence
from ..drawing.report import save_report
from ..framing import focuses_of
from ..moment_list import Moment, moments
from ..played import PlayedRun
from ..run_replay import replay
from ..terminal.output import command_line
from .runs import Findings

EACH = 2  # moments of a cause, of different objects
LEAST_SHARE = 0.05  # of the cost of all moments: causes below it have no picture


@dataclass(frozen=True)
class MomentPicture:
    """Picture of one moment: with the most hypotheses, and below it with one."""

    title: str
    path: Path  # PNG
    sentence: str
    command: str  # that opens it

    @property
    def base64(self) -> str:
        """The picture as text, for a page."""
        return b64encode(self.path.read_bytes()).decode("ascii")


def draw_worst_moments(findings: Findings, folder: Path) -> list[MomentPicture]:
    """Draw the worst moments of each cause into ``folder``."""
    subject, bench = findings.subject, findings.bench
    settings = {
        findings.of(each).folders[0]: each for each in (subject.most, subject.single)
    }
    played, quiet = [], replace(bench.options, progress=NO_PROGRESS)
    for place, setting in settings.items():
        name = (
            setting.label
            if (setting.hypotheses or 1) == 1
            else f"{setting.label}, H = {setting.hypotheses}"
        )
        played.append(
            (name, PlayedRun(open_run(place, bench.options.data, bench.card), quiet))
        )
    worst = worst_moments(findings, played[0][1])
    with long_work("drawing the worst moments") as work:
        work.started(len(worst))
        pictures = []
        for number, (scene, moment) in enumerate(worst, 1):
            path = folder / f"{number}-{moment.cause.replace(' ', '-')}.png"
            pictures.append(_draw(played, scene, moment, path))
            work.done(scene)
    return pictures


def worst_moments(findings: Findings, played: PlayedRun) -> list[tuple[str, Moment]]:
    """The scene and moment of the worst of each cause, of different objects; the costliest cause first."""
    bench, rollouts = findings.bench, played.opened.run.rollouts
    calls = [
        (bench.card, bench.options.data, each, played.parts[each.scene])
        for each in rollouts
    ]
    of_scenes = parallel_map(_moments, calls, bench.options.workers)
    listed = [
        (call[2].scene, moment)
        for call, own in zip(calls, of_scenes, strict=True)
        for moment in own
    ]
    cost: dict[str, float] = {}
    first: dict[str, dict[tuple[str, int], tuple[str, Moment]]] = {}
    for scene, moment in sorted(listed, key=lambda pair: -pair[1].cost):
        cost[moment.cause] = cost.get(moment.cause, 0.0) + moment.cost
        first.setdefault(moment.cause, {}).setdefault(
            (scene, moment.at.object_id), (scene, moment)
        )
    least = LEAST_SHARE * sum(cost.values())
    causes = [
        cause
        for cause in sorted(cost, key=lambda each: -cost[each])
        if cost[cause] >= least
    ]
    return [pair for cause in causes for pair in list(first[cause].values())[:EACH]]


def _moments(
    card: Card, data: str | None, rollout: Rollout, parts: SceneParts
) -> list[Moment]:
    return moments(
        replay(open_source(card, data).load(rollout.scene), rollout, card, parts=parts)
    )


def _draw(
    played: list[tuple[str, PlayedRun]], scene: str, moment: Moment, path: Path
) -> MomentPicture:
    notes = list[str]()
    runs = [run.opened for _, run in played]
    replays = [
        run.replay(run.opened.first(scene), run.opened.drawn(scene, notes.append), name)
        for name, run in played
    ]
    focuses = focuses_of(replays, moment.at)
    save_report(path, *focuses)
    frames, data = counted(moment.frames, "frame"), runs[0].data
    folders = [os.path.relpath(run.folder) for run in runs]
    sentences = "; ".join(
        f"{focus.replay.agent}: {sentence(focus)}" for focus in focuses
    )
    return MomentPicture(
        title=f"{moment.cause}: {focuses[0].named}, scene {scene}, {sum(moment.parts.values()):.1f} m in {frames}",
        path=path,
        sentence=sentences
        + ("; the road is not drawn, for its map is broken" if notes else ""),
        command=command_line(
            "view", *folders, scene=scene, at=moment.at.name, data=data
        ),
    )
