"""The worst events of each kind as pictures, each with the command that opens the moment in the viewer."""

from __future__ import annotations

import os
from base64 import b64encode
from dataclasses import dataclass
from io import BytesIO
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image

from ..running.stored import open_run
from ..types import Floats
from ..viz.drawing.report import report
from ..viz.focus import Focus
from ..viz.replay import replay
from ..viz.terminal.output import command_line
from .figures.style import Figure, beside, color, draw
from .findings import Findings
from .moments import Moment, Said, worst_moments

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_LEAST, _MOST = 6.0, 45.0  # m, half of what a panel shows


@dataclass(frozen=True)
class Picture:
    """One event, with what was forecast from each kind of past."""

    figure: Figure  # beside each other: from the true past, with one hypothesis and with the most
    focus: bytes  # PNG: the event with one hypothesis alone, as `mtp-bench view --png` draws it
    sentence: str  # what the focus picture shows
    command: str  # that opens it

    @property
    def base64(self) -> str:
        """The focus picture as text, for a page."""
        return b64encode(self.focus).decode("ascii")


def gallery(found: Findings) -> list[Picture]:
    """Pictures of the worst events of each kind."""
    count: dict[str, int] = {}
    pictures = []
    for moment in worst_moments(found):
        kind = moment.incident.kind
        count[kind] = count.get(kind, 0) + 1
        focus, sentence = _focus(found, moment)
        figure = picture_of(moment, f"{kind}-{count[kind]}")
        pictures.append(Picture(figure, focus, sentence, command_of(found, moment)))
    return pictures


def _focus(found: Findings, moment: Moment) -> tuple[bytes, str]:
    """The focus picture of a moment with one hypothesis, and its sentence."""
    bench, single = found.bench, found.subject.single
    run = open_run(found.of(single).folders[0], bench.options.data, bench.card)
    notes: list[str] = []
    scene = run.drawn(moment.scene, notes.append)
    focus = Focus.of(replay(scene, run.first(moment.scene), run.card, single.label), moment.incident)
    content = BytesIO()
    report(focus).quantize(128, dither=Image.Dither.NONE).save(content, "PNG", optimize=True)
    return content.getvalue(), focus.sentence + ("; the road is not drawn, for its map is broken" if notes else "")


def command_of(found: Findings, moment: Moment) -> str:
    """The command that opens a moment, with one hypothesis and with the most side by side."""
    subject, bench = found.subject, found.bench
    settings = dict.fromkeys(found.of(setting).folders[0] for setting in (subject.single, subject.most))
    folders = map(os.path.relpath, settings)
    return command_line("view", *folders, scene=moment.scene, at=moment.incident.name, data=bench.options.data)


def picture_of(moment: Moment, name: str) -> Figure:
    """An event: what was forecast from the true past, with one hypothesis and with the most."""
    incident = moment.incident
    center, half = _window(moment)

    def paint(*axes: Axes) -> None:
        for axis, said in zip(axes, moment.said, strict=True):
            _panel(axis, moment, said, center, half)
        axes[0].set_ylabel("y from the object, m")
        beside(axes[-1], ncols=5)

    return draw(
        name,
        f"{incident.kind}: {moment.class_name} {incident.object_id}",
        sentence_of(moment),
        f"1 event; scene {moment.scene}, frame {incident.frame}",
        paint,
        panels=len(moment.said),
        size=(3.1 * len(moment.said), 3.5),
        grid="",
    )


def sentence_of(moment: Moment) -> str:
    """What happened, and what each forecast was worth."""
    incident = moment.incident
    who = f"{moment.class_name} {incident.object_id}"
    happened = {
        "ids": f"{who} was track {incident.old_id} and is now track {incident.new_id}",
        "lost": f"{who} was track {incident.old_id} and is now held by none"
        + (", for that track is elsewhere" if incident.wrong else ""),
        "reacquired": f"{who} was held by none and is found again as track {incident.new_id}",
    }[incident.kind]
    worth = "; ".join(f"{said.label} {_worth(said)}" for said in moment.said)
    return f"{happened[0].upper()}{happened[1:]}. The best forecast is off by: {worth}."


def _worth(said: Said) -> str:
    return "no forecast" if said.error is None else f"{said.error:.2f} m"


def _window(moment: Moment) -> tuple[Floats, float]:
    """Centre and half size, m: past, future and the best forecasts are in it."""
    best = [said.forecast.nearest_path for said in moment.said if said.forecast is not None]
    points = np.concatenate([moment.past, moment.future, *best])
    low, high = points.min(axis=0), points.max(axis=0)
    return (low + high) / 2, float(np.clip((high - low).max() * 0.58, _LEAST, _MOST))


def _panel(axis: Axes, moment: Moment, said: Said, center: Floats, half: float) -> None:
    """What one agent said, in metres from the object."""
    place = moment.box[:2]
    for box in moment.others:
        axis.add_patch(_outline(box, place, "grey", 0.8))
    axis.add_patch(_outline(moment.box, place, "green", 1.6))
    if said.forecast is not None:
        for path in said.forecast.path:
            _way(axis, path - place, "vermillion", 0.7, "-", None, 0.35)
        best = said.forecast.path[said.forecast.nearest]
        _way(axis, best - place, "vermillion", 2.0, "-", "best forecast")
    _way(axis, moment.past - place, "green", 1.6, ":", "true past", mark="o")
    _way(axis, moment.future - place, "green", 2.0, "--", "true future")
    if len(said.trail) and said is not moment.said[0]:  # which is the true past itself
        _way(axis, said.trail - place, "blue", 1.4, "-", "track", mark="s")
    low, high = center - place - half, center - place + half
    axis.set_xlim(low[0], high[0])
    axis.set_ylim(low[1], high[1])
    axis.set_aspect("equal")
    axis.set_title(f"{said.label}: {_worth(said)}", loc="left")
    axis.set_xlabel("x from the object, m")


def _way(
    axis: Axes, path: Floats, name: str, width: float, kind: str, label: str | None, alpha: float = 1.0, mark: str = ""
) -> None:
    axis.plot(
        path[:, 0], path[:, 1], color=color(name), linewidth=width, linestyle=kind, label=label, alpha=alpha,
        marker=mark or None, markersize=3,
    )  # fmt: skip


def _outline(box: Floats, place: Floats, name: str, width: float):  # type: ignore[no-untyped-def]
    """The box from above, as a patch."""
    from matplotlib.patches import Polygon

    yaw, long, wide = float(box[3]), float(box[4]) / 2, float(box[5]) / 2
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    corners = np.array([[long, wide], [long, -wide], [-long, -wide], [-long, wide]]) @ turn.T + box[:2] - place
    return Polygon(corners, closed=True, fill=False, edgecolor=color(name), linewidth=width)
