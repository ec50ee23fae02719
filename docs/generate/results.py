"""Write the tables of RESULTS.md and README.md anew from the records of the leaderboard.

    python -m docs.generate.results

The tables of a page stand between ``<!-- table: NAME -->`` and ``<!-- /table -->``. The names are:

- ``story ENV with ENV``: ten agents of an environment, in words, and their Brier score on another one.
- ``pairs ENV,ENV of A-B,A-B``: paired differences of bADE; ``*`` stands for all environments that have both agents.
- ``costs ENV,ENV``: those of detection and tracking together, and of association alone; ``*`` as above.
- ``agreement ENV with ENV,ENV``: Kendall's tau of the order of agents with that of other environments.
- ``faults``: shares of bADE by part of the stack, of ``leaderboard/error_parts.json`` (``benchmarks/error_parts.py``).
- ``driving``: drive scores and their agreement with bADE, of ``leaderboard/driving.json`` (``benchmarks/driving.py``).
- ``paper``: relations between agents in the paper's tables, and on the leaderboard.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from docs.generate.agreement import agreement_table
from docs.generate.driving import FIGURES
from docs.generate.paper import paper_table
from mtp_bench.commands.board import read_board
from mtp_bench.core import Column, Table, Value, to_markdown
from mtp_bench.core.errors import MtpBenchError, RecordError, UnknownNameError
from mtp_bench.core.files import write_text
from mtp_bench.core.notice import NO_PROGRESS
from mtp_bench.judge import trusted
from mtp_bench.judge.records.shipped import earlier_cards
from mtp_bench.scoring.definitions import Subset
from mtp_bench.scoring.parts import PART_NAMES, STAGE_NAMES, by_fault
from mtp_bench.viz.board.entries import Entry, by_board
from mtp_bench.viz.board.lines import short_name

ROOT = Path(__file__).resolve().parents[2]
PAGES = (ROOT / "leaderboard" / "RESULTS.md", ROOT / "README.md")
PARTS_FILE = ROOT / "leaderboard" / "error_parts.json"
_BEGIN, _END = "<!-- table: ", "<!-- /table -->"
_BLOCK = re.compile(
    rf"^{_BEGIN}(?P<name>[^\n]*) -->\n(?:(?!^{_BEGIN}).)*?^{_END}$",
    flags=re.DOTALL | re.MULTILINE,
)


SUBSET_TEXT: dict[Subset, str] = {
    "all": "all targets",
    "ids": "identity switch",
    "reacquired": "reacquired",
}
_TRACKLETS = "network, of a tracker's tracks"
STORY = {  # agent -> its association and its predictor, in the order of the README
    "gt_tracks": "ground-truth tracks; constant velocity",
    "perfect_association_same_samples": "perfect association, 20 × k draws; constant velocity",
    "stp": "one hypothesis; constant velocity",
    "stp_same_samples": "one hypothesis, 20 × k draws; constant velocity",
    "mtp": "20 hypotheses, 20 × k draws; constant velocity",
    "stp_modes": "one hypothesis; network, of ground-truth tracks",
    "stp_modes_tracklets": f"one hypothesis; {_TRACKLETS}",
    "mtp_modes_tracklets": f"20 hypotheses; {_TRACKLETS}",
    "affinity": "soft association; network",
    "tracking_free": "no association; network, of detections nearby",
}


DRIVERS = ("gt_tracks", "stp", "stp_same_samples", "mtp", "tracking_free")


def filled(text: str, entries: Sequence[Entry], where: str) -> str:
    """``text`` with its tables made anew; ``where``: name of the page, for errors."""
    count = sum(1 for _ in _BLOCK.finditer(text))
    begun, ended = (
        sum(line.startswith(mark) for line in text.splitlines())
        for mark in (_BEGIN, _END)
    )
    if not count == begun == ended:
        raise MtpBenchError(
            f"{where}: {begun} lines `{_BEGIN}NAME -->` and {ended} lines `{_END}`, expected them in pairs"
        )
    if not count:
        raise MtpBenchError(
            f"{where}: no table to fill in; mark one by lines `{_BEGIN}NAME -->` and `{_END}`"
        )

    def block(match: re.Match[str]) -> str:
        table = _table(match["name"], entries, where)
        return f"{_BEGIN}{match['name']} -->\n\n{to_markdown(table)}\n{_END}"

    return _BLOCK.sub(block, text)


def _table(name: str, entries: Sequence[Entry], where: str) -> Table:
    first, *further = name.split()
    if first == "story" and further[1:2] == ["with"] and len(further) == 3:
        return story_table(further[0], further[2], entries)
    if first == "pairs" and further[1:2] == ["of"] and len(further) == 3:
        return pairs_table(
            further[0].split(","),
            [pair.split("-") for pair in further[2].split(",")],
            entries,
        )
    if first == "costs" and len(further) == 1:
        return costs_table(further[0].split(","), entries)
    if first == "agreement" and further[1:2] == ["with"] and len(further) == 3:
        return agreement_table(further[0], further[2].split(","), entries, SUBSET_TEXT)
    if name == "faults":
        return faults_table(json.loads(PARTS_FILE.read_text(encoding="utf-8")))
    if name == "driving":
        return driving_table(json.loads(FIGURES.read_text(encoding="utf-8")))
    if name == "paper":
        return paper_table(entries)
    names = "`story ENV with ENV`, `pairs ENV,ENV of A-B,A-B`, `costs ENV,ENV`, `agreement ENV with ENV,ENV`"
    raise MtpBenchError(
        f"{where}: table {name!r}, expected {names}, `faults`, `driving`, `paper`"
    )


def story_table(env_id: str, complete_env: str, entries: Sequence[Entry]) -> Table:
    """A row for each agent of `STORY`: bADE on all targets and ids, ranks, energy score, Brier score, parts in words.

    ``complete_env``: an environment whose truth is complete, for the Brier score, which needs false forecasts.
    """
    known = _of_env(env_id, entries)
    complete = _of_env(complete_env, entries)
    columns = [
        Column("agent", key="agent", read=lambda entry: f"`{entry.name}`"),
        *_error("all", "all targets"),
        Column("place (range)", key="all_rank", read=_rank),
        *_error("ids", "identity switch"),
        Column(
            "energy score",
            "m",
            "lower",
            ".2f",
            key="energy_score",
            read=lambda entry: entry.row.energy_score,
        ),
        Column(
            f"Brier score, {short_name(complete_env).removeprefix('nuScenes ')}",
            better="lower",
            format=".3f",
            key="brier",
            read=lambda entry: complete[entry.name].record.brier,
        ),
        Column(
            "association; predictor", key="parts", read=lambda entry: STORY[entry.name]
        ),
    ]
    return Table("story", env_id, "", [known[name] for name in STORY], columns)


def _of_env(env_id: str, entries: Sequence[Entry]) -> dict[str, Entry]:
    """Entries of an environment by name; raises UnknownNameError unless all agents of `STORY` are there."""
    listed = next(
        (each for each in by_board(entries).values() if each[0].env == env_id), []
    )
    known = {entry.name: entry for entry in listed}
    for name in STORY:
        if name not in known:
            raise UnknownNameError(f"agent of {env_id}", name, sorted(known))
    return known


def _error(subset: Subset, heading: str) -> list[Column]:
    """Columns of bADE on a subset: value and interval."""
    return [
        Column(
            heading,
            "m",
            "lower",
            ".2f",
            key=subset,
            read=lambda entry: entry.row_of(subset).error,
        ),
        Column(
            interval=True,
            format=".2f",
            key=f"{subset}_interval",
            read=lambda e: e.row_of(subset).interval,
        ),
    ]


def _rank(entry: Entry) -> Value:
    return entry.standing.places["all"].rank


def pairs_table(
    envs: Sequence[str], pairs: Sequence[Sequence[str]], entries: Sequence[Entry]
) -> Table:
    """Paired differences of bADE: a row per environment and pair; ``envs``: ["*"] are all that have records of both."""
    names = sorted({entry.name for entry in entries})
    for agent in (agent for pair in pairs for agent in pair):
        if agent not in names:
            raise UnknownNameError("agent", agent, names)
    rows = [
        (known[one], known[other])
        for one, other in pairs
        for known in _by_name((one, other), envs, entries)
    ]
    columns = [
        Column("environment", key="env", read=lambda row: row[0].env),
        Column(
            "difference",
            key="pair",
            read=lambda row: f"`{row[0].name}` − `{row[1].name}`",
        ),
    ]
    for subset, heading in SUBSET_TEXT.items():
        columns += _difference(heading, partial(_with_subset, subset))
    return Table(
        "pairs",
        "Differences of bADE",
        "",
        rows,
        columns if len(pairs) > 1 else [columns[0], *columns[2:]],
    )


def costs_table(envs: Sequence[str], entries: Sequence[Entry]) -> Table:
    """Costs of detection and tracking together, and of association alone by ranked subset: a row per environment."""
    both, alone = (
        ("stp", "gt_tracks"),
        ("stp_same_samples", "perfect_association_same_samples"),
    )
    columns = [Column("environment", key="env", read=lambda row: row["stp"].env)]
    columns += _difference("together, all targets", partial(_of_agents, *both, "all"))
    for subset, words in SUBSET_TEXT.items():
        columns += _difference(
            f"association alone, {words}", partial(_of_agents, *alone, subset)
        )
    rows = _by_name((*both, *alone), envs, entries)
    return Table("costs", "Costs of detection and tracking", "", rows, columns)


def _with_subset(
    subset: Subset, row: tuple[Entry, Entry]
) -> tuple[Entry, Entry, Subset]:
    return (*row, subset)


def _of_agents(
    one: str, other: str, subset: Subset, row: Mapping[str, Entry]
) -> tuple[Entry, Entry, Subset]:
    return row[one], row[other], subset


def _difference(
    heading: str, of: Callable[[Any], tuple[Entry, Entry, Subset]]
) -> list[Column]:
    """Columns of bADE of one entry minus another's; empty where there is no target, or the data differ."""

    def field(name: str) -> Callable[[Any], Value]:
        def read(row: Any) -> Value:
            one, other, subset = of(row)
            return (
                getattr(one.minus(other, subset), name, None)
                if one.conditions == other.conditions
                else None
            )

        return read

    return [
        Column(heading, "m", key=heading, format="+.3f", read=field("mean")),
        Column(
            interval=True,
            key=f"{heading}_interval",
            format="+.3f",
            read=field("interval"),
        ),
    ]


