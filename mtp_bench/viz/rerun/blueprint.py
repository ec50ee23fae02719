"""How a recording is laid out: the scene, bird's-eye views per hypothesis, counts, identity lanes and events."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...cards import Card
from ...types import Floats, Scene
from ..replay import Incident, Replay
from .arrays import TOP_HYPOTHESES, Contents, ShownAgent, box_counts
from .eye import FALSE, FOLLOW, Eye
from .focus_layout import focus_columns
from .sdk import rr, rrb

NEAR = 16.0  # m, half the side of what the views show around an event
MOST_LANES, FEWER_LANES = 5, 3  # in the first tab: as many as fit, without an event and with one
FAST = 1e6  # times the usual speed
ASIDE, UP = (-0.9, -1.0, 0.9), (0.0, 0.0, 1.0)


def layout(contents: Contents) -> rrb.Blueprint:
    """The blueprint of a recording; all views of the scene look at its event."""
    agents = contents.agents
    eye = _eye(agents[0].replay, contents.at)
    oblique = _oblique(agents[0], replace(eye, offset=ASIDE, up=UP))
    columns: list[Any]
    if contents.at is not None:
        columns = focus_columns(contents, [[oblique, *_birds(agents[0], eye)], *(_birds(a, eye) for a in agents[1:])])
    else:
        columns = [_bird(agent, eye) for agent in agents]
        columns[:0] = [oblique] if len(agents) == 1 else []
    identities = [_identities(agent, contents.at) for agent in agents]
    share = 1.6 if len(agents) == 1 else 1.2
    below = rrb.Horizontal(*_plots(agents), *identities, column_shares=[1, 1, *[share] * len(agents)])
    if contents.at is None:
        parts = rrb.Vertical(rrb.Horizontal(*columns), below, row_shares=[2, 1])
        return _blueprint(parts, "Paused", agents[0].replay.card)
    shares = [2.2, 1.0] if len(agents) == 1 else [1.8, 1.0, *[1.8] * (len(agents) - 1)]
    parts = rrb.Vertical(rrb.Horizontal(*columns, column_shares=shares), below, row_shares=[3.2, 1])
    last = contents.at.frame == agents[0].replay.frames - 1
    return _blueprint(
        parts, "Following" if last else "Playing", agents[0].replay.card, {} if last else _held(contents.at.frame)
    )


def _held(frame: int) -> dict[str, Any]:
    """Settings of a time panel that stands at ``frame``: at once, and until somebody moves the time cursor.

    A layout has no place for the cursor itself. One that plays a selection so fast that every step leaves it is put
    back to its beginning at every step.
    """
    selection = rr.encodings.AbsoluteTimeRange(frame, frame + 1)
    return {"loop_mode": "selection", "time_selection": selection, "playback_speed": FAST}


def live_layout(scene: Scene, card: Card, root: str = "") -> rrb.Blueprint:
    """The blueprint of an episode while it is played: the first hypotheses, following the newest frame.

    ``root``: prefix of the paths of the episode.
    """
    start = np.zeros(3) if card.has_ego else _middle(scene.detections.box[scene.detections.rows(0), :3])
    eye = Eye(start, 2 * NEAR, f"/{root}{FOLLOW if card.has_ego else 'world'}", root=root)
    views = [
        eye.view(f"hypothesis {h}", [f"/{root}world/det", f"/{root}world/forecast"], f"/{root}world/hyp/{h:02d}")
        for h in range(TOP_HYPOTHESES)
    ]
    return _blueprint(rrb.Tabs(*views, active_tab=0), "Following", card)


def _blueprint(parts: Any, play: Any, card: Card, more: dict[str, Any] | None = None) -> rrb.Blueprint:
    """``parts`` with a time panel."""
    return rrb.Blueprint(
        parts,
        rrb.TimePanel(state="collapsed", timeline="frame", play_state=play, fps=card.task.rate, **(more or {})),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
    )


def _eye(replay: Replay, at: Incident | None) -> Eye:
    """On the event; else on the vehicle that carries the sensors, all the way; else on the objects of frame 0."""
    if at is not None:
        return Eye(np.array(at.position), NEAR)
    if replay.card.has_ego:
        return Eye(np.zeros(3), 2 * NEAR, f"/{FOLLOW}")
    truth = replay.scene.truth
    place = truth.box[truth.rows(0), :3]
    center = _middle(place)
    spread = np.quantile(np.linalg.norm(place[:, :2] - center[:2], axis=1), 0.8) if len(place) else 3 * NEAR
    return Eye(center, float(np.clip(spread, NEAR, 6 * NEAR)))


def _middle(place: Floats) -> Floats:
    """The middle of places [n, 3]; the origin where there are none."""
    return np.median(place, axis=0) if len(place) else np.zeros(3)


def _paths(agent: ShownAgent) -> list[str]:
    return [f"/{agent.root}world/{name}" for name in ("forecast", "events")] + [f"/{agent.root}{FALSE}/**"]


def _hypothesis(agent: ShownAgent, number: int) -> str:
    return f"/{agent.root}world/hyp/{number:02d}"


def _oblique(agent: ShownAgent, eye: Eye) -> rrb.Spatial3DView:
    """The scene from above and aside, with everything of the best hypothesis."""
    paths = ["/world/det", *_paths(agent)]
    if agent.best is None:
        return eye.view("scene", paths)
    return eye.view(f"scene: truth, detections, hypothesis {agent.best}", paths, _hypothesis(agent, agent.best))


def _bird(agent: ShownAgent, eye: Eye) -> rrb.Tabs:
    """Bird's-eye views, that of the best hypothesis open."""
    return rrb.Tabs(*_birds(agent, eye), active_tab=0 if agent.best is None else agent.hypotheses.index(agent.best))


def _birds(agent: ShownAgent, eye: Eye) -> list[rrb.Spatial3DView]:
    """Bird's-eye views: one per hypothesis, and one of the detections."""
    views = [eye.view(agent.titled(f"hypothesis {h}"), _paths(agent), _hypothesis(agent, h)) for h in agent.hypotheses]
    return [*views, eye.view(agent.titled("detections"), ["/world/det", f"/{agent.root}world/events"])]


def _plots(agents: Sequence[ShownAgent]) -> list[rrb.TimeSeriesView]:
    def view(name: str, series: Sequence[str]) -> rrb.TimeSeriesView:
        contents = [f"/{agent.root}metrics/{one}" for agent in agents for one in series]
        return rrb.TimeSeriesView(origin="/", contents=contents, name=name, plot_legend=rrb.Corner2D.LeftTop)

    boxes = tuple(box_counts(agents[0].replay))
    return [view("boxes per frame", boxes), view("events so far", ("IDS", "lost", "reacquired"))]


def _eventful(replay: Replay, at: Incident | None) -> list[int]:
    """The objects whose lanes are shown first: switches count before other events, near ones and many before few."""
    rank: dict[int, tuple[float, ...]] = {}
    for object_id in {i.object_id for i in replay.events}:
        own = [i for i in replay.events if i.object_id == object_id]
        switches = [i for i in own if i.kind == "ids"]
        gap = min(abs(i.frame - at.frame) for i in switches or own) if at else 0
        rank[object_id] = (at is not None and object_id != at.object_id, not switches, gap, -len(switches), -len(own))
    most = MOST_LANES if at is None else FEWER_LANES
    return sorted(rank, key=lambda object_id: (rank[object_id], object_id))[:most]


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
