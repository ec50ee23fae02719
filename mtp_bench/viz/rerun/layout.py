"""Layout of a recording: the scene, bird's-eye views per hypothesis, an event alone, counts, identity lanes, events."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...cards import Card
from ...types import Floats
from ..framing import turn_of, window_of
from ..palette import Color
from ..replay import KINDS, MOMENT, Incident
from .sdk import rr, rrb
from .shown import ShownAgent

SHARED = ("map/**", "ego", "gt", "gt_future", "at")  # entities that every view of the scene shows
BACKGROUND = (18, 18, 24)
# place of an eye in units of the reach; direction that is up there
ABOVE, NORTH = (0.0, 0.0, 2.2), (0.0, 1.0, 0.0)
ASIDE, UP = (-0.9, -1.0, 0.9), (0.0, 0.0, 1.0)  # of an oblique eye
DARK: Color = (66, 66, 76)  # true boxes that are not of the event
DARKER: Color = (46, 46, 54)  # detections and tracks
DARKEST: Color = (34, 34, 42)  # forecasts
ASPECT = 1.9  # width of the view of an event in units of its height
NEAR = 16.0  # m, half the side of what the views show around an event
MOST_LANES, FEWER_LANES = 5, 3  # in the first tab: as many as fit, without an event and with one
FAST = 1e6  # times the usual speed


@dataclass(frozen=True, eq=False)
class Eye:
    """Place and target of the views."""

    center: Floats  # [3]
    reach: float  # m, half the side of what they show
    origin: str = "/world"  # entity whose frame of reference they show
    offset: tuple[float, float, float] = ABOVE
    up: tuple[float, float, float] = NORTH

    def view(self, agent: ShownAgent, name: str, hypothesis: int | None = None, detections: bool = True) -> Any:
        """The entities that all agents share, and one hypothesis of an agent with its forecasts and events.

        False forecasts among them are hidden until their eye icon is clicked.
        """
        world = f"/{agent.root}world"
        contents = [f"/{agent.shared}world/{path}" for path in (*SHARED, *(["det"] if detections else []))]
        contents.append(f"{world}/events")
        overrides: dict[Any, Any] = {f"{world}/false_forecast": rrb.EntityBehavior(visible=False)}
        if hypothesis is not None:
            contents += [f"{world}/{path}" for path in ("forecast", "false_forecast", f"hyp/{hypothesis:02d}/**")]
            overrides[f"{world}/hyp/{hypothesis:02d}/box"] = rr.Boxes3D.from_fields(show_labels=True)
        return self.view_of(agent.titled(name), contents, overrides)

    def view_of(self, name: str, contents: Sequence[str], overrides: dict[Any, Any]) -> rrb.Spatial3DView:
        """A view of the entities ``contents``, changed by ``overrides``."""
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


def layout(agents: Sequence[ShownAgent], at: Incident | None) -> rrb.Blueprint:
    """The blueprint of a recording; all views of the scene look at its event."""
    first, replay, alone = agents[0], agents[0].replay, len(agents) == 1
    eye = _eye(first, at)
    oblique = replace(eye, offset=ASIDE, up=UP).view(first, "scene", first.best)
    below = rrb.Horizontal(
        *_plots(agents),
        *(_identities(agent, at) for agent in agents),
        column_shares=[1, 1, *[1.6 if alone else 1.2] * len(agents)],
    )
    if at is None:
        birds = [rrb.Tabs(*_birds(agent, eye), active_tab=agent.hypotheses.index(agent.best)) for agent in agents]
        above = rrb.Horizontal(*([oblique] if alone else []), *birds)
        return _blueprint(rrb.Vertical(above, below, row_shares=[2, 1]), "Paused", replay.card)
    behind = [[oblique, *_birds(first, eye)], *(_birds(agent, eye) for agent in agents[1:])]
    columns = [_alone(agent, tabs) for agent, tabs in zip(agents, behind, strict=True)]
    shares = [2.2, 1.0] if alone else [1.8, 1.0, *[1.8] * (len(agents) - 1)]
    names = {agent.root: agent.titled("what happened") for agent in agents}
    texts = rrb.Vertical(*(rrb.TextDocumentView(origin=f"/{r}focus/text", name=name) for r, name in names.items()))
    above = rrb.Horizontal(columns[0], texts, *columns[1:], column_shares=shares)
    parts = rrb.Vertical(above, below, row_shares=[3.2, 1])
    if at.frame == replay.frames - 1:
        return _blueprint(parts, "Following", replay.card)
    # A layout has no field for the time cursor. One that plays a selection so fast that every step leaves it is put
    # back to its beginning at every step, until the time cursor is moved by hand.
    selection = rr.encodings.AbsoluteTimeRange(at.frame, at.frame + 1)
    stay = {"loop_mode": "selection", "time_selection": selection, "playback_speed": FAST}
    return _blueprint(parts, "Playing", replay.card, **stay)


def live_layout(agent: ShownAgent) -> rrb.Blueprint:
    """Blueprint of an episode that is still running: its hypotheses, at the newest frame."""
    return _blueprint(rrb.Tabs(*_birds(agent, _eye(agent, None)), active_tab=0), "Following", agent.replay.card)


def _blueprint(parts: Any, play: Any, card: Card, **time: Any) -> rrb.Blueprint:
    """``parts`` with a time panel, which has the settings ``time``."""
    return rrb.Blueprint(
        parts,
        rrb.TimePanel(state="collapsed", timeline="frame", play_state=play, fps=card.task.rate, **time),
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


def _birds(agent: ShownAgent, eye: Eye) -> list[Any]:
    """Bird's-eye views: one per hypothesis, and one of the detections."""
    views = [eye.view(agent, f"hypothesis {h}", h, detections=False) for h in agent.hypotheses]
    return [*views, eye.view(agent, "detections")]


