"""What `mtp-bench view` does: runs of one scene as a recording, in a file, a window or a browser."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import MtpBenchError

if TYPE_CHECKING:
    from ..viz.replay import Incident, Replay


def read_replays(folders: Sequence[Path], scene: str | None, data: str | None, env_id: str | None) -> list[Replay]:
    """The runs of one scene, by default the first of the first run.

    Raises MtpBenchError where the runs were made for different cards, UnknownNameError where one has no such scene.
    """
    from ..running.opened import open_run
    from ..viz.replay import replay

    runs = [open_run(folder, data, env_id) for folder in folders]
    first = runs[0]
    for run in runs[1:]:
        if run.card.digest != first.card.digest:
            raise MtpBenchError(
                f"{run.folder}: made for {run.card.id} ({run.card.digest}), expected {first.card.id} "
                f"({first.card.digest}) as in {first.folder}: only runs of one env and detector share a picture"
            )
    if not first.run.rollouts:
        raise MtpBenchError(f"{first.folder}: holds no scene; run the agent again")
    name = scene or first.run.rollouts[0].scene
    rollouts = [run.rollouts(name)[0] for run in runs]
    content = first.scene(name)
    return [replay(content, rollout, run.card, run.run.info.agent) for run, rollout in zip(runs, rollouts, strict=True)]


def view_runs(
    folders: Sequence[Path],
    scene: str | None,
    at: str | None,
    level: str,
    save: Path | None,
    web: bool,
    data: str | None,
    env_id: str | None,
    tell: Callable[[str], object],
) -> None:
    """Record runs of one scene and show them; ``tell`` gets what the user should know.

    Raises MtpBenchError for whatever the user can mend, before anything is read where that is possible.
    """
    from ..viz.rerun.log import save_recording
    from ..viz.rerun.viewer import require_display, serve_recording, show_recording

    if save is None and not web:
        require_display()
    replays = read_replays(folders, scene, data, env_id)
    first = replays[0]
    incident = None if at is None else first.incident(at)
    what = _sentence(first, incident)
    if save is not None:
        save_recording(save, replays, level, incident)
        tell(f"{save}: {what}; open it with `rerun {save}`" + (f", at frame {incident.frame}" if incident else ""))
    elif web:
        serve_recording(replays, level, incident, lambda url: tell(f"{what}: {url} until Ctrl-C"))
    else:
        show_recording(replays, level, incident)
        tell(what)


def _sentence(replay: Replay, incident: Incident | None) -> str:
    from ..viz.events_text import incident_text

    if incident is None:
        return f"scene {replay.scene.name}"
    return f"scene {replay.scene.name}, frame {incident.frame}, {incident_text(incident, replay.card.task.classes)}"
