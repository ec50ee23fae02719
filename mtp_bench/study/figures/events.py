"""Figures of events: where they are, when, and how many all hypotheses share."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..findings import Findings
from ..table import Tables
from .common import pick, where
from .style import HATCHES, Figure, beside, color, diamonds, draw

if TYPE_CHECKING:
    from matplotlib.axes import Axes

KINDS = (("ids", "vermillion"), ("frag", "blue"))


def _events(found: Findings, tables: Tables) -> str:
    counts = {row.kind: row.events for row in tables["frequency"].rows}
    return (
        f"{counts['ids']} ids, {counts['frag']} frag of {found.subject.single.label}, {len(found.bench.scenes)} scenes"
    )


def distance_figure(found: Findings, tables: Tables) -> Figure:
    """How far from the ego identities err."""
    table = tables["distance"]

    def paint(axis: Axes) -> None:
        for i, (kind, name) in enumerate(KINDS):
            rows = where(table.rows, kind=kind)
            place = np.arange(len(rows)) + 0.38 * (i - 0.5)
            axis.bar(
                place, pick(rows, "events"), 0.36, color=color(name), hatch=HATCHES[i], edgecolor="white", label=kind
            )
            for at, row in zip(place, rows, strict=True):
                axis.text(at, row.events, str(row.events), ha="center", va="bottom", fontsize=8.5)
        rows = where(table.rows, kind=KINDS[0][0])
        names = [f"{r.low:g}–{r.high:g}" if r.high is not None else f"over {r.low:g}" for r in rows]
        axis.set_xticks(range(len(rows)), names)
        axis.set_xlabel("distance of the object to the ego, m")
        axis.set_ylabel("events")
        axis.margins(y=0.1)
        beside(axis)

    return draw("distance", table.title, table.sentence, _events(found, tables), paint)


def shared_figure(found: Findings, tables: Tables) -> Figure:
    """Events that every hypothesis shares, over H."""
    table = tables["shared"]
    rows = where(table.rows, agent=found.subject.name)

    def paint(axis: Axes) -> None:
        for kind, name, marker in (("ids", "vermillion", "v"), ("lost", "orange", "D"), ("reacquired", "sky", "P")):
            mine = where(rows, kind=kind)
            if mine and mine[0].events_single:
                at = [1, *pick(mine, "H")]
                left = [100.0, *(100 * row.events_in_all / row.events_single for row in mine)]
                axis.plot(at, left, marker=marker, color=color(name), label=f"{kind} (n = {mine[0].events_single})")
        for row in where(rows, kind="ids"):
            if row.paper_fewer is not None:
                diamonds(axis, row.H, 100 * (1 - row.paper_fewer), "the paper's ids")
        axis.set_xticks([1, *sorted({row.H for row in rows})])
        axis.set_xlabel("hypotheses H")
        axis.set_ylabel("events in every hypothesis,\n% of those with one")
        axis.set_ylim(0, 105)
        beside(axis)

    return draw("shared", table.title, table.sentence, _events(found, tables), paint)


def frames_figure(found: Findings, tables: Tables) -> Figure:
    """Events over frames, with one hypothesis and in all."""
    table = tables["frames"]
    most = found.subject.most.hypotheses

    def paint(*axes: Axes) -> None:
        for axis, field, title in zip(
            axes, ("events_single", "events_in_all"), ("one hypothesis", f"in all {most} hypotheses"), strict=True
        ):
            base = None
            for i, (kind, name) in enumerate(KINDS):
                rows = where(table.rows, kind=kind)
                first = np.array(pick(rows, "first_frame"))
                width = np.array(pick(rows, "last_frame")) - first + 1
                value = np.array(pick(rows, field))
                base = np.zeros(len(rows)) if base is None else base
                axis.bar(
                    first, value, width * 0.92, bottom=base, align="edge", color=color(name), hatch=HATCHES[i],
                    edgecolor="white", label=kind,
                )  # fmt: skip
                base = base + value
            axis.set_title(title, loc="left")
            axis.set_xlabel("frame of the scene")
            axis.set_ylabel("events, all scenes")
        top = max(axis.get_ylim()[1] for axis in axes)
        for axis in axes:
            axis.set_ylim(0, top)
        axes[1].legend(loc="upper right")

    return draw("frames", table.title, table.sentence, _events(found, tables), paint, panels=2)