def _plots(agents: Sequence[ShownAgent]) -> list[rrb.TimeSeriesView]:
    """Plots of boxes per frame and of events so far."""
    plots = {"boxes per frame": ("TP", "FN", "FP"), "events so far": ("ids", "lost", "reacquired")}
    return [
        rrb.TimeSeriesView(
            origin="/",
            contents=[f"/{agent.root}metrics/{series}" for agent in agents for series in names],
            name=name,
            plot_legend=rrb.Corner2D.LeftTop,
        )
        for name, names in plots.items()
    ]


def _identities(agent: ShownAgent, at: Incident | None) -> rrb.Tabs:
    """Lanes of the objects with events; all lanes; the event log."""
    replay, truth = agent.replay, agent.replay.scene.truth
    # first that of the event, then those with many switches and other events
    events, switches = (Counter(i.object_id for i in replay.events if i.kind in kinds) for kinds in (KINDS, ("ids",)))
    own = None if at is None else at.object_id
    order = sorted(events, key=lambda g: (g != own, -switches[g], -events[g], g))
    lanes = {
        "track of each object with events": order[: MOST_LANES if at is None else FEWER_LANES],
        "of every object": np.unique(truth.object_id[~truth.neutral]).tolist(),
    }
    tabs: list[Any] = [
        rrb.StateTimelineView(
            origin="/", contents=[f"/{agent.root}identity/gt_{g:03d}" for g in objects], name=agent.titled(name)
        )
        for name, objects in lanes.items()
        if objects
    ]
    return rrb.Tabs(*tabs, rrb.TextLogView(origin=f"/{agent.root}events", name=agent.titled("event log")), active_tab=0)


def _alone(agent: ShownAgent, others: Sequence[Any]) -> Any:
    """The event alone from above, turned like its picture, above the small pictures; ``others`` in tabs behind."""
    focus, world = agent.focus, f"/{agent.root}world"
    assert focus is not None, "an event is shown"
    window, turn = window_of(focus, focus.at.frame), turn_of(focus)
    reach = 0.85 * max(window.high, window.wide / ASPECT) / 2
    eye = Eye(np.array([window.x, window.y, focus.at.position[2]]), reach, up=(-np.sin(turn), np.cos(turn), 0.0))
    box = f"{world}/hyp/{agent.best:02d}/box"
    contents = [f"/world/{name}" for name in ("map/**", "ego", "gt", "det", "at")]
    contents += [f"{world}/focus/**", f"{world}/forecast", f"{world}/false_forecast", box]
    hidden = rrb.EntityBehavior(visible=False)  # until the eye icon is clicked
    dim = {
        "/world/gt": rr.Boxes3D.from_fields(colors=DARK, radii=-0.8),
        "/world/det": rr.Boxes3D.from_fields(colors=DARKER, radii=-0.5),
        "/world/ego": rr.Boxes3D.from_fields(colors=DARKER),
        f"{world}/forecast": [rr.LineStrips3D.from_fields(colors=DARKEST), hidden],
        f"{world}/false_forecast": hidden,
        box: rr.Boxes3D.from_fields(colors=DARKER, radii=-0.5, show_labels=False, fill_mode="majorwireframe"),
    }
    name = f"{focus.at.name} alone" if focus.at.kind != MOMENT else "the same object: no event"
    view = eye.view_of(agent.titled(name), contents, dim)
    name = agent.titled("the frames t - 1, t and t + 1")
    pictures = rrb.Spatial2DView(origin=f"/{agent.root}focus/pictures", name=name)
    shares = [1.2 if focus.replay.images else 2.3, 1]
    return rrb.Vertical(rrb.Tabs(view, *others, active_tab=0), pictures, row_shares=shares)
