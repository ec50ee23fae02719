"""How a recording is laid out: the scene, bird's-eye views per hypothesis, counts, identity lanes and events."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...cards import Card
from ...types import Floats, Scene
from ..replay import Incident, Replay
from .arrays import TOP_HYPOTHESES, Contents, ShownAgent
from .sdk import rr, rrb

SHARED = ("/world/map/**", "/world/ego", "/world/gt", "/world/gt_future", "/world/at")
NEAR = 16.0  # m, half the side of what the views show around an event
MOST_LANES = 5  # in the first tab: as many as fit
BACKGROUND = (18, 18, 24)
ABOVE, NORTH = (0.0, 0.0, 2.2), (0.0, 1.0, 0.0)  # where an eye is, in units of the reach; what is up there
ASIDE, UP = (-0.9, -1.0, 0.9), (0.0, 0.0, 1.0)
FOLLOW = "/world/follow"


def layout(contents: Contents) -> rrb.Blueprint:
    """The blueprint of a recording; all views of the scene look at its event."""
    agents = contents.agents
    eye = _eye(agents[0].replay, contents.at)
    columns: list[Any] = [_bird(agent, eye) for agent in agents]
    if len(agents) == 1:
        columns.insert(0, _oblique(agents[0], replace(eye, offset=ASIDE, up=UP)))
    identities = [_identities(agent, contents.at) for agent in agents]
    share = 1.6 if len(agents) == 1 else 1.2
    below = rrb.Horizontal(*_plots(agents), *identities, column_shares=[1, 1, *[share] * len(agents)])
    parts = rrb.Vertical(rrb.Horizontal(*columns), below, row_shares=[2, 1])
    return _blueprint(parts, "Paused", agents[0].replay.card)


def live_layout(scene: Scene, card: Card) -> rrb.Blueprint:
    """The blueprint of an episode while it is played: the first hypotheses, following the newest frame."""
    start = np.zeros(3) if card.has_ego else _middle(scene.detections.box[scene.detections.rows(0), :3])
    eye = _Eye(start, 2 * NEAR, FOLLOW if card.has_ego else "/world")
    views = [
        eye.view(f"hypothesis {h}", ["/world/det", "/world/forecast"], f"/world/hyp/{h:02d}")
        for h in range(TOP_HYPOTHESES)
    ]
    return _blueprint(rrb.Tabs(*views, active_tab=0), "Following", card)


def _blueprint(parts: Any, play: Any, card: Card) -> rrb.Blueprint:
    return rrb.Blueprint(
        parts,
        rrb.TimePanel(state="collapsed", timeline="frame", play_state=play, fps=card.task.rate),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
    )


@dataclass(frozen=True, eq=False)
class _Eye:
    """Where the views look, and from where."""

    center: Floats  # [3]
    reach: float  # m, half the side of what they show
    origin: str = "/world"  # entity whose frame they show: FOLLOW moves along with the sensors
    offset: tuple[float, float, float] = ABOVE
    up: tuple[float, float, float] = NORTH

    def view(self, name: str, paths: Sequence[str], hypothesis: str | None = None) -> rrb.Spatial3DView:
        """What all agents share, the entities at ``paths``, and a hypothesis at its path, its tracks with labels."""
        contents = [*SHARED, *paths, *([] if hypothesis is None else [f"{hypothesis}/**"])]
        overrides: Any = hypothesis and {f"{hypothesis}/box": rr.Boxes3D.from_fields(show_labels=True)}
        position = self.center + self.reach * np.array(self.offset)
        return rrb.Spatial3DView(
            origin=self.origin,
            contents=contents,
            name=name,
            background=rrb.Background(kind="SolidColor", color=BACKGROUND),
            line_grid=rrb.LineGrid3D(visible=False),
            eye_controls=rrb.EyeControls3D(position=position, look_target=self.center, eye_up=self.up),
            overrides=overrides,
        )


def _eye(replay: Replay, at: Incident | None) -> _Eye:
    """On the event; else on the vehicle that carries the sensors, all the way; else on the objects of frame 0."""
    if at is not None:
        return _Eye(np.array(at.position), NEAR)
    if replay.card.has_ego:
        return _Eye(np.zeros(3), 2 * NEAR, FOLLOW)
    truth = replay.scene.truth
    place = truth.box[truth.rows(0), :3]
    center = _middle(place)
    spread = np.quantile(np.linalg.norm(place[:, :2] - center[:2], axis=1), 0.8) if len(place) else 3 * NEAR
    return _Eye(center, float(np.clip(spread, NEAR, 6 * NEAR)))


def _middle(place: Floats) -> Floats:
    """The middle of places [n, 3]; the origin where there are none."""
    return np.median(place, axis=0) if len(place) else np.zeros(3)


def _paths(agent: ShownAgent) -> list[str]:
    return [f"/{agent.root}world/{name}" for name in ("forecast", "events", "false_forecast")]


def _hypothesis(agent: ShownAgent, number: int) -> str:
    return f"/{agent.root}world/hyp/{number:02d}"


def _oblique(agent: ShownAgent, eye: _Eye) -> rrb.Spatial3DView:
    """The scene from above and aside, with everything of the best hypothesis."""
    paths = ["/world/det", *_paths(agent)]
    if agent.best is None:
        return eye.view("scene", paths)
    return eye.view(f"scene: truth, detections, hypothesis {agent.best}", paths, _hypothesis(agent, agent.best))


def _bird(agent: ShownAgent, eye: _Eye) -> rrb.Tabs:
    """Bird's-eye views: one per hypothesis, and one of the detections."""
    views = [eye.view(agent.titled(f"hypothesis {h}"), _paths(agent), _hypothesis(agent, h)) for h in agent.hypotheses]
    views.append(eye.view(agent.titled("detections"), ["/world/det", f"/{agent.root}world/events"]))
    return rrb.Tabs(*views, active_tab=0 if agent.best is None else agent.hypotheses.index(agent.best))


