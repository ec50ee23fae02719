"""Layout of a recording: the scene from above, the event, curves, lanes."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...cards import Card
from ...core import Floats
from ..incident import INCIDENT_KINDS, Incident
from .entities import EVENT
from .events import curves_of, lanes
from .sdk import rrb
from .shown import ShownAgent

# entities that every view of the scene shows
SHARED = ("map/**", "ego", "gt", "gt_future", "at")
BACKGROUND = (18, 18, 24)
# place of an eye in units of the reach; direction that is up there
ABOVE = (0.0, 0.0, 2.2)
NORTH = (0.0, 1.0, 0.0)
OBLIQUE = (-0.9, -1.0, 0.9)  # of an oblique eye
UP = (0.0, 0.0, 1.0)
NEAR_M = 16.0  # half the side of what the views show around an event
MAX_LANES = 3  # of objects in the first tab, without an event
MAX_VIEWS = 4  # side by side


@dataclass(frozen=True, eq=False)
class Eye:
    """Place and target of the views."""

    center: Floats  # [3]
    reach: float  # m, half the side of what they show
    origin: str = "/world"  # entity whose frame of reference they show
    offset: tuple[float, float, float] = ABOVE
    up: tuple[float, float, float] = NORTH

    def view(
        self, agent: ShownAgent, name: str, paths: Sequence[str]
    ) -> rrb.Spatial3DView:
        """Return a view of shared entities and of an agent's.

        False forecasts among them are hidden until their eye icon is clicked.
        """
        world = f"/{agent.root}world"
        contents = [f"/{agent.shared_prefix}world/{path}" for path in SHARED]
        contents += [f"{world}/{path}" for path in ("events", "plan", "slower")]
        contents += paths
        hidden = rrb.EntityBehavior(visible=False)
        return rrb.Spatial3DView(
            origin=self.origin,
            contents=contents,
            name=agent.titled(name),
            background=rrb.Background(kind="SolidColor", color=BACKGROUND),
            line_grid=rrb.LineGrid3D(visible=False),
            eye_controls=rrb.EyeControls3D(
                position=self.center + self.reach * np.array(self.offset),
                look_target=self.center,
                eye_up=self.up,
            ),
            overrides={f"{world}/false_forecast": hidden},
        )


def layout(agents: Sequence[ShownAgent], at: Incident | None) -> rrb.Blueprint:
    """Return the blueprint of a recording.

    All views look at its event.
    """
    eye = _eye(agents[0], at)
    card = agents[0].replay.card
    key = rrb.TextDocumentView(origin="/key", name="what the marks mean")
    views_each = max(1, MAX_VIEWS // len(agents)) if at is None else 1
    views = [view for agent in agents for view in _views(agent, eye, views_each)]
    in_tabs = len(agents) > 1
    curves = [curve for agent in agents for curve in _curves(agent, in_tabs)]
    below = rrb.Horizontal(*curves, _lanes(agents))
    if at is None:
        shares = [*[1.0] * len(views), 0.7]
        above = rrb.Horizontal(*views, key, column_shares=shares)
        parts = rrb.Vertical(above, below, row_shares=[1.7, 1])
        return _blueprint(parts, "Paused", "time", card)
    pictures = []
    texts = []
    for agent in agents:
        root = f"/{agent.root}focus"
        time_s = agent.replay.scene.seconds(at.frame)
        title = agent.titled(f"{at.name} at {time_s:.1f} s")
        pictures.append(rrb.Spatial2DView(origin=f"{root}/picture", name=title))
        title = agent.titled("what happened")
        texts.append(rrb.TextDocumentView(origin=f"{root}/text", name=title))
    event_views = rrb.Vertical(
        rrb.Tabs(*pictures, active_tab=0),
        rrb.Tabs(*texts, key, active_tab=0),
        row_shares=[2, 1],
    )
    above = rrb.Horizontal(
        *views, event_views, column_shares=[*[1.0] * len(views), 1.4]
    )
    # the timeline of the event has its window alone, which is played over and over
    parts = rrb.Vertical(above, below, row_shares=[2.8, 1])
    return _blueprint(parts, "Playing", EVENT, card, loop="All")


def live_layout(agent: ShownAgent) -> rrb.Blueprint:
    """Return the blueprint of an episode that still runs."""
    views = rrb.Horizontal(*_views(agent, _eye(agent, None), MAX_VIEWS))
    return _blueprint(views, "Following", "frame", agent.replay.card)


def _blueprint(
    parts: Any, play: Any, timeline: str, card: Card, loop: Any = None
) -> rrb.Blueprint:
    """Return ``parts`` with a time panel that plays in real time."""
    panel = rrb.TimePanel(
        state="collapsed",
        timeline=timeline,
        play_state=play,
        fps=card.task.rate,
        loop_mode=loop,
    )
    selection = rrb.SelectionPanel(state="hidden")
    return rrb.Blueprint(parts, panel, selection, rrb.BlueprintPanel(state="hidden"))


def _eye(agent: ShownAgent, at: Incident | None) -> Eye:
    """Return an eye on the event ``at``, else the sensors, else the detections."""
    world = f"/{agent.shared_prefix}world"
    if at is not None:
        return Eye(np.array(at.position), NEAR_M)
    if agent.replay.card.has_ego:
        return Eye(np.zeros(3), 2 * NEAR_M, f"{world}/follow")
    detections = agent.replay.scene.detections
    places: Floats = np.zeros((1, 3))
    if detections.start[1]:  # frame 0 has some
        places = detections.box[detections.rows(0), :3]
    center = np.median(places, axis=0)
    distance_m = np.hypot(*(places - center)[:, :2].T)
    reach_m = np.clip(np.quantile(distance_m, 0.8), NEAR_M, 6 * NEAR_M)
    return Eye(center, float(reach_m), world)


def _views(agent: ShownAgent, eye: Eye, max_views: int) -> list[Any]:
    """Return views of the hypotheses, then of the scene.

    The heaviest hypothesis is first; the scene is seen from aside, with detections.
    Views beyond ``max_views`` are in tabs behind the first.
    """
    world = f"/{agent.root}world"
    forecasts = [f"{world}/forecast", f"{world}/false_forecast"]
    views = []
    for hypothesis, weight in agent.hypotheses.items():
        name = "seen from above"
        if len(agent.hypotheses) > 1:
            name = f"hypothesis {hypothesis}"
            if not np.isnan(weight):
                name += f", weight {weight:.2f}"
        paths = [*forecasts, f"{world}/hyp/{hypothesis:02d}/**"]
        views.append(eye.view(agent, name, paths))
    best = next(iter(agent.hypotheses))
    paths = [
        *forecasts,
        f"{world}/hyp/{best:02d}/**",
        f"/{agent.shared_prefix}world/det",
    ]
    views.append(replace(eye, offset=OBLIQUE, up=UP).view(agent, "scene", paths))
    tabs = rrb.Tabs(views[0], *views[max_views:], active_tab=0)
    return [tabs, *views[1:max_views]]


def _curves(agent: ShownAgent, in_tabs: bool) -> list[Any]:
    """Return the plots of `curves_of`, as one view if ``in_tabs``."""
    plots = []
    for number, title in enumerate(curves_of(agent.replay, agent.focus)):
        corner = rrb.Corner2D.RightTop if number else rrb.Corner2D.LeftTop
        plots.append(
            rrb.TimeSeriesView(
                origin=f"/{agent.root}curves/{number}",
                name=agent.titled(title),
                plot_legend=corner,
            )
        )
    return [rrb.Tabs(*plots, active_tab=0)] if in_tabs else plots


def _lanes(agents: Sequence[ShownAgent]) -> rrb.Tabs:
    """Return lanes, and events on the time line.

    The first tab has those of the event, or of the objects with most events.
    """
    chosen_paths: list[str] = []
    all_paths: list[str] = []
    for agent in agents:
        lane_paths = [agent.lanes[object_id] for object_id in lanes(agent.replay)]
        root = f"/{agent.root}"
        chosen = _chosen_lanes(agent, MAX_LANES // len(agents))
        chosen_paths += [f"{root}{path}" for path in chosen]
        all_paths += [f"{root}{path}" for path in (*lane_paths, "marks/**")]
    views = []
    for name, paths in (("events and tracks", chosen_paths), ("all", all_paths)):
        if paths:
            views.append(rrb.StateTimelineView(origin="/", contents=paths, name=name))
    return rrb.Tabs(*views, active_tab=0)


def _chosen_lanes(agent: ShownAgent, max_lanes: int) -> list[str]:
    """Return paths of the lanes and marks in the first tab."""
    replay = agent.replay
    object_lanes = lanes(replay)
    kinds = {event.kind for event in replay.incidents}
    if agent.focus is None:
        count = Counter(event.object_id for event in replay.events)
        chosen = sorted(object_lanes, key=lambda number: (-count[number], number))
        chosen = chosen[:max_lanes]
    else:
        at = agent.focus.at
        tracks = {*agent.focus.tracks_at(at.frame)}
        chosen = [
            object_id
            for object_id, lane in object_lanes.items()
            if object_id == at.object_id or tracks & {*lane}
        ]
        kinds &= {at.kind}
    marks = [f"marks/{kind}" for kind in INCIDENT_KINDS if kind in kinds]
    return [*(agent.lanes[object_id] for object_id in chosen), *marks]
