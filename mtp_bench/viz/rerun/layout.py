"""Layout of a recording: the scene, hypotheses side by side, an event alone, curves, events on the time line, lanes."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...cards import Card
from ...core import Floats
from ..framing import turn_of, window_of
from ..incident import INCIDENT_KINDS, Incident
from .entities import EVENT
from .events import curves_of, lanes
from .sdk import rr, rrb
from .shown import ShownAgent

SHARED = (
    "map/**",
    "ego",
    "gt",
    "gt_future",
    "at",
)  # entities that every view of the scene shows
BACKGROUND = (18, 18, 24)
# place of an eye in units of the reach; direction that is up there
ABOVE, NORTH = (0.0, 0.0, 2.2), (0.0, 1.0, 0.0)
ASIDE, UP = (-0.9, -1.0, 0.9), (0.0, 0.0, 1.0)  # of an oblique eye
DARK = (66, 66, 76)  # true boxes that are not of the event
DARKER = (46, 46, 54)  # detections and tracks
DARKEST = (34, 34, 42)  # forecasts
ASPECT, NARROW = (
    1.9,
    1.3,
)  # width of the view of an event in units of its height; of one of several
NEAR = 16.0  # m, half the side of what the views show around an event
MOST_LANES = 3  # of objects in the first tab, without an event
MOST_BESIDE = 4  # bird's-eye views side by side


@dataclass(frozen=True, eq=False)
class Eye:
    """Place and target of the views."""

    center: Floats  # [3]
    reach: float  # m, half the side of what they show
    origin: str = "/world"  # entity whose frame of reference they show
    offset: tuple[float, float, float] = ABOVE
    up: tuple[float, float, float] = NORTH

    def view(
        self,
        agent: ShownAgent,
        name: str,
        hypothesis: int | None = None,
        detections: bool = True,
    ) -> Any:
        """The entities that all agents share, and one hypothesis of an agent with its forecasts and events.

        False forecasts among them are hidden until their eye icon is clicked.
        """
        world = f"/{agent.root}world"
        contents = [
            f"/{agent.shared}world/{path}"
            for path in (*SHARED, *(["det"] if detections else []))
        ]
        contents += [f"{world}/{name}" for name in ("events", "plan", "slower")]
        overrides: dict[Any, Any] = {
            f"{world}/false_forecast": rrb.EntityBehavior(visible=False)
        }
        if hypothesis is not None:
            contents += [
                f"{world}/{path}"
                for path in ("forecast", "false_forecast", f"hyp/{hypothesis:02d}/**")
            ]
        return self.view_of(agent.titled(name), contents, overrides)

    def view_of(
        self, name: str, contents: Sequence[str], overrides: dict[Any, Any]
    ) -> rrb.Spatial3DView:
        """A view of the entities ``contents``, changed by ``overrides``."""
        position = self.center + self.reach * np.array(self.offset)
        return rrb.Spatial3DView(
            origin=self.origin,
            contents=contents,
            name=name,
            background=rrb.Background(kind="SolidColor", color=BACKGROUND),
            line_grid=rrb.LineGrid3D(visible=False),
            eye_controls=rrb.EyeControls3D(
                position=position, look_target=self.center, eye_up=self.up
            ),
            overrides=overrides,
        )


def layout(agents: Sequence[ShownAgent], at: Incident | None) -> rrb.Blueprint:
    """The blueprint of a recording; all views of the scene look at its event."""
    alone, eye, card = len(agents) == 1, _eye(agents[0], at), agents[0].replay.card
    key = rrb.TextDocumentView(origin="/key", name="what the marks mean")
    if at is None:
        views = [
            view
            for agent in agents
            for view in _beside(agent, eye, max(1, MOST_BESIDE // len(agents)))
        ]
        above = rrb.Horizontal(*views, key, column_shares=[*[1.0] * len(views), 0.7])
        below = rrb.Horizontal(
            *_curves(agents), _lanes(agents), column_shares=[*[1] * len(agents), 2]
        )
        return _blueprint(
            rrb.Vertical(above, below, row_shares=[1.7, 1]), "Paused", "time", card
        )
    texts = [
        rrb.TextDocumentView(
            origin=f"/{a.root}focus/text", name=a.titled("what happened")
        )
        for a in agents
    ]
    beside = rrb.Vertical(
        *texts, key, row_shares=[*[1.2 if alone else 2.2] * len(agents), 1.0]
    )
    first, *others = (_alone(agents, agent, eye) for agent in agents)
    above = rrb.Horizontal(
        first,
        beside,
        *others,
        column_shares=[2.2 if alone else 1.8, 1.0, *[1.8] * len(others)],
    )
    below = rrb.Horizontal(*_curves(agents), _lanes(agents))
    # the timeline of the event has nothing but its window, which is played over and over
    return _blueprint(
        rrb.Vertical(above, below, row_shares=[2.8, 1]), "Playing", EVENT, card, "All"
    )


def live_layout(agent: ShownAgent) -> rrb.Blueprint:
    """Blueprint of an episode that is still running: its hypotheses, at the newest frame."""
    views = rrb.Horizontal(*_beside(agent, _eye(agent, None), MOST_BESIDE))
    return _blueprint(views, "Following", "frame", agent.replay.card)


def _blueprint(
    parts: Any, play: Any, timeline: str, card: Card, loop: Any = None
) -> rrb.Blueprint:
    """``parts`` with a time panel that plays in real time."""
    return rrb.Blueprint(
        parts,
        rrb.TimePanel(
            state="collapsed",
            timeline=timeline,
            play_state=play,
            fps=card.task.rate,
            loop_mode=loop,
        ),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
    )


def _eye(agent: ShownAgent, at: Incident | None) -> Eye:
    """An eye on the event; else on the vehicle that carries the sensors; else on the detections of frame 0."""
    replay, world = agent.replay, f"/{agent.shared}world"
    if at is not None:
        return Eye(np.array(at.position), NEAR)
    if replay.card.has_ego:
        return Eye(np.zeros(3), 2 * NEAR, f"{world}/follow")
    seen = replay.scene.detections
    place = seen.box[seen.rows(0), :3] if seen.start[1] else np.zeros((1, 3))
    center = np.median(place, axis=0)
    spread = np.quantile(np.linalg.norm(place[:, :2] - center[:2], axis=1), 0.8)
    return Eye(center, float(np.clip(spread, NEAR, 6 * NEAR)), world)


def _beside(agent: ShownAgent, eye: Eye, most: int) -> list[Any]:
    """Views side by side: the hypotheses from above, the heaviest first, the scene and the detections.

    Those that are more than ``most`` are in tabs behind the first.
    """
    hypotheses, best = agent.hypotheses, next(iter(agent.hypotheses))
    names = {
        h: f"hypothesis {h}" + ("" if np.isnan(w) else f", weight {w:.2f}")
        for h, w in hypotheses.items()
    }
    names = names if len(names) > 1 else {best: "seen from above"}
    views = [eye.view(agent, name, h, detections=False) for h, name in names.items()]
    views += [
        replace(eye, offset=ASIDE, up=UP).view(agent, "scene", best),
        eye.view(agent, "detections"),
    ]
    return [rrb.Tabs(views[0], *views[most:], active_tab=0), *views[1:most]]


def _curves(agents: Sequence[ShownAgent]) -> list[Any]:
    """Plots of the errors; of an event also of distances and speeds, those of one of several agents in tabs."""
    corners = (rrb.Corner2D.LeftTop, *[rrb.Corner2D.RightTop] * 2)
    plots = [
        [
            rrb.TimeSeriesView(
                origin=f"/{a.root}curves/{i}",
                name=a.titled(title),
                plot_legend=corners[i],
            )
            for i, title in enumerate(curves_of(a.replay, a.focus))
        ]
        for a in agents
    ]
    return (
        plots[0]
        if len(agents) == 1
        else [rrb.Tabs(*views, active_tab=0) for views in plots]
    )


def _lanes(agents: Sequence[ShownAgent]) -> rrb.Tabs:
    """Lanes of the objects of an event, or with most events, and events on the time line; all lanes; the event log."""
    few, every = [], []
    for agent in agents:
        run, tracks = agent.replay, lanes(agent.replay)
        count, switches = (
            Counter(i.object_id for i in run.events if i.kind in some)
            for some in (INCIDENT_KINDS, ("ids",))
        )
        order = sorted(tracks, key=lambda g: (-switches[g], -count[g], g))[
            : MOST_LANES // len(agents)
        ]
        marks = [
            f"marks/{kind}"
            for kind in INCIDENT_KINDS
            if any(i.kind == kind for i in run.incidents)
        ]
        if agent.focus is not None:
            named, own = {*agent.focus.named_tracks}, agent.focus.at.object_id
            order = [g for g, lane in tracks.items() if g == own or named & {*lane}]
            marks = [
                f"{agent.lanes[own]}-events" if own in tracks else "marks/spurious"
            ]
        few += [
            f"/{agent.root}{path}"
            for path in (*(agent.lanes[g] for g in order), *marks)
        ]
        every += [
            f"/{agent.root}{path}"
            for path in (*(agent.lanes[g] for g in tracks), "marks/**")
        ]
    names = {"events and tracks": few, "all": every}
    views = [
        rrb.StateTimelineView(origin="/", contents=paths, name=name)
        for name, paths in names.items()
        if paths
    ]
    columns = rrb.TextLogColumns(timeline_columns=["frame"], text_log_columns=["Body"])
    return rrb.Tabs(
        *views,
        rrb.TextLogView(origin="/", name="event log", columns=columns),
        active_tab=0,
    )


def _alone(agents: Sequence[ShownAgent], agent: ShownAgent, wide: Eye) -> Any:
    """The event alone from above, turned like its picture, above the small pictures; behind it the whole scene."""
    focus, world = agent.focus, f"/{agent.root}world"
    assert focus is not None, "an event is shown"
    window = window_of(
        focus, focus.at.frame, [each.focus for each in agents if each.focus is not None]
    )
    turn, aspect = turn_of(focus), ASPECT if len(agents) == 1 else NARROW
    reach = 0.85 * max(window.high, window.wide / aspect) / 2
    eye = Eye(
        np.array([window.x, window.y, focus.at.position[2]]),
        reach,
        up=(-np.sin(turn), np.cos(turn), 0.0),
    )
    box = f"{world}/hyp/{next(iter(agent.hypotheses)):02d}/box"
    contents = [f"/world/{name}" for name in ("map/**", "ego", "gt", "det", "at")]
    contents += [
        f"{world}/focus/**",
        f"{world}/forecast",
        f"{world}/false_forecast",
        box,
    ]
    hidden = rrb.EntityBehavior(visible=False)  # until the eye icon is clicked
    dim = {
        "/world/gt": rr.Boxes3D.from_fields(colors=DARK, radii=-0.8),
        "/world/det": rr.Boxes3D.from_fields(colors=DARKER, radii=-0.5),
        "/world/ego": rr.Boxes3D.from_fields(colors=DARKER),
        f"{world}/forecast": [rr.LineStrips3D.from_fields(colors=DARKEST), hidden],
        f"{world}/false_forecast": hidden,
        box: rr.Boxes3D.from_fields(
            colors=DARKER, radii=-0.5, fill_mode="majorwireframe"
        ),
    }
    view = eye.view_of(
        agent.titled(f"{focus.at.name} at {focus.seconds(focus.at.frame):.1f} s"),
        contents,
        dim,
    )
    frames = f"frames {focus.at.frame - 1}, {focus.at.frame} and {focus.at.frame + 1}"
    pictures = rrb.Spatial2DView(
        origin=f"/{agent.root}focus/pictures", name=agent.titled(frames)
    )
    shares = [1.2 if focus.replay.images else 2.3, 1]
    whole = rrb.Horizontal(
        *_beside(agent, wide, MOST_BESIDE), name=agent.titled("whole scene")
    )
    return rrb.Vertical(
        rrb.Tabs(view, whole, active_tab=0), pictures, row_shares=shares
    )
