"""How a recording is laid out: the scene, bird's-eye views per hypothesis, counts, identity lanes and events."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...cards import Card
from ...types import Floats, Scene
from ..replay import Incident, Replay
from .agents import Shown
from .arrays import TOP_HYPOTHESES
from .event_rows import lanes
from .sdk import rr, rrb

SHARED = ("/world/map/**", "/world/ego", "/world/gt", "/world/gt_future", "/world/at")
NEAR = 16.0  # m, half the side of what the views show around an event
MOST_LANES = 5  # in the first tab: as many as fit
BACKGROUND = (18, 18, 24)
Eye = tuple[tuple[float, float, float], tuple[float, float, float]]  # where it is, in units of the reach; what is up
ABOVE: Eye = (0.0, 0.0, 2.2), (0.0, 1.0, 0.0)
ASIDE: Eye = (-0.9, -1.0, 0.9), (0.0, 0.0, 1.0)
FOLLOW = "/world/follow"


def layout(shown: Sequence[Shown], at: Incident | None = None) -> rrb.Blueprint:
    """The blueprint of a recording; ``at``: all views of the scene look at this event."""
    focus = _focus(shown[0].replay, at)
    several = len(shown) > 1
    columns: list[Any] = [_bird(agent, focus) for agent in shown]
    if not several:
        columns.insert(0, _oblique(shown[0], focus))
    identities = [_identities(agent, at, several) for agent in shown]
    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Horizontal(*columns),
            rrb.Horizontal(*_plots(shown), *identities, column_shares=[1, 1, *[1.2 if several else 1.6] * len(shown)]),
            row_shares=[2, 1],
        ),
        rrb.TimePanel(state="collapsed", timeline="frame", play_state="Paused", fps=shown[0].replay.card.task.rate),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
    )


def live_layout(scene: Scene, card: Card) -> rrb.Blueprint:
    """The blueprint of an episode while it is played: the first hypotheses, following the newest frame."""
    shared = [*SHARED, "/world/det", "/world/forecast"]
    start = np.zeros(3) if card.has_ego else _middle(scene.detections.box[scene.detections.rows(0), :3])
    focus = _Focus(start, 2 * NEAR, FOLLOW if card.has_ego else "/world")
    views = [
        _view(f"hypothesis {h}", [*shared, f"/world/hyp/{h:02d}/**"], focus, ABOVE, f"/world/hyp/{h:02d}/box")
        for h in range(TOP_HYPOTHESES)
    ]
    return rrb.Blueprint(
        rrb.Tabs(*views, active_tab=0),
        rrb.TimePanel(state="collapsed", timeline="frame", play_state="Following", fps=card.task.rate),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
    )


@dataclass(frozen=True, eq=False)
class _Focus:
    """Where the views look."""

    center: Floats  # [3]
    reach: float  # m, half the side of what they show
    origin: str = "/world"  # entity whose frame they show: FOLLOW moves along with the sensors

    def eye(self, offset: Sequence[float], up: Sequence[float]) -> rrb.EyeControls3D:
        """An eye at ``offset`` [3], in units of the reach, from where it looks."""
        position = self.center + self.reach * np.array(offset)
        return rrb.EyeControls3D(position=position, look_target=self.center, eye_up=up)


def _focus(replay: Replay, at: Incident | None) -> _Focus:
    """The event; else the vehicle that carries the sensors, all the way; else the objects of the first frame."""
    if at is not None:
        return _Focus(np.array([at.x, at.y, at.z]), NEAR)
    scene = replay.scene
    if replay.card.has_ego:
        return _Focus(np.zeros(3), 2 * NEAR, FOLLOW)
    place = scene.truth.box[scene.truth.rows(0), :3]
    center = _middle(place)
    spread = np.quantile(np.linalg.norm(place[:, :2] - center[:2], axis=1), 0.8) if len(place) else 3 * NEAR
    return _Focus(center, float(np.clip(spread, NEAR, 6 * NEAR)))


def _middle(place: Floats) -> Floats:
    """The middle of places [n, 3]; the origin where there are none."""
    return np.median(place, axis=0) if len(place) else np.zeros(3)


def _of_agent(agent: Shown, hypothesis: int | None) -> list[str]:
    paths = [f"/{agent.root}world/{name}" for name in ("forecast", "events", "spurious")]
    if hypothesis is not None:
        paths.append(f"/{agent.root}world/hyp/{hypothesis:02d}/**")
    return paths


def _best(agent: Shown) -> int | None:
    """The shown hypothesis that is best in most frames."""
    if not agent.hypotheses:
        return None
    best = np.bincount(agent.replay.best, minlength=max(agent.hypotheses) + 1)
    return max(agent.hypotheses, key=lambda h: best[h])


def _view(name: str, contents: list[str], focus: _Focus, eye: Eye, labelled: str | None = None) -> rrb.Spatial3DView:
    overrides = {labelled: rr.Boxes3D.from_fields(show_labels=True)} if labelled else None
    return rrb.Spatial3DView(
        origin=focus.origin,
        contents=contents,
        name=name,
        background=rrb.Background(kind="SolidColor", color=BACKGROUND),
        line_grid=rrb.LineGrid3D(visible=False),
        eye_controls=focus.eye(*eye),
        overrides=overrides,  # type: ignore[arg-type]
    )


def _oblique(agent: Shown, focus: _Focus) -> rrb.Spatial3DView:
    """The scene from above and aside, with everything of the best hypothesis."""
    best = _best(agent)
    name = "scene" if best is None else f"scene: truth, detections, hypothesis {best}"
    labelled = None if best is None else f"/{agent.root}world/hyp/{best:02d}/box"
    return _view(name, [*SHARED, "/world/det", *_of_agent(agent, best)], focus, ASIDE, labelled)


def _bird(agent: Shown, focus: _Focus) -> rrb.Tabs:
    """Bird's-eye views: one per hypothesis, and one of the detections."""
    prefix = f"{agent.root.split('/')[1]}: " if agent.root else ""
    views = [
        _view(
            f"{prefix}hypothesis {h}",
            [*SHARED, *_of_agent(agent, h)],
            focus,
            ABOVE,
            f"/{agent.root}world/hyp/{h:02d}/box",
        )
        for h in agent.hypotheses
    ]
    views.append(_view(f"{prefix}detections", [*SHARED, "/world/det", f"/{agent.root}world/events"], focus, ABOVE))
    best = _best(agent)
    return rrb.Tabs(*views, active_tab=0 if best is None else agent.hypotheses.index(best))