def faults_table(rows: Sequence[dict[str, Any]]) -> Table:
    """Shares of bADE by part of the stack, which add up to 1: a row per environment and agent of `PARTS_FILE`."""

    def share(part: str) -> Callable[[dict[str, Any]], Value]:
        return lambda row: (
            by_fault({PART_NAMES[key]: value for key, value in row["parts"].items()})[
                part
            ]
            / row["error"]
        )

    columns = [
        Column("environment", key="env"),
        Column("agent", key="agent", read=lambda row: f"`{row['agent']}`"),
        Column(
            "scenes; seeds",
            key="runs",
            read=lambda row: f"{row['scenes']}; {row['seeds']}",
        ),
        Column("bADE", "m", "lower", key="error"),
    ]
    columns += [
        Column(heading, format=".1%", key=key, read=share(key))
        for key, heading in STAGE_NAMES.items()
    ]
    return Table("faults", "Parts of bADE", "", rows, columns)


def driving_table(figures: Mapping[str, Any]) -> Table:
    """Drive scores of `DRIVERS`, and Kendall's tau of driving better with less bADE: a row per closed loop."""
    columns = [
        Column("environment", key="env"),
        Column(
            "measured with",
            key="planner",
            read=lambda row: earlier_cards().get(row["card"], "today's planner"),
        ),
    ]
    for agent in DRIVERS:
        columns += [
            Column(
                f"`{agent}`",
                better="higher",
                key=agent,
                format=".2f",
                read=_of_driver(agent, "drive_score"),
            ),
            Column(
                interval=True,
                key=f"{agent}_interval",
                format=".2f",
                read=_of_driver(agent, "interval"),
            ),
        ]

    def tau(row: Mapping[str, Any]) -> dict[str, float]:
        measure: dict[str, float] = row["tau"]["all"]["measures"]["bADE"]
        return measure

    columns += [
        Column(
            "tau with bADE", key="tau", format=".2f", read=lambda row: tau(row)["tau"]
        ),
        Column(
            interval=True,
            key="tau_interval",
            format=".2f",
            read=lambda row: (tau(row)["low"], tau(row)["high"]),
        ),
        Column("agents", key="agents", read=lambda row: row["tau"]["all"]["agents"]),
    ]
    return Table("driving", "Driving", "", list(figures.values()), columns)


def _of_driver(agent: str, key: str) -> Callable[[Mapping[str, Any]], Value]:
    def read(row: Mapping[str, Any]) -> Value:
        value = row["rows"][agent][key]
        return tuple(value) if isinstance(value, list) else value

    return read


def _by_name(
    agents: Sequence[str], envs: Sequence[str], entries: Sequence[Entry]
) -> list[dict[str, Entry]]:
    """Entries by name, for each of the environments that has all of the agents."""
    rows: dict[str, dict[str, Entry]] = {}
    for listed in by_board(entries).values():
        known = {entry.name: entry for entry in reversed(listed)}
        if all(agent in known for agent in agents):
            rows.setdefault(listed[0].env, known)
    if missing := {*envs} - {"*"} - {*rows}:
        raise UnknownNameError("environment", min(missing), sorted(rows))
    return [rows[env] for env in rows if env in envs or envs == ["*"]]


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
