"""Tables of `benchmarks/driving.py show`, for the terminal and for a page in Markdown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from rich.console import Console
from rich.table import Table as RichTable

from benchmarks.driving_figures import MOST_SCENES
from benchmarks.driving_measure import AHEAD, NEAR
from benchmarks.driving_switches import LOST, SECONDS
from docs.generate.blocks import table
from mtp_bench.judge.records.shipped import earlier_cards

CHOSEN_LATER, KEPT = ", no switch in it", ", no switch before it"
IN_SHORT = (
    ("stp", "gt_tracks"),
    ("perfect_association", "stp"),
    ("stp_same_samples", "stp"),
    ("mtp", "stp_same_samples"),
    ("perfect_association_same_samples", "stp_same_samples"),
    ("stp_modes_tracklets", "stp"),
    ("stp_modes_tracklets", "stp_modes"),
    ("tracking_free", "stp_modes_tracklets"),
    ("tracking_free", "mtp_modes_tracklets"),
)
ROADS = ("Intersection", "Roundabout", "Merge", "Intersection-10Hz")
_Interval = Sequence[float] | None


@dataclass(frozen=True)
class Grid:
    """A table of texts; the first column is left-aligned. ``note`` stands below it."""

    title: str
    heads: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""

    def print(self, console: Console) -> None:
        """Print the table."""
        table = RichTable(title=self.title)
        for place, head in enumerate(self.heads):
            table.add_column(head, justify="right" if place else "left")
        for row in self.rows:
            table.add_row(*row)
        console.print(table)
        console.print(self.note)

    def markdown(self) -> str:
        """The table in Markdown."""
        first = [f"`{row[0]}`" if " " not in row[0] else row[0] for row in self.rows]
        rows = [[name, *row[1:]] for name, row in zip(first, self.rows, strict=True)]
        lines = table(self.heads, rows)
        return f"**{self.title}**\n\n{lines}\n" + f"\n{self.note}\n" * bool(self.note)


def grids(made: Mapping[str, Any]) -> list[Grid]:
    """All tables of the figures."""
    scenes, attacked = made["scenes"], made["attacked scenes"]
    several = [
        f"{agent} {count}" for agent, count in made["seeds"].items() if count > 1
    ]
    seeds = f"Seeds of the detector: {', '.join(several)}; else 1. " if several else ""
    left = "".join(
        f"Left out: {agent}, {reason}. " for agent, reason in made["left out"].items()
    )
    note = "Intervals (95 %) resample scenes; to stp and p: sign-flip test, paired by scene. Seen: smallest difference "
    note += f"that the test finds four times out of five, with as many scenes and with {MOST_SCENES}. {seeds}{left}"
    found = [_driving(f"{made['env']}, {scenes} scenes", made["rows"], scenes, note)]
    found += [_pairs(made["pairs"]), _errors(made["rows"], scenes)]
    if made["attacks"]:
        found.append(
            _driving(
                f"Dishonest agents, {attacked} scenes", made["attacks"], attacked, ""
            )
        )
    found.append(_taus(made["tau"]))
    if made["switches"]:
        found += _switches(made["switches"])
    mark = planner_note(made)
    return [replace(grid, title=grid.title + mark) for grid in found]


def planner_note(made: Mapping[str, Any]) -> str:
    """Mark of the figures of a card that has changed since."""
    note = earlier_cards().get(made["card"])
    return f", {note}" if note else ""


def in_short(figures: Mapping[str, Any]) -> Grid:
    """Table of what the text of the page speaks of: a column per environment; ``figures``: by environment."""
    roads = [road for road in ROADS if f"MTP-Drive-{road}-v0" in figures]
    names = [f"MTP-Drive-{road}-v0" for road in roads]
    rows = [
        [
            f"`{one}` − `{other}`",
            *(_difference(figures[name], one, other) for name in names),
        ]
        for one, other in IN_SHORT
    ]
    for group in ("all", "without references"):
        taus = [figures[name]["tau"][group] for name in names]
        found = [tau["measures"]["bADE"] for tau in taus]
        rows.append(
            [
                f"tau with bADE, {group}",
                *(_cell(tau["tau"], (tau["low"], tau["high"]), ".2f") for tau in found),
            ]
        )
        rows.append(
            [
                "between halves of the scenes",
                *(f"{tau['between halves']:.2f}" for tau in taus),
            ]
        )
    notes = {planner_note(figures[name]) for name in names}
    title = f"Differences of drive scores, and tau{max(notes, default='')}"
    return Grid(title, ["", *roads], rows)


def _difference(made: Mapping[str, Any], one: str, other: str) -> str:
    """Cell of the paired difference of drive scores; a dash where an agent has not driven."""
    pairs = {
        (pair["one"], pair["other"]): (pair["mean"], pair["interval"])
        for pair in made["pairs"]
    }
    for name, row in made["rows"].items():
        if name != "stp":
            pairs[name, "stp"] = row["difference"], row["difference_interval"]
    if (one, other) not in pairs and (other, one) in pairs:
        value, (low, high) = pairs[other, one]
        return _cell(-value, (-high, -low), "+.3f")
    return _cell(*pairs[one, other], "+.3f") if (one, other) in pairs else "–"


def _driving(title: str, rows: Mapping[str, Any], scenes: int, note: str) -> Grid:
    sizes = list(dict.fromkeys((scenes, MOST_SCENES)))
    heads = [
        "agent",
        "drive score",
        "to stp",
        "p",
        *(f"seen at {size}" for size in sizes),
        "at fault /100",
        "collisions /100",
        "near misses /100",
        "phantom brakes /100",
        "progress",
        "to goal, s",
        "comfort",
    ]
    texts = []
    for agent, row in rows.items():
        p = (
            ""
            if row["p"] is None
            else "<.001"
            if row["p"] < 0.0005
            else f"{row['p']:.3f}"
        )
        tested = [p, *(f"{row['seen'][str(size)]:.3f}" if p else "" for size in sizes)]
        texts.append(
            [
                agent,
                _cell(row["drive_score"], row["interval"]),
                _cell(row["difference"], row["difference_interval"], "+.3f"),
                *tested,
                _cell(row["collisions"], row["collisions_interval"], ".1f"),
                *(
                    f"{row[name]:.1f}"
                    for name in ("any_collision", "near_misses", "phantom_brakes")
                ),
                f"{row['progress']:.3f}",
                "" if row["goal_seconds"] is None else f"{row['goal_seconds']:.1f}",
                f"{row['comfort']:.2f}",
            ]
        )
    return Grid(title, heads, texts, note)


def _pairs(pairs: Sequence[Mapping[str, Any]]) -> Grid:
    texts = [
        [
            f"`{pair['one']}` − `{pair['other']}`",
            _cell(pair["mean"], pair["interval"], "+.3f"),
            f"{pair['seen']:.3f}",
        ]
        for pair in pairs
    ]
    note = "Paired by scene, 95 % interval of the sign-flip test. Seen: as above."
    return Grid(
        "Differences of drive scores",
        ["difference", "drive score", "seen"],
        texts,
        note,
    )


def _errors(rows: Mapping[str, Any], scenes: int) -> Grid:
    names = list(next(iter(rows.values()))["errors"])
    texts = [
        [agent, *(f"{row['errors'][name]:.3f}" for name in names)]
        for agent, row in rows.items()
    ]
    note = "Open loop: scenes in which ground-truth tracks drove, seed 0. Own episodes: each agent in its own traffic, "
    note += "targets of equal weight, budgets of the number of targets alone."
    return Grid(f"bADE, m, {scenes} scenes", ["agent", *names], texts, note)


def _taus(taus: Mapping[str, Any]) -> Grid:
    names = list(next(iter(taus.values()))["measures"])
    texts = []
    for group, own in taus.items():
        cells = [
            _cell(
                own["measures"][n]["tau"],
                (own["measures"][n]["low"], own["measures"][n]["high"]),
                ".2f",
            )
            for n in names
        ]
        texts.append(
            [f"{group}: {own['agents']} agents", *cells, f"{own['between halves']:.2f}"]
        )
    note = "1: the agent of less error always drives better. Last column, for comparison: tau of the drive scores of "
    note += "two halves of the scenes."
    return Grid(
        "Kendall's tau of drive score with less error",
        ["agents", *names, "between halves"],
        texts,
        note,
    )


def _switches(costs: Mapping[str, Any]) -> list[Grid]:
    heads = [
        "",
        "with",
        "without",
        "difference",
        "seen",
        "with a switch",
        "others",
        "scenes",
    ]
    note = (
        f"Per 100 windows of {SECONDS:.0f} s that begin with a switch within {NEAR:.0f} m of the ego, and per 100 "
        f"matched ones (agent, objects near, speed, time) without a switch in the {SECONDS:.0f} s before; one may "
        "follow, so that what comes later does not choose them. Last columns: numbers of windows and scenes. Way lost "
        "in m per window. Seen: smallest difference that is found four times out of five. There are "
        f"{costs['per drive']:.1f} such switches per drive, in {costs['drives without']:.0%} none."
    )
    below = "Drive score less that of ground-truth tracks in the same scene, within agents: drives with a switch near "
    below += "the ego against those without, and those with more switches per second than half of the agent's drives."
    tables = (
        ("windows", "What an identity switch near the ego costs", note, 100.0, ".2f"),
        (
            "ahead",
            f"The same for switches ahead of the ego, within {AHEAD:.0f} m",
            "",
            100.0,
            ".2f",
        ),
        (
            "scenes",
            "Drives with and without identity switches near the ego",
            below,
            1.0,
            ".3f",
        ),
    )
    return [
        Grid(
            title,
            heads,
            [
                _cost(name.removesuffix(KEPT), cost, scale, form)
                for name, cost in _shown(costs[key])
            ],
            text,
        )
        for key, title, text, scale, form in tables
    ]


def _shown(costs: Mapping[str, Any]) -> list[tuple[str, Any]]:
    """Costs without those whose windows are chosen by what comes later."""
    return [
        (name, cost) for name, cost in costs.items() if not name.endswith(CHOSEN_LATER)
    ]


def _cost(
    name: str, cost: Mapping[str, Any] | None, scale: float, form: str
) -> list[str]:
    if cost is None:
        return [name, "no matched ones", *[""] * 6]
    scale = 1.0 if name.startswith(LOST) else scale
    values = [format(scale * cost[key], form) for key in ("with", "without")]
    ends = scale * cost["low"], scale * cost["high"]
    numbers = [str(cost[key]) for key in ("exposed", "others", "scenes")]
    return [
        name,
        *values,
        _cell(scale * cost["difference"], ends, "+" + form),
        format(scale * cost["seen"], form),
        *numbers,
    ]


def _cell(value: float | None, interval: _Interval, form: str = ".3f") -> str:
    if value is None:
        return ""
    return format(value, form) + (
        "" if interval is None else f" [{interval[0]:{form}}, {interval[1]:{form}}]"
    )