def _plots(shown: Sequence[Shown]) -> list[rrb.TimeSeriesView]:
    def view(name: str, series: Sequence[str]) -> rrb.TimeSeriesView:
        contents = [f"/{agent.root}metrics/{one}" for agent in shown for one in series]
        return rrb.TimeSeriesView(origin="/", contents=contents, name=name, plot_legend=rrb.Corner2D.LeftTop)

    return [view("boxes per frame", ("TP", "FN", "FP")), view("events so far", ("IDS", "lost", "reacquired"))]


def _eventful(replay: Replay, at: Incident | None) -> list[int]:
    """The objects whose lanes are shown first: switches count before other events, near ones and many before few."""
    rank: dict[int, tuple[float, ...]] = {}
    incidents = [i for i in replay.incidents if i.kind != "spurious"]
    for object_id in {i.object_id for i in incidents}:
        own = [i for i in incidents if i.object_id == object_id]
        switches = [i for i in own if i.kind == "ids"]
        gap = min(abs(i.frame - at.frame) for i in switches or own) if at else 0
        rank[object_id] = (at is not None and object_id != at.object_id, not switches, gap, -len(switches), -len(own))
    return sorted(rank, key=lambda object_id: (rank[object_id], object_id))[:MOST_LANES]


def _identities(agent: Shown, at: Incident | None, several: bool) -> rrb.Tabs:
    """Lanes of the objects with events; all lanes; the event log."""
    prefix = f"{agent.root.split('/')[1]}: " if several else ""
    chosen = _eventful(agent.replay, at)
    every = [lane.object_id for lane in lanes(agent.replay)]
    tabs: list[Any] = []
    for name, objects in (("track of each object with events", chosen), ("of every object", every)):
        if objects:
            contents = [f"/{agent.root}identity/gt_{g:03d}" for g in objects]
            tabs.append(rrb.StateTimelineView(origin="/", contents=contents, name=f"{prefix}{name}"))
    tabs.append(rrb.TextLogView(origin=f"/{agent.root}events", name=f"{prefix}event log"))
    return rrb.Tabs(*tabs, active_tab=0)
