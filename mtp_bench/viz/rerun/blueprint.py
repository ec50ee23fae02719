"""Layout of a recording: the scene, bird's-eye views per hypothesis, counts, identity lanes and events."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...cards import Card
from ...types import Floats, Scene
from ..replay import Incident, Replay
from .contents import TOP_HYPOTHESES, Contents, ShownAgent, box_counts
from .sdk import rr, rrb
from .views import FALSE, FOLLOW, Eye, focus_columns

ASIDE, UP = (-0.9, -1.0, 0.9), (0.0, 0.0, 1.0)  # place of an oblique eye, in units of the reach, and its up
NEAR = 16.0  # m, half the side of what the views show around an event
MOST_LANES, FEWER_LANES = 5, 3  # in the first tab: as many as fit, without an event and with one
FAST = 1e6  # times the usual speed


def layout(contents: Contents) -> rrb.Blueprint:
    """The blueprint of a recording; all views of the scene look at its event."""
    agents, at = contents.agents, contents.at
    replay, card, alone = agents[0].replay, agents[0].replay.card, len(agents) == 1
    eye = _eye(replay, at)
    oblique = _oblique(agents[0], replace(eye, offset=ASIDE, up=UP))
    identities = [_identities(agent, at) for agent in agents]
    column_shares = [1, 1, *[1.6 if alone else 1.2] * len(agents)]
    below = rrb.Horizontal(*_plots(agents), *identities, column_shares=column_shares)
    if at is None:
        birds = [_bird(agent, eye) for agent in agents]
        above = rrb.Horizontal(*([oblique] if alone else []), *birds)
        return _blueprint(rrb.Vertical(above, below, row_shares=[2, 1]), "Paused", card)
    behind = [[oblique, *_birds(agents[0], eye)], *(_birds(agent, eye) for agent in agents[1:])]
    shares = [2.2, 1.0] if alone else [1.8, 1.0, *[1.8] * (len(agents) - 1)]
    above = rrb.Horizontal(*focus_columns(contents, behind), column_shares=shares)
    parts = rrb.Vertical(above, below, row_shares=[3.2, 1])
    if at.frame == replay.frames - 1:
        return _blueprint(parts, "Following", card)
    # A layout has no field for the time cursor. One that plays a selection so fast that every step leaves it is put
    # back to its beginning at every step, until the time cursor is moved by hand.
    selection = rr.encodings.AbsoluteTimeRange(at.frame, at.frame + 1)
    stay = {"loop_mode": "selection", "time_selection": selection, "playback_speed": FAST}
    return _blueprint(parts, "Playing", card, stay)


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


def _blueprint(parts: Any, play: Any, card: Card, time: dict[str, Any] | None = None) -> rrb.Blueprint:
    """``parts`` with a time panel, which has the settings ``time``."""
    return rrb.Blueprint(
        parts,
        rrb.TimePanel(state="collapsed", timeline="frame", play_state=play, fps=card.task.rate, **(time or {})),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
    )


def _eye(replay: Replay, at: Incident | None) -> Eye:
    """An eye on the event; else on the vehicle that carries the sensors; else on the objects of frame 0."""
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
    """The middle of places [n, 3]; the origin without any."""
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
    """Plots of boxes per frame and of events so far."""
    plots = {"boxes per frame": box_counts(agents[0].replay), "events so far": ("IDS", "lost", "reacquired")}
    return [
        rrb.TimeSeriesView(
            origin="/",
            contents=[f"/{agent.root}metrics/{series}" for agent in agents for series in names],
            name=name,
            plot_legend=rrb.Corner2D.LeftTop,
        )
        for name, names in plots.items()
    ]


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
    truth, tabs = agent.replay.scene.truth, list[Any]()
    lanes = {
        "track of each object with events": _eventful(agent.replay, at),
        "of every object": np.unique(truth.object_id[~truth.neutral]).tolist(),
    }
    for name, objects in lanes.items():
        if objects:
            contents = [f"/{agent.root}identity/gt_{g:03d}" for g in objects]
            tabs.append(rrb.StateTimelineView(origin="/", contents=contents, name=agent.titled(name)))
    tabs.append(rrb.TextLogView(origin=f"/{agent.root}events", name=agent.titled("event log")))
    return rrb.Tabs(*tabs, active_tab=0)
