"""Write the tables of RESULTS.md and README.md anew from the records of the leaderboard.

    python -m docs.generate.results

The tables of a page stand between ``<!-- table: NAME -->`` and ``<!-- /table -->``. The names are ``env ID``, a row per
entry of an environment, ``story ID``, ten of them in words,
``SUBSET of AGENT AGENT ...``, bADE of these agents with a row per environment, ``costs``, those of detection and
tracking together and of association alone, and ``faults`` and ``parts``, shares of bADE by part of the stack and by
cause. The last two are made from ``leaderboard/error_parts.json``, which ``benchmarks/error_parts.py`` writes.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from mtp_bench.commands.board import read_board
from mtp_bench.errors import MtpBenchError, RecordError, UnknownNameError
from mtp_bench.files import write_text
from mtp_bench.parallel import NO_PROGRESS
from mtp_bench.records import trusted
from mtp_bench.scoring.definitions import SUBSETS, Subset
from mtp_bench.scoring.parts import FAULT_NAMES, PARTS, by_fault
from mtp_bench.scoring.rank import rank_text
from mtp_bench.tables import Column, Table, Value, to_markdown
from mtp_bench.viz.board.columns import COLUMN, PAGE
from mtp_bench.viz.board.entries import Entry, by_board
from mtp_bench.viz.board.tables import earlier_text

ROOT = Path(__file__).resolve().parents[2]
PAGES = (ROOT / "leaderboard" / "RESULTS.md", ROOT / "README.md")
PARTS_FILE = ROOT / "leaderboard" / "error_parts.json"
_BEGIN, _END = "<!-- table: ", "<!-- /table -->"
_BLOCK = re.compile(rf"^{_BEGIN}(?P<name>[^\n]*) -->\n(?:(?!^{_BEGIN}).)*?^{_END}$", flags=re.DOTALL | re.MULTILINE)


_INTERVALS = {"error": "interval", "difference": "difference_interval"}  # key of a column -> that of its intervals
_TRACKLETS = "network, of a tracker's tracks"
STORY = {  # agent -> its association and its predictor, in the order of the README
    "truth_past": "ground-truth tracks; constant velocity",
    "perfect_association_same_samples": "perfect association, 20 k draws; constant velocity",
    "stp": "one hypothesis; constant velocity",
    "stp_same_budget": "one hypothesis, 20 k draws; constant velocity",
    "mtp": "20 hypotheses, 20 k draws; constant velocity",
    "stp_modes": "one hypothesis; network, of ground-truth tracks",
    "stp_modes_tracklets": f"one hypothesis; {_TRACKLETS}",
    "mtp_modes_tracklets": f"20 hypotheses; {_TRACKLETS}",
    "affinity": "soft association; network",
    "tracking_free": "no association; network, of detections nearby",
}


def filled(text: str, entries: Sequence[Entry], where: str) -> str:
    """``text`` with its tables made anew; ``where``: name of the page, for errors."""
    count = sum(1 for _ in _BLOCK.finditer(text))
    begun, ended = (sum(line.startswith(mark) for line in text.splitlines()) for mark in (_BEGIN, _END))
    if not count == begun == ended:
        raise MtpBenchError(
            f"{where}: {begun} lines `{_BEGIN}NAME -->` and {ended} lines `{_END}`, expected them in pairs"
        )
    if not count:
        raise MtpBenchError(f"{where}: no table to fill in; mark one by lines `{_BEGIN}NAME -->` and `{_END}`")

    def block(match: re.Match[str]) -> str:
        table = _table(match["name"], entries, where)
        return f"{_BEGIN}{match['name']} -->\n\n{to_markdown(table)}\n{_END}"

    return _BLOCK.sub(block, text)


def _table(name: str, entries: Sequence[Entry], where: str) -> Table:
    first, *further = name.split()
    if first == "env" and len(further) == 1:
        return env_table(further[0], entries)
    if first == "story" and len(further) == 1:
        return story_table(further[0], entries)
    if name == "costs":
        return costs_table(entries)
    if name in ("faults", "parts"):
        return parts_table(name, json.loads(PARTS_FILE.read_text(encoding="utf-8")))
    if first in SUBSETS and further[:1] == ["of"] and further[1:]:
        return across_table(next(subset for subset in SUBSETS if subset == first), further[1:], entries)
    names = "`env ID`, `story ID`, `SUBSET of AGENT ...`, `costs`, `faults`, `parts`"
    raise MtpBenchError(f"{where}: table {name!r}, expected {names}")


def env_table(env_id: str, entries: Sequence[Entry]) -> Table:
    """A row per entry of an environment; those of earlier definitions if there are no others."""
    listed = next((each for each in by_board(entries).values() if each[0].env == env_id), None)
    if listed is None:
        raise UnknownNameError("environment", env_id, sorted({entry.env for entry in entries}))
    names = [
        Column(f"agent{earlier_text(listed[0])}", key="agent", read=lambda entry: f"`{entry.name}`"),
        Column("rank", key="rank", read=lambda entry: entry.rank),
    ]
    keys = [key for page_key in (*PAGE, "association_gap") for key in (page_key, _INTERVALS.get(page_key, "")) if key]
    return Table(env_id, env_id, "", listed, [*names, *(replace(COLUMN[key], optional=True) for key in keys)])


def story_table(env_id: str, entries: Sequence[Entry]) -> Table:
    """A row for each agent of `STORY`: association and predictor in words, bADE and ranks on all targets and ids."""
    listed = next((each for each in by_board(entries).values() if each[0].env == env_id), [])
    known = {entry.name: entry for entry in listed}
    for name in STORY:
        if name not in known:
            raise UnknownNameError(f"agent of {env_id}", name, sorted(known))
    columns = [
        Column("agent", key="agent", read=lambda entry: f"`{entry.name}`"),
        *_ranked("all", "all targets"),
        *_ranked("ids", "identity switch"),
        Column("association; predictor", key="parts", read=lambda entry: STORY[entry.name]),
    ]
    return Table("story", env_id, "", [known[name] for name in STORY], columns)


def _ranked(subset: Subset, heading: str) -> list[Column]:
    """Columns of bADE on a subset: value, interval and rank."""

    def rank(entry: Entry) -> Value:
        place = entry.standing.places[subset]
        return rank_text(place.place, place.span)

    return [
        Column(heading, "m", "lower", ".2f", key=subset, read=lambda entry: entry.row_of(subset).error),
        Column(interval=True, format=".2f", key=f"{subset}_interval", read=lambda e: e.row_of(subset).interval),
        Column("rank (range)", key=f"{subset}_rank", read=rank),
    ]


def across_table(subset: Subset, agents: Sequence[str], entries: Sequence[Entry]) -> Table:
    """Values of bADE of agents on one subset: a row per environment in which all of them have a record."""
    names = sorted({entry.name for entry in entries})
    for agent in agents:
        if agent not in names:
            raise UnknownNameError("agent", agent, names)
    rows = _by_name(agents, entries)
    columns = [Column("environment", key="env", read=lambda row: row[agents[0]].env + earlier_text(row[agents[0]]))]
    for agent in agents:
        columns.append(Column(f"`{agent}`", "m", "lower", key=agent, read=_value(subset, agent, "error")))
        columns.append(Column(interval=True, key=f"{agent}_interval", read=_value(subset, agent, "interval")))
    for what in ("objects", "units"):
        read = _value(subset, agents[0], f"effective_{what}")
        columns.append(Column(f"effective {what}", format=".1f", key=what, read=read))
    return Table(subset, f"bADE on {subset}", "", rows, columns)


def costs_table(entries: Sequence[Entry]) -> Table:
    """Costs of detection and tracking together, and of association alone: a row per environment and ranked subset."""
    both, alone = ("stp", "truth_past"), ("stp_same_budget", "perfect_association_same_samples")
    subsets: tuple[Subset, ...] = ("all", "ids", "reacquired")
    rows = [(subset, known) for known in _by_name((*both, *alone), entries) for subset in subsets]
    columns = [
        Column("environment", key="env", read=lambda row: row[1]["stp"].env + earlier_text(row[1]["stp"])),
        Column("subset", key="subset", read=lambda row: row[0]),
    ]
    for heading, (worse, better) in (("detection and tracking together", both), ("of which association", alone)):
        columns += [
            Column(heading, "m", key=better, format="+.3f", read=_cost(worse, better, "mean")),
            Column(interval=True, key=f"{better}_interval", read=_cost(worse, better, "interval")),
        ]
    return Table("costs", "Costs of detection and tracking", "", rows, columns)


def parts_table(name: str, rows: Sequence[dict[str, Any]]) -> Table:
    """Shares of bADE over all targets, which add up to 1: a row per environment and agent of `PARTS_FILE`.

    ``name``: "faults" are by part of the stack, "parts" by cause.
    """

    def of_stack(who: str) -> Callable[[dict[str, Any]], Value]:
        return lambda row: by_fault({PARTS[key]: part for key, part in row["parts"].items()})[who] / row["error"]

    def of_cause(key: str) -> Callable[[dict[str, Any]], Value]:
        return lambda row: row["parts"][key] / row["error"]

    names, share = (FAULT_NAMES, of_stack) if name == "faults" else (PARTS, of_cause)
    columns = [
        Column("environment", key="env"),
        Column("agent", key="agent", read=lambda row: f"`{row['agent']}`"),
        Column("scenes; seeds", key="runs", read=lambda row: f"{row['scenes']}; {row['seeds']}"),
        Column("bADE", "m", "lower", key="error"),
    ]
    columns += [Column(heading, format=".1%", key=key, read=share(key)) for key, heading in names.items()]
    return Table(name, "Parts of bADE", "", rows, columns)


def _cost(worse: str, better: str, what: str) -> Callable[[tuple[Subset, dict[str, Entry]]], Value]:
    """A field of the difference between two agents; None where there is no target, or the data differ."""

    def read(row: tuple[Subset, dict[str, Entry]]) -> Value:
        one, other = row[1][worse], row[1][better]
        alike = one.conditions == other.conditions
        return getattr(one.minus(other, row[0]) if alike else None, what, None)

    return read


def _by_name(agents: Sequence[str], entries: Sequence[Entry]) -> list[dict[str, Entry]]:
    """Entries by name, for each environment in which all of the agents have one; earlier ones without others."""
    rows: dict[str, dict[str, Entry]] = {}
    for listed in by_board(entries).values():
        known = {entry.name: entry for entry in reversed(listed)}
        if all(agent in known for agent in agents):
            rows.setdefault(listed[0].env, known)
    return list(rows.values())


def _value(subset: Subset, agent: str, name: str) -> Callable[[dict[str, Entry]], Value]:
    return lambda row: getattr(row[agent].row_of(subset), name)


def main() -> None:
    """Fill in the pages; a record that is broken stops it, as a page would lose its row."""
    entries, refused, _ = read_board(None, (), None, None, trusted(None), NO_PROGRESS)
    if refused:
        raise RecordError(f"{len(refused)} records refused: {refused[0]}")
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        new = filled(text, entries, page.name)
        write_text(page, new)
        print(f"{page.name}: {'unchanged' if new == text else 'tables written anew'}")


if __name__ == "__main__":
    main()
