"""Figures of lines: over H, k, false forecasts, confidence and the cut of the input."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..findings import Findings
from ..plan import SAME_BUDGET
from ..table import Tables
from .common import agents, called, colors_of, n_of, pick, where
from .style import MARKERS, Figure, beside, color, draw, line

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def gain_figure(found: Findings, tables: Tables) -> Figure | None:
    """MinADE over H, with and without sampling, where identities switch and over all targets; None without any."""
    subject = found.subject
    known = (("targeted", "IDS"), ("targeted", "ids"), ("global", "all"))
    panels = [p for p in known if any(r.minADE is not None for r in where(tables[p[0]].rows, targets_of=p[1]))]
    if not panels:
        return None

    def paint(*axes: Axes) -> None:
        for axis, (table, subset) in zip(axes, panels, strict=True):
            rows = where(tables[table].rows, targets_of=subset)
            single = where(rows, agent=subject.single.label, H=subject.single.hypotheses or 1)
            for sampling, name, label in (("k of all", "vermillion", "k samples"), ("none", "sky", "H·k samples")):
                mine = single[:1] + [r for r in where(rows, agent=subject.name, sampling=sampling) if r.H > 1]
                line(axis, pick(mine, "H"), pick(mine, "minADE"), name, f"{subject.name}, {label}")
                papers = [r for r in mine if r.paper_minADE is not None]
                axis.plot(
                    pick(papers, "H"), pick(papers, "paper_minADE"), linestyle=":", marker=MARKERS[name],
                    markerfacecolor="none", color=color(name), label=f"the paper's, {label}" if papers else None,
                )  # fmt: skip
            for label, name, kind in ((SAME_BUDGET, "orange", "--"), (subject.truth.label, "green", "-")):
                for row in where(rows, agent=label)[:1]:
                    if row.minADE is not None:
                        axis.axhline(row.minADE, color=color(name), linestyle=kind, linewidth=1.5, label=label)
            axis.set_xticks(sorted({row.H for row in rows}))
            axis.set_xlabel("hypotheses H")
            axis.set_ylabel(f"minADE on {subset}, m")
            axis.set_ylim(bottom=0)
        beside(axes[0], ncols=2)

    return draw(
        "gain",
        "What hypotheses and samples win back",
        "minADE over the number of hypotheses, with k samples and with all of them. More samples lower minADE without "
        "any skill; stp_same_budget shows how much of the fall sampling alone explains.",
        n_of(found),
        paint,
        panels=len(panels),
        size=(9.2, 3.7),
    )


def ranked_figure(found: Findings, tables: Tables) -> Figure:
    """The error that ranks over H, with intervals of the difference to one hypothesis."""
    subject = found.subject
    rows = [*tables["global"].rows, *tables["targeted"].rows]

    def paint(*axes: Axes) -> None:
        for axis, subset in zip(axes, ("all", "ids", "reacquired"), strict=True):
            here = where(rows, targets_of=subset)
            mine = [r for r in where(here, agent=subject.name, sampling="k of all") if r.to_single is not None]
            line(
                axis, [1, *pick(mine, "H")], [0.0, *pick(mine, "to_single")], "vermillion", subject.name,
                [0.0, *pick(mine, "to_single_low")], [0.0, *pick(mine, "to_single_high")],
            )  # fmt: skip
            for row in where(here, agent=SAME_BUDGET)[:1]:
                if row.to_single is not None:
                    axis.axhline(row.to_single, color=color("orange"), linestyle="--", linewidth=1.5, label=SAME_BUDGET)
            axis.axhline(0, color=color("blue"), linewidth=1.2, label=subject.single.label)
            axis.set_xticks([1, *pick(mine, "H")])
            axis.set_xlabel("hypotheses H")
            axis.set_ylabel(f"error on {subset}, m, difference")
        beside(axes[0])

    return draw(
        "ranked",
        "The error that ranks, against one hypothesis",
        "Difference of the error at false-forecast budgets to that of one hypothesis, at equal k, with its 95 % "
        "interval. Below the dashed line hypotheses win more than sampling alone.",
        n_of(found),
        paint,
        panels=3,
        size=(9.2, 3.3),
    )


def speed_figure(found: Findings, tables: Tables) -> Figure:
    """Time of a frame by stage over H."""
    table = tables["speed"]
    rows = sorted(table.rows, key=lambda row: row.H)

    def paint(axis: Axes) -> None:
        at = pick(rows, "H")
        for field, name, label in (("tracking", "blue", "tracking"), ("prediction", "vermillion", "prediction")):
            line(axis, at, pick(rows, field), name, label)
        line(axis, at, pick(rows, "whole"), "grey", "whole agent")
        axis.set_xticks(at)
        axis.set_xlabel("hypotheses H")
        axis.set_ylabel("time of a frame, ms")
        axis.set_ylim(bottom=0)
        beside(axis)

    return draw("speed", table.title, table.sentence, f"{rows[0].frames} frames", paint)


def k_figure(found: Findings, tables: Tables) -> Figure:
    """The k-curves."""
    table = tables["k_curve"]
    told = colors_of(found)

    def paint(axis: Axes) -> None:
        most = max(row.H for row in table.rows)
        for agent, count in agents(table.rows):
            if count in (1, most):
                rows = where(table.rows, agent=agent, H=count)
                line(axis, pick(rows, "k"), pick(rows, "minADE"), told.get(agent, "grey"), called(agent, count))
        axis.set_xscale("log")
        ks = sorted({row.k for row in table.rows})
        axis.set_xticks(ks, [str(k) for k in ks])
        axis.minorticks_off()
        axis.set_xlabel("samples k (logarithmic)")
        axis.set_ylabel("expected minADE, m")
        axis.set_ylim(bottom=0)
        beside(axis)

    return draw("k_curve", table.title, table.sentence, n_of(found), paint)


def budgets_figure(found: Findings, tables: Tables) -> Figure:
    """The error over what is allowed."""
    table = tables["budgets"]
    known = found.table(found.subject.single).budgets.false_known
    told = colors_of(found)

    def paint(axis: Axes) -> None:
        for agent, count in agents(table.rows):
            rows = where(table.rows, agent=agent, H=count)
            name = told.get(agent, "grey")
            line(axis, pick(rows, "allowed"), pick(rows, "error"), name, called(agent, count), markersize=3)
        axis.set_xlabel("false forecasts allowed per target" if known else "forecasts allowed per live frame")
        axis.set_ylabel("error, m")
        axis.set_ylim(bottom=0)
        beside(axis, ncols=2)

    return draw("budgets", table.title, table.sentence, n_of(found), paint)


def calibration_figure(found: Findings, tables: Tables) -> Figure:
    """The reliability curve."""
    table = tables["calibration"]
    told = colors_of(found)

    def paint(axis: Axes) -> None:
        axis.plot([0, 1], [0, 1], color=color("soft"), linestyle=":", label="a probability")
        for agent, count in agents(table.rows):
            rows = where(table.rows, agent=agent, H=count)
            brier = rows[0].brier
            label = f"{called(agent, count)} (Brier {brier:.3f})" if brier is not None else called(agent, count)
            line(axis, pick(rows, "confidence"), pick(rows, "of_a_true_object"), told.get(agent, "grey"), label)
        axis.set_xlabel("stated confidence (probability)")
        axis.set_ylabel("share of a true object")
        axis.set_xlim(0, 1)
        axis.set_ylim(0, 1)
        beside(axis, ncols=1)

    count = sum(row.forecasts for row in table.rows)
    n = f"{count} forecasts of {len(agents(table.rows))} agents"
    return draw("calibration", table.title, table.sentence, n, paint, size=(5.6, 4.2))


def cuts_figure(found: Findings, tables: Tables) -> Figure:
    """The error over the cut of the input."""
    table = tables["cuts"]
    names = {"stp": "blue", "mtp": "vermillion", "stp_same_budget": "orange"}

    def paint(*axes: Axes) -> None:
        for axis, (field, subset) in zip(axes, (("error", "all"), ("error_ids", "ids")), strict=True):
            for agent, name in names.items():
                rows = where(table.rows, agent=agent)
                line(axis, [100 * r.true_detections_below for r in rows], pick(rows, field), name, agent)
            axis.set_xlabel("true detections left out, %")
            axis.set_ylabel(f"error on {subset}, m")
            axis.set_ylim(bottom=0)
        first = where(table.rows, agent="stp")
        for row in first:
            axes[1].annotate(
                f"{row.switches_of_stp} ids", (100 * row.true_detections_below, 0), xytext=(0, 4),
                textcoords="offset points", ha="center", fontsize=8, color=color("soft"),
            )  # fmt: skip
        beside(axes[0])

    return draw("cuts", table.title, table.sentence, n_of(found, seeds=1), paint, panels=2)
