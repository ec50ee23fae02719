"""Write the tables and the picture of "Whether honesty pays" anew from `leaderboard/driving_honesty.json`.

    python -m docs.generate.honesty [PART FIGURES.json ...]

PART says where the figures of `benchmarks/driving_honesty.py --json` belong, such as ``gains/MTP-Drive-Merge-v0/scan``,
``apart/MTP-Drive-Merge-v0`` or ``chances/planner of 3.0/MTP-Drive-Merge-v0``; the file then takes their place.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mtp_bench.core.files import write_text

from .blocks import filled_blocks, table
from .driving import PAGE, ROOT, rounded
from .svg import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    LIGHT,
    VERMILLION,
    Point,
    circle,
    drawing,
    line,
    text,
)

FIGURES = ROOT / "leaderboard" / "driving_honesty.json"
PICTURE = ROOT / "docs" / "environment" / "honesty.svg"
COLORS = {"gt_tracks": BLACK, "tracking_free": GREEN, "mtp": BLUE, "stp": VERMILLION}
SCALES = (0.25, 0.5, 0.75, 1.0, 1.5, 2.0)
WIDTH, HEIGHT, LEFT = 330.0, 220.0, 60.0  # px of a panel
LOW, HIGH = 0.5, 1.0  # drive scores
NONE = "Not measured yet."


def filled(page: str, figures: Mapping[str, Any]) -> str:
    """``page`` with its tables made anew."""

    def content(name: str) -> str:
        table_name, _, env = name.partition(" ")
        return TABLES[table_name](figures, env) or NONE

    return filled_blocks(page, "honesty", content)


def chances(figures: Mapping[str, Any], env: str) -> str:
    """Return expected and true contacts by class of motion, of both planners; ``env``: empty for all at 2 Hz."""
    rows = []
    for planner, envs in figures.get("chances", {}).items():
        chosen = [
            each
            for name, each in envs.items()
            if name == env or (not env and "10Hz" not in name)
        ]
        for agent in chosen[0] if chosen else ():
            cells = []
            for kind in chosen[0][agent]:
                expected, true = np.sum(
                    [each[agent][kind] for each in chosen if agent in each], axis=0
                )
                share = f" ({expected / true:.2f})" if true >= 10 else ""
                cells.append(f"{expected:.0f} : {true:.0f}{share}")
            rows.append([planner, agent if " " in agent else f"`{agent}`", *cells])
        heads = ["planner", "forecasts", *chosen[0][agent]] if chosen else []
    return table(heads, rows) if rows else ""


def scan(figures: Mapping[str, Any], env: str) -> str:
    """Gains of all changes of an environment: a row per change, a column per agent."""
    rows = figures.get("gains", {}).get(env, {}).get("scan", {})
    agents = [agent for agent in COLORS if agent in rows]
    changes = dict.fromkeys(name.partition(": ")[2] for name in rows if ": " in name)
    lines = [
        ["as it is, drive score", *(f"{rows[agent]['score']:.3f}" for agent in agents)]
    ]
    lines += [
        [change, *(_gain(rows.get(f"{agent}: {change}")) for agent in agents)]
        for change in changes
    ]
    return table(["", *(f"`{agent}`" for agent in agents)], lines) if agents else ""


def fresh(figures: Mapping[str, Any], env: str) -> str:
    """The largest gains again, on scenes that had no part in their choice."""
    heads = [
        "agent and change",
        "gain in the scan",
        "gain in fresh scenes",
        "p",
        "p by Holm",
        "at fault /100",
        "scenes",
    ]
    lines = []
    parts = figures.get("gains", {}).get(env, {})
    for name, row in parts.get("fresh", {}).items():
        if "gain" in row:
            p = [f"{row[key]:.3f}" for key in ("p", "p by Holm")]
            lines.append(
                [
                    name,
                    _gain(parts["scan"].get(name)),
                    _gain(row),
                    *p,
                    f"{row['at fault']:.1f}",
                    str(row["scenes"]),
                ]
            )
    return table(heads, lines) if lines else ""


def attacks(figures: Mapping[str, Any], env: str) -> str:
    """Attacks on an environment, the one that gains most first."""
    rows = figures.get("gains", {}).get(env, {}).get("attacks", {})
    listed = sorted(
        (row for row in rows.items() if "gain" in row[1]),
        key=lambda row: -row[1]["gain"],
    )
    heads = [
        "agent",
        "drive score",
        "to stp",
        "p",
        "at fault /100",
        "phantom brakes /100",
    ]
    lines = []
    for name, row in [("stp", rows.get("stp")), *listed] if rows else ():
        gain = [_gain(row), f"{row['p']:.3f}"] if "gain" in row else ["", ""]
        lines.append(
            [
                name,
                f"{row['score']:.3f}",
                *gain,
                f"{row['at fault']:.1f}",
                f"{row['phantom brakes']:.0f}",
            ]
        )
    return table(heads, lines) if lines else ""


def apart(figures: Mapping[str, Any], env: str) -> str:
    """Agents that must differ, each less the one above it."""
    lines = []
    for name, row in figures.get("apart", {}).get(env, {}).items():
        gain = [_gain(row), f"{row['p by Holm']:.4f}"] if "gain" in row else ["", ""]
        score = f"{row['score']:.3f}"
        scenes = str(row["scenes"])
        lines.append([f"`{name}`", score, *gain, f"{row['at fault']:.1f}", scenes])
    heads = ["agent", "drive score", "more than above", "p by Holm", "at fault /100"]
    heads.append("scenes of both")
    return table(heads, lines) if lines else ""


def _gain(row: Mapping[str, Any] | None) -> str:
    if row is None or "gain" not in row:
        return "–"
    low, high = row["interval"] or (row["gain"], row["gain"])
    return f"{row['gain']:+.3f} [{low:+.3f}, {high:+.3f}]"


TABLES: dict[str, Callable[[Mapping[str, Any], str], str]] = {
    "chances": chances, "scan": scan, "fresh": fresh, "attacks": attacks, "apart": apart,
}  # fmt: skip


def curve(figures: Mapping[str, Any]) -> str:
    """Drive score over the scale of the confidence: a panel per environment, a line per agent."""
    panels = {
        env: parts["scan"]
        for env, parts in figures.get("gains", {}).items()
        if "scan" in parts
    }
    lines: list[str] = []
    for place, (env, rows) in enumerate(panels.items()):
        left = LEFT + place * (WIDTH + LEFT)

        def at(scale: float, score: float, left: float = left) -> Point:
            return left + WIDTH * (
                0.08 + 0.84 * np.log2(4 * scale) / 3
            ), 50 + HEIGHT * (HIGH - score) / (HIGH - LOW)

        lines.append(
            text(
                (left, 28),
                env.removeprefix("MTP-Drive-").removesuffix("-v0"),
                bold=True,
            )
        )
        for score in np.arange(LOW, HIGH + 0.01, 0.1):
            y = at(1.0, score)[1]
            lines += [
                line([(left, y), (left + WIDTH, y)], LIGHT, 1),
                text((left - 8, y + 5), f"{score:.1f}", GREY, "end"),
            ]
        lines += [
            text((at(scale, LOW)[0], 50 + HEIGHT + 20), f"{scale:g}", GREY, "middle")
            for scale in SCALES
        ]
        for shift, agent in enumerate(name for name in COLORS if name in rows):
            lines += _agent_lines(rows, agent, COLORS[agent], 3.0 * shift - 4.5, at)
    for place, (agent, color) in enumerate(COLORS.items()):
        lines.append(
            text((LEFT + 150.0 * place, 50 + HEIGHT + 66), agent, color, bold=True)
        )
    lines.append(
        text(
            (LEFT, 50 + HEIGHT + 42),
            "scale of the stated confidence; bars: 95 % of the difference to scale 1",
            GREY,
        )
    )
    return drawing(LEFT + len(panels) * (WIDTH + LEFT), 50 + HEIGHT + 80, lines)


def _agent_lines(
    rows: Mapping[str, Any],
    agent: str,
    color: str,
    shift: float,
    at: Callable[[float, float], Point],
) -> list[str]:
    score = rows[agent]["score"]
    points, lines = [], []
    for scale in SCALES:
        row = rows.get(
            f"{agent}: scale {scale:g}", rows[agent] if scale == 1.0 else None
        )
        if row is None:
            continue
        x, y = at(scale, row["score"])
        points.append((x + shift, y))
        lines.append(circle((x + shift, y), 4, color))
        if row.get("interval"):
            ends = [(x + shift, at(scale, score + end)[1]) for end in row["interval"]]
            lines.append(line(ends, color, 1.5))
    return [line(points, color), *lines]


def main(words: Sequence[str]) -> None:
    """Take in the figures of the files, and fill in the page."""
    figures = (
        json.loads(FIGURES.read_text(encoding="utf-8")) if FIGURES.is_file() else {}
    )
    for part, path in zip(words[::2], words[1::2], strict=True):
        *above, last = part.split("/")
        place = figures
        for key in above:
            place = place.setdefault(key, {})
        place[last] = rounded(json.loads(Path(path).read_text(encoding="utf-8")))
    if words:
        write_text(FIGURES, json.dumps(figures, indent=1) + "\n")
    write_text(PAGE, filled(PAGE.read_text(encoding="utf-8"), figures))
    write_text(PICTURE, curve(figures))


if __name__ == "__main__":
    main(sys.argv[1:])