def _plots(agents: Sequence[ShownAgent]) -> list[rrb.TimeSeriesView]:
    def view(name: str, series: Sequence[str]) -> rrb.TimeSeriesView:
        contents = [f"/{agent.root}metrics/{one}" for agent in agents for one in series]
        return rrb.TimeSeriesView(origin="/", contents=contents, name=name, plot_legend=rrb.Corner2D.LeftTop)

    return [view("boxes per frame", ("TP", "FN", "FP")), view("events so far", ("IDS", "lost", "reacquired"))]


def _eventful(replay: Replay, at: Incident | None) -> list[int]:
    """The objects whose lanes are shown first: switches count before other events, near ones and many before few."""
    rank: dict[int, tuple[float, ...]] = {}
    for object_id in {i.object_id for i in replay.events}:
        own = [i for i in replay.events if i.object_id == object_id]
        switches = [i for i in own if i.kind == "ids"]
        gap = min(abs(i.frame - at.frame) for i in switches or own) if at else 0
        rank[object_id] = (at is not None and object_id != at.object_id, not switches, gap, -len(switches), -len(own))
    return sorted(rank, key=lambda object_id: (rank[object_id], object_id))[:MOST_LANES]


def _identities(agent: ShownAgent, at: Incident | None) -> rrb.Tabs:
    """Lanes of the objects with events; all lanes; the event log."""
    tabs: list[Any] = []
    truth = agent.replay.scene.truth
    every = np.unique(truth.object_id[~truth.neutral]).tolist()
    for name, objects in (
        ("track of each object with events", _eventful(agent.replay, at)),
        ("of every object", every),
    ):
        if objects:
            contents = [f"/{agent.root}identity/gt_{g:03d}" for g in objects]
            tabs.append(rrb.StateTimelineView(origin="/", contents=contents, name=agent.titled(name)))
    tabs.append(rrb.TextLogView(origin=f"/{agent.root}events", name=agent.titled("event log")))
    return rrb.Tabs(*tabs, active_tab=0)
