"""How a recording is laid out: the scene, bird's-eye views per hypothesis, counts, identity lanes and events."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from . import recording_arrays as arrays
from .replay import Incident
from .rerun_log import Shown
from .rerun_sdk import rr, rrb

SHARED = ("/world/map/**", "/world/ego", "/world/gt", "/world/gt_future", "/world/at")
NEAR = 16.0  # m, half the side of what the views show around an event
MOST_LANES = 5  # in the first tab, of the objects with events nearest in time
BACKGROUND = (18, 18, 24)


def layout(shown: Sequence[Shown], level: str, at: Incident | None = None) -> rrb.Blueprint:
    """The blueprint of a recording; ``at``: all views of the scene look at this event."""
    center, reach = _focus(shown, at)
    several = len(shown) > 1
    columns: list[Any] = [_bird(agent, center, reach, level) for agent in shown]
    if not several:
        columns.insert(0, _oblique(shown[0], center, reach))
    frame = 0 if at is None else at.frame
    lanes = [_identities(agent, frame, several) for agent in shown]
    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Horizontal(*columns),
            rrb.Horizontal(*_plots(shown), *lanes, column_shares=[1, 1, *(1.6 if not several else 1.2 for _ in lanes)]),
            row_shares=[2, 1],
        ),
        rrb.TimePanel(state="collapsed", timeline="frame", play_state="Paused", fps=shown[0].replay.card.task.rate),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
    )


def live_layout(rate: float) -> rrb.Blueprint:
    """The blueprint of an episode while it is played: the heaviest hypotheses, following the newest frame."""
    shared = [*SHARED, "/world/det", "/world/forecast"]
    views = [
        _view(f"hypothesis {h}", [*shared, f"/world/hyp/{h:02d}/**"], None, f"/world/hyp/{h:02d}/box")
        for h in range(arrays.TOP_HYPOTHESES)
    ]
    return rrb.Blueprint(
        rrb.Tabs(*views, active_tab=0),
        rrb.TimePanel(state="collapsed", timeline="frame", play_state="Following", fps=rate),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
    )


def _focus(shown: Sequence[Shown], at: Incident | None) -> tuple[np.ndarray[Any, Any], float]:
    """Where the views look, and how far they see."""
    if at is not None:
        return np.array([at.x, at.y, at.z]), NEAR
    scene = shown[0].replay.scene
    place = scene.truth.box[scene.truth.rows(0), :3]
    if not len(place):
        return np.array([*scene.ego[0, :3]]), 3 * NEAR
    center = np.median(place, axis=0)
    spread = np.quantile(np.linalg.norm(place[:, :2] - center[:2], axis=1), 0.8)
    return center, float(np.clip(spread, NEAR, 6 * NEAR))


def _of_agent(agent: Shown, hypothesis: int | None) -> list[str]:
    paths = [f"/{agent.root}world/forecast", f"/{agent.root}world/events"]
    if hypothesis is not None:
        paths.append(f"/{agent.root}world/hyp/{hypothesis:02d}/**")
    return paths


def _best(agent: Shown) -> int | None:
    """The shown hypothesis that is best in most frames."""
    if not agent.hypotheses:
        return None
    best = np.bincount(agent.replay.best, minlength=max(agent.hypotheses) + 1)
    return max(agent.hypotheses, key=lambda h: best[h])


def _view(name: str, contents: list[str], eye: Any, labelled: str | None = None) -> rrb.Spatial3DView:
    overrides = {labelled: rr.Boxes3D.from_fields(show_labels=True)} if labelled else None
    return rrb.Spatial3DView(
        origin="/world",
        contents=contents,
        name=name,
        background=rrb.Background(kind="SolidColor", color=BACKGROUND),
        line_grid=rrb.LineGrid3D(visible=False),
        eye_controls=eye,
        overrides=overrides,  # type: ignore[arg-type]
    )


def _oblique(agent: Shown, center: np.ndarray[Any, Any], reach: float) -> rrb.Spatial3DView:
    """The scene from behind and above, with everything of the best hypothesis."""
    eye = rrb.EyeControls3D(
        position=center + reach * np.array([-0.9, -1.0, 0.9]), look_target=center, eye_up=(0.0, 0.0, 1.0)
    )
    best = _best(agent)
    name = "scene" if best is None else f"scene: truth, detections, hypothesis {best}"
    labelled = None if best is None else f"/{agent.root}world/hyp/{best:02d}/box"
    return _view(name, [*SHARED, "/world/det", *_of_agent(agent, best)], eye, labelled)


def _bird(agent: Shown, center: np.ndarray[Any, Any], reach: float, level: str) -> rrb.Tabs:
    """Bird's-eye views: one per hypothesis, and one of the detections."""
    eye = rrb.EyeControls3D(
        position=center + np.array([0.0, 0.0, 2.2 * reach]), look_target=center, eye_up=(0.0, 1.0, 0.0)
    )
    prefix = f"{agent.root.split('/')[1]}: " if agent.root else ""
    views = [
        _view(f"{prefix}hypothesis {h}", [*SHARED, *_of_agent(agent, h)], eye, f"/{agent.root}world/hyp/{h:02d}/box")
        for h in agent.hypotheses
    ]
    events = f"/{agent.root}world/events"
    views.append(_view(f"{prefix}detections", [*SHARED, "/world/det", events], eye))
    best = _best(agent)
    return rrb.Tabs(*views, active_tab=0 if best is None else agent.hypotheses.index(best))


def _plots(shown: Sequence[Shown]) -> list[rrb.TimeSeriesView]:
    def view(name: str, series: Sequence[str]) -> rrb.TimeSeriesView:
        contents = [f"/{agent.root}metrics/{one}" for agent in shown for one in series]
        return rrb.TimeSeriesView(origin="/", contents=contents, name=name, plot_legend=rrb.Corner2D.LeftTop)

    return [view("boxes per frame", ("TP", "FN", "FP")), view("events so far", ("IDS", "lost", "reacquired"))]


def _identities(agent: Shown, frame: int, several: bool) -> rrb.Tabs:
    """Lanes of the objects with events, nearest in time first; all lanes; the event log."""
    prefix = f"{agent.root.split('/')[1]}: " if several else ""
    near: dict[int, int] = {}
    for i in agent.replay.incidents:
        if i.kind != "spurious":
            weight = abs(i.frame - frame) + (0 if i.kind == "ids" else 1000)  # switches first
            near[i.object_id] = min(weight, near.get(i.object_id, weight))
    chosen = sorted(near, key=lambda g: (near[g], g))[:MOST_LANES]
    every = [lane.object_id for lane in arrays.lanes(agent.replay)]
    tabs: list[Any] = []
    for name, objects in (("track of each object with events", chosen), ("of all", every)):
        if objects:
            contents = [f"/{agent.root}identity/gt_{g:03d}" for g in objects]
            tabs.append(rrb.StateTimelineView(origin="/", contents=contents, name=f"{prefix}{name}"))
    tabs.append(rrb.TextLogView(origin=f"/{agent.root}events", name=f"{prefix}event log"))
    return rrb.Tabs(*tabs, active_tab=0)
